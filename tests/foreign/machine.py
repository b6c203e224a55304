"""The core of the foreign rigs: the plant with its servo-valves and air valves, without interfaces."""

from enum import Enum
from typing import Any, Final

import numpy as np

from bench_sim.model.layout import Input, Mode, Sensor, State
from bench_sim.model.plant import Plant
from bench_sim.parameters import load

SENSOR: Final = {sensor.name.lower(): int(sensor) for sensor in Sensor}
#: Vertical left, vertical right, lateral; then the platform, vertical, lateral, roll.
AXES: Final = 6
DRIVES: Final = 3
VALVE_CYCLE: Final = 5  # ms
FULL_OPENING, DEAD_ZONE = 15e3, 500.0  # Pa: of the pressure controllers
EMPTY: Final = 22e3  # Pa gauge, too little to carry the bolster
SET_DOWN: Final = -500.0  # N
LOWERING: Final = -0.04  # m/s
FLANGE: Final = 30e3  # Pa gauge, up to which a valve may be opened

_COMMANDS: Final = [
    Input.VERTICAL_LEFT_COMMAND,
    Input.VERTICAL_RIGHT_COMMAND,
    Input.LATERAL_COMMAND,
    Input.PLATFORM_VERTICAL,
    Input.PLATFORM_LATERAL,
    Input.PLATFORM_ROLL,
]
_MODES: Final = slice(Input.VERTICAL_LEFT_MODE, Input.VERTICAL_LEFT_MODE + DRIVES)
_FORCES: Final = slice(Sensor.VERTICAL_LEFT_FORCE, Sensor.VERTICAL_LEFT_FORCE + DRIVES)
_PLACES: Final = slice(Sensor.VERTICAL_LEFT_DISPLACEMENT, Sensor.VERTICAL_LEFT_DISPLACEMENT + DRIVES)
_CHAMBERS: Final = slice(Sensor.LEFT_BELLOWS_PRESSURE, Sensor.SUPPLY_PRESSURE)


def late(*kinds: str, by: float) -> dict[Sensor, float]:
    """Return the lags (s) of transducers that are all late ``by`` as much, for `Machine`."""
    return {sensor: by for sensor in Sensor if any(kind in sensor.name.lower() for kind in kinds)}


class Drive(Enum):
    """What a servo-valve does with its set-point."""

    OFF = Mode.OFF
    POSITION = Mode.DISPLACEMENT
    FORCE = Mode.FORCE


class Valve(Enum):
    """What the air valves of one spring do."""

    SHUT = 0
    LEVEL = 1
    FILL = 2
    VENT = 3


class Power(Enum):
    """What the actuators and the supply may do."""

    SAFE = 0  # held while there is air, vented, set down, released
    HALTED = 1  # shut in, the air stays where it is
    ON = 2


class Machine:
    """Hydraulics and pneumatics, with the wired safe position that needs no PLC.

    ``present`` (SI, `AXES`) are the axes' set-points; ``readings`` are the sensors' (SI, `SENSOR`).
    """

    def __init__(self, seed: int = 0, **changes: Any) -> None:
        parameters = load("astb").with_values(**changes).as_built(seed)
        self.plant = Plant.depressurised(parameters.record, seed=seed)
        self.readings = self.plant.measure()
        self.power = Power.SAFE
        self.drives = [Drive.POSITION] * DRIVES
        self.valves = [Valve.SHUT, Valve.SHUT]
        self.targets = [0.0, 0.0]  # Pa gauge
        self.chambers_joined = [True, True]
        self.sides_joined = True
        self.present = np.zeros(AXES)
        self._gripping = False
        self._milliseconds = 0

    def read(self, name: str) -> float:
        """Return what a sensor reads (SI)."""
        return float(self.readings[SENSOR[name]])

    # -- orders ------------------------------------------------------------------------------------------------------

    def set_power(self, power: Power) -> None:
        """Engage the actuators at their position, shut them in, or enter the safe position."""
        if power is Power.ON and self.power is not Power.ON:
            self.stay()
        self._gripping |= power is not Power.SAFE or self.power is not Power.SAFE
        self.power = power

    def set_drive(self, axis: int, drive: Drive) -> None:
        """Make an axis follow a force or a position; it starts from its present value."""
        if self.drives[axis] is not drive:
            self.drives[axis] = drive
            self.stay(axis)

    def stay(self, *axes: int) -> None:
        """Let drives (all of them, without any) begin where they are."""
        self.present = self.present.copy()
        for axis in axes or range(DRIVES):
            force = self.drives[axis] is not Drive.POSITION
            self.present[axis] = self.readings[_FORCES if force else _PLACES][axis]

    def shim(self, preload: float) -> bool:
        """Put shims under the emergency springs for ``preload`` (N per spring); False while they carry anything."""
        par, x = self.plant.parameters, self.plant.state
        change = preload - par.nominal_preload
        if not change.any():
            return True
        if self.power is not Power.SAFE or self._gripping:
            return False
        lift = change / par.emergency_stiffness_vertical
        x[State.BOLSTER_VERTICAL] += lift.mean()
        x[State.BOLSTER_ROLL] += 0.5 * (lift[0] - lift[1]) / par.spring_half_spacing
        x[State.LEVER : State.LEVER + 2] += lift
        par.nominal_preload[:] = preload
        return True

    def fit_plates(self, bore: float) -> bool:
        """Fit orifice plates of ``bore`` (m) on both sides; False while there is air behind the flanges."""
        if self.power is not Power.SAFE or (self.readings[_CHAMBERS] > FLANGE).any():
            return False
        self.plant.parameters.orifice_diameter[:] = bore
        return True

    # -- time --------------------------------------------------------------------------------------------------------

    def move(self, path: np.ndarray) -> None:
        """Let time pass and the axes go along a ``path`` (ms, `AXES`), if they have power; then measure."""
        inputs = self.plant.inputs
        self._engage(inputs)
        for point in path:
            if self._milliseconds % VALVE_CYCLE == 0:
                self._switch(inputs)
            if self.power is Power.ON:
                inputs[_COMMANDS] = self.present = point
            self.plant.step()
            self._milliseconds += 1
        self.readings = self.plant.measure()

    def _engage(self, inputs: np.ndarray) -> None:
        """Set the modes of the servo-valves; without power they hold on to what the springs push against."""
        if self.power is Power.ON:
            inputs[_MODES] = [drive.value for drive in self.drives]
            return
        hanging = self.readings[_FORCES] < SET_DOWN
        hanging[2] = False
        empty = bool((self.readings[_CHAMBERS] < EMPTY).all())
        if self.power is Power.SAFE and empty and not hanging.any():
            self._gripping = False
        inputs[_MODES] = Mode.SHUT_IN if self._gripping else Mode.OFF
        lower = self._gripping and self.power is Power.SAFE and empty
        inputs[_COMMANDS[:DRIVES]] = np.where(hanging & lower, LOWERING, 0.0)

    def _switch(self, inputs: np.ndarray) -> None:
        """Set the air valves: the controllers look at the chambers' own transducers."""
        ready, vented = self.power is Power.ON, self.power is Power.SAFE
        pressures = self.plant.measure()[_CHAMBERS][2:]
        inputs[Input.SUPPLY] = ready
        inputs[Input.DPV_CONNECTED] = self.sides_joined
        for side, valve in enumerate(self.valves):
            error = (self.targets[side] - pressures[side]) / FULL_OPENING
            opening = 0.0
            if vented:
                opening = -1.0
            elif ready and abs(error) * FULL_OPENING > DEAD_ZONE:
                if valve is Valve.FILL:
                    opening = min(max(error, 0.0), 1.0)
                elif valve is Valve.VENT:
                    opening = max(min(error, 0.0), -1.0)
            inputs[Input.LEFT_SERVICE_VALVE + side] = opening
            inputs[Input.LEFT_LEVELING + side] = ready and valve is Valve.LEVEL
            inputs[Input.LEFT_RESERVOIR_VALVE + side] = vented or self.chambers_joined[side]


class Interpolation:
    """A cubic through set-points that come once a cycle, of which the last is only ahead."""

    #: By what an axis is driven with: m, rad or N in one second.
    FASTEST: Final = {Drive.POSITION: 0.3, Drive.FORCE: 60e3, Drive.OFF: 0.0}

    def __init__(self, cycle: int) -> None:
        self._cycle = cycle  # ms
        self._ahead = np.zeros((3, AXES))  # where the axes come from, where they are to be, and after that

    def path(self, machine: Machine, goal: np.ndarray | None) -> np.ndarray:
        """Return the way (ms, `AXES`) of the axes in this cycle, towards ``goal`` or where they go already."""
        if not np.array_equal(machine.present, self._ahead[1]):  # it was held
            self._ahead = np.tile(machine.present, (3, 1))
        rates = [self.FASTEST[drive] for drive in machine.drives] + [0.3] * (AXES - DRIVES)
        longest = np.array(rates) * (self._cycle * 1e-3)
        before, here, there = self._ahead
        beyond = there + np.clip((there if goal is None else goal) - there, -longest, longest)
        self._ahead = np.array((here, there, beyond))
        u = np.linspace(1 / self._cycle, 1, self._cycle)[:, None]
        slope, next_slope = 0.5 * (there - before), 0.5 * (beyond - here)
        way = there - here
        path = (
            here
            + u * slope
            + u**2 * (3 * way - 2 * slope - next_slope)
            + u**3 * (slope + next_slope - 2 * way)
        )
        path[-1] = there
        return path
