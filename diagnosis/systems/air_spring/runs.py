"""Conversion of an experiment for the replay of the bench: motion of the plates, and state of the valves."""

from collections import OrderedDict
from dataclasses import replace
from functools import cached_property
from typing import Any, Final
from weakref import WeakValueDictionary

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from bench_sim.model.effects import effect as bench
from bench_sim.model.lanes.traces import TracedReplay, feeds
from bench_sim.model.layout import INPUTS, LATERAL, Input
from bench_sim.model.replay import Motion
from diagnosis.contracts import Array, DiagnosisError, Experiment
from diagnosis.systems.air_spring.batch import KeptTraces
from diagnosis.systems.motion import GIVE

_VALVES: Final = {
    "left.leveling": Input.LEFT_LEVELING,
    "right.leveling": Input.RIGHT_LEVELING,
    "left.reservoir": Input.LEFT_RESERVOIR_VALVE,
    "right.reservoir": Input.RIGHT_RESERVOIR_VALVE,
    "dpv": Input.DPV_CONNECTED,
}

#: The inputs from displacement sensors.
_LATE: Final = (
    "left.height",
    "right.height",
    "shear",
    "platform.vertical",
    "platform.lateral",
    "platform.roll",
)


class PreparedRun:
    """The motion and inputs of an experiment, converted for the replay, and a cache of the latest simulated outputs."""

    def __init__(self, experiment: Experiment, par: Any, step: float) -> None:
        self.experiment = experiment
        self.motion = Motion.through(_motion(experiment, par), experiment.step)
        if "lateral.acceleration" in experiment.inputs:
            # An accelerometer is quieter than the second derivative of a displacement.
            read = experiment.inputs["lateral.acceleration"]
            self.motion = self.motion.accelerated(0, _of_the_centre(read, self.motion, par))
        #: Whether a leveling valve is connected at any time; else its parameters have no effect.
        self.fed = feeds(self.inputs)
        self.supply = (
            given(experiment, "supply.pressure", float(par.supply_pressure)) + par.atmospheric_pressure
        )
        self.speeds = _actuator_speeds(self.motion, par)
        self.outputs: OrderedDict[str, Array] = OrderedDict()
        self.kept = KeptTraces()
        self._par, self._step = par, step
        self._moved: WeakValueDictionary[tuple[float, float], PreparedRun] = WeakValueDictionary()

    def moved_by(self, par: Any) -> "PreparedRun":
        """Return the run with its motion corrected for the frame and the displacement sensors of ``par``; cached.

        The transducer is in the lateral actuator: with a softer frame, the same readings mean a smaller shear of the
        springs. Delayed readings belong to earlier times.
        """
        more, late = self._added_compliance_and_delay(par)
        if (more, late) == (0.0, 0.0):
            return self
        moved = self._moved.get((more, late))
        if moved is None:
            moved = self._moved[more, late] = self._moved_so(more, late)
        return moved

    def moved_by_each(self, records: Any, of: NDArray[np.intp]) -> "PreparedRun":
        """Return the run as `moved_by` does, but with another parameter record at each sample: ``records`` at the
        indices ``of`` (n,).
        """
        more, late = np.array([self._added_compliance_and_delay(par) for par in records]).T
        return self._moved_so(more[of], late[of]) if more.any() or late.any() else self

    def _added_compliance_and_delay(self, par: Any) -> tuple[float, float]:
        """Return how ``par`` differs from the nominal parameters: relative compliance of the frame, and delay (s) of
        displacements.
        """
        more = float(self._par.frame_stiffness[LATERAL] / par.frame_stiffness[LATERAL]) - 1.0
        late = float(par.displacement_latency - self._par.displacement_latency)
        return more if GIVE in self.experiment.inputs else 0.0, late

    def _moved_so(self, more: float | Array, late: float | Array) -> "PreparedRun":
        inputs = (
            _inputs_without_latency(self.experiment, late) if np.any(late) else dict(self.experiment.inputs)
        )
        if np.any(more):
            inputs["shear"] = inputs.get("shear", 0.0) - more * inputs[GIVE]
        return PreparedRun(replace(self.experiment, inputs=inputs), self._par, self._step)

    @property
    def inputs(self) -> Array:
        """All inputs of the bench (n, INPUTS). Most of them are 0. They are computed on each request."""
        inputs = np.zeros((len(self.experiment.time), INPUTS))
        inputs[:, Input.SUPPLY] = 1.0
        for name, place in _VALVES.items():
            default = 1.0 if name.endswith("reservoir") else 0.0
            inputs[:, place] = given(self.experiment, name, default)
        return inputs

    @cached_property
    def traced(self) -> TracedReplay:
        """The replay in parallel lanes, with the exact step."""
        return self._traced(self._step)

    @cached_property
    def rough(self) -> TracedReplay:
        """The replay in parallel lanes with twice the step. It is the exact replay if the sampling does not allow a
        longer step.
        """
        longer = self._traced(2.0 * self._step)
        return longer if longer.steps < self.traced.steps else self.traced

    def _traced(self, step: float) -> TracedReplay:
        start = self.experiment.settings.get("start", 0.0)
        return TracedReplay(self._par, self.motion, self.inputs, self.supply, step=step, start=start)


def _of_the_centre(read: Array, motion: Motion, par: Any) -> Array:
    """Return ÿ (n,) of the bolster's centre from the accelerometer ``read``, ÿ + (g + z̈)φ − h_m φ̈."""
    roll = motion.displacement[:, 2]
    vertical, angular = motion.acceleration[:, 1], motion.acceleration[:, 2]
    return read - (par.gravity + vertical) * roll + par.accelerometer_height * angular


def _inputs_without_latency(experiment: Experiment, late: float | Array) -> dict[str, Array]:
    """Return the inputs of an experiment with displacements shifted by their delay ``late`` (s). Forces have no
    delay.
    """
    time, inputs = experiment.time, dict(experiment.inputs)
    own = np.zeros(len(time))
    gave_way = inputs.get(GIVE, own)  # the shear was made of displacements less this
    for name in _LATE:
        if name in inputs:
            apart = gave_way if name == "shear" else own
            course = CubicSpline(time, inputs[name] + apart)
            inputs[name] = course(np.clip(time + late, time[0], time[-1])) - apart
    return inputs


def given(experiment: Experiment, name: str, default: float | None = None) -> Array:
    """Return an input (n,) of an experiment, or its default. Raises DiagnosisError if there is neither."""
    values = experiment.inputs.get(name)
    if values is not None:
        return values
    if default is None:
        raise DiagnosisError(
            f"run {experiment.name} has no input {name}, which the simulation needs; record it"
        )
    return np.full(len(experiment.time), default)


def _actuator_speeds(motion: Motion, par: Any) -> dict[str, Array]:
    """Return speeds (n,) of the bolster at the actuators' pins, up or left positive, by the names of their forces."""
    y, z, phi = motion.speed[:, :3].T
    return {
        "vertical_left.force": z + par.actuator_half_spacing * phi,
        "vertical_right.force": z - par.actuator_half_spacing * phi,
        "lateral.force": y - par.lateral_actuator_height * phi,
    }


def _motion(experiment: Experiment, par: Any) -> Array:
    """Return displacements (n, 6) of bolster and platform: lateral, vertical, roll of each.

    φ_B = (ζ_L − ζ_R)/2b + φ_P,  z_B = (ζ_L + ζ_R)/2 + z_P,  y_B = y − e φ_B + y_P − h φ_P
    """
    left, right = (given(experiment, f"{side}.height") for side in bench.PLACES)
    z, y, phi = (given(experiment, f"platform.{axis}", 0.0) for axis in ("vertical", "lateral", "roll"))
    roll = 0.5 * (left - right) / par.spring_half_spacing + phi
    lateral = given(experiment, "shear", 0.0) - par.centre_height * roll + y - par.column_height * phi
    return np.column_stack((lateral, 0.5 * (left + right) + z, roll, y, z, phi))
