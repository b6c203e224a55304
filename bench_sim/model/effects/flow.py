"""Effects of the flow between the chambers and through the valves.

Each comment has the equation of its effect in the notation of the model.
"""

from collections.abc import Mapping
from math import pi
from typing import Any, Final

from bench_sim.model.effects.effect import PLACES, Effect, EffectParameter, ShownBy, adds, scales, springs
from bench_sim.model.effects.gas import sonic_conductance


def _blocked_orifice(par: Any, place: int | None, values: Mapping[str, float]) -> None:
    par.discharge_coefficient[springs(place)] *= 1.0 - values["share"]


def _pipe_inertia(par: Any, place: int | None, values: Mapping[str, float]) -> None:
    par.flow_inertance[:] += values["length"] / (0.25 * pi * par.pipe_diameter[:] ** 2)


def _dpv_leak(par: Any, place: int | None, values: Mapping[str, float]) -> None:
    par.dpv_leak += sonic_conductance(values["area"], float(par.gas_constant))


EFFECTS: Final = (
    # The orifice passes more or less than its drawing says.
    #
    #     C_d ← (1 + e) C_d
    #
    # in both springs. Only C_d d² can be distinguished from dynamics, never the two factors. Source: the base model's
    # own coefficient, which is assumed.
    Effect(
        name="discharge",
        family="flow",
        title="discharge coefficient of the orifice",
        plain="the orifice lets through more or less than assumed",
        amplitude=EffectParameter("change", "1", "%", 0.01, nominal=0.0, typical=0.05, low=-0.5, high=0.6),
        change=scales("discharge_coefficient", "change"),
        touches=frozenset({"flow"}),
        confusers=("discharge_reynolds", "auxiliary_volume", "bellows_volume"),
        richer=("discharge_reynolds", "asymmetric_orifice"),
        phenomenon="a changed discharge of the orifice",
        equation=("C_d ← (1+e) C_d\nC_d: discharge coefficient; e: change"),
        source="size assumed",
        separated_by="sine around 1 Hz, at two amplitudes: maximum damping at another frequency than predicted",
    ),
    # The orifice passes less at small flows.
    #
    #     C_d = C_d∞/(1 + k/√Re),   Re = 4|G|/(π d μ)
    #
    # the customary C_d∞ (1 − k/√Re) where that is close to C_d∞, and positive where the flow turns. Re is that of
    # the flow with C_d∞. It breaks the rule f_peak √a = const of the damping maximum. Source: boundary layer of
    # nozzles and short holes (ISO 5167, Re^−½ of the nozzle); at 5 mm and 1.2 Hz Re is about 1.4e5, and k = 20
    # takes 5 %. Sizes assumed.
    Effect(
        name="discharge_reynolds",
        family="flow",
        title="discharge that falls with the Reynolds number",
        plain="the orifice lets through less at low Reynolds numbers",
        amplitude=EffectParameter("k", "1", "1", 1.0, nominal=0.0, typical=20.0, low=0.0, high=300.0),
        change=adds("orifice_reynolds", "k"),
        touches=frozenset({"flow"}),
        confusers=("discharge", "pipe_inertia"),
        phenomenon="a changed discharge of the orifice",
        equation=(
            "C_d = C_d∞/(1 + k/√Re)\n"
            "C_d: discharge coefficient, C_d∞: its value at high Reynolds numbers; Re: Reynolds number of the "
            "orifice; k: coefficient"
        ),
        source="boundary layer of nozzles and short holes (ISO 5167); sizes assumed",
        separated_by="sine around 1 Hz, amplitudes a from 0.5 to 15 mm: f√a changes, f: frequency of maximum damping",
    ),
    # Dirt blocks a part of the orifice of one spring.
    #
    #     C_d ← (1 − e) C_d
    #
    # on one side only. As a fault it begins in the middle of a run (`astb rig fault`). Source: swarf and rubber
    # crumbs in the pipe; sizes assumed.
    Effect(
        name="blocked_orifice",
        family="flow",
        title="partly blocked orifice of one spring",
        plain="the orifice of the {side} spring is partly blocked",
        amplitude=EffectParameter("share", "1", "%", 0.01, nominal=0.0, typical=0.1, low=0.0, high=0.99),
        change=_blocked_orifice,
        places=PLACES,
        touches=frozenset({"flow"}),
        confusers=("discharge", "asymmetric_orifice"),
        equation=("C_d ← (1 − e) C_d on one side\nC_d: discharge coefficient; e: blocked share"),
        source="swarf in the pipe; sizes assumed",
        separated_by="sine around 1 Hz: the damping of the two springs differs",
    ),
    # The orifice passes more in one direction than in the other.
    #
    #     C_d ← (1 + e) C_d out of the bellows, (1 − e) C_d into it
    #
    # in both springs. In an oscillation as much mass must flow out as in. So the mean of p_b − p_a
    # changes against e, in proportion to the square of the motion, and its even harmonics change. Source: one edge
    # sharp, the other rounded or burred; sizes assumed.
    Effect(
        name="asymmetric_orifice",
        family="flow",
        title="orifice with different flow in each direction",
        plain="the orifice lets air out of the bellows differently than into it",
        amplitude=EffectParameter("asymmetry", "1", "%", 0.01, nominal=0.0, typical=0.08, low=-0.8, high=0.8),
        change=adds("orifice_asymmetry", "asymmetry"),
        touches=frozenset({"flow"}),
        confusers=("pressure_offset", "discharge"),
        equation=(
            "C_d ← (1 ± e) C_d\n"
            "C_d: discharge coefficient, with + out of the bellows and − into it; e: asymmetry"
        ),
        source="one edge sharp, one rounded; sizes assumed",
        separated_by="sine of 10 to 15 mm at 1 to 2 Hz: mean pressure difference of the chambers, even harmonics",
    ),
    # The air between bellows and auxiliary chamber has inertia that the orifice alone does not show.
    #
    #     (L/A_p) dG/dt = p_b − p_a − Δp_orifice(G)
    #
    # A_p is the bore of the connection (``pipe_diameter`` of the parameter file). The solution is such that a very
    # small length needs no shorter step: `bench_sim.model.inertance`. If a pipe is fitted, L adds to its inertance.
    # The flow lags behind the pressure; at the surge frequency, (c/2π)√((A_p/L)(1/V_b + 1/V_a)), the stiffness
    # overshoots. Source: Berg, Veh. Syst. Dyn. 33 Suppl. (1999); Docquier et al. 2007; 1.5 m of 50 mm bore assumed.
    Effect(
        name="pipe_inertia",
        family="flow",
        title="inertia of the air in the connection",
        plain="the air in the connection has inertia",
        amplitude=EffectParameter("length", "m", "m", 1.0, nominal=0.0, typical=1.0, low=0.0, high=10.0),
        change=_pipe_inertia,
        touches=frozenset({"flow"}),
        confusers=("pressure_lag", "discharge_reynolds"),
        equation=(
            "(L/A_p) dG/dt = p_b − p_a − Δp_orifice(G)\n"
            "L: length of the connection (m); A_p: area of its bore (m²); G: mass flow (kg/s); t: time (s); p_b, "
            "p_a: pressure in bellows and auxiliary chamber, Δp_orifice: pressure loss of the orifice (Pa)"
        ),
        source="Berg 1999, Docquier et al. 2007; size assumed",
        separated_by="small sine from 5 to 12 Hz: the auxiliary pressure oscillates more than the bellows pressure",
    ),
    # The leveling valve opens earlier or later than it should.
    #
    #     δ ← δ + e
    #
    # in both valves; the hysteresis stays. While a valve stays open its opening, (|x| − δ + δ_h)/Δ, is smooth in e;
    # whether and when it opens is not. Source: adjustment and wear; size assumed.
    Effect(
        name="leveling_deadband",
        family="flow",
        title="deadband of the leveling valves",
        plain="the deadband of the leveling valves differs from the assumed one",
        amplitude=EffectParameter(
            "change", "m", "mm", 1e-3, nominal=0.0, typical=2e-3, low=-3e-3, high=20e-3
        ),
        change=adds("leveling_deadband", "change"),
        touches=frozenset({"flow"}),
        confusers=("leveling_delay", "leak"),
        equation=("δ ← δ + e\nδ: deadband of the leveling valve (m); e: change (m)"),
        source="adjustment and wear; size assumed",
        separated_by="slow height ramp through both ends of the dead zone, valves connected",
        shown_by=ShownBy.CONNECTED_VALVES,
    ),
    # The lever of the leveling valve follows the height later than it should.
    #
    #     dx_l/dt = (ζ − x_l)/(τ_LV + e)
    #
    # in both valves. Smooth in e while the valve stays open. Source: makers state 3 ± 1 s for the dash-pot; size
    # assumed.
    Effect(
        name="leveling_delay",
        family="flow",
        title="delay of the leveling valves",
        plain="the delay of the leveling valves differs from the assumed one",
        amplitude=EffectParameter("time", "s", "s", 1.0, nominal=0.0, typical=1.0, low=-0.9, high=10.0),
        change=adds("leveling_lag", "time"),
        touches=frozenset({"flow", "timing"}),
        confusers=("leveling_deadband",),
        equation=(
            "dx_l/dt = (ζ − x_l)/(τ_LV + e)\n"
            "x_l: position of the lever, ζ: height of the spring (m); t: time, τ_LV: time constant of the lever, "
            "e: additional time constant (s)"
        ),
        source="makers state 3 ± 1 s; size assumed",
        separated_by="height step beyond the dead zone, valves connected: when the flow begins and how it grows",
        shown_by=ShownBy.CONNECTED_VALVES,
    ),
    # The differential pressure valve does not close: its seat leaks.
    #
    #     G = C ρ₀ p₁ √(T₀/T₁) iso(p₂/p₁) between the auxiliary chambers, at any difference,   C = A ψ_c/(ρ₀ √(R T₀))
    #
    # while the valve is connected; A as in the effect `leak`. A difference between left and right
    # decays to zero. Source: ISO 6358-1; sizes assumed.
    Effect(
        name="dpv_leak",
        family="flow",
        title="leaking differential pressure valve",
        plain="the differential pressure valve leaks",
        amplitude=EffectParameter("area", "m2", "mm2", 1e-6, nominal=0.0, typical=1e-6, low=0.0, high=50e-6),
        change=_dpv_leak,
        touches=frozenset({"gas", "flow"}),
        confusers=("leak", "leak_laminar"),
        equation=(
            "G = C ρ₀ p₁ √(T₀/T₁) iso(p₂/p₁) between the auxiliary chambers\n"
            "G: mass flow (kg/s); C: sonic conductance (m³/(s·Pa)); ρ₀ = 1.185 kg/m³, T₀ = 293.15 K: reference "
            "state; iso: flow function of ISO 6358; p₁, p₂: higher and lower absolute pressure (Pa); T₁: "
            "temperature at p₁ (K)"
        ),
        source="ISO 6358-1; sizes assumed",
        separated_by="hold with unequal pressures, valve connected and isolated: one side loses what the other gains",
        shown_by=ShownBy.CONNECTED_VALVES,
    ),
)
