"""The air between bellows and auxiliary chamber has inertia that the orifice alone does not show.

    (L/A_p) dG/dt = p_b − p_a − Δp_orifice(G)

A_p is the bore of the connection (``pipe_diameter`` of the parameter file). Solved so that a length of any smallness
needs no shorter step: `bench_sim.model.inertance`. Where a pipe is fitted, L adds to its inertance. The flow lags
behind the pressure; at the surge frequency, (c/2π)√((A_p/L)(1/V_b + 1/V_a)), the stiffness overshoots. Source: Berg,
Veh. Syst. Dyn. 33 Suppl. (1999); Docquier et al. 2007; 1.5 m of 50 mm bore assumed.
"""

from collections.abc import Mapping
from math import pi
from typing import Any, Final

from bench_sim.model.effects.effect import Effect, EffectParameter


def _change(par: Any, place: int | None, values: Mapping[str, float]) -> None:
    par.flow_inertance[:] += values["length"] / (0.25 * pi * par.pipe_diameter[:] ** 2)


EFFECT: Final = Effect(
    name="pipe_inertia",
    family="flow",
    title="inertia of the air in the connection",
    plain="the air in the connection has inertia",
    amplitude=EffectParameter("length", "m", "m", 1.0, nominal=0.0, typical=1.0, low=0.0, high=10.0),
    change=_change,
    touches=frozenset({"flow"}),
    confusers=("pressure_lag", "discharge_reynolds"),
    equation="(L/A_p) dG/dt = p_b − p_a − Δp_orifice(G)",
    source="Berg 1999, Docquier et al. 2007; size assumed",
    separated_by="small sine from 5 to 12 Hz: p_a swings more than p_b only with inertia",
)
