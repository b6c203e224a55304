"""The interface of the diagnosis: simulators, their effects, and the measured data. The engine uses no other interface
of simulators and data.

Shapes: n samples, c channels, p parameters. All values are SI. Times are seconds from the start of a run.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Final, Literal, Protocol

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
#: Role of a run: *fit* runs fit parameters, *select* runs choose models, *report* runs measure the gain.
Role = Literal["fit", "select", "report"]
ROLES: Final[tuple[Role, ...]] = ("fit", "select", "report")


class DiagnosisError(ValueError):
    """Data, a map or a request that cannot be diagnosed. The text states the error and the correct form."""


@dataclass(frozen=True, slots=True)
class Parameter:
    """One number of a model, with its unit, its prior (nominal value and spread) and its bounds."""

    name: str
    unit: str
    nominal: float
    spread: float  #: standard deviation of the prior; inf: no prior
    low: float = -math.inf
    high: float = math.inf
    step: float = 0.0  #: of finite differences, in units of the parameter; 0: a hundredth of the spread
    logarithmic: bool = False  #: fitted as its logarithm (time constants)
    display: str = ""  #: unit that people read, with ``scale`` SI per unit
    scale: float = 1.0
    #: The input along which it is a length, or "time". The step of this input between samples limits its resolution.
    along: str = ""
    title: str = ""  #: in texts; "": the name

    @property
    def difference(self) -> float:
        """The step of a finite difference, in the unit of the parameter."""
        return self.step if self.step > 0.0 else 0.01 * self.spread


@dataclass(frozen=True, slots=True)
class Nuisance(Parameter):
    """A parameter of the base model that is refitted with every candidate.

    ``per_run``: each run has its own value, for example its initial state. Parts of one record share the value.
    """

    per_run: bool = False


@dataclass(frozen=True, slots=True)
class Hypothesis:
    """An effect that the base model may lack. The diagnosis tests each hypothesis.

    ``amplitude`` is 0 if the effect is missing. The ``low`` of the amplitude is 0 if only a positive amplitude is
    physical. ``shapes`` are parameters without meaning at amplitude 0, such as a time constant. The fit starts from
    each point of ``grid`` for the shapes.
    """

    name: str
    family: str
    title: str
    amplitude: Parameter
    shapes: tuple[Parameter, ...] = ()
    grid: tuple[tuple[float, ...], ...] = ((),)  #: each point has one value for each shape
    touches: frozenset[str] = frozenset()  #: of force, gas, flow, sensor, timing
    confusers: tuple[str, ...] = ()
    #: Members of the family that include this effect. They are tested before other families.
    richer: tuple[str, ...] = ()
    equation: str = ""
    source: str = ""
    #: Amplitude that errors of the simulator itself, or of the way in which its inputs were measured, may imitate, as
    #: one standard deviation, for each point of the grid (none: 0). An effect of this size cannot be separated from
    #: them.
    imitated: tuple[float, ...] = ()
    #: Ratio of χ² in the directions of this effect: stretches of sound rigs over pure noise.
    overdispersion: float = 1.0
    plain: str = ""  #: consequence of the effect, a clause without full stop; "": use the title
    #: The phenomenon, such as "friction of the rubber", if the catalogue has several laws for it.
    phenomenon: str = ""
    separated_by: str = ""  #: the run that separates it from similar effects

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """The amplitude, then the shapes."""
        return (self.amplitude, *self.shapes)

    @property
    def one_sided(self) -> bool:
        """Whether only one sign of the amplitude is physical."""
        return self.amplitude.low >= 0.0 or self.amplitude.high <= 0.0


@dataclass(frozen=True, slots=True)
class Surface:
    """An unknown term of the model: a smooth surface over two states, as a sum of basis functions.

    A simulator receives the coefficients like the parameters of an effect, under the names of ``coefficients``.
    """

    name: str
    title: str
    coordinates: tuple[str, ...]  #: with units, e.g. "displacement in mm"
    coefficients: tuple[Parameter, ...]
    touches: frozenset[str] = frozenset()
    #: Centre of each basis function, in the units of ``coordinates``.
    centres: tuple[tuple[float, ...], ...] = ()


@dataclass(frozen=True, slots=True)
class Channel:
    """One measured output. ``noise`` and ``resolution`` are from the data sheet, in SI (0: unknown)."""

    name: str
    unit: str
    noise: float = 0.0
    resolution: float = 0.0
    kind: str = ""  #: force, pressure, temperature, displacement, …
    display: str = ""  #: unit that people read, with ``scale`` SI per unit
    scale: float = 1.0


@dataclass(frozen=True, slots=True, eq=False)
class Experiment:
    """One run: equidistant ``time`` (n,), and the inputs (n,) by name that drive the simulator."""

    name: str
    time: Array
    inputs: Mapping[str, Array]
    settings: Mapping[str, float] = field(default_factory=dict)  #: constants of this run, e.g. the preload
    minutes: float = 0.0  #: duration of the run on the rig
    #: The record that this run is a part of. The replay starts with the first part. "": a record of its own.
    source: str = ""
    #: Inputs that keep their value until the next sample; the others are straight lines between samples.
    held: frozenset[str] = frozenset()

    @property
    def record(self) -> str:
        """The name of the record that this run belongs to. Runs of one record have the same values of their own
        nuisances.
        """
        return self.source or self.name

    @property
    def step(self) -> float:
        """Sampling interval in s."""
        return float(self.time[1] - self.time[0])


@dataclass(frozen=True, slots=True, eq=False)
class MeasuredRun:
    """An experiment and its measured ``outputs`` (n, c), NaN where nothing was measured.

    ``scored`` (n,) is False where the model is not valid, for example in the first cycle of friction after a
    standstill. ``rest`` (n,) is True in stretches without motion, which show only the noise.
    """

    experiment: Experiment
    outputs: Array
    scored: NDArray[np.bool_]
    rest: NDArray[np.bool_]
    role: Role = "fit"

    @property
    def counted(self) -> NDArray[np.bool_]:
        """A mask of the samples (n, c) that count: measured and scored."""
        counted: NDArray[np.bool_] = self.scored[:, None] & np.isfinite(self.outputs)
        return counted


@dataclass(frozen=True, slots=True)
class DataQuality:
    """One row of the table of data quality: the result of a check of a column, and its consequence."""

    file: str
    column: str
    check: str
    count: int  #: of its ``samples``; of missing stretches, how many there are
    samples: int
    first: str  #: position of the first one in the file
    found: str
    consequence: str
    doubt: bool = False


@dataclass(frozen=True, slots=True, eq=False)
class Dataset:
    """Measured runs with the same channels. ``digest`` is the hash of their files.

    ``quality`` holds the results of the data checks; its doubtful rows are also in ``doubts``. ``doubts`` are sentences
    on data that cannot be correct; reports print them before the verdict. ``readings`` are sentences on how files were
    read and which rows were skipped. For the runs in ``beside`` only figures are compared (`CheckFigures`).
    """

    channels: tuple[Channel, ...]
    runs: tuple[MeasuredRun, ...]
    digest: str = ""
    sources: tuple[str, ...] = ()
    doubts: tuple[str, ...] = ()
    readings: tuple[str, ...] = ()
    quality: tuple[DataQuality, ...] = ()
    beside: tuple[MeasuredRun, ...] = ()

    def of(self, *roles: Role) -> tuple[MeasuredRun, ...]:
        """Return the runs that have one of the roles."""
        return tuple(run for run in self.runs if run.role in roles)


#: Figures of checks by name and unit.
Figures = Mapping[tuple[str, str], float]


class CheckFigures(Protocol):
    """Computes the figures that test plans measure on the rig. The fit does not use them. ``experiments`` are the runs
    of these plans, as planned.
    """

    @property
    def experiments(self) -> Sequence[Experiment]: ...

    def states(self, nuisance: str) -> bool:
        """Return whether planned experiments are free of the error that this nuisance represents."""

    def figures(self, experiment: Experiment, outputs: Mapping[str, Array]) -> Figures:
        """Return the figures of an experiment, computed from its ``outputs`` (n,) by channel; empty if it has none."""


#: Values of effects (and surfaces) by effect name and parameter name. Effects that are not named are missing.
Effects = Mapping[str, Mapping[str, float]]


class Simulator(Protocol):
    """A model that simulates experiments in fixed time steps. Equal arguments give equal results. It reads and writes
    no files and has no other side effects.

    ``run`` returns the outputs (n, c) in the order of ``channels``. ``parameters`` holds nuisances by name; a missing
    one has its nominal value. Several threads may call ``run`` at once.
    """

    @property
    def name(self) -> str: ...

    @property
    def channels(self) -> tuple[Channel, ...]: ...

    @property
    def nuisances(self) -> tuple[Nuisance, ...]: ...

    @property
    def catalogue(self) -> Mapping[str, Hypothesis]: ...

    @property
    def surfaces(self) -> tuple[Surface, ...]: ...

    def run(self, experiment: Experiment, parameters: Mapping[str, float], effects: Effects) -> Array: ...


@dataclass(frozen=True, slots=True, eq=False)
class Job:
    """One call of `Simulator.run`."""

    experiment: Experiment
    parameters: Mapping[str, float]
    effects: Effects


class CompleteSimulator:
    """Base class for simulators that offer more than ``run``. All further members are optional and have a default.

    `diagnosis.engine.simulation.completed` adds the defaults to other simulators.
    """

    name: str
    channels: tuple[Channel, ...]
    nuisances: tuple[Nuisance, ...]
    catalogue: Mapping[str, Hypothesis]
    surfaces: tuple[Surface, ...]

    #: A unique identity, such as the hash of its file; "": its name and the version of this project are enough.
    identity: str = ""
    #: Fewest jobs for a call of `run_many`. Fewer jobs share too little.
    least_batch: int = 1
    #: Nuisances and effects that approximate outputs do not distinguish. Their differences use exact outputs.
    too_alike: frozenset[str] = frozenset()
    #: Errors of its inputs that its nuisances imitate exactly, so that no data can show them. Each entry holds the
    #: shift of the nuisances by one standard deviation of the error, by name in their own units. For example, the zero
    #: of a height sensor changes every volume and area, and the outputs stay the same.
    unseen_errors: Sequence[Mapping[str, float]] = ()
    #: Other ways to determine a nuisance, such as a calibration: instructions by name of the nuisance.
    references: Mapping[str, str] = MappingProxyType({})

    def run(self, experiment: Experiment, parameters: Mapping[str, float], effects: Effects) -> Array:
        """Return the outputs (n, c), see `Simulator`."""
        raise NotImplementedError

    def run_many(self, jobs: Sequence[Job]) -> Iterator[Array]:
        """Yield the outputs (n, c) of each job, in the order of the jobs. Jobs may share intermediate results.

        The outputs equal those of ``run``, except for rounding errors. Several threads may call this at once.
        """
        for job in jobs:
            yield self.run(job.experiment, job.parameters, job.effects)

    def run_roughly(self, jobs: Sequence[Job]) -> Iterator[Array | None]:
        """Yield approximate outputs of each job; None if the simulator has no approximation. Only their differences
        between jobs are used.

        The outputs may have a larger error, for example from a longer step, if neighbouring points have the same error.
        Then the difference quotients are still accurate to a few hundredths.
        """
        yield from (None for _ in jobs)

    def sharpened(self, runs: Sequence[MeasuredRun], channels: Sequence[Channel]) -> Mapping[str, Hypothesis]:
        """Return hypotheses that replace those of the same name in the catalogue; usually none.

        Use this for shapes that need a finer grid than the catalogue has, and that the data show before any fit. For
        example, a period that repeats for minutes must be known to 1 in 100 000, or the effect explains nothing.
        ``channels`` are those of the outputs of ``runs``.
        """
        return {}

    def counted(self, experiment: Experiment, outputs: Array) -> NDArray[np.bool_]:
        """Return a mask (n, c) for a planned experiment with these ``outputs``: True for the samples that the diagnosis
        would use in a record.
        """
        return np.ones(outputs.shape, np.bool_)

    def parity(self, experiment: Experiment, outputs: Array) -> Mapping[str, Array]:
        """Return signals (n,) that only one subsystem can change, computed from the outputs (n, c). A signal is NaN
        where an output is NaN.
        """
        return {}
