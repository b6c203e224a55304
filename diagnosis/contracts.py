"""What the diagnosis asks of a simulator, of its effects and of its data; it knows nothing else of any of them.

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
    """Data, a map or a request that cannot be diagnosed; the text states what is wrong and what would be right."""


@dataclass(frozen=True, slots=True)
class Parameter:
    """One number of a model, with its unit, its prior (nominal value and spread) and its bounds."""

    name: str
    unit: str
    nominal: float
    spread: float  #: standard deviation of the prior; inf: there is none
    low: float = -math.inf
    high: float = math.inf
    step: float = 0.0  #: of finite differences, in units of the parameter; 0: a hundredth of the spread
    logarithmic: bool = False  #: fitted as its logarithm (time constants)
    display: str = ""  #: unit that people read, with ``scale`` SI per unit
    scale: float = 1.0
    #: The input along which it is a length, or "time". The step of this input between samples limits its resolution.
    along: str = ""

    @property
    def difference(self) -> float:
        """The step of a finite difference."""
        return self.step if self.step > 0.0 else 0.01 * self.spread


@dataclass(frozen=True, slots=True)
class Nuisance(Parameter):
    """A parameter of the base model that is refitted with every candidate.

    ``per_run``: each run has its own, such as the state it starts from; runs that are parts of one record share it.
    """

    per_run: bool = False


@dataclass(frozen=True, slots=True)
class Hypothesis:
    """An effect that the base model may lack, as the diagnosis tries it.

    ``amplitude`` is 0 where the effect is missing (its ``low`` is 0 where only one sign is physical); ``shapes`` are
    parameters that mean nothing while it is missing (a time constant), tried at the points of ``grid``.
    """

    name: str
    family: str
    title: str
    amplitude: Parameter
    shapes: tuple[Parameter, ...] = ()
    grid: tuple[tuple[float, ...], ...] = ((),)  #: each point has one value for each shape
    touches: frozenset[str] = frozenset()  #: of force, gas, flow, sensor, timing
    confusers: tuple[str, ...] = ()
    #: Members of the family that contain more: to be tried before another family.
    richer: tuple[str, ...] = ()
    equation: str = ""
    source: str = ""
    #: Amplitude that errors of the simulator itself, or of the way in which its inputs were measured, may imitate, as
    #: one standard deviation, for each point of the grid (none: 0). An effect of this size cannot be separated from
    #: them.
    imitated: tuple[float, ...] = ()
    #: Ratio of χ² in the directions of this effect: stretches of sound rigs over pure noise.
    overdispersion: float = 1.0
    plain: str = ""  #: consequence of the effect, a clause without full stop; "": the title is enough
    #: The phenomenon that it describes, such as "friction of the rubber", if the catalogue has several laws of it.
    phenomenon: str = ""
    separated_by: str = ""  #: the run that separates it from similar effects

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """Amplitude first, then the shapes."""
        return (self.amplitude, *self.shapes)

    @property
    def one_sided(self) -> bool:
        """Whether only one sign of the amplitude is physical."""
        return self.amplitude.low >= 0.0 or self.amplitude.high <= 0.0


@dataclass(frozen=True, slots=True)
class Surface:
    """A term without a name: a smooth surface over two states, as a sum of basis functions.

    A simulator takes its coefficients like the parameters of an effect, under the names of ``coefficients``.
    """

    name: str
    title: str
    coordinates: tuple[str, ...]  #: with units, e.g. "displacement in mm"
    coefficients: tuple[Parameter, ...]
    touches: frozenset[str] = frozenset()
    #: Where each basis function lies, in the units of ``coordinates``.
    centres: tuple[tuple[float, ...], ...] = ()


@dataclass(frozen=True, slots=True)
class Channel:
    """One measured output: ``noise`` and ``resolution`` as the data sheet says them (0: unknown), in SI."""

    name: str
    unit: str
    noise: float = 0.0
    resolution: float = 0.0
    kind: str = ""  #: force, pressure, temperature, displacement, …
    display: str = ""  #: unit that people read, with ``scale`` SI per unit
    scale: float = 1.0


@dataclass(frozen=True, slots=True, eq=False)
class Experiment:
    """Equidistant ``time`` (n,) and the inputs (n,) that drive the simulator, by name."""

    name: str
    time: Array
    inputs: Mapping[str, Array]
    settings: Mapping[str, float] = field(default_factory=dict)  #: constants of this run, e.g. the preload
    minutes: float = 0.0  #: what the run costs on the rig
    #: The record that this is a part of, replayed from where all of its parts begin; "": its own record.
    source: str = ""
    #: Inputs that keep their value until the next sample; the others are straight lines between samples.
    held: frozenset[str] = frozenset()

    @property
    def record(self) -> str:
        """The record whose nuisances are those of this run."""
        return self.source or self.name

    @property
    def step(self) -> float:
        """Sampling interval in s."""
        return float(self.time[1] - self.time[0])


@dataclass(frozen=True, slots=True, eq=False)
class MeasuredRun:
    """An experiment and its measured ``outputs`` (n, c), NaN where nothing was measured.

    ``scored`` (n,) leaves out stretches in which the model does not claim to hold, such as the first cycle that
    friction needs to forget; ``rest`` (n,) marks stretches without motion, which show the noise alone.
    """

    experiment: Experiment
    outputs: Array
    scored: NDArray[np.bool_]
    rest: NDArray[np.bool_]
    role: Role = "fit"

    @property
    def counted(self) -> NDArray[np.bool_]:
        """Which samples (n, c) count: measured and scored."""
        counted: NDArray[np.bool_] = self.scored[:, None] & np.isfinite(self.outputs)
        return counted


@dataclass(frozen=True, slots=True)
class DataQuality:
    """What a check of the data found in a column of a file, and what follows: a row of the table of data quality."""

    file: str
    column: str
    check: str
    count: int  #: of its ``samples``; of missing stretches, how many there are
    samples: int
    first: str  #: where in the file the first of them stands
    found: str
    consequence: str
    doubt: bool = False


@dataclass(frozen=True, slots=True, eq=False)
class Dataset:
    """Measured runs with the same channels; ``digest`` is the hash of the files they came from.

    ``quality`` holds the results of the data checks; its doubtful rows are among the ``doubts``. ``doubts`` are
    sentences on data that cannot be right; reports print them before the verdict. ``readings`` are sentences on how
    files were read and which rows were skipped. ``beside`` are runs of which only figures are compared
    (`CheckFigures`).
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
    """What plans measure on the rig, of which none was fitted: ``experiments`` are such plans as they are planned."""

    @property
    def experiments(self) -> Sequence[Experiment]: ...

    def states(self, nuisance: str) -> bool:
        """Return whether a planned experiment is given without the error that this nuisance represents."""

    def figures(self, experiment: Experiment, outputs: Mapping[str, Array]) -> Figures:
        """Return the figures that an experiment holds, of its ``outputs`` (n,) by channel; none if it holds none."""


#: Values of effects (and surfaces) by effect name and parameter name. What is not named is missing.
Effects = Mapping[str, Mapping[str, float]]


class Simulator(Protocol):
    """A model that replays experiments: pure, deterministic, fixed-step, without I/O.

    ``run`` returns the outputs (n, c) in the order of ``channels``. ``parameters`` holds every nuisance by name; what
    is missing has its nominal value. It may be called from several threads at once.
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
    """A simulator with all that one may offer together with ``run``: the base of those that offer any of it.

    Each has a default that does without. Others are completed by the engine (`diagnosis.engine.simulation.completed`).
    """

    name: str
    channels: tuple[Channel, ...]
    nuisances: tuple[Nuisance, ...]
    catalogue: Mapping[str, Hypothesis]
    surfaces: tuple[Surface, ...]

    #: Which one it is beyond doubt, such as the hash of its file; "": its name and the version of this project say it.
    identity: str = ""
    #: Fewest jobs that are worth a call of `run_many`: fewer hardly have anything to share.
    least_batch: int = 1
    #: Names of nuisances and effects that rough outputs do not distinguish : differences in them are never rough.
    too_alike: frozenset[str] = frozenset()
    #: Errors of its inputs that its nuisances imitate exactly, so that no data can show them. Each entry holds the
    #: shift of the nuisances by one standard deviation of the error, by name in their own units. For example, the zero
    #: of a height sensor changes every volume and area, and the outputs stay the same.
    unseen_errors: Sequence[Mapping[str, float]] = ()
    #: How nuisances are learnt otherwise, such as by a calibration: what to do, by the name of the nuisance.
    references: Mapping[str, str] = MappingProxyType({})

    def run(self, experiment: Experiment, parameters: Mapping[str, float], effects: Effects) -> Array:
        """Return the outputs (n, c) as `Simulator` says."""
        raise NotImplementedError

    def run_many(self, jobs: Sequence[Job]) -> Iterator[Array]:
        """Yield the outputs (n, c) of each job in order, as they are done; jobs may share intermediate results.

        They are those of ``run`` to within the rounding of the arithmetic. It may be called from several threads.
        """
        for job in jobs:
            yield self.run(job.experiment, job.parameters, job.effects)

    def run_roughly(self, jobs: Sequence[Job]) -> Iterator[Array | None]:
        """Yield outputs that are only good for being subtracted from each other, or None where they would not be.

        Their errors may be larger, such as those of a longer step, as long as those of neighbouring points are the
        same: difference quotients are as good as ever, to a few hundredths.
        """
        yield from (None for _ in jobs)

    def sharpened(self, runs: Sequence[MeasuredRun], channels: Sequence[Channel]) -> Mapping[str, Hypothesis]:
        """Return the hypotheses to be tried instead of those of their names in the catalogue; mostly none.

        These are shapes that no point of a grid would meet. The data show them before any fit. A period that repeats
        for minutes must be known to a part in a hundred thousand, or the effect explains nothing. ``channels`` are
        those of the runs' outputs.
        """
        return {}

    def counted(self, experiment: Experiment, outputs: Array) -> NDArray[np.bool_]:
        """Return which samples (n, c) of a planned experiment its record would count, if it had these ``outputs``."""
        return np.ones(outputs.shape, np.bool_)

    def parity(self, experiment: Experiment, outputs: Array) -> Mapping[str, Array]:
        """Return signals (n,) of outputs (n, c) that one subsystem alone can move, NaN where an output is."""
        return {}
