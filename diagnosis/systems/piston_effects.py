"""The effects of a pneumatic actuator in addition to F = p·A: friction of its seal, an uneven bore, lags, its drive.

x is the displacement that compresses the gas, v its speed, p the gauge pressure, F the force that holds the piston. α,
between −1 and 1, is the normalised friction state of Berg: it has the sign of the motion, and changes after a reversal
over a presliding displacement x_2.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from math import pi
from types import MappingProxyType
from typing import Final

import numpy as np

from bench_sim.model.compiled import compiled_entry
from diagnosis.contracts import Array, Hypothesis, Parameter


@compiled_entry
def friction_state(x: Array, x_2: float) -> Array:
    """Return Berg's normalised friction state α (n,) along the displacement ``x`` (n,), from 0 at the start.

    From a reversal (x_s, α_s) on, upwards: α = α_s + (x − x_s)·(1 − α_s)/(x_2·(1 − α_s) + x − x_s); downwards alike.
    Source: M. Berg, Vehicle System Dynamics 33 (S1), 1999.
    """
    alpha = np.zeros(x.shape[0])
    x_s = x[0]
    alpha_s = 0.0
    direction = 0.0
    for i in range(1, x.shape[0]):
        step = x[i] - x[i - 1]
        if step * direction < 0.0:
            x_s = x[i - 1]
            alpha_s = alpha[i - 1]
        if step != 0.0:
            direction = 1.0 if step > 0.0 else -1.0
        way = (x[i] - x_s) * direction
        room = 1.0 - alpha_s * direction
        alpha[i] = alpha_s
        if way > 0.0 and room > 0.0:
            alpha[i] += direction * way / (x_2 * room + way) * room
    return alpha


#: Gauge pressure at which the friction of a seal is reported: the middle of the range of an actuator.
REFERENCE_PRESSURE: Final = 4e5
#: Presliding of friction without presliding: far below the resolution of a sampled motion.
SHARP: Final = 1e-6

#: Symbols of the equations.
_SYMBOLS: Final = "F: force that holds the piston (N); p: gauge pressure (Pa); A: area of the piston (m²)"
_SPEED: Final = "v: speed (m/s), positive if the gas is compressed"
_PLACE: Final = "x: displacement that compresses the gas (m)"
_MIDDLE: Final = f"{_PLACE}; x_m: middle of the stroke (m)"
_SEAL: Final = "F_4: friction force at 4 bar (N); w: share of this force that grows with the pressure"

_BERG: Final = "M. Berg, Vehicle System Dynamics 33 (S1), 1999"
_STRIBECK: Final = "B. Armstrong-Hélouvry, P. Dupont, C. Canudas de Wit, Automatica 30 (7), 1994"
_SEALS: Final = "G. Belforte, N. D'Alfio, T. Raparelli, J. Fluid Control 20, 1989: linear in the pressure"


def _force(name: str, low: float, spread: float = 10.0, step: float = 1e-3) -> Parameter:
    return Parameter(name, "N", 0.0, spread, low=low, step=step * spread, display="N")


def _presliding() -> Parameter:
    return Parameter(
        "presliding_distance",
        "m",
        0.1e-3,
        0.15e-3,
        5e-6,
        10e-3,
        logarithmic=True,
        display="mm",
        scale=1e-3,
        along="displacement",
    )


def _share() -> Parameter:
    # Above 1 the friction would be negative without pressure: no seal drives its piston.
    return Parameter(
        "share_growing_with_pressure", "1", 0.7, 0.4, low=0.0, high=1.0, step=0.01, display="%", scale=0.01
    )


def _lag() -> Parameter:
    # A logger reads one channel after the other: within a step of its clock nothing states which came first.
    return Parameter(
        "lag", "s", 0.0, 0.05, low=0.0, high=0.5, step=2e-4, display="ms", scale=1e-3, along="time"
    )


_EFFECTS: Final = (
    Hypothesis(
        name="coulomb",
        family="friction",
        title="Coulomb friction",
        plain="the seals have a constant friction force",
        amplitude=_force("force", 0.0),
        touches=frozenset({"force"}),
        confusers=("viscous",),
        richer=("seal_friction", "seal_presliding"),
        phenomenon="friction of the seals",
        equation=f"F = p·A + F_c·sign(v)\n{_SYMBOLS}; {_SPEED}; F_c: friction force (N)",
        source="C. A. de Coulomb, 1785",
    ),
    Hypothesis(
        name="seal_friction",
        family="friction",
        title="seal friction growing with pressure",
        plain="the seals have a friction force that grows with the pressure",
        amplitude=_force("force_at_4_bar", 0.0),
        shapes=(_share(),),
        grid=((0.4,), (0.7,), (1.0,)),
        touches=frozenset({"force"}),
        confusers=("viscous",),
        richer=("seal_presliding",),
        phenomenon="friction of the seals",
        equation=f"F = p·A + F_4·(1 − w + w·p/4 bar)·sign(v)\n{_SYMBOLS}; {_SPEED}; {_SEAL}",
        source=_SEALS,
    ),
    Hypothesis(
        name="seal_presliding",
        family="friction",
        title="seal friction growing with pressure, with presliding",
        plain="the seals have a friction force that grows with the pressure, and deform before they slide",
        amplitude=_force("force_at_4_bar", 0.0),
        shapes=(_share(), _presliding()),
        grid=tuple((w, x_2) for w in (0.4, 0.7, 1.0) for x_2 in (0.05e-3, 0.15e-3, 0.5e-3)),
        touches=frozenset({"force"}),
        confusers=("force_lag",),
        phenomenon="friction of the seals",
        separated_by="the same motion at two pressures, with many samples at each reversal",
        equation=f"F = p·A + F_4·(1 − w + w·p/4 bar)·α(x; x_2)\n{_SYMBOLS}; {_SEAL}; α: friction state after "
        f"Berg, from −1 to 1; x_2: distance after a reversal in which the friction changes its sign (m); {_PLACE}",
        source=f"{_SEALS}; presliding: {_BERG}",
    ),
    Hypothesis(
        name="stribeck",
        family="friction",
        title="friction falling with speed (Stribeck)",
        plain="the friction force falls with speed, as described by Stribeck",
        amplitude=_force("force", 0.0),
        shapes=(
            Parameter(
                "speed",
                "m/s",
                5e-3,
                4e-3,
                0.5e-3,
                0.1,
                logarithmic=True,
                display="mm/s",
                scale=1e-3,
            ),
        ),
        grid=((2e-3,), (5e-3,), (10e-3,)),
        touches=frozenset({"force"}),
        confusers=("coulomb", "viscous"),
        equation=f"F = p·A + F_s·exp(−(v/v_s)²)·sign(v)\n{_SYMBOLS}; {_SPEED}; F_s: friction force at rest (N); "
        "v_s: Stribeck speed (m/s)",
        source=_STRIBECK,
    ),
    Hypothesis(
        name="friction_gradient",
        family="friction",
        title="friction growing along the stroke",
        plain="the friction force grows along the stroke",
        amplitude=Parameter("force_per_length", "N/m", 0.0, 100.0, step=0.1, display="N/mm", scale=1e3),
        touches=frozenset({"force"}),
        confusers=("spring",),
        equation=f"F = p·A + G·(x − x_m)·sign(v)\n{_SYMBOLS}; {_SPEED}; {_MIDDLE}; G: friction force per length (N/m)",
        source="a bore that is not cylindrical, a guide that is not straight",
    ),
    Hypothesis(
        name="viscous",
        family="lubrication",
        title="viscous friction",
        plain="there is viscous friction",
        amplitude=Parameter("damping", "N*s/m", 0.0, 500.0, low=0.0, step=0.5, display="N*s/m"),
        touches=frozenset({"force"}),
        confusers=("coulomb",),
        equation=f"F = p·A + d·v\n{_SYMBOLS}; {_SPEED}; d: damping (N·s/m)",
        source=_STRIBECK,
    ),
    Hypothesis(
        name="spring",
        family="geometry",
        title="spring beside the piston (hose, cable)",
        plain="something acts as a spring beside the piston, such as a hose or a cable",
        amplitude=Parameter("stiffness", "N/m", 0.0, 100.0, step=0.1, display="N/mm", scale=1e3),
        touches=frozenset({"force"}),
        confusers=("area_gradient",),
        equation=f"F = p·A + k·(x − x_m)\n{_SYMBOLS}; {_MIDDLE}; k: stiffness (N/m)",
        source="Hooke",
    ),
    Hypothesis(
        name="area_gradient",
        family="geometry",
        title="area changing along the stroke",
        plain="the area changes along the stroke",
        amplitude=Parameter("relative_per_length", "1/m", 0.0, 1.0, step=1e-3, display="%/mm", scale=10.0),
        touches=frozenset({"force"}),
        confusers=("spring",),
        equation=f"F = p·A·(1 + g·(x − x_m))\n{_SYMBOLS}; {_MIDDLE}; g: relative change of the area per length (1/m)",
        source="a conical bore",
    ),
    Hypothesis(
        name="drive_ripple",
        family="drive",
        title="ripple of the drive's spindle",
        plain="the spindle of the drive causes a ripple of the force",
        amplitude=_force("force", -20.0, spread=1.0, step=1e-3),
        shapes=(
            Parameter(
                "pitch", "m", 3e-3, 1e-3, 1e-3, 10e-3, step=1.5e-6, logarithmic=True, display="mm", scale=1e-3
            ),
            Parameter(
                "phase",
                "rad",
                0.0,
                1.8,
                low=-3.2,
                high=3.2,
                step=0.01,
                display="deg",
                scale=0.017453292519943295,
            ),
        ),
        # Half a turn is the other sign. Along a stroke of 40 mm, pitches 3 % apart are a different ripple.
        grid=tuple(
            (pitch * 1e-3, phase) for pitch in (2.0, 2.5, 2.9, 3.0, 3.1, 4.0, 5.0) for phase in (0.0, 1.5708)
        ),
        touches=frozenset({"force"}),
        equation=f"F = p·A + R·sin(2π·x/λ + φ)\n{_SYMBOLS}; {_PLACE}; R: force (N); λ: pitch (m); φ: phase (rad)",
        source="a spindle out of line presses on the guide once in a turn",
    ),
    Hypothesis(
        name="force_lag",
        family="sensor",
        title="lag of the force signal",
        plain="the force signal lags behind",
        amplitude=_lag(),
        touches=frozenset({"sensor"}),
        confusers=("seal_presliding",),
        equation="τ·dF_m/dt + F_m = F\nF_m: measured force, F: true force (N); τ: lag (s); t: time (s)",
        source="first-order filter of the amplifier",
    ),
    Hypothesis(
        name="pressure_lag",
        family="sensor",
        title="lag of the pressure signal",
        plain="the pressure signal lags behind",
        amplitude=_lag(),
        touches=frozenset({"sensor"}),
        equation="p = p_m + τ·dp_m/dt\np_m: measured pressure, p: true pressure (Pa); τ: lag (s); t: time (s)",
        source="first-order filter of the amplifier",
    ),
    Hypothesis(
        name="force_drift",
        family="sensor",
        title="drift of the force signal",
        plain="the force signal drifts",
        amplitude=Parameter("rate", "N/s", 0.0, 0.02, step=2e-5, display="N/s"),
        touches=frozenset({"sensor"}),
        equation="F_m = F + r·t\nF_m: measured force, F: true force (N); r: rate (N/s); t: time since the start "
        "of the file (s)",
        source="warming of the amplifier",
    ),
)

#: Effects of the actuator by name.
PISTON_EFFECTS: Final[Mapping[str, Hypothesis]] = MappingProxyType(
    {effect.name: effect for effect in _EFFECTS}
)


@dataclass(frozen=True, slots=True, eq=False)
class Stroke:
    """The inputs of the force terms: arrays (n,) in SI, and ``area`` in m²."""

    x: Array
    v: Array
    p: Array
    clock: Array
    from_middle: Array
    area: float

    def direction(self) -> Array:
        """Return the sign of the motion (n,). At rest it keeps the last sign."""
        return friction_state(self.x, SHARP)

    def seal(self, values: Mapping[str, float]) -> Array:
        """Return the friction of a seal under pressure, in N."""
        return values["force_at_4_bar"] * (
            1.0 + values["share_growing_with_pressure"] * (self.p / REFERENCE_PRESSURE - 1.0)
        )


#: The force that each effect adds, in N (n,). The lags are not forces: the simulator applies them to the signals.
FORCES: Final[Mapping[str, Callable[[Stroke, Mapping[str, float]], Array]]] = MappingProxyType(
    {
        "coulomb": lambda s, k: k["force"] * s.direction(),
        "seal_friction": lambda s, k: s.seal(k) * s.direction(),
        "seal_presliding": lambda s, k: s.seal(k) * friction_state(s.x, k["presliding_distance"]),
        "stribeck": lambda s, k: k["force"] * np.exp(-((s.v / k["speed"]) ** 2)) * s.direction(),
        "friction_gradient": lambda s, k: k["force_per_length"] * s.from_middle * s.direction(),
        "viscous": lambda s, k: k["damping"] * s.v,
        "spring": lambda s, k: k["stiffness"] * s.from_middle,
        "area_gradient": lambda s, k: k["relative_per_length"] * s.from_middle * s.area * s.p,
        "drive_ripple": lambda s, k: k["force"] * np.sin(2.0 * pi * s.x / k["pitch"] + k["phase"]),
        "force_drift": lambda s, k: k["rate"] * s.clock,
    }
)
