"""Rig B, a stranger's: CAN alone, as `hall_b.dbc` describes it, with firmware that packs its frames by hand.

``python -m tests.foreign.can_rig [INTERFACE]`` uses a SocketCAN interface, or without one a socketcand
gateway on 127.0.0.1, until its input ends.

The lateral actuator knows positions only and measures no force. Load cells hang upside down and weigh in kg. A client
must beat like a heart; who sends set-points does not matter. Refused frames are ignored: the state and the parameters
in force, which are sent cyclically, show it.
"""

import sys
from enum import IntEnum
from typing import Final

import numpy as np

from tests.foreign.can_gateway import serve
from tests.foreign.machine import AXES, DRIVES, Drive, Machine, Power, Valve, late

CYCLE: Final = 10  # ms
SETPOINTS: Final = 20  # ms: how often they come, and how long an axis takes to the next
HEARTBEAT: Final = 500  # ms of silence until the rig halts
ANEW: Final = 500  # ms of silence after which a counter may begin anywhere
GIVEN_UP: Final = 2000  # ms more until it goes into its safe position
KILOGRAM: Final = 9.80665  # N
ATMOSPHERE: Final = 101_325.0  # Pa

HEIGHTS, POSITIONS, FORCES, CELLS_A, CELLS_B, AIR, GAS, PLATFORM, STATUS, PARAMETER_IS = range(
    0x18FF1001, 0x18FF100B
)
SET_POSITIONS, SET_FORCES, SET_PLATFORM = range(0x18FF2001, 0x18FF2004)
HEART, COMMAND, PARAMETER = range(0x18FF2010, 0x18FF2013)

(VERTICAL, LATERAL, LEFT, RIGHT, TO_LEFT, TO_RIGHT, JOIN_LEFT, JOIN_RIGHT, BRIDGE, SHIMS, PLATES) = range(
    1, 12
)
#: Parameters: bits, value at the start, and the highest.
_PARAMETERS: Final = {
    VERTICAL: (8, 1, 2),
    LATERAL: (8, 1, 1),
    LEFT: (8, 0, 3),
    RIGHT: (8, 0, 3),
    TO_LEFT: (16, 2027, 20_000),
    TO_RIGHT: (16, 2027, 20_000),
    JOIN_LEFT: (8, 1, 1),
    JOIN_RIGHT: (8, 1, 1),
    BRIDGE: (8, 1, 1),
    SHIMS: (16, 10_911, 32_000),
    PLATES: (16, 130, 400),
}
_DRIVES: Final = (Drive.OFF, Drive.POSITION, Drive.FORCE)
_RATES: Final = {Drive.POSITION: 0.3, Drive.FORCE: 60e3, Drive.OFF: 0.0}


class State(IntEnum):
    """The states of the rig."""

    SLEEP = 0
    AWAKE = 1
    OPERATE = 2
    HALT = 5
    SAFE = 6
    STOPPED = 7


class Fault(IntEnum):
    """Why it does not operate."""

    NONE = 0
    HEARTBEAT = 3
    LIMIT = 4
    STOPPED = 9


#: How it is built (SI), as its file of dimensions says: wider and heavier than our bench, and its transducers slower.
BUILT: Final = {
    "spring_half_spacing": 1.23,
    "actuator_half_spacing": 1.23,
    "load_cell_y": 1.05,
    "bolster_mass": 2400.0,
    "bolster_inertia": 2500.0,
    "centre_height": 0.3,
    "lateral_actuator_height": 0.2,
    "frame_stiffness": (120e6, 120e6, 60e6),
    "sensor_lag": late("height", "load_cell", by=0.004),
}
_POWER: Final = {State.AWAKE: Power.ON, State.OPERATE: Power.ON, State.HALT: Power.HALTED}
#: Requests: from which states they lead where.
_REQUESTS: Final = {
    17: ((State.SLEEP, State.OPERATE), State.AWAKE),
    34: ((State.AWAKE,), State.OPERATE),
    51: ((State.AWAKE, State.OPERATE, State.HALT), State.SLEEP),
    68: ((State.HALT, State.SAFE, State.STOPPED), State.SLEEP),
}

Frame = tuple[int, bytes]  # 29-bit identifier, eight bytes


def checksum(identifier: int, data: bytes) -> int:
    """Return what the last byte must be: all before it, the identifier first, each xored with the rest turned."""
    found = 0xA5
    for byte in (*identifier.to_bytes(4, "big"), *data[:7]):
        found = (found << 1 & 0xFF | found >> 7) ^ byte
    return found


class CanRig:
    """The rig without a bus or clock: frames in, frames out, cycle by cycle."""

    def __init__(self, seed: int = 0, **changes: float) -> None:
        self.machine = Machine(seed, **BUILT | changes)
        self.state, self.fault = State.SLEEP, Fault.NONE
        self.estop = False
        self.ignored = 0  # corrupt or repeated frames
        self._heard: dict[int, tuple[int, int]] = {}  # counters, and when (ms)
        self._counters: dict[int, int] = {}
        self._parameters = {index: start for index, (_, start, _) in _PARAMETERS.items()}
        self._positions: list[float] | None = None
        self._forces: list[float] | None = None
        self._platform: list[float] | None = None
        self._silent = self._since = self._time = 0
        self._due = 0  # when the axes are to be where the set-points want them

    # -- received frames ---------------------------------------------------------------------------------------------

    def receive(self, identifier: int, data: bytes) -> None:
        """Take one frame; corrupt, repeated and unrelated frames are ignored."""
        take = {
            SET_POSITIONS: self._take_positions,
            SET_FORCES: self._take_forces,
            SET_PLATFORM: self._take_platform,
            HEART: self._take_beat,
            COMMAND: self._take_command,
            PARAMETER: self._take_parameter,
        }.get(identifier)
        if take is None:
            return
        fits = len(data) == 8 and data[7] == checksum(identifier, data)
        counter, time = self._heard.get(identifier, (-1, 0))
        if not fits or (counter == data[6] & 0xF and self._time - time < ANEW):
            self.ignored += 1
            return
        self._heard[identifier] = data[6] & 0xF, self._time
        take(data)

    def _take_positions(self, data: bytes) -> None:
        self._due = self._time + SETPOINTS
        self._positions = [number * 1e-5 - 0.3 for number in _unpack(data, 16, 16, 16)]

    def _take_forces(self, data: bytes) -> None:
        self._forces = [(number ^ 0x8000) * 10.0 - 327_680.0 for number in _unpack(data, 16, 16)]

    def _take_platform(self, data: bytes) -> None:
        self._platform = [number * 1e-5 - 0.3 for number in _unpack(data, 16, 16, 16)]

    def _take_beat(self, data: bytes) -> None:
        self._silent = 0

    def _take_command(self, data: bytes) -> None:
        sources, target = _REQUESTS.get(data[0], ((), State.SLEEP))
        if self.state not in sources or self.estop:
            return
        if data[0] == 68:
            self.fault = Fault.NONE
            target = State.AWAKE if self.state is State.HALT else State.SLEEP
        if self.state is State.OPERATE:
            self.machine.stay()
        if target is State.OPERATE:
            self._positions = self._forces = self._platform = None  # only later frames
        self._enter(target)

    def _take_parameter(self, data: bytes) -> None:
        index = data[0]
        bits, _, highest = _PARAMETERS.get(index, (8, 0, -1))
        value = int.from_bytes(data[1 : 1 + bits // 8], "big")
        if value > highest:
            return
        if index == SHIMS and not self.machine.shim(0.5 * value * KILOGRAM):
            return
        if index == PLATES and not self.machine.fit_plates(value * 1e-4):
            return
        self._parameters[index] = value
        self._set()

    def _set(self) -> None:
        """Bring the parameters into force."""
        now, machine = self._parameters, self.machine
        for axis, mode in enumerate((VERTICAL, VERTICAL, LATERAL)):
            machine.set_drive(axis, _DRIVES[now[mode]])
        machine.valves = [Valve(now[LEFT]), Valve(now[RIGHT])]
        machine.targets = [now[side] * 50.0 - ATMOSPHERE for side in (TO_LEFT, TO_RIGHT)]
        machine.chambers_joined = [bool(now[JOIN_LEFT]), bool(now[JOIN_RIGHT])]
        machine.sides_joined = bool(now[BRIDGE])

    # -- the cycle ---------------------------------------------------------------------------------------------------

    def cycle(self) -> list[Frame]:
        """Move for 10 ms and return the frames that leave then."""
        self._time += CYCLE
        self._since += CYCLE
        self._silent += CYCLE
        self._guard()
        machine = self.machine
        machine.set_power(_POWER.get(self.state, Power.SAFE))
        way = np.zeros(AXES)
        if self.state is State.OPERATE:
            rates = [_RATES[drive] for drive in machine.drives] + [0.3] * (AXES - DRIVES)
            longest = np.array(rates) * (CYCLE * 1e-3)
            cycles = max(self._due - self._time, 0) // CYCLE + 1
            way = np.clip((self._goal() - machine.present) / cycles, -longest, longest)
        machine.move(machine.present + np.outer(np.linspace(1 / CYCLE, 1, CYCLE), way))
        return self._frames()

    def _enter(self, state: State, fault: Fault | None = None) -> None:
        self.state, self._since = state, 0
        if fault is not None and self.fault is Fault.NONE:
            self.fault = fault

    def _guard(self) -> None:
        if self.estop and self.state is not State.STOPPED:
            self._enter(State.STOPPED, Fault.STOPPED)
        if self.state in (State.AWAKE, State.OPERATE):
            if self._silent > HEARTBEAT:
                self._enter(State.HALT, Fault.HEARTBEAT)
            read = self.machine.read
            for side in ("left", "right"):
                if not -0.13 < read(f"{side}_height") < 0.09 or read(f"{side}_bellows_pressure") > 900e3:
                    self._enter(State.SAFE, Fault.LIMIT)
                if not -60e3 < read(f"vertical_{side}_force") < 190e3:
                    self._enter(State.HALT, Fault.LIMIT)
        if self.state is State.HALT and self._since > GIVEN_UP:
            self._enter(State.SAFE)

    def _goal(self) -> np.ndarray:
        """Return where the set-points that have come want the axes."""
        goal = self.machine.present.copy()
        for axis in range(DRIVES):
            told = self._forces if self.machine.drives[axis] is Drive.FORCE else self._positions
            if told is not None and axis < len(told):
                goal[axis] = told[axis]
        if self._platform is not None:
            goal[DRIVES:] = self._platform
        return goal

    # -- what leaves -------------------------------------------------------------------------------------------------

    def _frames(self) -> list[Frame]:
        read = self.machine.read
        frames = [
            self._frame(
                HEIGHTS,
                *(_length(read(n)) for n in ("left_height", "right_height", "lateral_displacement")),
            ),
            self._frame(
                POSITIONS, *(_length(read(f"vertical_{side}_displacement")) for side in ("left", "right"))
            ),
            self._frame(FORCES, *((read(f"vertical_{side}_force") / 10.0, 16) for side in ("left", "right"))),
            self._frame(CELLS_A, *self._cells(2.0, 1, 2, 3)),
            self._frame(CELLS_B, *self._cells(2.0, 4), *self._cells(10.0, 5, 6)),
            self._air(),
            self._frame(
                PLATFORM, *(_length(read(f"platform_{axis}")) for axis in ("vertical", "lateral", "roll"))
            ),
        ]
        if self._time % 20 == 0:
            frames += [
                self._frame(STATUS, (self.state, 8), (self.fault, 8), (self.estop, 8)),
                self._parameter(),
            ]
        if self._time % 100 == 0:
            gas = [f"{side}_{part}" for part in ("bellows", "auxiliary") for side in ("left", "right")]
            frames += [self._frame(GAS, *((10 * (read(f"{one}_temperature") - 223.15), 12) for one in gas))]
        return frames

    def _cells(self, scale: float, *cells: int) -> list[tuple[float, int]]:
        return [(-scale * self.machine.read(f"load_cell_{cell}") / KILOGRAM, 16) for cell in cells]

    def _air(self) -> Frame:
        """The chambers of the left, of the right, and the supply, in turn."""
        place = self._time // CYCLE % 3
        side = ("left", "right", "")[place]
        names = (
            [f"{side}_{part}_pressure" for part in ("bellows", "auxiliary")] if side else ["supply_pressure"]
        )
        return self._frame(
            AIR, (place, 8), *(((self.machine.read(one) + ATMOSPHERE) / 50.0, 16) for one in names)
        )

    def _parameter(self) -> Frame:
        index = 1 + self._time // 20 % len(_PARAMETERS)
        return self._frame(PARAMETER_IS, (index, 8), (self._parameters[index], _PARAMETERS[index][0]))

    def _frame(self, identifier: int, *fields: tuple[float, int]) -> Frame:
        """Return the fields (number, bits) one behind the other, the first bit first, with counter and checksum."""
        counter = self._counters[identifier] = (self._counters.get(identifier, -1) + 1) & 0xF
        packed, used = 0, 0
        for number, bits in fields:
            packed, used = packed << bits | round(number) & (1 << bits) - 1, used + bits
        data = (packed << 48 - used).to_bytes(6, "big") + bytes([counter])
        return identifier, data + bytes([checksum(identifier, data)])


def _unpack(data: bytes, *widths: int) -> list[int]:
    """Return the numbers of so many bits, one behind the other."""
    packed, left = int.from_bytes(data, "big"), 64
    numbers = []
    for bits in widths:
        left -= bits
        numbers.append(packed >> left & (1 << bits) - 1)
    return numbers


def _length(metres: float) -> tuple[float, int]:
    """Return hundredths of a millimetre (of a milliradian) over -300."""
    return (metres + 0.3) / 1e-5, 16


def main() -> None:
    """Serve the rig in real time until the input ends."""
    serve(CanRig(seed=1), CYCLE, sys.argv[1] if len(sys.argv) > 1 else "")


if __name__ == "__main__":
    main()
