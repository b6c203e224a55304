"""Readings of ideal sensors for each reading of a virtual rig, and the plans' results with them."""

from contextlib import contextmanager
from dataclasses import replace

import numpy as np
import pytest

from astb.rig_in_memory import RigInMemory
from bench_protocol.dimensions import LAGS, Dimensions, lag, ordinary
from bench_protocol.frames import Block, join
from bench_protocol.table import TABLE
from bench_protocol.units import NS
from bench_sim.model.layout import Sensor
from bench_sim.model.wiring import sensor_of
from bench_sim.parameters import Parameters
from bench_sim.parameters.dimensions import dimensions_of
from bench_sim.rig.controls import TICK_NS
from bench_sim.rig.rig import Rig
from drivers.link import Link
from drivers.receiver import Capture
from test_plans.description import Description
from test_plans.run import Run

#: The truth is written down this often: what lies between is on lines, alike for all that is compared.
EVERY = 4
#: Ticks that may be captured in one run.
MOST = 1_000_000


class Samples(np.ndarray):
    """Samples that keep the true values when some are chosen."""

    truth = None

    def __getitem__(self, chosen):
        found = super().__getitem__(chosen)
        if isinstance(found, np.ndarray) and self.truth is not None:
            found = found.view(Samples)
            found.truth = self.truth[chosen]
        return found


class Mean(float):
    """A mean with its true value."""

    truth: float


def samples(values, truth):
    found = values.view(Samples)
    found.truth = truth
    return found


def mean(value, truth):
    found = Mean(value)
    found.truth = truth
    return found


def exact_dimensions(parameters: Parameters) -> Dimensions:
    """Return the dimensions of a rig as they are, for ideal sensors, which are never late."""
    built = ordinary().built(dimensions_of(parameters))
    late = {lag(signal) for signal in LAGS}
    return replace(
        built,
        known={
            name: replace(one, value=0.0 if name in late else one.value) for name, one in built.known.items()
        },
    )


class Ideal:
    """A rig in memory whose ideal readings are stored during a capture.

    ``known`` is the truth of each value that a plan has measured, by the value.
    """

    def __init__(self, parameters: Parameters, seed: int, every: int = EVERY):
        self.rig, self.exact, self.ticks = Rig(parameters, seed=seed), exact_dimensions(parameters), 0
        self.every = every
        self.size, self.known = 0, {}
        self.times, self.rows = np.zeros(MOST, np.int64), np.zeros((MOST, len(Sensor)))
        self.memory = RigInMemory(self.rig, self.run)
        self.bench = self.memory.bench()

    def run(self, ticks: int) -> Block:
        if not self.bench.receiver._captures:
            self.ticks += ticks
            return self.rig.run(ticks)
        blocks = []
        while ticks > 0:
            some = min(ticks, self.every)
            blocks.append(self.rig.run(some))
            self.ticks, ticks = self.ticks + some, ticks - some
            self.times[self.size] = self.ticks * TICK_NS
            self.rows[self.size] = self.rig.plant.ideal()
            self.size += 1
        return join(blocks)

    def at(self, name, times):
        """Return the truth of ``name`` at ``times`` (ns)."""
        return np.interp(times, self.times[: self.size], self.rows[: self.size, sensor_of(name)])

    def with_truth(self, name, values, times):
        """Return samples with their truth; states and choices are true as they are."""
        if name not in TABLE.index or TABLE[name].group is None or not times.size:
            return values
        return samples(values, self.at(name, times))

    def true(self, evaluate, captures):
        """Return what an evaluation makes of true readings and exact dimensions, None where one is not known."""
        whole = []
        for one in captures:
            if isinstance(one, Description):
                whole.append(Description("exact", self.exact))
                continue
            whole.append({name: getattr(of, "truth", None) for name, of in one.items()})
            for name, of in one.items():
                if whole[-1][name] is None:
                    if name in TABLE.index and TABLE[name].group is not None:
                        return None
                    whole[-1][name] = of
        return np.atleast_1d(np.asarray(evaluate(*whole), float))


@contextmanager
def with_truth(ideal: Ideal):
    """Make readings of captures carry their true values; measured quantities have theirs in ``ideal.known``."""
    aligned, values, averages, measure = Capture.aligned, Capture.values, Link.averages, Run.measure

    def of_capture(self, name):
        at = self.start + np.round(self.times(name) * NS)
        return ideal.with_truth(name, values(self, name), at)

    def of_aligned(self, rate=200.0):
        grid, found = aligned(self, rate)
        at = self.start + np.round(grid * NS)
        return grid, {name: ideal.with_truth(name, of, at) for name, of in found.items()}

    def of_averages(self, *names, over=1.0):
        begun = self.clock.now()
        found = averages(self, *names, over=over)
        at = np.arange(begun, self.clock.now(), TICK_NS)
        return {
            name: mean(of, float(ideal.at(name, at).mean())) if TABLE[name].group is not None else of
            for name, of in found.items()
        }

    def plain(one):
        if isinstance(one, Description):
            return one
        return {name: np.asarray(of) if isinstance(of, np.ndarray) else of for name, of in one.items()}

    def of_measure(self, evaluate, *captures, **how):
        found = measure(self, evaluate, *map(plain, captures), **how)
        truth = ideal.true(evaluate, captures)
        if truth is not None:
            ideal.known |= {one.value: float(true) for one, true in zip(found, truth, strict=True)}
        return found

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Capture, "values", of_capture)
        patch.setattr(Capture, "aligned", of_aligned)
        patch.setattr(Link, "averages", of_averages)
        patch.setattr(Run, "measure", of_measure)
        yield
