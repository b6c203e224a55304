"""Before step 1: reduce the dataset to the measured channels, and give every run a role."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from diagnosis.contracts import (
    Array,
    Channel,
    CompleteSimulator,
    Dataset,
    DiagnosisError,
    Effects,
    Experiment,
    Hypothesis,
    Job,
    MeasuredRun,
    Role,
    Simulator,
)
from diagnosis.engine.simulation import completed


class MeasuredChannels(CompleteSimulator):
    """A simulator reduced to the measured ``channels``."""

    def __init__(self, simulator: CompleteSimulator, channels: tuple[Channel, ...]) -> None:
        names = [channel.name for channel in simulator.channels]
        self._all = simulator
        self._places = [names.index(channel.name) for channel in channels]
        self.name, self.channels = simulator.name, channels
        self.nuisances, self.catalogue = simulator.nuisances, simulator.catalogue
        self.surfaces = simulator.surfaces
        self.too_alike, self.unseen_errors = simulator.too_alike, simulator.unseen_errors
        self.references, self.least_batch = simulator.references, simulator.least_batch

    def run(self, experiment: Experiment, parameters: Mapping[str, float], effects: Effects) -> Array:
        return self._all.run(experiment, parameters, effects)[:, self._places]

    def run_many(self, jobs: Sequence[Job]) -> Iterator[Array]:
        for outputs in self._all.run_many(jobs):
            yield outputs[:, self._places]

    def run_roughly(self, jobs: Sequence[Job]) -> Iterator[Array | None]:
        for outputs in self._all.run_roughly(jobs):
            yield None if outputs is None else outputs[:, self._places]

    def sharpened(self, runs: Sequence[MeasuredRun], channels: Sequence[Channel]) -> Mapping[str, Hypothesis]:
        return self._all.sharpened(runs, channels)

    def counted(self, experiment: Experiment, outputs: Array) -> NDArray[np.bool_]:
        everything = np.full((len(outputs), len(self._all.channels)), np.nan)
        everything[:, self._places] = outputs
        return self._all.counted(experiment, everything)[:, self._places]


def measured_channels(dataset: Dataset, simulator: Simulator) -> tuple[Dataset, CompleteSimulator]:
    """Return data and simulator reduced to the measured channels, with units and noise as in the data.

    Raises ``DiagnosisError`` for a channel that the simulator does not have, and if nothing was measured.
    """
    simulator = completed(simulator)
    names = [channel.name for channel in simulator.channels]
    for channel in dataset.channels:
        if channel.name not in names:
            raise DiagnosisError(
                f"the data have a channel {channel.name!r} that {simulator.name} does not predict; its channels are "
                + ", ".join(names)
            )
    keep = [i for i in range(len(dataset.channels)) if any(run.counted[:, i].any() for run in dataset.runs)]
    if not keep:
        raise DiagnosisError("no run has a measured sample that counts; add runs, or fewer ignored times")
    channels = tuple(dataset.channels[i] for i in keep)
    runs, beside = (
        tuple(replace(run, outputs=run.outputs[:, keep]) for run in some)
        for some in (dataset.runs, dataset.beside)
    )
    data = replace(dataset, channels=channels, runs=runs, beside=beside)
    if channels == simulator.channels:
        return data, simulator
    return data, MeasuredChannels(simulator, channels)


def split(dataset: Dataset, seed: int) -> Dataset:
    """Return the dataset with random roles for whole runs: about a fifth to select, a fifth to report, the others to
    fit.

    With one or two runs all are for the fit, because a second run is usually made to decide between causes. Raises
    ``DiagnosisError`` if there are no runs.
    """
    count = len(dataset.runs)
    if count == 0:
        raise DiagnosisError("the dataset holds no runs; add at least one")
    part = max(1, round(count / 5)) if count >= 3 else 0
    kept_back: tuple[Role, Role] = ("report", "select")
    others = [role for role in kept_back for _ in range(part)]
    order = np.random.default_rng(seed).permutation(count)
    roles: dict[int, Role] = dict(zip(order.tolist(), others, strict=False))
    return replace(
        dataset, runs=tuple(replace(run, role=roles.get(i, "fit")) for i, run in enumerate(dataset.runs))
    )
