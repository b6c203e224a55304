"""Sensor offset: what one spring is measured with is off zero, s_m = s + b.

Of forces these are the two load cells under a spring, with half of the offset each, or one load cell alone.
"""

from collections.abc import Mapping
from typing import Any, Final

from bench_sim.model.effects.channels import BELLOWS_BY_SIDE, CELLS, CELLS_BY_SIDE
from bench_sim.model.effects.effect import PLACES, Effect, EffectParameter


def _change_forces(par: Any, place: int | None, values: Mapping[str, float]) -> None:
    assert place is not None
    par.sensor_bias[CELLS_BY_SIDE[place]] += 0.5 * values["offset"]


def _change_cell(par: Any, place: int | None, values: Mapping[str, float]) -> None:
    assert place is not None
    par.sensor_bias[CELLS[place]] += values["offset"]


def _change_pressures(par: Any, place: int | None, values: Mapping[str, float]) -> None:
    assert place is not None
    par.sensor_bias[BELLOWS_BY_SIDE[place]] += values["offset"]


EFFECTS: Final = (
    Effect(
        name="force_offset",
        family="sensor",
        title="zero error of the load cells under one spring",
        plain="the load cells under the {side} spring have a zero error",
        amplitude=EffectParameter("offset", "N", "N", 1.0, nominal=0.0, typical=1000.0, low=-2e4, high=2e4),
        change=_change_forces,
        places=PLACES,
        touches=frozenset({"sensor"}),
        confusers=("pressure_offset",),
        equation="F_m = F + b",
        source="zero of a strain-gauge bridge, tare not taken",
        separated_by="the empty, vented bench: what is read there is the offset",
    ),
    Effect(
        name="cell_offset",
        family="sensor",
        title="zero error of one load cell",
        plain="load cell {side} has a zero error",
        amplitude=EffectParameter("offset", "N", "N", 1.0, nominal=0.0, typical=300.0, low=-2e4, high=2e4),
        change=_change_cell,
        places=tuple(str(number) for number in range(1, len(CELLS) + 1)),
        touches=frozenset({"sensor"}),
        confusers=("force_offset", "twisted_seat", "soft_support"),
        equation="F_m = F + b at one cell",
        source="zero of a strain-gauge bridge, tare not taken",
        separated_by="the empty, vented bench: what is read there is the offset",
    ),
    Effect(
        name="pressure_offset",
        family="sensor",
        title="zero error of the pressure transmitter of one bellows",
        plain="the {side} pressure transmitter has a zero error",
        amplitude=EffectParameter(
            "offset", "Pa", "mbar", 100.0, nominal=0.0, typical=10e3, low=-1e5, high=1e5
        ),
        change=_change_pressures,
        places=PLACES,
        touches=frozenset({"sensor"}),
        confusers=("force_offset", "pressure_drift"),
        equation="p_m = p + b",
        source="zero of a transmitter",
        separated_by="the vented bench; bellows and auxiliary chamber at rest, which have the same pressure",
    ),
)
