"""The effects of a closed chamber: five laws of a leak, two of heat, and a drifting sensor.

p is the absolute pressure, p_a the ambient one, G the mass flow out of the chamber.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Final

from diagnosis.contracts import Hypothesis, Parameter

R_AIR: Final = 287.05  #: J/(kg·K)
KAPPA: Final = 1.4
T_0: Final = 293.15  #: ISO 6358 reference temperature, K
RHO_0: Final = 1.185  #: ISO 6358 reference density, kg/m³

#: A chamber that empties within this time has an ordinary leak.
_EMPTYING_TIME: Final = 30.0
_BAR: Final = 1e5
#: Symbols of the equations of all leaks.
_SYMBOLS: Final = "G: mass flow out of the chamber (kg/s); p, p_a: absolute pressure inside and outside (Pa)"
_LEAK_NAMES: Final = ("leak_orifice", "leak_linear", "leak_laminar", "leak_inertial", "leak_opening")


def chamber_effects(volume: float) -> Mapping[str, Hypothesis]:
    """Return the effects of a chamber of ``volume`` in m³ by name."""
    effects = (*_leaks(volume), *_HEAT, _DRIFT)
    return MappingProxyType({effect.name: effect for effect in effects})


def _leaks(volume: float) -> tuple[Hypothesis, ...]:
    """Return the laws of a leak. A typical leak empties the chamber within `_EMPTYING_TIME`."""
    mass_per_pressure = volume / (R_AIR * T_0)
    sonic = _conductance(
        "m3/(s*Pa)", mass_per_pressure / (RHO_0 * _EMPTYING_TIME), "litre/(min*bar)", 1e-3 / 60.0 / _BAR
    )
    linear = _conductance("kg/(s*Pa)", mass_per_pressure / _EMPTYING_TIME, "mg/(s*bar)", 1e-6 / _BAR)
    squares = _conductance(
        "kg/(s*Pa2)", mass_per_pressure / _EMPTYING_TIME / (4.0 * _BAR), "mg/(s*bar2)", 1e-6 / _BAR**2
    )
    return (
        _leak(
            "leak_orifice", "leak through an orifice", "through an orifice", sonic,
            "G = C·ρ_0·p·√(T_0/T)·q(p_a/p), q = 1 up to the critical ratio b, then an ellipse",
            "C: conductance (m³/(s·Pa)); q: flow function; b: critical ratio; ρ_0 = 1.185 kg/m³, T_0 = "
            "293.15 K: reference state; T: gas temperature (K)", "ISO 6358-1",
            shapes=(Parameter("critical_ratio", "1", 0.4, 0.15, 0.05, 0.6, step=0.02, display="1"),),
            grid=((0.2,), (0.5,)),
        ),
        _leak(
            "leak_linear", "leak in proportion to the gauge pressure", "in proportion to the gauge pressure", linear,
            "G = k·(p − p_a)", "k: conductance (kg/(s·Pa))",
            "a permeable wall", richer=("leak_opening",),
        ),
        _leak(
            "leak_laminar", "laminar leak through a narrow gap", "through a narrow gap in laminar flow", squares,
            "G = k·(p² − p_a²)", "k: conductance (kg/(s·Pa²))",
            "Hagen-Poiseuille for an ideal gas at constant temperature", richer=("leak_inertial", "leak_opening"),
        ),
        _leak(
            "leak_inertial", "leak through pores, turbulent at high flow",
            "through pores, with turbulence at high flow", squares, "p² − p_a² = G/k + G²/(k·p_t)²",
            "k: conductance (kg/(s·Pa²)); p_t: transition pressure to turbulent flow (Pa)", "P. Forchheimer, 1901",
            shapes=(
                Parameter(
                    "transition", "Pa", 3.0 * _BAR, 4.0 * _BAR, 0.02 * _BAR, 200.0 * _BAR, logarithmic=True,
                    display="bar", scale=_BAR,
                ),
            ),
            grid=((0.5 * _BAR,), (2.0 * _BAR,), (8.0 * _BAR,)),
        ),
        _leak(
            "leak_opening", "leak through pores that the pressure opens", "through pores that the pressure opens",
            linear,
            "G = k·(p − p_a)·(1 + s·(p − p_a)); s = 0 is a fixed permeable wall, s = 1/(2 p_a) a fixed laminar gap",
            "k: conductance (kg/(s·Pa)); s: opening, the relative growth of k with the pressure (1/Pa)",
            "first order of a conductance that grows with the load on the wall",
            shapes=(
                Parameter("opening", "1/Pa", 0.3 / _BAR, 0.5 / _BAR, 0.0, 20.0 / _BAR, step=1e-3 / _BAR,
                          display="1/bar", scale=1.0 / _BAR),
            ),
            grid=((0.1 / _BAR,), (1.0 / _BAR,)),
        ),
    )  # fmt: skip


def _leak(
    name: str, title: str, how: str, amplitude: Parameter, equation: str, symbols: str, source: str,
    shapes: tuple[Parameter, ...] = (), grid: tuple[tuple[float, ...], ...] = ((),), richer: tuple[str, ...] = (),
) -> Hypothesis:  # fmt: skip
    confusers = (*(other for other in _LEAK_NAMES if other != name), "sensor_drift")
    return Hypothesis(
        name, "leak", title, amplitude, shapes, grid, frozenset({"gas"}), confusers, richer,
        f"{equation}\n{_SYMBOLS}; {symbols}", source, plain=f"the chamber leaks {how}",
        phenomenon="a leak",
        separated_by="the closed chamber, filled to the highest permitted pressure: the fall of the pressure",
    )  # fmt: skip


def _conductance(unit: str, typical: float, display: str, scale: float) -> Parameter:
    return Parameter(
        "conductance", unit, 0.0, typical, 0.0, step=1e-5 * typical, display=display, scale=scale
    )


_HEAT: Final = (
    Hypothesis(
        name="heat_exchange",
        family="heat",
        title="slow heat exchange with the wall",
        plain="the wall exchanges heat slowly",
        amplitude=Parameter("time_constant", "s", 0.0, 5.0, 0.0, 60.0, step=0.01, display="s"),
        touches=frozenset({"gas"}),
        confusers=_LEAK_NAMES,
        equation="dT/dt = (T_w − T)/τ − (κ − 1)·T·G/m\nT, T_w: temperature of gas and wall (K); t: time, τ: time "
        "constant (s); κ = 1.4: ratio of specific heats; G: mass flow out of the chamber (kg/s); m: mass of gas (kg)",
        source="first law of thermodynamics for a gas that leaves a chamber",
    ),
    Hypothesis(
        name="filling_heat",
        family="heat",
        title="gas still warm from filling",
        plain="the gas is still warm from filling",
        amplitude=Parameter("excess_temperature", "K", 0.0, 10.0, -40.0, 40.0, step=0.01, display="K"),
        shapes=(Parameter("time_constant", "s", 20.0, 20.0, 1.0, 600.0, logarithmic=True, display="s"),),
        grid=((5.0,), (20.0,), (60.0,)),
        touches=frozenset({"gas"}),
        confusers=_LEAK_NAMES,
        equation="T = T_w + ΔT·exp(−t/τ)\nT, T_w: temperature of gas and wall (K); ΔT: excess temperature (K); "
        "t: time since the start of the file, τ: time constant (s)",
        source="compression while filling",
    ),
)
_DRIFT: Final = Hypothesis(
    name="sensor_drift",
    family="sensor",
    title="drift of the pressure sensor",
    plain="the pressure sensor drifts",
    amplitude=Parameter(
        "rate", "Pa/s", 0.0, 3.0, -1e3, 1e3, step=1e-3, display="mbar/min", scale=100.0 / 60.0
    ),
    touches=frozenset({"sensor"}),
    confusers=_LEAK_NAMES,
    equation="p_m = p + r·t\np_m: measured pressure, p: true pressure (Pa); r: rate (Pa/s); t: time since the start of "
    "the file (s)",
    source="data sheets of transducers",
)
