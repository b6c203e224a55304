"""Effects of the gas: leaks, heat, volumes and area.

Each comment has the equation of its effect in the notation of the model.
"""

from collections.abc import Mapping
from math import sqrt
from typing import Any, Final

from bench_sim.model.effects.effect import PLACES, Effect, EffectParameter, adds, scales, springs
from bench_sim.model.iso6358 import ISO_DENSITY, ISO_TEMPERATURE

#: ψ of a choked nozzle for κ = 1.4.
CHOKED: Final = 0.6847


def sonic_conductance(area: float, gas_constant: float) -> float:
    """Return the sonic conductance C in m³/(s·Pa) of a hole with the effective ``area`` in m²."""
    return area * CHOKED / (ISO_DENSITY * sqrt(gas_constant * ISO_TEMPERATURE))


def _leak(par: Any, place: int | None, values: Mapping[str, float]) -> None:
    par.leak_conductance[springs(place)] += sonic_conductance(values["area"], float(par.gas_constant))


_DISPLAY = 1e-3 / 60.0 / 1e10


def _heat(par: Any, place: int | None, values: Mapping[str, float]) -> None:
    par.bellows_heat_transfer[:] *= 1.0 + values["change"]
    par.auxiliary_heat_transfer[:] *= 1.0 + values["change"]


EFFECTS: Final = (
    # A hole in a bellows: air flows out as through an orifice, which is choked at these pressures.
    #
    #     G = C ρ₀ p √(T₀/T) · iso(p_atm/p),   C = A ψ_c/(ρ₀ √(R T₀)),   ψ_c = 0.6847
    #
    # A is the effective area of the hole and C its sonic conductance (ISO 6358), which passes the same choked flow
    # as an ideal nozzle of area A: 0.1 mm² is 1.99e-10 m³/(s·Pa). Above twice the atmosphere ln p falls on a
    # straight line with the time constant V/(C ρ₀ √(T₀/T) R T). Source: ISO 6358-1:2013; sizes assumed (0.1 mm²
    # costs the 100 litres of a spring and its chamber 37 mbar a minute at AW0 and held height).
    Effect(
        name="leak",
        family="gas",
        title="leak of a bellows (orifice)",
        plain="the {side} bellows leaks through an orifice",
        amplitude=EffectParameter(
            "area", "m2", "mm2", 1e-6, nominal=0.0, typical=0.1e-6, low=0.0, high=20e-6
        ),
        change=_leak,
        places=PLACES,
        touches=frozenset({"gas"}),
        confusers=("leak_laminar", "heat", "creep", "pressure_drift"),
        phenomenon="a leak of the {side} bellows",
        equation=(
            "G = C ρ₀ p √(T₀/T) iso(p_atm/p), C = 0.6847 A/(ρ₀ √(R T₀))\n"
            "G: mass flow out of the bellows (kg/s); p, p_atm: absolute pressure in the bellows and outside (Pa); "
            "C: sonic conductance (m³/(s·Pa)); ρ₀ = 1.185 kg/m³, T₀ = 293.15 K: reference state; iso: flow "
            "function of ISO 6358; T: gas temperature (K); A: area of the hole (m²); R: gas constant (J/(kg·K))"
        ),
        source="ISO 6358-1; sizes assumed",
        separated_by="hold at two pressures, leveling valve isolated: the mass of air pV/(RT) falls all the time",
        loses_air=True,
    ),
    # A fine crack in a bellows or its seat: air flows out with laminar flow.
    #
    #     G = k (p² − p_atm²)
    #
    # Source: compressible Poiseuille flow; the leak of a pneumatic test chamber can follow it (Zillen, TU Delft
    # 2021), and only a wide range of pressures distinguishes it from an orifice. Sizes assumed: 0.5 g/(min·bar²) is
    # 70 mg/s at AW0, much like a hole of 0.1 mm².
    Effect(
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
        change=adds("leak_laminar", "coefficient"),
        places=PLACES,
        touches=frozenset({"gas"}),
        confusers=("leak", "heat", "creep", "pressure_drift"),
        phenomenon="a leak of the {side} bellows",
        equation=(
            "G = k (p² − p_atm²)\n"
            "G: mass flow out of the bellows (kg/s); p, p_atm: absolute pressure in the bellows and outside (Pa); "
            "k: coefficient (kg/(s·Pa²))"
        ),
        source="compressible Poiseuille flow; Zillen 2021 for a test chamber; sizes assumed",
        separated_by="holds at pressures a factor of five apart: the mass flow grows with p² instead of p",
        loses_air=True,
    ),
    # Heat passes between gas and walls better or worse than assumed.
    #
    #     hS ← (1 + e) hS
    #
    # in all four chambers. It shifts the frequency at which the gas turns from isothermal to adiabatic, and the
    # time constant m c_v/(hS) with which pressure settles after a step. Source: the base model's own heat exchange,
    # whose size is assumed (published transitions lie between 0.001 and 0.1 Hz: Pelz & Buttenbender 2004).
    Effect(
        name="heat",
        family="gas",
        title="heat exchange with the walls",
        plain="the walls exchange more or less heat than assumed",
        amplitude=EffectParameter("change", "1", "%", 0.01, nominal=0.0, typical=0.5, low=-0.95, high=9.0),
        change=_heat,
        touches=frozenset({"gas"}),
        confusers=("leak", "leak_laminar", "creep"),
        equation=(
            "hS ← (1+e) hS\nh: heat transfer coefficient (W/(m²·K)); S: area of the walls (m²); e: change"
        ),
        source="published transitions 0.001 to 0.1 Hz (Pelz & Buttenbender 2004); size assumed",
        separated_by="hold after a step, and slow sine from 0.003 to 0.1 Hz: time constant of 10 to 20 s in the hold",
    ),
    # The bellows at design height holds more or less air than its drawing says.
    #
    #     V_b ← (1 + e) V_b
    #
    # in both springs. Source: the base model's own volume, which is assumed.
    Effect(
        name="bellows_volume",
        family="gas",
        title="volume of the bellows",
        plain="the bellows hold more or less air than assumed",
        amplitude=EffectParameter("change", "1", "%", 0.01, nominal=0.0, typical=0.1, low=-0.5, high=1.0),
        change=scales("bellows_volume", "change"),
        touches=frozenset({"gas"}),
        confusers=("auxiliary_volume", "compliance", "discharge"),
        equation=("V_b ← (1+e) V_b\nV_b: volume of the bellows (m³); e: change"),
        source="size assumed",
        separated_by="fast sine, 10 to 20 Hz: the same error of the stiffness at AW0 and AW3",
    ),
    # The auxiliary chamber holds more or less air than its drawing says.
    #
    #     V_a ← (1 + e) V_a
    #
    # in both springs. Source: the base model's own volume, which is assumed.
    Effect(
        name="auxiliary_volume",
        family="gas",
        title="volume of the auxiliary chamber",
        plain="the auxiliary chambers hold more or less air than assumed",
        amplitude=EffectParameter("change", "1", "%", 0.01, nominal=0.0, typical=0.1, low=-0.5, high=1.0),
        change=scales("auxiliary_volume", "change"),
        touches=frozenset({"gas"}),
        confusers=("bellows_volume", "compliance", "discharge"),
        equation=("V_a ← (1+e) V_a\nV_a: volume of the auxiliary chamber (m³); e: change"),
        source="size assumed",
        separated_by="slow sine, 0.1 Hz: the stiffness of both chambers together differs",
    ),
    # The bellows stretches under pressure: its volume grows with it.
    #
    #     V = V_b(ζ, y) + C_V (p − p_ref),   p (V_b + C_V (p − p_ref)) = (κ−1) U
    #
    # solved for p in closed form; p_ref is the pressure of the load case, so that rest is as without it. The
    # stretched wall stores energy, ½ C_V (p − p_ref)² beyond its preload, and takes none; the force p_g ∂V_b/∂ζ is
    # the same function of the pressure. A closed bellows has K = κ p A²/(V + κ C_V p) − p_g A_1, softer, and the
    # more so the higher p is, which no wrong volume can imitate under two loads. Source: 0.25 to 1 litre per bar
    # assumed; Kuzyshyn et al. (2024) measured an area that grows with pressure, a related effect that is not this
    # one.
    Effect(
        name="compliance",
        family="gas",
        title="radial compliance of the bellows",
        plain="the bellows widen under pressure",
        amplitude=EffectParameter(
            "compliance", "m3/Pa", "litre/bar", 1e-8, nominal=0.0, typical=0.25e-8, low=0.0, high=4e-8
        ),
        change=adds("bellows_compliance", "compliance"),
        touches=frozenset({"gas"}),
        confusers=("bellows_volume", "area_slope"),
        equation=(
            "V = V_b(ζ,y) + C_V (p − p_ref)\n"
            "V: volume of the bellows, V_b: its volume without stretch (m³); ζ: height, y: lateral displacement "
            "(m); C_V: compliance (m³/Pa); p: pressure, p_ref: pressure of the load case (Pa)"
        ),
        source="size assumed",
        separated_by="fast sine at AW0 and at AW3: the loss of stiffness grows with the load",
    ),
    # The effective area grows with the pressure.
    #
    #     A_e = A_0 + A_1 ζ + A_p (p_g − p_A),   F = p_g A_e
    #
    # in both springs, p_A being the pressure at which the area is A_0. Force and volume follow from one potential
    # (`bench_sim.model.spring`): the wall stretches without loss, and the volume grows with the area over the height
    # of the bellows. Source: Kuzyshyn et al., J. Vibroeng. (2024), a spring of a high-speed train: 0.231 m² at
    # 2.5 atm to 0.306 m² at 5.0 atm, 296 cm²/bar.
    Effect(
        name="area_pressure",
        family="gas",
        title="effective area that grows with pressure",
        plain="the effective area grows with the pressure",
        amplitude=EffectParameter(
            "growth", "m2/Pa", "cm2/bar", 1e-9, nominal=0.0, typical=1e-7, low=0.0, high=8e-7
        ),
        change=adds("effective_area_growth", "growth"),
        touches=frozenset({"force", "gas"}),
        confusers=("force_gain", "compliance", "area_slope"),
        equation=(
            "A_e = A_0 + A_1 ζ + A_p (p_g − p_A)\n"
            "A_e: effective area, A_0: its value at design height (m²); ζ: height above the design height (m); "
            "A_1: slope of the area (m); A_p: growth (m²/Pa); p_g: gauge pressure, p_A: its value for which A_0 "
            "is valid (Pa)"
        ),
        source="Kuzyshyn et al. 2024: 296 cm²/bar measured",
        separated_by="heights held at constant pressure, at three pressures: force / gauge pressure is not constant",
    ),
    # The effective area changes with height differently than assumed.
    #
    #     A_1 ← A_1 + e,   A_e = A_0 + A_1 ζ
    #
    # in both springs: a stiffness −p_g e, without loss, at any frequency. Source: isobaric test of EN 13597; the base
    # model's own slope is assumed.
    Effect(
        name="area_slope",
        family="gas",
        title="slope of the effective area",
        plain="the effective area changes with height differently than assumed",
        amplitude=EffectParameter("slope", "m", "m", 1.0, nominal=0.0, typical=0.1, low=-0.2, high=0.2),
        change=adds("effective_area_slope", "slope"),
        touches=frozenset({"force", "gas"}),
        confusers=("compliance", "force_gain", "bellows_volume"),
        equation=(
            "A_e = A_0 + (A_1 + e) ζ\n"
            "A_e: effective area, A_0: its value at design height (m²); ζ: height above the design height (m); "
            "A_1: slope of the area (m); e: change of the slope (m)"
        ),
        source="EN 13597, isobaric test; size assumed",
        separated_by="heights held at constant pressure: another slope of force / gauge pressure over the height",
    ),
)
