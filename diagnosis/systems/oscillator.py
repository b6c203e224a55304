"""A mass on a spring with a damper: the smallest system that can be diagnosed, and a pattern for one of your own.

    m ẍ + c ẋ + k x + (what may be hidden) = f(t)

The drive f is given, the displacement x and the force on the ground are measured. Whatever is to be diagnosed is a
class with the attributes and the method `run` of `diagnosis.contracts.Simulator`; nothing is inherited or registered.
The causes that may be missing stand in `diagnosis.systems.oscillator_effects`, measurements of a virtual specimen in
`diagnosis.systems.oscillator_specimen`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from math import inf
from typing import Any, Final, NamedTuple

import numpy as np

from bench_sim.model.compiled import compiled, compiled_parallel
from diagnosis.contracts import Array, Channel, Effects, Experiment, Hypothesis, Nuisance, Parameter, Surface
from diagnosis.systems.oscillator_effects import OSCILLATOR_EFFECTS

#: Coefficients of a smooth force over displacement and asinh(speed/`UNIT_SPEED`), and how far these reach to each side.
SURFACE_SHAPE: Final = (8, 4)
REACH: Final = (0.04, 2.0)
UNIT_SPEED: Final = 0.1
#: Dry friction reaches its force over some of this speed (m/s).
FRICTION_SPEED: Final = 0.005

CHANNELS: Final = (
    Channel("displacement", "m", 5e-5, kind="displacement", display="mm", scale=1e-3),
    Channel("force", "N", 1.0, kind="force"),
)
NUISANCES: Final = (
    Nuisance("mass", "kg", 10.0, 0.1),
    Nuisance("damping", "N s/m", 30.0, 3.0, 0.0),
    Nuisance("stiffness", "N/m", 4000.0, 80.0),
    Nuisance("force_offset", "N", 0.0, 5.0),
    Nuisance("start", "m", 0.0, 1e-3, per_run=True),
)


class Terms(NamedTuple):
    """The parameters of the equation of motion, in SI; what is 0 is absent."""

    mass: float
    damping: float
    stiffness: float
    start: float  #: displacement at t = 0
    cubic: float
    quadratic: float
    coulomb: float
    branch_stiffness: float  #: of the first Maxwell branch
    branch_time: float
    second_ratio: float  #: stiffness of the second branch over that of the first
    second_time: float
    lag: float  #: of the displacement sensor
    stop_stiffness: float
    stop_gap: float


@dataclass(frozen=True)
class Oscillator:
    """The simulator: driven by ``drive`` (N), it returns displacement (m) and force on the ground (N).

    Beside its catalogue it understands a ``stop`` (N/m) behind a ``gap`` (m) and a ``force`` by the coefficients of
    `force_surface`: terms to be hidden that no candidate describes. With `force_surface` among its ``surfaces``, the
    engine may fit one of its own.
    """

    name: str = "oscillator"
    channels: tuple[Channel, ...] = CHANNELS
    nuisances: tuple[Nuisance, ...] = NUISANCES
    catalogue: Mapping[str, Hypothesis] = field(default_factory=lambda: OSCILLATOR_EFFECTS)
    surfaces: tuple[Surface, ...] = ()

    def run(self, experiment: Experiment, parameters: Mapping[str, float], effects: Effects) -> Array:
        """Return displacement and force (n, 2) as sensors without noise would have read them."""
        base = {nuisance.name: nuisance.nominal for nuisance in self.nuisances} | dict(parameters)
        outputs = np.asarray(
            _oscillate(experiment.inputs["drive"], experiment.step, _terms(base, effects), _surface(effects))
        )
        outputs[:, 1] *= 1.0 + _value(effects, "force_gain")
        outputs[:, 1] += base["force_offset"] + _value(effects, "drift") * experiment.time
        return outputs


def force_surface() -> Surface:
    """Return the force without a name over displacement and speed, for the ``surfaces`` of an `Oscillator`."""
    rows, columns = SURFACE_SHAPE
    coefficients = tuple(
        Parameter(f"c{i}{j}", "N", 0.0, 5.0, step=0.05) for i in range(rows) for j in range(columns)
    )
    x, v = (
        reach * np.clip(2.0 * (np.arange(count) - 0.5) / (count - 2) - 1.0, -1.0, 1.0)
        for reach, count in zip(REACH, SURFACE_SHAPE, strict=True)
    )
    return Surface(
        "force",
        "a force",
        ("displacement in m", "speed in m/s"),
        coefficients,
        centres=tuple((float(a), UNIT_SPEED * float(np.sinh(b))) for a in x for b in v),
    )


def coefficients_of(surface: Array) -> dict[str, float]:
    """Return the values of the effect ``force`` whose coefficients are ``surface`` (rows, columns), in N."""
    return {f"c{i}{j}": float(value) for (i, j), value in np.ndenumerate(surface)}


def _value(effects: Effects, effect: str, parameter: str = "amplitude", absent: float = 0.0) -> float:
    return effects.get(effect, {}).get(parameter, absent)


def _terms(base: Mapping[str, float], effects: Effects) -> Terms:
    branches = effects.get("maxwell_two") or effects.get("maxwell") or {}
    return Terms(
        mass=base["mass"],
        damping=base["damping"],
        stiffness=base["stiffness"],
        start=base["start"],
        cubic=_value(effects, "cubic"),
        quadratic=_value(effects, "quadratic"),
        coulomb=_value(effects, "coulomb"),
        branch_stiffness=branches.get("amplitude", 0.0),
        branch_time=branches.get("tau", 1.0),
        second_ratio=branches.get("ratio", 0.0),
        second_time=branches.get("tau_two", 1.0),
        lag=_value(effects, "lag"),
        stop_stiffness=_value(effects, "stop"),
        stop_gap=_value(effects, "stop", "gap", inf),
    )


def _surface(effects: Effects) -> Array:
    rows, columns = SURFACE_SHAPE
    if "force" not in effects:
        return np.zeros((0, columns))
    return np.array([[_value(effects, "force", f"c{i}{j}") for j in range(columns)] for i in range(rows)])


@compiled
def _weights(u: float, count: int) -> tuple[int, tuple[float, float, float]]:
    """First index and values of the three quadratic B-splines at u in 0…1, with uniform knots."""
    s = min(max(u, 0.0), 1.0) * (count - 2)
    i = min(int(s), count - 3)
    t = s - i
    return i, (0.5 * (1.0 - t) ** 2, 0.5 + t * (1.0 - t), 0.5 * t * t)


@compiled
def _force(x: float, v: float, p: Any, surface: Array) -> float:
    """Spring, damper and every hidden force that has no memory, in N."""
    force = p.damping * v + x * (p.stiffness + x * (p.quadratic + x * p.cubic))
    if p.coulomb != 0.0:
        force += p.coulomb * np.tanh(v / FRICTION_SPEED)
    if p.stop_stiffness > 0.0 and abs(x) > p.stop_gap:
        force += p.stop_stiffness * (abs(x) - p.stop_gap) * np.sign(x)
    if len(surface) > 0:
        i, a = _weights(0.5 + 0.5 * x / REACH[0], SURFACE_SHAPE[0])
        j, b = _weights(0.5 + 0.5 * np.arcsinh(v / UNIT_SPEED) / REACH[1], SURFACE_SHAPE[1])
        for k in range(3):
            for n in range(3):
                force += surface[i + k, j + n] * a[k] * b[n]
    return force


@compiled
def _derivative(state: Any, drive: float, p: Any, surface: Array) -> Any:
    """d/dt of (x, v, dash-pot of the first branch, of the second)."""
    x, v, q1, q2 = state
    branches = p.branch_stiffness * ((x - q1) + p.second_ratio * (x - q2))
    acceleration = (drive - _force(x, v, p, surface) - branches) / p.mass
    return v, acceleration, (x - q1) / p.branch_time, (x - q2) / p.second_time


@compiled
def _moved(state: Any, h: float, rate: Any) -> Any:
    """The state after ``h`` s at a constant ``rate``."""
    return (
        state[0] + h * rate[0],
        state[1] + h * rate[1],
        state[2] + h * rate[2],
        state[3] + h * rate[3],
    )


@compiled_parallel
def _oscillate(drive: Array, dt: float, p: Any, surface: Array) -> Array:
    """Displacement and force on the ground (n, 2): a Runge-Kutta step of fourth order from sample to sample."""
    n = len(drive)
    out = np.empty((n, 2))
    state = (p.start, 0.0, p.start, p.start)
    seen = before = p.start
    tau = p.lag
    decay = np.exp(-dt / tau) if tau > 0.0 else 0.0
    for i in range(n):
        # A lag that is linear in τ at τ = 0: the response to a line between the samples.
        x = state[0]
        rate = (x - before) / dt
        seen = x - tau * rate + (seen - before + tau * rate) * decay
        before = x
        out[i, 0] = seen
        out[i, 1] = _force(x, state[1], p, surface) + p.branch_stiffness * (
            (x - state[2]) + p.second_ratio * (x - state[3])
        )
        if i + 1 < n:
            middle = 0.5 * (drive[i] + drive[i + 1])
            a = _derivative(state, drive[i], p, surface)
            b = _derivative(_moved(state, 0.5 * dt, a), middle, p, surface)
            c = _derivative(_moved(state, 0.5 * dt, b), middle, p, surface)
            d = _derivative(_moved(state, dt, c), drive[i + 1], p, surface)
            state = _moved(state, dt / 6.0, a)
            state = _moved(state, dt / 3.0, b)
            state = _moved(state, dt / 3.0, c)
            state = _moved(state, dt / 6.0, d)
    return out
