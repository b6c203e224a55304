"""Cell loads: how the four upright and the two lateral load cells share what the platform carries.

Off the middle lengthwise, a seat or a load brings a moment about the axis across. Of four supports one that gives way,
or that does not lie in the plane of the others, leaves its load to its neighbours: no sum of cells tells that.
"""

from collections.abc import Mapping
from typing import Any, Final

from bench_sim.model.effects.effect import PLACES, Effect, EffectParameter, springs

_STATICS: Final = "balance of forces and moments on the platform"


def _change_seat(par: Any, place: int | None, values: Mapping[str, float]) -> None:
    par.seat_ahead[springs(place)] += values["ahead"]


def _change_load(par: Any, place: int | None, values: Mapping[str, float]) -> None:
    par.load_ahead += values["ahead"]


def _change_support(par: Any, place: int | None, values: Mapping[str, float]) -> None:
    assert place is not None
    par.support_softness[place] += values["softer"]


def _change_twist(par: Any, place: int | None, values: Mapping[str, float]) -> None:
    par.platform_twist += values["force"]


EFFECTS: Final = (
    Effect(
        name="seat_offset",
        family="rig",
        title="seat of a spring off the middle, lengthwise",
        plain="the seat of the {side} spring stands off the middle, lengthwise",
        amplitude=EffectParameter(
            "ahead", "m", "mm", 1e-3, nominal=0.0, typical=10e-3, low=-50e-3, high=50e-3
        ),
        change=_change_seat,
        places=PLACES,
        touches=frozenset({"sensor"}),
        confusers=("load_offset",),
        equation="Σ x_k F_k = x_s F_z,  l_x (F_5 − F_6) = x_s F_y",
        source=_STATICS,
        separated_by="roll, in which one spring carries more and the other less; shear, which only a seat turns",
    ),
    Effect(
        name="load_offset",
        family="rig",
        title="vertical actuators off the middle, lengthwise",
        plain="the vertical actuators press off the middle, lengthwise",
        amplitude=EffectParameter(
            "ahead", "m", "mm", 1e-3, nominal=0.0, typical=10e-3, low=-50e-3, high=50e-3
        ),
        change=_change_load,
        touches=frozenset({"sensor"}),
        confusers=("seat_offset",),
        equation="Σ x_k F_k = x_l (F_a,L + F_a,R)",
        source=f"{_STATICS}; a bolster that does not pitch",
        separated_by="shear: the lateral cells stay equal, as they do not with a seat off the middle",
    ),
    Effect(
        name="soft_support",
        family="rig",
        title="soft support of a load cell",
        plain="the support of load cell {side} is softer than the others",
        amplitude=EffectParameter("softer", "1", "%", 0.01, nominal=0.0, typical=0.2, low=0.0, high=10.0),
        change=_change_support,
        places=("1", "2", "3", "4"),
        touches=frozenset({"sensor"}),
        confusers=("twisted_seat",),
        equation="a = −±_k δ F_k / (4 + δ) on cells 1 and 4, −a on 2 and 3",
        source="least energy of a rigid platform on four elastic supports, of which one is 1 + δ times as compliant",
        separated_by="loads that differ from corner to corner, as in roll or shear; for the twist, two load cases",
    ),
    Effect(
        name="twisted_seat",
        family="rig",
        title="twisted seat of the platform",
        plain="the seat of the platform on its four supports is twisted",
        amplitude=EffectParameter("force", "N", "N", 1.0, nominal=0.0, typical=1000.0, low=-2e4, high=2e4),
        change=_change_twist,
        touches=frozenset({"sensor"}),
        confusers=("soft_support", "force_offset"),
        equation="a = +w on cells 1 and 4, −w on 2 and 3; supports of stiffness k out of plane by s: w = k s / 4",
        source=f"{_STATICS}; a rigid platform that is bolted down",
        separated_by="two load cases: a twist does not grow with the load",
    ),
)
