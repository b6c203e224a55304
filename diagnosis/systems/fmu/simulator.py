"""An FMU as a simulator: worker processes replay measured inputs, and this module adds errors of sensors.

The outputs of an FMU depend only on its inputs, start values and communication step. They are cached: a cause that only
changes the reading of an output needs no simulation.
"""

from __future__ import annotations

import hashlib
import threading
from collections import OrderedDict
from collections.abc import Mapping, Sequence
from copy import copy
from dataclasses import dataclass, replace
from typing import Final, Literal

import numpy as np

from bench_sim.fmu.description import REALS, Variable
from diagnosis.contracts import (
    Array,
    Channel,
    CompleteSimulator,
    DiagnosisError,
    Effects,
    Experiment,
    Hypothesis,
    Job,
    MeasuredRun,
    Nuisance,
    Surface,
)
from diagnosis.systems.fmu.pool import FmuPool
from diagnosis.systems.fmu.worker import Feedback, SimulationRequest
from diagnosis.systems.held_samples import errors_of, held_period, of_period
from diagnosis.systems.measurement import driven_by, read_as
from diagnosis.systems.splines import TensorSplines

#: Size of the cache of outputs, in bytes.
_KEPT: Final = 1 << 27
#: Relative tolerance of whole multiples of a step.
_WHOLE: Final = 1e-6


@dataclass(frozen=True, slots=True)
class OfVariable:
    """Connection of an effect to a variable of the FMU. At the value ``off`` (SI) the effect is missing."""

    variable: Variable
    off: float


@dataclass(frozen=True, slots=True)
class Drive:
    """How the FMU is driven: inputs with a column in the data, communication step (s; None: that of the grid), settle
    time (s), and ``hold``.
    """

    inputs: tuple[Variable, ...]
    step: float | None
    settle: float
    hold: Literal["middle", "begin", "end"]


class FmuSimulator(CompleteSimulator):
    """The simulator of an FMU. ``unnamed`` are the surfaces of unknown terms, each with the signal that it is added to.

    ``preset`` holds values (SI) of variables that replace the FMU's own.
    """

    def __init__(
        self,
        *,
        pool: FmuPool,
        drive: Drive,
        channels: tuple[Channel, ...],
        nuisances: tuple[Nuisance, ...],
        catalogue: Mapping[str, Hypothesis],
        effects: Mapping[str, OfVariable],
        unnamed: Sequence[tuple[str, TensorSplines]],
        preset: Mapping[str, float],
    ) -> None:
        self.fmu = pool.fmu
        self.name = self.fmu.path.name
        self.identity = self.fmu.identity
        self.channels, self.nuisances, self.catalogue = channels, nuisances, catalogue
        self.effects, self._preset = effects, preset
        self.surfaces: tuple[Surface, ...] = tuple(splines.surface for _, splines in unnamed)
        self._pool, self._drive, self._unnamed = pool, drive, unnamed
        driven = {one.name for one in drive.inputs}
        beside = {axis.state for _, one in unnamed for axis in (one.first, one.second)} - driven
        self._asked = tuple(dict.fromkeys([*(channel.name for channel in channels), *sorted(beside)]))
        self._kept: OrderedDict[bytes, Array] = OrderedDict()
        self._lock = threading.Lock()
        self._tried = False

    def run(self, experiment: Experiment, parameters: Mapping[str, float], effects: Effects) -> Array:
        """Return the outputs (n, c), see `Simulator`."""
        time = experiment.time
        drawn = {**effects, **_of_base(parameters)}
        inputs = {
            one.name: driven_by(one.name, experiment.inputs[one.name], time, drawn)
            for one in self._drive.inputs
        }
        starts = self.starts(experiment, parameters, effects)
        answer = self._simulated(self._request(experiment, starts, inputs, self._feedback(effects)))
        states = inputs | dict(zip(self._asked, answer.T, strict=True))
        added = dict(states)
        for signal, splines in self._unnamed:
            if splines.name in effects and signal not in inputs:
                added[signal] = added[signal] + splines.value(states, effects[splines.name])
        return np.column_stack([read_as(one.name, added[one.name], time, drawn) for one in self.channels])

    def sharpened(self, runs: Sequence[MeasuredRun], channels: Sequence[Channel]) -> Mapping[str, Hypothesis]:
        """Return the hypotheses of outputs whose readings are held, with the periods found in the data."""
        places = {one.name: k for k, one in enumerate(self.channels)}
        expected = list(self.run_many([Job(run.experiment, {}, {}) for run in runs]))
        found: dict[str, Hypothesis] = {}
        for k, channel in enumerate(channels):
            held = self.catalogue.get(f"held.{channel.name}")
            if held is None:
                continue
            columns = [places[channel.name]]
            readings = [
                one
                for run, outputs in zip(runs, expected, strict=True)
                for one in errors_of(run, [k], outputs[:, columns])
            ]
            (shape,) = held.shapes
            if period := held_period(readings, shape.low, shape.high):
                found[held.name] = of_period(held, period)
        return found

    def step_of(self, experiment: Experiment) -> float:
        """Return the communication step in s."""
        return self._drive.step or experiment.step

    def with_step(self, step: float) -> FmuSimulator:
        """Return a copy with another communication step (s); both share the cache."""
        other = copy(self)
        other._drive = replace(self._drive, step=step)
        return other

    def starts(
        self, experiment: Experiment | None, parameters: Mapping[str, float], effects: Effects
    ) -> dict[str, float]:
        """Return the values (SI) to which variables of the FMU are set before a run."""
        variables = self.fmu.variables
        values = dict(self._preset)
        values |= {one.name: one.nominal for one in self.nuisances if one.name in variables}
        values |= {name: value for name, value in parameters.items() if name in variables}
        for name, value in (experiment.settings if experiment is not None else {}).items():
            one = variables.get(name)
            known = self._preset.get(
                name, None if one is None or one.start is None else one.unit.to_si(one.start)
            )
            if one is not None and value != known:
                values[name] = value
        for name, of in self.effects.items():
            here = effects.get(name)
            values[of.variable.name] = of.off + (here[of.variable.name] if here else 0.0)
            for shape, value in (here or {}).items():
                if shape != of.variable.name:
                    values[shape] = value
        return values

    def _feedback(self, effects: Effects) -> tuple[Feedback, ...]:
        """Return the surfaces that are added to inputs, in the form that the worker process needs."""
        columns = {one.name: k for k, one in enumerate(self._drive.inputs)}
        order = dict(
            zip(self._asked, _order([self.fmu.variables[name] for name in self._asked]), strict=True)
        )

        def source(name: str) -> tuple[bool, int, float, float]:
            unit = self.fmu.variables[name].unit
            of_input = name in columns
            return of_input, columns[name] if of_input else order[name], unit.factor, unit.zero

        return tuple(
            Feedback(
                columns[signal],
                (source(splines.first.state), source(splines.second.state)),
                splines.table(effects[splines.name]),
                1.0 / self.fmu.variables[signal].unit.factor,
            )
            for signal, splines in self._unnamed
            if signal in columns and splines.name in effects
        )

    def _request(
        self,
        experiment: Experiment,
        starts: Mapping[str, float],
        inputs: Mapping[str, Array],
        feedback: tuple[Feedback, ...],
    ) -> SimulationRequest:
        drive, step = self._drive, experiment.step
        wanted = step if drive.step is None else drive.step
        parts = round(step / wanted)
        if parts < 1 or abs(parts * wanted / step - 1.0) > _WHOLE:
            raise DiagnosisError(
                f"{self.name}: a communication step of {wanted:g} s does not divide the step of the grid, {step:g} s; "
                "choose fmu.step or time.step of the map so that it does"
            )
        self._refuse_step(step / parts)
        at = np.zeros((len(experiment.time), len(drive.inputs)))
        for column, one in enumerate(drive.inputs):
            at[:, column] = (inputs[one.name] - one.unit.zero) / one.unit.factor
        return SimulationRequest(
            start=_by_type(self.fmu.variables, starts),
            inputs=_columns(drive.inputs),
            outputs=_references([self.fmu.variables[name] for name in self._asked]),
            at=at,
            held=_held(at, parts, drive.hold, [one.name not in experiment.held for one in drive.inputs]),
            parts=parts,
            step=step / parts,
            settle=round(drive.settle / (step / parts)),
            feedback=feedback,
        )

    def _refuse_step(self, step: float) -> None:
        own = self.fmu.step
        if own is None or not own > 0.0:
            return
        times = step / own
        if round(times) < 1 or abs(times / round(times) - 1.0) > _WHOLE:
            raise DiagnosisError(
                f"{self.name} has a fixed step of {own:g} s, but the communication step of {step:g} s is not a whole "
                f'multiple of this; set time.step or fmu.step = "{max(round(times), 1) * own:g} s" in the map'
            )

    def _simulated(self, request: SimulationRequest) -> Array:
        """Return the outputs (n, k) of a request, in SI; from the cache if it was requested before."""
        key = _key(request)
        with self._lock:
            if key in self._kept:
                self._kept.move_to_end(key)
                return self._kept[key]
            tried, self._tried = self._tried, True
        found = self._pool.simulate(request)
        if not tried:
            again = self._pool.simulate(request)
            if again.tobytes() != found.tobytes():
                raise DiagnosisError(
                    f"{self.name} returned other outputs when it was simulated again with the same inputs, by up to "
                    f"{np.nanmax(np.abs(again - found)):.3g}; use an FMU without random numbers and without data "
                    "that remain from one instance to the next"
                )
        order = _order([self.fmu.variables[name] for name in self._asked])
        units = [self.fmu.variables[name].unit for name in self._asked]
        answer = np.column_stack(
            [unit.factor * found[:, place] + unit.zero for place, unit in zip(order, units, strict=True)]
        )
        answer.setflags(write=False)
        with self._lock:
            self._kept[key] = answer
            while sum(one.nbytes for one in self._kept.values()) > _KEPT:
                self._kept.popitem(last=False)
        return answer


def _of_base(parameters: Mapping[str, float]) -> dict[str, dict[str, float]]:
    """Return the sensor errors among the base parameters, such as ``offset.force``, in the form of effects."""
    names = {"gain": "gain", "offset": "offset", "drift": "rate", "lag": "lag", "latency": "delay"}
    found = {}
    for name, value in parameters.items():
        kind = name.partition(".")[0]
        if kind in names and value:
            found[name] = {names[kind]: value}
    return found


def _held(at: Array, parts: int, hold: str, straight: Sequence[bool]) -> Array:
    """Return the inputs ((n − 1)·parts, m) of each communication step. Inputs are interpolated linearly if ``straight``
    (m,), otherwise piecewise constant.
    """
    where = {"begin": 0.0, "middle": 0.5, "end": 1.0}[hold]
    shares = (np.arange(parts)[np.newaxis, :, np.newaxis] + where) / parts
    between = at[:-1, np.newaxis] + shares * np.diff(at, axis=0)[:, np.newaxis]
    stairs = np.broadcast_to(at[:-1, np.newaxis], between.shape)
    held = np.where(np.array(straight, np.bool_), between, stairs)
    return np.ascontiguousarray(held.reshape(-1, at.shape[1]))


def _by_type(
    variables: Mapping[str, Variable], values: Mapping[str, float]
) -> dict[str, tuple[list[int], list[float]]]:
    found: dict[str, tuple[list[int], list[float]]] = {}
    for name, value in values.items():
        one = variables[name]
        references, numbers = found.setdefault(one.type, ([], []))
        references.append(one.reference)
        number = one.unit.from_si(value)
        numbers.append(
            number if one.type in REALS else bool(number) if one.type == "Boolean" else round(number)
        )
    return found


def _columns(inputs: Sequence[Variable]) -> dict[str, tuple[list[int], list[int]]]:
    found: dict[str, tuple[list[int], list[int]]] = {}
    for column, one in enumerate(inputs):
        references, columns = found.setdefault(one.type, ([], []))
        references.append(one.reference)
        columns.append(column)
    return found


def _references(outputs: Sequence[Variable]) -> dict[str, list[int]]:
    found: dict[str, list[int]] = {}
    for one in outputs:
        found.setdefault(one.type, []).append(one.reference)
    return found


def _order(outputs: Sequence[Variable]) -> list[int]:
    """Return the column of each output in the result of the worker, which groups outputs by type."""
    types = list(dict.fromkeys(one.type for one in outputs))
    places = sorted(range(len(outputs)), key=lambda k: types.index(outputs[k].type))
    return [places.index(k) for k in range(len(outputs))]


def _key(request: SimulationRequest) -> bytes:
    digest = hashlib.blake2b(repr((request.start, request.parts, request.step, request.settle)).encode())
    for values in (request.at, request.held, *(one.table[-1] for one in request.feedback)):
        digest.update(np.ascontiguousarray(values).tobytes())
    digest.update(repr([(one.column, one.over) for one in request.feedback]).encode())
    return digest.digest()
