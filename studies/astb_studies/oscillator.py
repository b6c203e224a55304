"""A mass on a spring with a damper: the smallest system for a diagnosis, and a template for your system.

    m ẍ + c ẋ + k x + (what may be hidden) = f(t)

The drive f is given; the displacement x and the force on the ground are measured. A system for a diagnosis is a class
with the attributes and the method `run` of `diagnosis.contracts.Simulator`; no base class and no registration are
needed. `OSCILLATOR_EFFECTS` are the possible missing causes. A `Laboratory` measures virtual specimens.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from math import inf
from types import MappingProxyType
from typing import Any, Final, NamedTuple

import numpy as np
from scipy.signal import lfilter

from bench_sim.model.compiled import compiled, compiled_parallel
from diagnosis.contracts import (
    Array,
    Channel,
    Dataset,
    Effects,
    Experiment,
    Hypothesis,
    MeasuredRun,
    Nuisance,
    Parameter,
    Role,
    Surface,
)


def _effect(
    name: str, unit: str, spread: float, *, family: str, low: float = -np.inf, **more: Any
) -> Hypothesis:
    amplitude = Parameter("amplitude", unit, 0.0, spread, low)
    return Hypothesis(name=name, family=family, title=name, amplitude=amplitude, **more)


def _time_constant(name: str, nominal: float) -> Parameter:
    return Parameter(name, "s", nominal, 1.5 * nominal, 0.01, 10.0, logarithmic=True)


_EFFECTS: Final = (
    _effect("cubic", "N/m³", 2e6, family="spring", confusers=("quadratic",), equation="F = a x³"),
    _effect("quadratic", "N/m²", 2e4, family="spring", equation="F = a x²"),
    _effect(
        "coulomb",
        "N",
        5.0,
        low=0.0,
        family="loss",
        confusers=("maxwell",),
        equation="F = a tanh(v/v_0)",
    ),
    _effect(
        "maxwell",
        "N/m",
        300.0,
        low=0.0,
        family="rubber",
        shapes=(_time_constant("tau", 0.1),),
        grid=((0.02,), (0.1,), (0.5,)),
        confusers=("coulomb",),
        richer=("maxwell_two",),
        phenomenon="relaxation of the rubber",
        equation="F = a (x − q), dq/dt = (x − q)/τ",
    ),
    _effect(
        "maxwell_two",
        "N/m",
        300.0,
        low=0.0,
        family="rubber",
        shapes=(
            _time_constant("tau", 0.05),
            Parameter("ratio", "1", 1.0, 1.0, 0.05, 20.0, logarithmic=True),
            _time_constant("tau_two", 0.5),
        ),
        grid=((0.03, 1.0, 0.3), (0.03, 1.0, 1.0), (0.1, 1.0, 1.0)),
        phenomenon="relaxation of the rubber",
        separated_by="free decays and slow sines, over two decades of frequency",
        equation="F = a ((x − q) + r (x − q_2)), dq/dt = (x − q)/τ, dq_2/dt = (x − q_2)/τ_2",
    ),
    _effect("lag", "s", 5e-3, low=0.0, family="sensor", equation="a ẋ_m + x_m = x"),
    _effect("force_gain", "1", 0.02, family="sensor", equation="F_m = (1 + a) F"),
    _effect("drift", "N/s", 0.1, family="sensor", equation="F_m = F + a t"),
)
#: Every cause by name.
OSCILLATOR_EFFECTS: Final[Mapping[str, Hypothesis]] = MappingProxyType(
    {effect.name: effect for effect in _EFFECTS}
)


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
    """The parameters of the equation of motion, in SI; a value of 0 removes its term."""

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

    In addition to its catalogue it accepts a ``stop`` (N/m) behind a ``gap`` (m), and a ``force`` given by the
    coefficients of `force_surface`: these are hidden terms that no candidate describes. With `force_surface` among its
    ``surfaces``, the engine may fit such a surface.
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


#: What the runs of other names than these are for: to be fitted.
ROLES: Final[Mapping[str, Role]] = MappingProxyType({"noise large": "select", "report": "report"})
#: Samples after which autoregressive noise has forgotten that it began at 0.
_FORGOTTEN: Final = 200


@dataclass(frozen=True)
class Laboratory:
    """Measures specimens of a ``simulator``, with ``samples`` samples in each run, one every ``dt`` s."""

    simulator: Oscillator = field(default_factory=Oscillator)
    samples: int = 1500
    dt: float = 0.01

    def experiments(self) -> list[Experiment]:
        """Return the experiments on every specimen."""
        time: Array = self.dt * np.arange(self.samples, dtype=np.float64)
        return [
            Experiment(name, time, {"drive": drive}, minutes=0.25) for name, drive in _drives(time).items()
        ]

    def measure(
        self,
        seed: int,
        effects: Effects | None = None,
        *,
        colour: float = 0.0,
        dropped: float = 0.0,
        quantised: bool = False,
        loud: float = 1.0,
    ) -> Dataset:
        """Return the runs of a specimen whose nuisances are drawn from their priors.

        The specimen has the hidden ``effects``. ``colour`` is the AR(1) coefficient of the noise, ``loud`` its size
        relative to the data sheet. A fraction ``dropped`` of the samples is lost; ``quantised`` rounds to two standard
        deviations.
        """
        rng = np.random.default_rng(seed)
        shared = self._drawn(rng, per_run=False)
        runs = []
        channels = self.simulator.channels
        for experiment in self.experiments():
            own = self._drawn(rng, per_run=True)
            outputs = self.simulator.run(experiment, shared | own, effects or {})
            for i, channel in enumerate(channels):
                outputs[:, i] += loud * channel.noise * ar1_noise(rng, len(outputs), colour)
                if quantised:
                    step = _quantised(channel).resolution
                    outputs[:, i] = step * np.round(outputs[:, i] / step)
            outputs[rng.random(len(outputs)) < dropped] = np.nan
            everywhere = np.ones(len(outputs), np.bool_)
            role = ROLES.get(experiment.name, "fit")
            runs.append(MeasuredRun(experiment, outputs, everywhere, ~everywhere, role))
        if quantised:
            channels = tuple(_quantised(channel) for channel in channels)
        return Dataset(channels, tuple(runs))

    def _drawn(self, rng: np.random.Generator, *, per_run: bool) -> dict[str, float]:
        return {
            nuisance.name: nuisance.nominal + nuisance.spread * rng.standard_normal()
            for nuisance in self.simulator.nuisances
            if nuisance.per_run == per_run
        }


def ar1_noise(rng: np.random.Generator, n: int, coefficient: float) -> Array:
    """Return AR(1) noise (n,) of unit variance: each value depends on the one before by ``coefficient``."""
    innovations = rng.standard_normal(n + _FORGOTTEN) * np.sqrt(1.0 - coefficient**2)
    noise: Array = lfilter([1.0], [1.0, -coefficient], innovations)[_FORGOTTEN:]
    return noise


def _quantised(channel: Channel) -> Channel:
    return replace(channel, resolution=2.0 * channel.noise)


def _drives(t: Array) -> dict[str, Array]:
    """The force (n,) over time by the name of the run, in N."""
    rng = np.random.default_rng(7)

    def multisine(level: float, low: float, high: float) -> Array:
        lines = [np.sin(2 * np.pi * (f * t + rng.uniform())) for f in np.linspace(low, high, 24)]
        return level * np.asarray(sum(lines)) / np.sqrt(12.0)

    return {
        "slow": 60.0 * np.sin(2 * np.pi * 0.4 * t),
        "sweep": 25.0 * np.sin(2 * np.pi * (0.3 * t + 0.5 * (5.0 - 0.3) / t[-1] * t**2)),
        "noise small": multisine(15.0, 0.2, 8.0),
        "noise large": multisine(40.0, 0.2, 6.0),
        "report": multisine(30.0, 0.2, 7.0) + 20.0 * np.sin(2 * np.pi * 0.7 * t),
    }
