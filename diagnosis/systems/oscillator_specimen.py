"""Measurements of a virtual oscillator with something hidden in it, with the noise of its sensors.

Five runs of different drives: three to be fitted, one to choose models by, one to tell the gain.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import Final

import numpy as np
from scipy.signal import lfilter

from diagnosis.contracts import Array, Channel, Dataset, Effects, Experiment, MeasuredRun, Role
from diagnosis.systems.oscillator import Oscillator

#: What the runs of other names than these are for: to be fitted.
ROLES: Final[Mapping[str, Role]] = MappingProxyType({"noise large": "select", "report": "report"})
#: Samples after which autoregressive noise has forgotten that it began at 0.
_FORGOTTEN: Final = 200


@dataclass(frozen=True)
class Laboratory:
    """Measures specimens of a ``simulator``: so many ``samples`` in each run, every ``dt`` s."""

    simulator: Oscillator = field(default_factory=Oscillator)
    samples: int = 1500
    dt: float = 0.01

    def experiments(self) -> list[Experiment]:
        """Return what is done with every specimen."""
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

        ``effects`` are hidden in it. ``colour`` is the AR(1) coefficient of the noise and ``loud`` its size over that
        of the data sheet; a part ``dropped`` of the samples is lost; ``quantised`` rounds to two standard deviations.
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
    """Return AR(1) noise (n,) of unit variance: each value remembers the one before by ``coefficient``."""
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
