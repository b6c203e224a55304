"""The emergency spring goes on giving way under the load that it carries.

    ζ = ζ_b − (F_z − P)/k_z − q,   dq/dt = (r F_z/k_z − q)/τ

a Kelvin element in series with each emergency spring, of r times its elastic compliance. It has not yet crept when
the simulation begins: a load that has stood for longer shows a smaller r. A replay is told how far it has crept where
it begins. Height at constant pressure and mass, or pressure at constant height, drift by an exponential that ends.
Source: creep of layered rubber, some percent of the deflection per decade of time (Freakley & Payne, Theory and
Practice of Engineering with Rubber, 1978); sizes assumed.
"""

from collections.abc import Mapping
from typing import Any, Final

from bench_sim.model.effects.effect import Effect, EffectParameter


def _change(par: Any, place: int | None, values: Mapping[str, float]) -> None:
    if values["ratio"] != 0.0:
        par.creep_ratio[:] += values["ratio"]
        par.creep_time[:] = values["time"]


EFFECT: Final = Effect(
    name="creep",
    family="rubber",
    title="creep of the emergency spring",
    plain="the emergency springs creep",
    amplitude=EffectParameter("ratio", "1", "%", 0.01, nominal=0.0, typical=0.05, low=0.0, high=1.0),
    change=_change,
    shapes=(
        EffectParameter(
            "time", "s", "s", 1.0, nominal=100.0, typical=100.0, low=5.0, high=1e4, logarithmic=True
        ),
    ),
    grid=((10.0,), (30.0,), (100.0,), (300.0,), (1000.0,)),
    touches=frozenset({"force", "gas"}),
    confusers=("leak", "leak_laminar", "heat", "pressure_drift"),
    equation="ζ = ζ_b − (F_z−P)/k_z − q, dq/dt = (r F_z/k_z − q)/τ",
    source="creep of layered rubber (Freakley & Payne 1978); sizes assumed",
    separated_by="hold at AW3 for several minutes: the mass pV/(RT) stays while force and pressure drift together",
)
