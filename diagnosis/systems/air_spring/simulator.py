"""The bench of two air springs as a system to be diagnosed: the model replays the measured motion.

Inputs of an experiment (SI, gauge pressures): ``left.height`` and ``right.height`` of the springs; ``shear``, the
lateral displacement of their top plates relative to the platform, and ``lateral.give``, the deflection of the lateral
actuator's frame that is included in it; ``platform.vertical``, ``.lateral`` and ``.roll``; the valves as 0 … 1,
``left.leveling``, ``left.reservoir`` (and right), ``dpv``; ``supply.pressure``; ``lateral.acceleration`` of the
bolster. Only the heights are required.

Settings: ``left.bellows_pressure``, ``left.auxiliary_pressure`` (and right) at the start, the temperatures of the same
chambers, the common ``wall_temperature``, ``nominal_preload``, ``orifice_diameter``, ``pipe_length``, and ``start``,
the time (s) since the bench was switched on, which determines sensor drift; and the history of the springs
(`diagnosis.systems.air_spring.history`). Only the bellows' pressures are required. An experiment that begins in a
motion has `MOVING`. One whose effects begin at its start has `BEFORE`. A planned one has ``conditioned``, the time (s)
from which on its record would count.
"""

from collections import Counter, OrderedDict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from threading import Lock
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from bench_protocol.signals import Group
from bench_protocol.table import TABLE
from bench_protocol.table_signals import BY_GROUP
from bench_protocol.units import UNITS
from bench_sim.model.effects import effect as bench
from bench_sim.model.layout import Sensor
from bench_sim.model.quantities import PARAMETERS
from bench_sim.model.replay import DIRECTIONS, STEP, Gas, ParameterChanges, replay
from bench_sim.model.wiring import sensor_of
from bench_sim.parameters import Parameters
from bench_sim.parameters.effects import find_effect
from diagnosis.contracts import (
    Array,
    Channel,
    CompleteSimulator,
    Effects,
    Experiment,
    Hypothesis,
    Job,
    MeasuredRun,
    Nuisance,
    Surface,
)
from diagnosis.systems.air_spring import history
from diagnosis.systems.air_spring.batch import Replayed, read_all
from diagnosis.systems.air_spring.gas import BEFORE, gas_that_was_read, kept
from diagnosis.systems.air_spring.parameters import (
    DRAG,
    SEAT,
    SHEAR,
    SUPPLY,
    deviate,
    hypotheses,
    locate,
    nuisances,
    zeros_of_heights,
)
from diagnosis.systems.air_spring.parity import parity
from diagnosis.systems.air_spring.runs import PreparedRun
from diagnosis.systems.air_spring.surfaces import TERMS
from diagnosis.systems.counted import counted_if_recorded
from diagnosis.systems.held_samples import ChannelErrors, errors_of, held_period, of_period
from diagnosis.systems.system import KINDS

#: Everything that the model predicts from an imposed motion, by the name of its signal.
OUTPUTS: Final[Mapping[str, Sensor]] = {
    name: sensor_of(name)
    for name in (
        *BY_GROUP[Group.PRESSURE],
        *BY_GROUP[Group.VERTICAL_LOAD_CELL],
        *BY_GROUP[Group.LATERAL_LOAD_CELL],
        *BY_GROUP[Group.VERTICAL_FORCE],
        *BY_GROUP[Group.LATERAL_FORCE],
        "vertical_left.displacement",
        "vertical_right.displacement",
        *BY_GROUP[Group.TEMPERATURE],
    )
}
#: Display unit of the errors of a channel, by its SI unit.
_DISPLAYED: Final = {"Pa": "mbar", "N": "N", "m": "mm", "K": "K"}
#: Nuisances that shift a reading, by a constant or in proportion to the speed, and need no simulation.
_SHIFTS: Final = (".offset", SEAT, DRAG)
#: Offsets of sensors from whose readings a replay starts or is driven: these change the simulation.
_PHYSICAL: Final = (
    "_pressure.offset",
    "_temperature.offset",
    f"{SUPPLY}.offset",
    f"{SHEAR}.offset",
    f"{SHEAR}{SEAT}",
)
#: The effect whose period is found in the readings.
_HELD: Final = "sample_and_hold"
#: A narrower orifice on both sides is nearly the same as on each side: the difference is a hundredth.
_TOO_ALIKE: Final = frozenset(
    {
        "discharge",
        *(f"blocked_orifice.{side}" for side in bench.PLACES),
        *(f"{side}.discharge_coefficient" for side in bench.PLACES),
    }
)
#: Sizes of the caches of prepared experiments, and of outputs of each: with two, offsets vary without a simulation.
_PREPARED, _OUTPUTS = 64, 2


def channels(parameters: Parameters) -> tuple[Channel, ...]:
    """Return the output channels, with the noise of the sensors and the resolution of sensor or bus, whichever is
    coarser.
    """
    record = parameters.record
    steps = {field.signal: field.step for message in TABLE.messages for field in message.fields}
    found = []
    for name, sensor in OUTPUTS.items():
        unit = UNITS[TABLE[name].unit].si
        resolution = max(float(record.sensor_resolution[sensor]), steps[name] or TABLE[name].step)
        display = _DISPLAYED[unit]
        found.append(
            Channel(
                name,
                unit,
                float(record.sensor_noise[sensor]),
                resolution,
                KINDS[unit],
                display,
                UNITS[display].factor,
            )
        )
    return tuple(found)


class AirSpring(CompleteSimulator):
    """The bench as a simulator, with a parameter set and its catalogue of effects. Steps are at most ``step`` s.

    Effects of the set are part of the base model and no candidates. Several threads may use it at once. ``only`` names
    the measured outputs (default: all).
    """

    too_alike = _TOO_ALIKE
    least_batch = 4

    def __init__(
        self,
        parameters: Parameters,
        *,
        effects: Mapping[str, bench.Effect],
        only: tuple[str, ...] = tuple(OUTPUTS),
        step: float = STEP,
    ) -> None:
        self.parameters = parameters
        self.step = step
        self.channels: tuple[Channel, ...] = tuple(c for c in channels(parameters) if c.name in only)
        self._sensors = [OUTPUTS[channel.name] for channel in self.channels]
        self._zeros = [(f"{channel.name}.offset", f"{channel.name}{SEAT}") for channel in self.channels]
        self._places = {channel.name: k for k, channel in enumerate(self.channels)}
        self._effects = effects
        held = parameters.effects
        self.name = "air springs on the bench" + (f" with {', '.join(held)}" if held else "")
        self._bare = replace(parameters, effects={}).record
        self._terms = {name: term.over(parameters.record) for name, term in TERMS.items()}
        self.catalogue: Mapping[str, Hypothesis] = hypotheses(effects, self._has_room)
        self.nuisances: tuple[Nuisance, ...] = nuisances(
            parameters, tuple(zip(self.channels, self._sensors, strict=True))
        )
        self.surfaces: tuple[Surface, ...] = tuple(term.surface for term in self._terms.values())
        self.unseen_errors: tuple[Mapping[str, float], ...] = zeros_of_heights(parameters)
        #: What `run_many` has done so far (`diagnosis.systems.air_spring.batch.read_all`), and for how many ``jobs``.
        self.effort: Counter[str] = Counter()
        self._lock = Lock()
        self._prepared: OrderedDict[int, PreparedRun] = OrderedDict()

    def forget(self) -> None:
        """Clear the cache of experiments, which takes some hundred MB."""
        with self._lock:
            self._prepared.clear()

    def counted(self, experiment: Experiment, outputs: Array) -> NDArray[np.bool_]:
        """Return a mask (n, c) for a planned experiment: True for samples that would count in its record
        (`diagnosis.contracts`).
        """
        return counted_if_recorded(experiment, outputs, self.channels, self.parameters.record)

    def run(self, experiment: Experiment, parameters: Mapping[str, float], effects: Effects) -> Array:
        """Return the outputs (n, c): readings of the sensors without noise."""
        prepared = self._prepare(experiment)
        simulated = _simulated(parameters)
        key = _simulation_key(simulated, effects)
        with self._lock:
            outputs = prepared.outputs.get(key)
        if outputs is None:
            outputs = self._simulate(experiment, prepared, simulated, effects)
            with self._lock:
                prepared.outputs[key] = outputs
                while len(prepared.outputs) > _OUTPUTS:
                    prepared.outputs.popitem(last=False)
        return self._shifted(prepared, outputs, parameters)

    def run_many(self, jobs: Sequence[Job]) -> Iterator[Array]:
        """Yield the outputs (n, c) of each job in order. Springs are integrated in parallel lanes; equal ones are
        integrated once.

        The outputs equal those of ``run`` within thousandths of a pascal and tenths of a millinewton, the tolerance of
        Newton's method.
        """
        for outputs in self._run_many(jobs, rough=False):
            assert outputs is not None  # what no lane can do is replayed alone
            yield outputs

    def run_roughly(self, jobs: Sequence[Job]) -> Iterator[Array | None]:
        """Yield the outputs (n, c) of each job in order, computed with twice the step; None for jobs that lanes cannot
        compute.

        The error of the longer step is some tenths of the noise, and nearly the same at a neighbouring point. A
        difference quotient has a norm of thousands of times the noise; its error is about a tenth of the noise.
        """
        return self._run_many(jobs, rough=True)

    def _run_many(self, jobs: Sequence[Job], *, rough: bool) -> Iterator[Array | None]:
        replayed: dict[object, Replayed] = {}
        known = [self._replayed(job, replayed, rough) for job in jobs]
        effort = Counter(jobs=len(jobs))
        for job, readings in zip(jobs, read_all(known, effort), strict=True):
            if readings is None:
                yield None
                continue
            yield self._shifted(self._prepare(job.experiment), readings, job.parameters)
        with self._lock:
            self.effort.update(effort)

    def run_turning(
        self,
        experiment: Experiment,
        effect: str,
        values: Sequence[Mapping[str, float]],
        since: NDArray[np.intp],
    ) -> Array:
        """Return the outputs (n, c) of a bench whose effect changes during the run: to the ``values`` (m,) at the
        samples ``since`` (m,).

        The first value applies from sample 0 and must not be 0, because a delay must exist from the start.
        """
        records = np.array([self.record(experiment, {}, {effect: one}) for one in values], PARAMETERS)
        first, later = records.view(np.recarray)[0], ParameterChanges(since[1:], records[1:])
        of = np.searchsorted(since, np.arange(len(experiment.time)), "right") - 1
        prepared = self._prepare(experiment).moved_by_each(records.view(np.recarray), of)
        return self._replay(prepared, first, self._gas(experiment, {}, first), 0.0, 0.0, later)

    def record(self, experiment: Experiment, parameters: Mapping[str, float], effects: Effects) -> Any:
        """Return the parameter record of a model: the parameter set with the load of the experiment, its deviations and
        effects.

        Effects are applied last, those of the set first, because they change the spring relative to its state without
        them.
        """
        record = np.array([self._bare], PARAMETERS).view(np.recarray)[0]
        for name in ("nominal_preload", "orifice_diameter", "pipe_length"):
            if name in experiment.settings:
                record[name][:] = experiment.settings[name]
        if "wall_temperature" in experiment.settings:
            record.wall_temperature_offset = (
                experiment.settings["wall_temperature"] - record.ambient_temperature
            )
        deviate(record, parameters, leveling=self._prepare(experiment).fed)
        for name, values in self.parameters.effects.items():
            effect, place = find_effect(name)
            effect.change(record, place, values)
        for name, values in effects.items():
            if name in self._terms:
                self._terms[name].write(record, values)
                continue
            effect, place = locate(name, self._effects)
            effect.change(record, place, values)
        return record

    def parity(self, experiment: Experiment, outputs: Array) -> Mapping[str, Array]:
        """Return signals (n,) that only one subsystem can change, from ``outputs`` (n, c); NaN where an output is NaN.

        The force of a spring minus p_g A_e(ζ) depends on rubber and load cells, its mass of air on leaks, and the
        difference between an actuator and the lasers on its frame.
        """
        return parity(
            experiment, dict(zip((c.name for c in self.channels), outputs.T, strict=True)), self.parameters
        )

    def sharpened(self, runs: Sequence[MeasuredRun], channels: Sequence[Channel]) -> Mapping[str, Hypothesis]:
        """Return the hypothesis of held pressure readings, with the period found in the data; empty if they are not
        held.
        """
        held = self.catalogue.get(_HELD)
        if held is None:
            return {}
        (shape,) = held.shapes
        pressures = [k for k, channel in enumerate(channels) if channel.kind == "pressure"]
        columns = [self._places[channels[k].name] for k in pressures]
        readings: list[ChannelErrors] = []
        jobs = [Job(run.experiment, {}, {}) for run in runs]
        for run, expected in zip(runs, self.run_many(jobs), strict=True):
            readings += errors_of(run, pressures, expected[:, columns])
        period = held_period(readings, shape.low, shape.high)
        return {_HELD: of_period(held, period)} if period else {}

    def _has_room(self, name: str) -> bool:
        """Return whether an effect can be added: the set does not have it, and enough rubber elements of the model are
        free.
        """
        if name in self.parameters.effects:
            return False
        effect, place = locate(name, self._effects)
        typical = {shape.name: shape.nominal for shape in effect.shapes}
        try:
            effect.change(
                self.parameters.record.copy(),
                place,
                typical | {effect.amplitude.name: effect.amplitude.typical},
            )
        except ValueError:
            return False
        return True

    def _simulate(
        self,
        experiment: Experiment,
        prepared: PreparedRun,
        parameters: Mapping[str, float],
        effects: Effects,
    ) -> Array:
        record = self.record(experiment, parameters, effects)
        gas = self._gas(experiment, parameters, record)
        prepared = prepared.moved_by(record)
        return self._replay(prepared, record, gas, _shift(parameters), _supply_error(prepared, parameters))

    def _replay(
        self,
        prepared: PreparedRun,
        record: Any,
        gas: Gas,
        shift: float,
        supply_error: float,
        changes: ParameterChanges | None = None,
    ) -> Array:
        motion = prepared.motion
        if shift:
            motion = motion._replace(displacement=motion.displacement + shift * np.eye(DIRECTIONS)[0])
        settings = prepared.experiment.settings
        readings = replay(
            record,
            motion,
            prepared.inputs,
            prepared.supply - supply_error,
            gas,
            step=self.step,
            start=settings.get("start", 0.0),
            before=history.before(settings, record),
            changes=changes,
        )
        return readings[:, self._sensors]

    def _replayed(self, job: Job, known: dict[object, Replayed], rough: bool) -> Replayed:
        """Return the replay of a job; the ``known`` one if an earlier job has requested the same.

        A ``rough`` replay takes steps of twice the length. Only parallel lanes can do this.
        """
        prepared = self._prepare(job.experiment)
        simulated = _simulated(job.parameters)
        asked = id(prepared), _simulation_key(simulated, job.effects)
        if asked not in known:
            known[asked] = self._new_or_known(job, prepared, simulated, known, rough)
        return known[asked]

    def _gas(self, experiment: Experiment, parameters: Mapping[str, float], par: Any) -> Gas:
        """Return the gas at the start of a run, in the springs with the parameters ``par``."""
        if BEFORE not in experiment.settings:
            return gas_that_was_read(experiment, parameters, par)
        before = self.record(experiment, parameters, {})
        return kept(gas_that_was_read(experiment, parameters, before), experiment, before, par)

    def _new_or_known(
        self,
        job: Job,
        prepared: PreparedRun,
        simulated: Mapping[str, float],
        known: dict[object, Replayed],
        rough: bool,
    ) -> Replayed:
        """Return the replay for parameters that were not requested before. It is a known one if the resulting record is
        equal.
        """
        record = self.record(job.experiment, simulated, job.effects)
        gas = self._gas(job.experiment, simulated, record)
        prepared = prepared.moved_by(record)
        shift, error = _shift(simulated), _supply_error(prepared, simulated)
        key = id(prepared), record.tobytes(), gas.pressure.tobytes(), gas.temperature.tobytes(), shift, error
        if key not in known:
            traced = prepared.rough if rough else prepared.traced
            before = history.before(job.experiment.settings, record)
            springs = traced.springs(record, gas, shift, before, error) if traced.fits(record) else ()
            alone = partial(self._replay, prepared, record, gas, shift, error)
            known[key] = Replayed(
                traced,
                prepared.kept,
                record,
                shift,
                springs,
                self._sensors,
                alone,
                rough,
            )
        return known[key]

    def _shifted(self, prepared: PreparedRun, outputs: Array, parameters: Mapping[str, float]) -> Array:
        """Return simulated outputs (n, c) plus the zeros and drags of the sensors."""
        shifted = outputs + np.array(
            [parameters.get(zero, 0.0) + parameters.get(seat, 0.0) for zero, seat in self._zeros]
        )
        for name, speed in prepared.speeds.items():
            if drag := parameters.get(f"{name}{DRAG}", 0.0):
                shifted[:, self._places[name]] += drag * speed
        return shifted

    def _prepare(self, experiment: Experiment) -> PreparedRun:
        with self._lock:
            found = self._prepared.get(id(experiment))
        if found is not None and found.experiment is experiment:
            return found
        made = PreparedRun(experiment, self.parameters.record, self.step)
        with self._lock:
            self._prepared[id(experiment)] = made
            while len(self._prepared) > _PREPARED:
                self._prepared.popitem(last=False)
        return made


def _simulated(parameters: Mapping[str, float]) -> dict[str, float]:
    """Return the parameters that change the simulation itself, without those that only shift readings."""
    return {
        name: value
        for name, value in parameters.items()
        if not name.endswith(_SHIFTS) or name.endswith(_PHYSICAL)
    }


def _simulation_key(simulated: Mapping[str, float], effects: Effects) -> str:
    """Return a text for use as a key. It is equal for requests of the same simulation."""
    return repr((sorted(simulated.items()), sorted((name, sorted(v.items())) for name, v in effects.items())))


def _shift(parameters: Mapping[str, float]) -> float:
    """Return how far (m) the bolster is to the left of its measured position: minus the offset of its transducer."""
    return -parameters.get(f"{SHEAR}.offset", 0.0) - parameters.get(f"{SHEAR}{SEAT}", 0.0)


def _supply_error(prepared: PreparedRun, parameters: Mapping[str, float]) -> float:
    """Return the offset (Pa) of the supply's gauge; 0 if the springs are not fed."""
    return parameters.get(f"{SUPPLY}.offset", 0.0) if prepared.fed else 0.0
