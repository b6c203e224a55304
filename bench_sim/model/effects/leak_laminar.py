"""A fine crack in a bellows or its seat: air leaves it by laminar flow.

    G = k (p² − p_atm²)

Source: compressible Poiseuille flow; what a pneumatic test chamber loses can follow it (Zillen, TU Delft 2021), and
only a wide range of pressures tells it from an orifice. Sizes assumed: 0.5 g/(min·bar²) is 70 mg/s at AW0, much like
a hole of 0.1 mm².
"""

from collections.abc import Mapping
from typing import Any, Final

from bench_sim.model.effects.effect import PLACES, Effect, EffectParameter, springs


def _change(par: Any, place: int | None, values: Mapping[str, float]) -> None:
    par.leak_laminar[springs(place)] += values["coefficient"]


_DISPLAY = 1e-3 / 60.0 / 1e10

EFFECT: Final = Effect(
    name="leak_laminar",
    family="gas",
    title="leak of a bellows (laminar)",
    plain="the {side} bellows leaks in laminar flow",
    amplitude=EffectParameter(
        "coefficient",
        "kg/(s*Pa2)",
        "g/(min*bar2)",
        _DISPLAY,
        nominal=0.0,
        typical=0.5 * _DISPLAY,
        low=0.0,
        high=100.0 * _DISPLAY,
    ),
    change=_change,
    places=PLACES,
    touches=frozenset({"gas"}),
    confusers=("leak", "heat", "creep", "pressure_drift"),
    phenomenon="a leak of the {side} bellows",
    equation="G = k (p² − p_atm²)",
    source="compressible Poiseuille flow; Zillen 2021 for a test chamber; sizes assumed",
    separated_by="holds at pressures a factor of five apart: G grows with p² instead of p",
    loses_air=True,
)
