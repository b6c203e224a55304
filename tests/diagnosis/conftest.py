"""Small systems with hidden effects: what the engine is tried on, hundreds of times where needed."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace

import numpy as np
import pytest
from numba import njit

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

ROWS, COLUMNS = 8, 4  #: coefficients of the surface over (x, asinh v)
REACH, SWIFT = 0.04, 2.0  #: the surface's range: m, and asinh of a speed over 0.1 m/s


@njit(nogil=True)
def _weights(u: float, count: int) -> tuple[int, tuple[float, float, float]]:
    """First index and values of the three quadratic B-splines at u in 0…1, with uniform knots."""
    s = min(max(u, 0.0), 1.0) * (count - 2)
    i = min(int(s), count - 3)
    t = s - i
    return i, (0.5 * (1.0 - t) ** 2, 0.5 + t * (1.0 - t), 0.5 * t * t)


@njit(nogil=True)
def _force(x: float, v: float, p: Array, surface: Array) -> float:
    """Spring, damper and everything static that may be hidden, in N."""
    force = p[1] * v + x * (p[2] + x * (p[5] + x * p[4]))
    if p[6] != 0.0:
        force += p[6] * np.tanh(v / 0.005)
    if p[12] > 0.0 and abs(x) > p[13]:
        force += p[12] * (abs(x) - p[13]) * np.sign(x)
    if len(surface) > 0:
        i, a = _weights(0.5 + 0.5 * x / REACH, ROWS)
        j, b = _weights(0.5 + 0.5 * np.arcsinh(v / 0.1) / SWIFT, COLUMNS)
        for k in range(3):
            for n in range(3):
                force += surface[i + k, j + n] * a[k] * b[n]
    return force


@njit(nogil=True)
def _slope(s: tuple, f: float, p: Array, surface: Array) -> tuple:
    x, v, q1, q2 = s
    branches = p[7] * ((x - q1) + p[9] * (x - q2))
    return v, (f - _force(x, v, p, surface) - branches) / p[0], (x - q1) / p[8], (x - q2) / p[10]


@njit(nogil=True)
def _along(s: tuple, h: float, k: tuple) -> tuple:
    return s[0] + h * k[0], s[1] + h * k[1], s[2] + h * k[2], s[3] + h * k[3]


@njit(nogil=True)
def _oscillate(drive: Array, dt: float, p: Array, surface: Array) -> Array:
    """Displacement and force on the ground, (n, 2); RK4 with one step for each sample, a sensor with a lag."""
    n = len(drive)
    out = np.empty((n, 2))
    s = (p[3], 0.0, p[3], p[3])
    seen = before = p[3]
    tau = p[11]
    decay = np.exp(-dt / tau) if tau > 0.0 else 0.0
    for i in range(n):
        # A lag that is linear in τ at τ = 0: the response to a line between the samples.
        rate = (s[0] - before) / dt
        seen = s[0] - tau * rate + (seen - before + tau * rate) * decay
        before = s[0]
        out[i, 0] = seen
        out[i, 1] = _force(s[0], s[1], p, surface) + p[7] * ((s[0] - s[2]) + p[9] * (s[0] - s[3]))
        if i + 1 < n:
            middle = 0.5 * (drive[i] + drive[i + 1])
            a = _slope(s, drive[i], p, surface)
            b = _slope(_along(s, 0.5 * dt, a), middle, p, surface)
            c = _slope(_along(s, 0.5 * dt, b), middle, p, surface)
            d = _slope(_along(s, dt, c), drive[i + 1], p, surface)
            s = _along(_along(_along(_along(s, dt / 6.0, a), dt / 3.0, b), dt / 3.0, c), dt / 6.0, d)
    return out


def _effect(
    name: str, unit: str, spread: float, *, low: float = -np.inf, high: float = np.inf, **rest
) -> Hypothesis:
    rest.setdefault("family", "spring")
    return Hypothesis(
        name=name, title=name, amplitude=Parameter("amplitude", unit, 0.0, spread, low, high), **rest
    )


def _tau(name: str = "tau", nominal: float = 0.1) -> Parameter:
    return Parameter(name, "s", nominal, 1.5 * nominal, 0.01, 10.0, logarithmic=True)


CATALOGUE = {
    effect.name: effect
    for effect in (
        _effect("cubic", "N/m³", 2e6, confusers=("quadratic",)),
        _effect("quadratic", "N/m²", 2e4),
        _effect("coulomb", "N", 5.0, low=0.0, family="loss", confusers=("maxwell",)),
        _effect(
            "maxwell",
            "N/m",
            300.0,
            low=0.0,
            family="rubber",
            shapes=(_tau(),),
            grid=((0.02,), (0.1,), (0.5,)),
            confusers=("coulomb",),
            richer=("maxwell_two",),
        ),
        _effect(
            "maxwell_two",
            "N/m",
            300.0,
            low=0.0,
            family="rubber",
            shapes=(
                _tau("tau", 0.05),
                Parameter("ratio", "1", 1.0, 1.0, 0.05, 20.0, logarithmic=True),
                _tau("tau_two", 0.5),
            ),
            grid=((0.03, 1.0, 0.3), (0.03, 1.0, 1.0), (0.1, 1.0, 1.0)),
        ),
        _effect("lag", "s", 5e-3, low=0.0, family="sensor"),
        _effect("force_gain", "1", 0.02, family="sensor"),
        _effect("drift", "N/s", 0.1, family="sensor"),
    )
}


def _channels() -> tuple[Channel, ...]:
    return (
        Channel("displacement", "m", 5e-5, kind="displacement", display="mm", scale=1e-3),
        Channel("force", "N", 1.0, kind="force"),
    )


def _surface() -> Surface:
    coefficients = tuple(
        Parameter(f"c{i}{j}", "N", 0.0, 5.0, step=0.05) for i in range(ROWS) for j in range(COLUMNS)
    )
    x, v = (
        reach * np.clip(2.0 * (np.arange(count) - 0.5) / (count - 2) - 1.0, -1.0, 1.0)
        for reach, count in ((REACH, ROWS), (SWIFT, COLUMNS))
    )
    centres = tuple((float(a), float(b)) for a in x for b in v)
    return Surface(
        "force", "a force", ("displacement in m", "asinh of speed in 0.1 m/s"), coefficients, centres=centres
    )


@dataclass(frozen=True)
class Oscillator:
    """m ẍ + c ẋ + k x = f, with a catalogue of what may be missing. A stop is in no catalogue."""

    name: str = "oscillator"
    channels: tuple[Channel, ...] = field(default_factory=_channels)
    nuisances: tuple[Nuisance, ...] = (
        Nuisance("mass", "kg", 10.0, 0.1),
        Nuisance("damping", "N s/m", 30.0, 3.0, 0.0),
        Nuisance("stiffness", "N/m", 4000.0, 80.0),
        Nuisance("force_offset", "N", 0.0, 5.0),
        Nuisance("start", "m", 0.0, 1e-3, per_run=True),
    )
    catalogue: Mapping[str, Hypothesis] = field(default_factory=lambda: CATALOGUE)
    surfaces: tuple[Surface, ...] = ()

    def run(self, experiment: Experiment, parameters: Mapping[str, float], effects: Effects) -> Array:
        nuisance = {n.name: n.nominal for n in self.nuisances} | dict(parameters)

        def of(effect: str, name: str = "amplitude", default: float = 0.0) -> float:
            return effects.get(effect, {}).get(name, default)

        one, two = effects.get("maxwell"), effects.get("maxwell_two")
        branches = two or one or {}
        p = np.array(
            [
                nuisance["mass"],
                nuisance["damping"],
                nuisance["stiffness"],
                nuisance["start"],
                of("cubic"),
                of("quadratic"),
                of("coulomb"),
                branches.get("amplitude", 0.0),
                branches.get("tau", 1.0),
                branches.get("ratio", 0.0),
                branches.get("tau_two", 1.0),
                of("lag"),
                of("stop"),
                of("stop", "gap", 1.0),
            ]
        )
        surface = np.zeros((0, COLUMNS))
        if "force" in effects:
            surface = np.array([[of("force", f"c{i}{j}") for j in range(COLUMNS)] for i in range(ROWS)])
        out = _oscillate(experiment.inputs["drive"], experiment.step, p, surface)
        out[:, 1] *= 1.0 + of("force_gain")
        out[:, 1] += nuisance["force_offset"] + of("drift") * experiment.time
        return out


def _drives(n: int, dt: float) -> dict[str, Array]:
    t = dt * np.arange(n)
    rng = np.random.default_rng(7)

    def multisine(level: float, low: float, high: float) -> Array:
        f = np.linspace(low, high, 24)
        return level * sum(np.sin(2 * np.pi * (f_ * t + rng.uniform())) for f_ in f) / np.sqrt(12.0)

    sweep = 25.0 * np.sin(2 * np.pi * (0.3 * t + 0.5 * (5.0 - 0.3) / t[-1] * t**2))
    return {
        "slow": 60.0 * np.sin(2 * np.pi * 0.4 * t),
        "sweep": sweep,
        "noise small": multisine(15.0, 0.2, 8.0),
        "noise large": multisine(40.0, 0.2, 6.0),
        "report": multisine(30.0, 0.2, 7.0) + 20.0 * np.sin(2 * np.pi * 0.7 * t),
    }


ROLES: dict[str, Role] = {"noise large": "select", "report": "report"}


@dataclass(frozen=True)
class Laboratory:
    """Makes measurements of a system whose truth is hidden in them."""

    simulator: Oscillator = field(default_factory=Oscillator)
    samples: int = 1500
    dt: float = 0.01

    def experiments(self) -> list[Experiment]:
        t = self.dt * np.arange(self.samples)
        return [
            Experiment(name, t, {"drive": drive}, minutes=0.25)
            for name, drive in _drives(self.samples, self.dt).items()
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
        """Runs of a specimen whose nuisances are drawn from their priors; AR(1) noise of a ``colour``."""
        rng = np.random.default_rng(seed)
        shared = {
            n.name: n.nominal + n.spread * rng.standard_normal()
            for n in self.simulator.nuisances
            if not n.per_run
        }
        runs = []
        channels = self.simulator.channels
        for experiment in self.experiments():
            own = {
                n.name: n.nominal + n.spread * rng.standard_normal()
                for n in self.simulator.nuisances
                if n.per_run
            }
            outputs = self.simulator.run(experiment, shared | own, effects or {})
            for i, channel in enumerate(channels):
                noise = coloured(rng, len(outputs), colour)
                outputs[:, i] += loud * channel.noise * noise
                if quantised:
                    resolution = 2.0 * channel.noise
                    outputs[:, i] = resolution * np.round(outputs[:, i] / resolution)
            outputs[rng.random(len(outputs)) < dropped] = np.nan
            runs.append(
                MeasuredRun(
                    experiment,
                    outputs,
                    np.ones(len(outputs), bool),
                    np.zeros(len(outputs), bool),
                    ROLES.get(experiment.name, "fit"),
                )
            )
        if quantised:
            channels = tuple(replace(c, resolution=2.0 * c.noise) for c in channels)
        return Dataset(channels, tuple(runs))


def coloured(rng: np.random.Generator, n: int, colour: float) -> Array:
    """AR(1) noise (n,) of unit variance."""
    from scipy.signal import lfilter

    white = rng.standard_normal(n + 200) * np.sqrt(1.0 - colour**2)
    return lfilter([1.0], [1.0, -colour], white)[200:]


@pytest.fixture(scope="session")
def laboratory() -> Callable[..., Laboratory]:
    """Return the maker of laboratories."""
    return Laboratory


@pytest.fixture(scope="session")
def oscillator() -> Callable[..., Oscillator]:
    """Return the maker of oscillators."""
    return Oscillator


@pytest.fixture(scope="session")
def force_surface() -> Surface:
    """A force over (x, asinh v), which the oscillator takes as an unknown term."""
    return _surface()


@pytest.fixture(scope="session")
def ar1() -> Callable[[np.random.Generator, int, float], Array]:
    """AR(1) noise of unit variance."""
    return coloured


@pytest.fixture(scope="session")
def bench_record(tmp_path_factory):
    """Record stretches of motion on a virtual rig: ``directory`` of the record and the ``parameters`` without effects.

    ``effects`` are hidden in the rig, ``faults`` in its CAN; the sensors' biases are drawn from the seed.
    """
    from types import SimpleNamespace

    from astb.rig_in_memory import RigInMemory
    from bench_sim.parameters import load
    from bench_sim.parameters.effects import with_effects
    from bench_sim.rig.rig import Rig
    from test_plans.execution import execute
    from test_plans.loads import AW0
    from test_plans.motions import Part, Programme
    from test_plans.perform import programme_plan

    def make(name, stretches, *, effects=None, faults=None, seed=1, **changes):
        parameters = load("astb").with_values(**changes)
        rig = Rig(with_effects(parameters, effects or {}), seed=seed)
        directory = tmp_path_factory.mktemp(name)
        programme = Programme("short", "Short motions", (Part(AW0, tuple(stretches)),), "To be replayed.")
        with RigInMemory(rig).bench(faults=faults, seed=seed) as bench:
            result = execute(programme_plan(programme), bench, directory, seed=seed)
        assert result.verdict.value == "pass" or not stretches, result.reason
        return SimpleNamespace(directory=directory, parameters=parameters)

    return make
