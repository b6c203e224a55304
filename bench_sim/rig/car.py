"""A simulated car in the tick of the rig: the measured spring forces move it, and the actuators move the springs
accordingly.
"""

from collections.abc import Mapping
from typing import Any, Final

import numpy as np

from bench_protocol import car as law
from bench_protocol.car import STOP_POINTS, WAYS, MovingCar
from bench_protocol.geometry import SpringPose, Springs, column_of, setpoints_of
from bench_protocol.rates import TICK
from bench_protocol.table import TABLE
from bench_protocol.units import s
from bench_protocol.words import Program
from bench_sim.model.compiled import compiled
from bench_sim.model.layout import SENSORS, Sensor
from bench_sim.model.sensors import read_cells
from bench_sim.rig.controls import CELLS, MEDIUM, TARGETS, Happened, Target
from bench_sim.rig.faults.in_tick import disturb
from bench_sim.rig.setpoints import DISPLACEMENTS, LONGEST_WAVE_STEP, REACH

#: The equations of the car are compiled unchanged.
_wave, _slope = compiled(law.track_wave), compiled(law.track_slope)
_move, _ahead, _shaken = (compiled(one) for one in (law.move_car, law.springs_ahead, law.floor_acceleration))
#: Time in ticks for which the load cells are read before a ride, to measure the forces of the springs at rest.
_REST_TICKS: Final = round(1 * s / TICK)
#: At the end of a ride its offsets return within a second, like those of a stopped generator.
RETURN_TICKS: Final = round(1 * s / TICK)
_ROWS: Final = tuple(
    TABLE.index[f"car.{name}"]
    for name in ("shear", "height", "roll", "acceleration", "rising", "bump_stop", "wind")
)
_SHEAR, _HEIGHT, _ROLL, _ACCELERATION, _RISING, _BUMP_STOP, _WIND = _ROWS


@compiled
def _leave(c: Any, program: int) -> None:
    """End the ride: the offsets are added to the set-points, which then return to their goals within a second."""
    c.program = program
    c.riding = 0
    for row in range(TARGETS):
        c.setpoint[row] += c.offset[row]
        c.offset[row] = 0.0
        c.slew[row] = RETURN_TICKS


@compiled
def _feel(c: Any, mem: Any, par: Any, faults: Any, readings: Any) -> None:
    """Read the load cells in this tick, including simulated sensor faults."""
    car = c.car
    if faults.counts[0] != 0:  # a cell may read what another sensor does
        for k in range(SENSORS):
            car.readings[k] = readings[k]
    read_cells(mem, par, -c.tick, car.delivered, car.readings)
    if faults.counts[0] != 0:
        disturb(faults, c.tick, par, car.readings)


@compiled
def _place(c: Any, ahead: float) -> Any:
    """Return shear (m), height (m) and roll (rad) of the springs ``ahead`` s from now."""
    car = c.car
    wave = _wave(min(c.phase[0] + c.frequency[0] * ahead, c.cycles[0]))
    return _ahead(car, ahead, car.track_size[0] * wave, car.track_size[1] * wave, car.track_size[2] * wave)


@compiled
def _follow(c: Any) -> bool:
    """Set the offsets of the set-points to the position of the car. Return whether the actuators can reach them."""
    car = c.car
    for row in range(TARGETS):
        shear, height, roll = _place(c, car.lead[row])
        offset = (
            car.to_targets[row, 0] * shear + car.to_targets[row, 1] * height + car.to_targets[row, 2] * roll
        )
        for k in range(WAYS):
            offset += car.to_targets[row, WAYS + k] * car.springs[k]
        way = offset - c.offset[row]
        there = c.setpoint[row] + offset
        # This also rejects NaN: without a force there is no ride.
        if not (abs(way) <= LONGEST_WAVE_STEP[row] and abs(there) <= REACH[row]):
            return False
        c.offset[row] = offset
    return True


@compiled
def ride(c: Any, mem: Any, par: Any, faults: Any, readings: Any) -> int:
    """Advance the car by one tick under the measured spring forces. Return the `Happened` events.

    Before the ride, the load cells measure the springs at rest. If the motion exceeds the range of the actuators, the
    ride ends.
    """
    if c.program != Program.RUN:
        return int(Happened.NOTHING.value)
    car = c.car
    _feel(c, mem, par, faults, readings)
    if c.waits > 0:
        c.waits -= 1
        for k in range(CELLS):
            car.rest[k] += car.readings[Sensor.LOAD_CELL_1 + k] / c.resting
        return int(Happened.NOTHING.value)
    for way in range(WAYS):
        car.springs[way] = 0.0
        for k in range(CELLS):
            car.springs[way] += car.of_cells[way, k] * (car.readings[Sensor.LOAD_CELL_1 + k] - car.rest[k])
    phase = c.phase[0]
    for way in range(WAYS):
        car.track[way] = car.track_size[way] * _wave(phase)
        car.track_rate[way] = car.track_size[way] * c.frequency[0] * _slope(phase)
    car.wind = c.wind
    _move(car, TICK)
    c.phase[0] = min(phase + c.frequency[0] * TICK, c.cycles[0])
    if not _follow(c):
        _leave(c, Program.STOPPED.value)
        return int(Happened.ASTRAY.value)
    if c.phase[0] >= c.cycles[0]:
        _leave(c, Program.IDLE.value)
        return int(Happened.PROGRAM_DONE.value)
    return int(Happened.NOTHING.value)


@compiled
def publish_car(c: Any, values: Any) -> None:
    """Write the motion of the car to ``values``; NaN if there is no ride."""
    if c.riding == 0 or c.waits > 0:
        for row in _ROWS:
            values[row] = np.nan
        return
    car = c.car
    values[_SHEAR], values[_HEIGHT], values[_ROLL] = _place(c, 0.0)
    values[_ACCELERATION] = _shaken(car)
    values[_RISING] = car.acceleration[1]
    values[_BUMP_STOP] = car.bump_stop
    values[_WIND] = car.wind


class Couplings:
    """Matrices for a car on a bench with these ``dimensions``: from load cells to spring forces, and from spring
    positions to set-points.
    """

    def __init__(self, dimensions: Mapping[str, float]) -> None:
        columns = np.array([column_of(dimensions, f"load_cell.{k + 1}") for k in range(CELLS)]).T
        self._of_cells = columns[1:4]  # sideways, upward, roll
        self._gravity = dimensions["gravity"]
        unit = np.eye(WAYS).tolist()
        asked = [
            *(setpoints_of(SpringPose(*one), dimensions) for one in unit),
            *(setpoints_of(SpringPose(0.0, 0.0, 0.0), dimensions, Springs(*one)) for one in unit),
        ]
        self._to_targets = np.zeros((TARGETS, 2 * WAYS))
        for target, name in enumerate(DISPLACEMENTS):
            self._to_targets[target] = [one.get(name, 0.0) for one in asked]
        #: Whether a set-point is moved at all.
        self.moved = self._to_targets.any(axis=1)

    def begin(self, c: Any, settings: Mapping[str, float]) -> bool:
        """Write the car of the ``settings`` (SI, by name) to the tick's controls, and prepare its ride. Return False
        for invalid settings.
        """
        own = {
            name.removeprefix("car."): value for name, value in settings.items() if name.startswith("car.")
        }
        travel = [own[f"stop_travel_{k}"] for k in range(1, STOP_POINTS + 1)]
        rising = bool((np.diff(travel) > 0.0).all())
        if not (rising and own["mass"] and own["roll_gyration"] and own["track_frequency"]):
            return False
        track = np.array([own[f"track_{way}"] for way in ("lateral", "vertical", "roll")])
        speeds = np.abs(self._to_targets[:, :WAYS]) @ track * np.pi * own["track_frequency"]
        if (speeds > LONGEST_WAVE_STEP / TICK).any():
            return False
        car = c["car"]
        for name in MovingCar.__dataclass_fields__:
            car[name] = own.get(name, 0.0)
        car["inertia"] = own["mass"] * own["roll_gyration"] ** 2
        car["gravity"] = self._gravity
        car["bump_stop_travel"] = travel
        car["bump_stop_force"] = [own[f"stop_force_{k}"] for k in range(1, STOP_POINTS + 1)]
        car["track_size"] = track
        car["of_cells"], car["to_targets"] = self._of_cells, self._to_targets
        car["lead"] = own["piston_lead"]
        car["lead"][Target.PLATFORM_VERTICAL :] = own["platform_lead"]
        car["rest"] = 0.0
        # The ride begins on a tick whose signals are sent.
        c["waits"] = c["resting"] = _REST_TICKS + -int(c["tick"]) % MEDIUM
        c["waves"], c["phase"][0] = 1, 0.0
        c["frequency"][0], c["cycles"][0] = own["track_frequency"], own["track_waves"]
        c["amplitude"][0] = 0.0
        c["riding"] = 1
        return True
