"""Computes sensor readings from the known trajectories of springs. Only the lags of the sensors are integrated."""

from collections.abc import Sequence
from math import ceil
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from bench_sim.model.algebraic import ALGEBRAICS, Algebraic
from bench_sim.model.compiled import compiled, compiled_entry, compiled_parallel
from bench_sim.model.lanes.layout import LANES, LENGTH
from bench_sim.model.lanes.springs import AUXILIARY_PRESSURE, STIFFEST, Course, LaneSpring
from bench_sim.model.lanes.start import begin_springs, has_lanes, power_coefficients
from bench_sim.model.layout import SENSORS, SIDES, STATES, Input, Sensor, State
from bench_sim.model.quantities import MEMORY, PARAMETERS
from bench_sim.model.replay import STEP, Before, Gas, Motion, balance, place
from bench_sim.model.rest import settle_sensors
from bench_sim.model.sensors import arrives_late, express, move_lags, read_exactly, true_values
from bench_sim.model.spring import displacements, spring_term

#: Inputs through which air comes from the supply, or leaves.
_FEEDING: Final = (
    Input.LEFT_LEVELING,
    Input.RIGHT_LEVELING,
    Input.LEFT_SERVICE_VALVE,
    Input.RIGHT_SERVICE_VALVE,
)
#: A differential pressure valve that comes closer to its opening pressure than this (Pa) is integrated with both sides.
_MARGIN: Final = 1.0


@compiled_entry
def follow_plates(motion: Any, parameters: Any, steps: int, places: Any) -> None:
    """Write the positions of the plates of both springs at every half step to ``places`` (SIDES, 2 rows − 1, 4)."""
    par = parameters[0]
    x = np.zeros(STATES)
    out = np.zeros(ALGEBRAICS)
    halves = 2 * steps
    for k in range(places.shape[1]):
        n = min(k // halves, motion.displacement.shape[0] - 2)
        place(n, (k - n * halves) / halves, motion, x)
        displacements(x, par, out)
        for i in range(SIDES):
            places[i, k, 0] = out[Algebraic.HEIGHT + i]
            places[i, k, 1] = out[Algebraic.HEIGHT_SPEED + i]
            places[i, k, 2] = out[Algebraic.LATERAL + i]
            places[i, k, 3] = out[Algebraic.LATERAL_SPEED + i]


@compiled
def recollect(row: Any, i: int, out: Any) -> None:
    """Copy one row of a trace to the algebraic variables of spring ``i``."""
    out[Algebraic.PRESSURE + i] = row[0]
    out[Algebraic.TEMPERATURE + i] = row[1]
    out[Algebraic.AUXILIARY_PRESSURE + i] = row[2]
    out[Algebraic.AUXILIARY_TEMPERATURE + i] = row[3]
    out[Algebraic.STACK_VERTICAL + i] = row[4]
    out[Algebraic.STACK_LATERAL + i] = row[5]
    out[Algebraic.CONTACT + i] = row[6]


@compiled_parallel
def read_samples(
    memory: Any,
    parameters: Any,
    motion: Any,
    supply: Any,
    left: Any,
    right: Any,
    steps: int,
    sensors: Any,
    readings: Any,
) -> None:
    """Write readings like `bench_sim.model.replay.replay_samples`, from the traces (rows, TRACE) of both springs.

    ``readings`` (c, n) are those of the sensors with the indices ``sensors`` (c,), at n samples.
    """
    mem = memory[0]
    par = parameters[0]
    x = np.zeros(STATES)
    dx = np.zeros(STATES)
    out = np.zeros(ALGEBRAICS)
    values = np.zeros(SENSORS)
    ideal = np.zeros(SENSORS)
    read = np.zeros(SENSORS)
    dt = motion.interval / steps
    late = arrives_late(par)
    last = motion.displacement.shape[0] - 1
    for row in range(left.shape[0]):
        n = row // steps
        k = row - n * steps
        interval = min(n, last - 1)
        part = k / steps if n < last else 1.0
        place(interval, part, motion, x)
        x[State.SUPPLY_LINE] = supply[n]
        displacements(x, par, out)
        recollect(left[row], 0, out)
        recollect(right[row], 1, out)
        for j in range(State.BOLSTER_LATERAL_SPEED, State.BOLSTER_ROLL_SPEED + 1):
            dx[j] = 0.0
        spring_term(par, out, dx)
        balance(interval, part, motion, x, par, dx, out)
        true_values(x, mem, par, out, values)
        if k == 0:
            if n == 0:
                settle_sensors(mem, par, values, dt)
            if late:
                for j in range(SENSORS):
                    ideal[j] = values[j]
                read_exactly(mem, par, ideal, read)
        move_lags(mem, par, values)
        if k == 0:
            if not late:  # Without delays the readings are the outputs of the lags.
                express(mem, par, mem.sensor_output, read)
            for j in range(sensors.shape[0]):
                readings[j, n] = read[sensors[j]]
        mem.time += dt
        mem.step += 1


def feeds(inputs: NDArray[np.float64]) -> bool:
    """Return whether the inputs (n, `INPUTS`) connect a spring with the supply or the atmosphere at any time."""
    return bool(inputs[:, _FEEDING].any())


class TracedReplay:
    """The replay of one ``motion`` in two stages: springs are integrated in lanes, and readings are computed from the
    traces.

    The arguments are those of `bench_sim.model.replay.replay`. Of ``parameters`` only the dimensions are used. The
    springs are integrated separately if no air flows between them. Before the integration, `leaks_between` returns
    whether air always flows. After it, `stays_shut` returns whether the differential pressure valve stayed closed.
    """

    def __init__(
        self,
        parameters: Any,
        motion: Motion,
        inputs: NDArray[np.float64],
        supply: NDArray[np.float64],
        *,
        step: float,
        start: float,
    ) -> None:
        self.motion = motion
        self.supply = supply
        self.start = start
        self.steps = ceil(motion.interval / step - 1e-9)
        #: s, rounded to twelve digits, because the clocks of two runs differ in the last digits.
        self.step = float(f"{motion.interval / self.steps:.12g}")
        self.geometry = _geometry(parameters)
        self.joined = bool(inputs[:, Input.DPV_CONNECTED].any())
        self.fed = feeds(inputs)
        rows = (len(motion.displacement) - 1) * self.steps + 1
        places = np.empty((SIDES, 2 * rows - 1, 4))
        follow_plates(motion, _one(parameters), self.steps, places)
        self.courses = tuple(
            Course(self.step, places[i], self._valves(inputs, i, rows), self.fed) for i in range(SIDES)
        )

    def fits(self, parameters: Any) -> bool:
        """Return whether lanes can integrate springs with these parameters, which must have the dimensions of this
        replay.

        A step longer than that of a replay has further conditions: leveling and service valves stay closed, a connected
        differential pressure valve does not leak, and nothing is too fast for the step (`_quick`).
        """
        sudden = self.fed or self.leaks_between(parameters)
        return (
            has_lanes(parameters)
            and _geometry(parameters) == self.geometry
            and (self.step <= STEP or not (sudden or _quick(parameters, self.step)))
        )

    def leaks_between(self, parameters: Any) -> bool:
        """Return whether the differential pressure valve is connected and leaks."""
        return self.joined and parameters.dpv_leak != 0.0

    def stays_shut(self, parameters: Any, traces: Sequence[NDArray[np.float64]]) -> bool:
        """Return whether the differential pressure valve stays closed between springs with these traces (rows,
        TRACE).
        """
        if not self.joined:
            return True
        left, right = (trace[:, AUXILIARY_PRESSURE] for trace in traces)
        apart = np.abs(left - right)
        most = max(apart.max(), (2.0 * apart[1:] - apart[:-1]).max())  # `bench_sim.model.valves.ahead`
        return bool(most < parameters.dpv_opening - _MARGIN)

    def springs(
        self,
        parameters: Any,
        gas: Gas,
        shift: float,
        before: Before | None = None,
        supply_error: float = 0.0,
    ) -> tuple[LaneSpring, LaneSpring]:
        """Return both springs in their initial state with ``gas``. Their plates are ``shift`` m to the left of the
        motion.

        ``before`` is that of `bench_sim.model.replay.replay`. The supply pressure is ``supply_error`` Pa below the
        reported one.
        """
        x = np.zeros(STATES)
        x[State.BOLSTER_LATERAL : State.BOLSTER_ROLL + 1] = self.motion.displacement[0, :3]
        x[State.PLATFORM_LATERAL : State.PLATFORM_ROLL + 1] = self.motion.displacement[0, 3:]
        x[State.BOLSTER_LATERAL] += shift
        columns = np.empty((SIDES, LENGTH // LANES))
        memory = np.zeros(1, MEMORY).view(np.recarray)
        powers = power_coefficients(float(parameters.heat_capacity_ratio))
        begin_springs(x, memory, _one(parameters), gas, before or Before.at_rest(), powers, columns)
        left, right = (
            LaneSpring(columns[i], parameters, i, self.courses[i], shift, supply_error) for i in range(SIDES)
        )
        return left, right

    def _valves(self, inputs: NDArray[np.float64], side: int, rows: int) -> NDArray[np.float64]:
        """Return the valve openings and the supply pressure (Pa) of one side in each step (rows, GIVEN)."""
        every = np.column_stack(
            (
                np.clip(inputs[:, Input.LEFT_RESERVOIR_VALVE + side], 0.0, 1.0),
                np.clip(inputs[:, Input.LEFT_LEVELING + side], 0.0, 1.0),
                np.clip(inputs[:, Input.LEFT_SERVICE_VALVE + side], -1.0, 1.0),
                self.supply,
                np.clip(inputs[:, Input.DPV_CONNECTED], 0.0, 1.0),
            )
        )
        return np.repeat(every, self.steps, axis=0)[:rows]

    def readings(
        self,
        parameters: Any,
        traces: Sequence[NDArray[np.float64]],
        shift: float,
        sensors: Sequence[int] = tuple(Sensor),
    ) -> NDArray[np.float64]:
        """Return the readings (n, c) of ``sensors`` (default: all), from the traces (rows, TRACE) of both springs.

        The supply pressure is constant between samples. Other Python threads can run meanwhile. The readings of each
        sensor are contiguous in memory, because callers process one sensor after the other.
        """
        record = _one(parameters)
        memory = np.zeros(1, MEMORY).view(np.recarray)
        memory.time = self.start
        motion = self.motion
        if shift:
            motion = motion._replace(
                displacement=motion.displacement + shift * np.eye(1, motion.displacement.shape[1])
            )
        readings = np.empty((len(sensors), len(motion.displacement)))
        chosen = np.array(sensors, np.intp)
        read_samples(memory, record, motion, self.supply, *traces, self.steps, chosen, readings)
        return readings.T


def _quick(parameters: Any, step: float) -> bool:
    """Return whether readings are delayed, air has inertia, or rubber relaxes too fast. A ``step`` longer than that
    of a replay is not possible then.
    """
    par = parameters
    late = (
        par.force_latency,
        par.pressure_latency,
        par.displacement_latency,
        par.pressure_clock_skew,
        par.pressure_hold,
    )
    relaxing = np.concatenate(
        (par.maxwell_time[par.maxwell_ratio != 0.0], par.extra_branch_time[par.extra_branch_ratio != 0.0])
    )
    return (
        any(one > 0.0 for one in late)
        or bool((par.flow_inertance > 0.0).any())
        or bool((relaxing < step / STIFFEST).any())
    )


def _one(parameters: Any) -> Any:
    return np.array([parameters], PARAMETERS).view(np.recarray)


def _geometry(parameters: Any) -> tuple[float, float, float]:
    """Return the dimensions that determine the positions of the springs' plates, from those of bolster and platform."""
    par = parameters
    return float(par.spring_half_spacing), float(par.centre_height), float(par.column_height)
