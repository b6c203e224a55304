"""Before step 1: the runs of a dataset with only the channels that were measured, and with a role for every run."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from diagnosis.contracts import (
    Array,
    BatchSimulator,
    Channel,
    Dataset,
    DiagnosisError,
    Effects,
    Experiment,
    HasRecords,
    HasReferences,
    HasUnseenErrors,
    Hypothesis,
    Job,
    Nuisance,
    Role,
    RoughSimulator,
    Simulator,
    Surface,
)


@dataclass(frozen=True, slots=True)
class MeasuredChannels:
    """A simulator that predicts only the channels which were measured."""

    simulator: Simulator
    channels: tuple[Channel, ...]
    places: tuple[int, ...]

    @property
    def name(self) -> str:
        return self.simulator.name

    @property
    def nuisances(self) -> tuple[Nuisance, ...]:
        return self.simulator.nuisances

    @property
    def catalogue(self) -> Mapping[str, Hypothesis]:
        return self.simulator.catalogue

    @property
    def surfaces(self) -> tuple[Surface, ...]:
        return self.simulator.surfaces

    @property
    def unseen_errors(self) -> Sequence[Mapping[str, float]]:
        return self.simulator.unseen_errors if isinstance(self.simulator, HasUnseenErrors) else ()

    @property
    def references(self) -> Mapping[str, str]:
        return self.simulator.references if isinstance(self.simulator, HasReferences) else {}

    def counted(self, experiment: Experiment, outputs: Array) -> NDArray[np.bool_]:
        if not isinstance(self.simulator, HasRecords):
            return np.ones(outputs.shape, np.bool_)
        everything = np.full((len(outputs), len(self.simulator.channels)), np.nan)
        everything[:, list(self.places)] = outputs
        return self.simulator.counted(experiment, everything)[:, list(self.places)]

    def run(self, experiment: Experiment, parameters: Mapping[str, float], effects: Effects) -> Array:
        return self.simulator.run(experiment, parameters, effects)[:, list(self.places)]


@dataclass(frozen=True, slots=True)
class MeasuredBatch(MeasuredChannels):
    """The same of a simulator that can do many jobs at once."""

    batch: BatchSimulator

    def run_many(self, jobs: Sequence[Job]) -> Iterator[Array]:
        places = list(self.places)
        for outputs in self.batch.run_many(jobs):
            yield outputs[:, places]


@dataclass(frozen=True, slots=True)
class MeasuredRough(MeasuredBatch):
    """The same of a simulator that can also do them roughly."""

    rough: RoughSimulator

    @property
    def too_alike(self) -> frozenset[str]:
        return self.rough.too_alike

    def run_roughly(self, jobs: Sequence[Job]) -> Iterator[Array | None]:
        places = list(self.places)
        for outputs in self.rough.run_roughly(jobs):
            yield None if outputs is None else outputs[:, places]


def measured_channels(dataset: Dataset, simulator: Simulator) -> tuple[Dataset, Simulator]:
    """Return data and simulator with the channels of the data that hold anything, as the data describe them.

    Raises ``DiagnosisError`` for a channel that the simulator does not have, and where nothing was measured.
    """
    names = [channel.name for channel in simulator.channels]
    for channel in dataset.channels:
        if channel.name not in names:
            raise DiagnosisError(
                f"the data have a channel {channel.name!r} that {simulator.name} does not predict; it has "
                + ", ".join(names)
            )
    keep = [i for i in range(len(dataset.channels)) if any(run.counted[:, i].any() for run in dataset.runs)]
    if not keep:
        raise DiagnosisError("no run holds a single measured and scored sample: there is nothing to diagnose")
    channels = tuple(dataset.channels[i] for i in keep)
    runs = tuple(replace(run, outputs=run.outputs[:, keep]) for run in dataset.runs)
    data = replace(dataset, channels=channels, runs=runs)
    if channels == simulator.channels:
        return data, simulator
    places = tuple(names.index(channel.name) for channel in channels)
    if isinstance(simulator, RoughSimulator):
        return data, MeasuredRough(simulator, channels, places, simulator, simulator)
    if isinstance(simulator, BatchSimulator):
        return data, MeasuredBatch(simulator, channels, places, simulator)
    return data, MeasuredChannels(simulator, channels, places)


def split(dataset: Dataset, seed: int) -> Dataset:
    """Return the dataset with roles drawn by whole runs: about a fifth to select and a fifth to report.

    One run or two are all fitted: a second one was made to decide what the first left open.
    """
    count = len(dataset.runs)
    if count == 0:
        raise DiagnosisError("the dataset holds no runs")
    part = max(1, round(count / 5)) if count >= 3 else 0
    kept_back: tuple[Role, Role] = ("report", "select")
    others = [role for role in kept_back for _ in range(part)]
    order = np.random.default_rng(seed).permutation(count)
    roles: dict[int, Role] = dict(zip(order.tolist(), others, strict=False))
    return replace(
        dataset, runs=tuple(replace(run, role=roles.get(i, "fit")) for i, run in enumerate(dataset.runs))
    )
