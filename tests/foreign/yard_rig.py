"""Rig C, third-party: Modbus/TCP as listed in `yard_c_registers.csv` in its folder, decoded and answered by pymodbus.

``python -m tests.foreign.yard_rig [PORT]`` serves it on 127.0.0.1 until its input ends. It is unit 17, and silent to
any other.

Its manual says: all numbers are of 32 bits in holding registers, the low word first, in the resolution of the list. At
most 32 registers are read or written at once. Coils are read by function 1 and written by 15, registers are read by 3
and written by 16 or 23; others are not known. What the list has no row for is refused, and so is writing what it says
is read only.

The lamps show the state. "enable" starts the pump when it is pressed while nothing is lit; once "ready" is lit, "run"
makes the actuators follow from their position. "stop" ends all. A button that is held for more than two seconds is
jammed, and trips. "heartbeat" has to change once in 600 ms from "enable" on, else it trips: the actuators hold for 3 s,
then it locks out, as after any other fault: it vents the air and goes into its safe position. "acknowledge" puts the
lamps of a trip or a lockout out. At power-up all that can be written is 0, but for shims and plates, which are fitted.
"""

import asyncio
import csv
import struct
import sys
from collections.abc import Coroutine, Sequence
from enum import Enum
from pathlib import Path
from typing import Any, Final

import numpy as np
from pymodbus.constants import ExcCodes
from pymodbus.exceptions import NoSuchIdException
from pymodbus.pdu import DecodePDU, ModbusPDU
from pymodbus.server import ModbusTcpServer
from pymodbus.simulator import DataType, SimData, SimDevice

from tests.foreign.machine import Drive, Interpolation, Machine, Power, Valve, late

LIST: Final = Path(__file__).with_name("yard_c_registers.csv")
UNIT_ID: Final = 17
CYCLE: Final = 20  # ms
JAMMED: Final = 2000  # ms
STARTING: Final = 600  # ms
HEARTBEAT: Final = 600  # ms
GIVEN_UP: Final = 3000  # ms
AT_ONCE: Final = 32
PSI, ATMOSPHERE = 6894.757293168361, 101_325.0  # Pa
#: Functions by their purpose.
_COILS, _WORDS = frozenset({1, 15}), frozenset({3, 16, 23})
_DRIVES: Final = {0: Drive.OFF, 1: Drive.POSITION, 2: Drive.FORCE}
_VALVES: Final = {0: Valve.SHUT, 1: Valve.LEVEL, 2: Valve.FILL, 3: Valve.VENT}
_SIDES: Final = ("left", "right")
_BUTTONS: Final = ("enable", "run", "stop", "acknowledge")
#: Settings, and their values at power-up; the values in force are in a separate row.
_SETTINGS: Final = {
    "vertical_drive": 0.0,
    "lateral_drive": 0.0,
    "left_valve": 0.0,
    "right_valve": 0.0,
    "left_target": 0.0,
    "right_target": 0.0,
    "shim_preload": 53500.0,
    "orifice": 13.0,
}
_VALVE_COILS: Final = ("left_tank", "right_tank", "crossover")

#: How it is built (SI), as its file of dimensions says: wider than our bench, and no two things in line.
BUILT: Final = {
    "spring_half_spacing": 1.1,
    "actuator_half_spacing": 1.18,
    "load_cell_y": 1.35,
    "bolster_mass": 1600.0,
    "bolster_inertia": 1100.0,
    "sensor_lag": late("height", "displacement", by=0.003),
}


class State(Enum):
    """What is lit."""

    OFF = ()
    STARTING = ("pump",)
    READY = ("pump", "ready")
    FOLLOWING = ("pump", "ready", "following")
    TRIPPED = ("pump", "tripped")
    LOCKED_OUT = ("locked_out",)


_LIVE: Final = (State.STARTING, State.READY, State.FOLLOWING)
_POWER: Final = {State.READY: Power.ON, State.FOLLOWING: Power.ON, State.TRIPPED: Power.HALTED}
LAMPS: Final = ("pump", "ready", "following", "tripped", "locked_out")
CAUSES: Final = ("heartbeat_lost", "overpressure", "overtravel", "overload", "button_jammed")


class YardRig:
    """The controller without a socket or clock: requests in, answers out, cycle by cycle."""

    def __init__(self, seed: int = 0, **changes: Any) -> None:
        self.machine = Machine(seed, **BUILT | changes)
        self.state, self.cause = State.OFF, ""
        self.estop = False
        with LIST.open(newline="") as file:
            rows = {row["Tag name"]: row for row in csv.DictReader(file)}
        coil = {name: row["Register type"] == "Coil" for name, row in rows.items()}
        self._at = {name: (coil[name], int(row["Address"][1:]) - 1) for name, row in rows.items()}
        self._count = {name: float(row["Resolution"] or 1) for name, row in rows.items()}
        places = [
            (kind, first + k, rows[name]["R/W"] == "R/W")
            for name, (kind, first) in self._at.items()
            for k in range(1 if kind else 2)
        ]
        self._held: dict[tuple[bool, int], int] = {(kind, place): 0 for kind, place, _ in places}
        self._written = {(kind, place) for kind, place, written in places if written}
        self._pressed = dict.fromkeys(_BUTTONS, 0)  # ms
        self._since = self._silent = 0  # ms since the state began, and since the heart beat
        self._beat = 0
        self._interpolation = Interpolation(CYCLE)
        self._decoder = DecodePDU(True)
        for name, value in _SETTINGS.items():
            self._put(name, value)
        self._in_force = dict(_SETTINGS)
        self._publish()

    # -- Modbus ------------------------------------------------------------------------------------------------------

    def answer(self, request: bytes) -> bytes:
        """Return the answer to one request (ADU), empty where it is for another unit."""
        decoded = self._decoder.decode(request[7:])
        if request[6] != UNIT_ID or decoded is None:
            return b""
        reply = _now(decoded.datastore_update(self, UNIT_ID))
        data = bytes([reply.function_code]) + reply.encode()
        return request[:2] + struct.pack(">HHB", 0, len(data) + 1, UNIT_ID) + data

    async def async_getValues(
        self, unit: int, function: int, address: int, count: int = 1
    ) -> list[int] | list[bool] | ExcCodes:
        """Return the values of coils or registers, for pymodbus."""
        found = self._places(unit, function, address, count, set(self._held))
        return found if isinstance(found, ExcCodes) else [self._held[place] for place in found]

    async def async_setValues(
        self, unit: int, function: int, address: int, values: Sequence[int]
    ) -> ExcCodes | None:
        """Take coils or registers, all or none of them, for pymodbus."""
        found = self._places(unit, function, address, len(values), self._written)
        if isinstance(found, ExcCodes):
            return found
        self._held.update(zip(found, map(int, values), strict=True))
        return None

    def _places(
        self, unit: int, function: int, address: int, count: int, allowed: set[tuple[bool, int]]
    ) -> list[tuple[bool, int]] | ExcCodes:
        if unit != UNIT_ID:
            raise NoSuchIdException
        if function not in _COILS | _WORDS:
            return ExcCodes.ILLEGAL_FUNCTION
        if not 1 <= count <= AT_ONCE:
            return ExcCodes.ILLEGAL_VALUE
        places = [(function in _COILS, address + k) for k in range(count)]
        return places if allowed.issuperset(places) else ExcCodes.ILLEGAL_ADDRESS

    def _put(self, name: str, value: float) -> None:
        coil, place = self._at[name]
        if coil:
            self._held[True, place] = int(value)
            return
        low, high = struct.unpack("<HH", struct.pack("<i", round(value / self._count[name])))
        self._held[False, place], self._held[False, place + 1] = low, high

    def _get(self, name: str) -> float:
        coil, place = self._at[name]
        if coil:
            return self._held[True, place]
        words = struct.pack("<HH", self._held[False, place], self._held[False, place + 1])
        return float(struct.unpack("<i", words)[0] * self._count[name])

    # -- the cycle ---------------------------------------------------------------------------------------------------

    def cycle(self) -> None:
        """Read the written values, move for 20 ms, and publish the state."""
        self._since += CYCLE
        self._watch()
        self._guard()
        for name in _BUTTONS:
            self._press(name)
        self._set()
        self.machine.set_power(_POWER.get(self.state, Power.SAFE))
        goal = self._goal() if self.state is State.FOLLOWING else None
        self.machine.move(self._interpolation.path(self.machine, goal))
        self._publish()

    def _enter(self, state: State, cause: str = "") -> None:
        self.state, self._since = state, 0
        self.cause = self.cause or cause

    def _watch(self) -> None:
        """Look whether the heart beats."""
        beat = int(self._get("heartbeat"))
        self._silent = 0 if beat != self._beat or self.state not in _LIVE else self._silent + CYCLE
        self._beat = beat
        if self._silent > HEARTBEAT:
            self._enter(State.TRIPPED, "heartbeat_lost")
        if self.state is State.TRIPPED and self._since > GIVEN_UP:
            self._enter(State.LOCKED_OUT)
        if self.state is State.STARTING and self._since >= STARTING:
            self._enter(State.READY)

    def _guard(self) -> None:
        """Look at what must not be."""
        if self.estop and self.state is not State.LOCKED_OUT:
            self._enter(State.LOCKED_OUT)
        if self.state not in (*_LIVE, State.TRIPPED):
            return
        read = self.machine.read
        for side in _SIDES:
            if read(f"{side}_bellows_pressure") > 900e3:
                self._enter(State.LOCKED_OUT, "overpressure")
            if not -0.13 < read(f"{side}_height") < 0.09:
                self._enter(State.LOCKED_OUT, "overtravel")
            if not -60e3 < read(f"vertical_{side}_force") < 190e3 and self.state is not State.TRIPPED:
                self._enter(State.TRIPPED, "overload")

    def _press(self, name: str) -> None:
        """Look at one button, which acts when it goes down."""
        down = bool(self._get(name))
        edge = down and not self._pressed[name]
        self._pressed[name] = self._pressed[name] + CYCLE if down else 0
        if self._pressed[name] > JAMMED and self.state in _LIVE:
            self._enter(State.TRIPPED, "button_jammed")
        if not edge:
            return
        if name == "enable" and self.state is State.OFF and not self.estop:
            self._enter(State.STARTING)
        elif name == "run" and self.state is State.READY:
            self._enter(State.FOLLOWING)
        elif name == "stop" and self.state in _LIVE:
            self._enter(State.OFF)
        elif name == "acknowledge" and self.state not in (*_LIVE, State.OFF) and not self.estop:
            self.cause = ""
            self._enter(State.OFF)

    def _set(self) -> None:
        """Bring settings into force, as far as they are allowed now."""
        machine = self.machine
        wanted = {name: self._get(name) for name in _SETTINGS}
        for name, known in (
            ("vertical_drive", _DRIVES),
            ("lateral_drive", _DRIVES),
            ("left_valve", _VALVES),
            ("right_valve", _VALVES),
        ):
            if wanted[name] not in known:
                wanted[name] = self._in_force[name]
        for name, change, unit in (
            ("shim_preload", machine.shim, 1.0),
            ("orifice", machine.fit_plates, 1e-3),
        ):
            if wanted[name] != self._in_force[name] and not change(wanted[name] * unit):
                wanted[name] = self._in_force[name]
        for axis, name in enumerate(("vertical_drive", "vertical_drive", "lateral_drive")):
            machine.set_drive(axis, _DRIVES[int(wanted[name])])
        machine.valves = [_VALVES[int(wanted[f"{side}_valve"])] for side in _SIDES]
        machine.targets = [wanted[f"{side}_target"] * PSI - ATMOSPHERE for side in _SIDES]
        machine.chambers_joined = [bool(self._get(f"open_{name}")) for name in _VALVE_COILS[:2]]
        machine.sides_joined = bool(self._get(f"open_{_VALVE_COILS[2]}"))
        self._in_force = wanted

    def _goal(self) -> np.ndarray:
        """Return where the set-points want the axes."""
        drives = [
            self._get(f"set_force_{axis}")
            if drive is Drive.FORCE
            else self._get(f"set_position_{axis}") * 1e-3
            for axis, drive in zip(("left", "right", "lateral"), self.machine.drives, strict=True)
        ]
        return np.array([*drives, *(self._get(f"set_{axis}") * 1e-3 for axis in ("heave", "sway", "roll"))])

    def _publish(self) -> None:
        """Publish the readings, the lamps, and the settings in force."""
        read = self.machine.read
        for side in _SIDES:
            self._put(f"spring_height_{side}", read(f"{side}_height") * 1e3)
            for chamber, called in (("bellows", "bellows"), ("auxiliary", "tank")):
                pressure = read(f"{side}_{chamber}_pressure")
                self._put(f"{called}_pressure_{side}", (pressure + ATMOSPHERE) / PSI)
                self._put(
                    f"{called}_temperature_{side}", read(f"{side}_{chamber}_temperature") * 9 / 5 - 459.67
                )
            self._put(f"force_{side}", read(f"vertical_{side}_force"))
            self._put(f"position_{side}", read(f"vertical_{side}_displacement") * 1e3)
        self._put("supply_pressure", (read("supply_pressure") + ATMOSPHERE) / PSI)
        self._put("force_lateral", read("lateral_force"))
        self._put("position_lateral", read("lateral_displacement") * 1e3)
        for cell in range(1, 7):
            self._put(f"load_cell_{cell}", read(f"load_cell_{cell}"))
        for axis, sensor in (("heave", "vertical"), ("sway", "lateral"), ("roll", "roll")):
            self._put(f"platform_{axis}", read(f"platform_{sensor}") * 1e3)
        for name, value in self._in_force.items():
            self._put(f"{name}_is", value)
        for name in _VALVE_COILS:
            self._put(f"{name}_is_open", self._get(f"open_{name}"))
        for lamp in LAMPS:
            self._put(lamp, lamp in self.state.value)
        for cause in CAUSES:
            self._put(cause, cause == self.cause)
        self._put("emergency_stop", self.estop)


def _now(answer: Coroutine[Any, Any, ModbusPDU]) -> ModbusPDU:
    """Return what a coroutine that waits for nothing comes to."""
    try:
        answer.send(None)
    except StopIteration as done:
        return done.value
    raise AssertionError("it waits")


async def serve(rig: YardRig, port: int) -> None:
    """Let pymodbus serve the rig in real time until the input ends."""
    anything = SimDevice(UNIT_ID, SimData(0, datatype=DataType.REGISTERS))
    server = ModbusTcpServer(anything, address=("127.0.0.1", port), ignore_missing_devices=True)
    server.context = rig
    await server.serve_forever(background=True)
    print(f"ready modbus=127.0.0.1:{server.transport.sockets[0].getsockname()[1]}", flush=True)
    loop = asyncio.get_running_loop()
    ended = loop.run_in_executor(None, sys.stdin.read)
    due = loop.time()
    while not ended.done():
        due += CYCLE * 1e-3
        await asyncio.sleep(max(0.0, due - loop.time()))
        rig.cycle()
    await server.shutdown()


def main() -> None:
    """Serve the rig at the requested port, or at any."""
    rig = YardRig(seed=1)
    rig.cycle()
    asyncio.run(serve(rig, int(sys.argv[1]) if len(sys.argv) > 1 else 0))


if __name__ == "__main__":
    main()
