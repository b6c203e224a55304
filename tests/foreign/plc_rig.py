"""Rig A, a stranger's: a PLC alone, everything in scaled integers on Modbus/TCP, a process image every 50 ms.

``python -m tests.foreign.plc_rig [PORT]`` serves it on 127.0.0.1 until its input ends.

Input registers:

    0           cycles, counts up
    1           0 STOP, 1 STARTING, 2 READY, 3 RUN, 8 QUICK STOP, 9 FAULT, 12 EMERGENCY STOP
    2           the request that is acknowledged, plus 128 if it was refused
    3           fault: 1 watchdog, 2 pressure, 3 travel, 4 force, 5 emergency stop
    10, 11      distance of the lasers: 400 mm less the height, 0.01 mm
    12 .. 15    gauge pressures: bellows left, right, chambers left, right, 0.5 mbar
    16          gauge pressure of the supply, 10 mbar
    17, 18      gas in the bellows, 0.1 degC
    20 .. 25    forces of the actuators, N
    26 .. 31    positions of the actuators, um
    32 .. 43    load cells 1 to 6, N
    44 .. 49    platform, um, um, urad
    60 .. 68    what of the holding registers 2 to 10 is in force

Holding registers:

    0           request: 1 stop, 2 ready, 3 run, 4 reset; taken back when it is acknowledged
    1           watchdog: a client must count up
    2, 3        vertical and lateral actuators: 0 off, 1 position, 2 force
    4, 5        valves: 0 shut, 1 level, 2 fill, 4 vent
    6, 7        targets of the valves, mbar
    8           bits: 0 and 1 chambers joined, 2 sides joined
    9           shims, for a preload of so many 10 N
    10          orifice plates, 0.1 mm
    20 .. 25    positions, um
    26 .. 31    forces, N
    32 .. 37    platform, um, um, urad

Two registers are one number of 32 bits, the low one first. Contact 0: the emergency stop.
"""

import struct
import sys
import threading
import time
from enum import IntEnum
from typing import Final

import numpy as np

from tests.foreign import modbus_server
from tests.foreign.machine import DRIVES, Drive, Interpolation, Machine, Power, Valve, late
from tests.foreign.modbus_server import ILLEGAL_ADDRESS, ILLEGAL_VALUE, Refusal, Server

CYCLE: Final = 50  # ms
WATCHDOG: Final = 500  # ms without counting, until the rig holds
GIVEN_UP: Final = 3000  # ms more, until it goes into its safe position
STARTING: Final = 400  # ms
REQUEST, COUNTED, SETTINGS, POSITIONS, FORCES, HOLDINGS = 0, 1, 2, 20, 26, 38
CELLS, IN_FORCE, INPUTS = 32, 60, 69

_DRIVES: Final = {0: Drive.OFF, 1: Drive.POSITION, 2: Drive.FORCE}
_VALVES: Final = {0: Valve.SHUT, 1: Valve.LEVEL, 2: Valve.FILL, 4: Valve.VENT}
_START: Final = (1, 1, 0, 0, 0, 0, 7, 5350, 130)  # of the settings
#: What the registers take; of the others any number.
_HIGHEST: Final = {2: 2, 3: 2, 4: 4, 5: 4, 6: 9000, 7: 9000, 8: 7, 9: 16000, 10: 400}


class State(IntEnum):
    """The states of the PLC."""

    STOP = 0
    STARTING = 1
    READY = 2
    RUN = 3
    QUICK_STOP = 8
    FAULT = 9
    EMERGENCY_STOP = 12


class Fault(IntEnum):
    """Why it left RUN."""

    NONE = 0
    WATCHDOG = 1
    PRESSURE = 2
    TRAVEL = 3
    FORCE = 4
    EMERGENCY_STOP = 5


#: How it is built (SI), as its file of dimensions says: narrower and lighter than our bench, and no two things in line.
BUILT: Final = {
    "spring_half_spacing": 0.9,
    "actuator_half_spacing": 0.97,
    "load_cell_y": 1.2,
    "bolster_mass": 900.0,
    "bolster_inertia": 500.0,
    "centre_height": 0.2,
    "lateral_actuator_height": 0.4,
    "sensor_lag": late("height", "displacement", by=0.004),
}
_LIVE: Final = (State.STARTING, State.READY, State.RUN)
_POWER: Final = {State.READY: Power.ON, State.RUN: Power.ON, State.QUICK_STOP: Power.HALTED}
#: Requests: from which states they lead where.
_REQUESTS: Final = {
    1: ((*_LIVE, State.QUICK_STOP), State.STOP),
    2: ((State.STOP, State.RUN), State.STARTING),
    3: ((State.READY,), State.RUN),
    4: ((State.QUICK_STOP, State.FAULT, State.EMERGENCY_STOP), State.STOP),
}


class PlcRig:
    """The PLC without a socket or clock: requests in, answers out, cycle by cycle."""

    def __init__(self, seed: int = 0, **changes: float) -> None:
        self.machine = Machine(seed, **BUILT | changes)
        self.state, self.fault = State.STOP, Fault.NONE
        self.estop = False
        self._holding = [0] * HOLDINGS
        self._holding[SETTINGS : SETTINGS + len(_START)] = _START
        self._in_force = list(_START)
        self._image = [0] * INPUTS
        self._cycles = 0
        self._request = self._acknowledged = self._counted = 0
        self._since = 0  # ms since it was counted, or since the state began
        self._silent = 0
        self._interpolation = Interpolation(CYCLE)
        self._publish()

    # -- Modbus ------------------------------------------------------------------------------------------------------

    def answer(self, request: bytes) -> bytes:
        """Return the answer to one request."""
        return modbus_server.answer(self, request)

    def read_words(self, holding: bool, address: int, count: int) -> list[int]:
        """Return registers of the process image, or written ones."""
        registers = self._holding if holding else self._image
        if address + count > len(registers):
            raise Refusal(ILLEGAL_ADDRESS)
        return registers[address : address + count]

    def read_bits(self, coils: bool, address: int, count: int) -> list[bool]:
        """Return the contacts, of which there is one."""
        if coils or address + count > 1:
            raise Refusal(ILLEGAL_ADDRESS)
        return [self.estop]

    def write_words(self, address: int, words: list[int]) -> None:
        """Keep registers for the next cycle; all or none of them."""
        if address + len(words) > HOLDINGS:
            raise Refusal(ILLEGAL_ADDRESS)
        for place, word in enumerate(words, address):
            if word > _HIGHEST.get(place, 0xFFFF) or (place in (4, 5) and word not in _VALVES):
                raise Refusal(ILLEGAL_VALUE)
        self._holding[address : address + len(words)] = words

    # -- the cycle ---------------------------------------------------------------------------------------------------

    def cycle(self) -> None:
        """Read the written registers, move for 50 ms, and publish a new image."""
        self._cycles += 1
        self._since += CYCLE
        self._watch()
        self._guard()
        self._answer_request()
        self._set()
        self.machine.set_power(_POWER.get(self.state, Power.SAFE))
        self.machine.move(self._path())
        self._publish()

    def _enter(self, state: State, fault: Fault | None = None) -> None:
        self.state, self._since = state, 0
        if fault is not None and self.fault is Fault.NONE:
            self.fault = fault

    def _watch(self) -> None:
        """Check whether a client counts."""
        counted = self._holding[COUNTED]
        self._silent = 0 if 0 < (counted - self._counted) & 0xFFFF < 1000 else self._silent + CYCLE
        self._counted = counted
        if self.state in _LIVE and self._silent > WATCHDOG:
            self._enter(State.QUICK_STOP, Fault.WATCHDOG)
        if self.state is State.QUICK_STOP and self._since > GIVEN_UP:
            self._enter(State.FAULT)
        if self.state is State.STARTING and self._since >= STARTING:
            self._enter(State.READY)

    def _guard(self) -> None:
        """Look at what must not be."""
        if self.estop and self.state is not State.EMERGENCY_STOP:
            self._enter(State.EMERGENCY_STOP, Fault.EMERGENCY_STOP)
        if self.state not in (*_LIVE, State.QUICK_STOP):
            return
        read = self.machine.read
        for side in ("left", "right"):
            if read(f"{side}_bellows_pressure") > 900e3:
                self._enter(State.FAULT, Fault.PRESSURE)
            if not -0.13 < read(f"{side}_height") < 0.09:
                self._enter(State.FAULT, Fault.TRAVEL)
            if not -60e3 < read(f"vertical_{side}_force") < 190e3:
                self._enter(State.QUICK_STOP, Fault.FORCE)

    def _answer_request(self) -> None:
        """Answer a request: one that is new, and only after the one before was taken back."""
        request = self._holding[REQUEST]
        if request == self._request:
            return
        before, self._request = self._request, request
        if request == 0:
            self._acknowledged = 0
            return
        sources, target = _REQUESTS.get(request, ((), State.STOP))
        allowed = before == 0 and self.state in sources and not (request == 4 and self.estop)
        self._acknowledged = request if allowed else request | 0x80
        if not allowed:
            return
        if request == 4:
            self.fault = Fault.NONE
            if self.state is State.QUICK_STOP:
                target = State.READY
        if request == 2 and self.state is State.RUN:
            target = State.READY
            self.machine.stay()
        self._enter(target)

    def _set(self) -> None:
        """Bring settings into force, as far as they are allowed now."""
        wanted = self._holding[SETTINGS : SETTINGS + len(_START)]
        machine = self.machine
        if wanted[7] != self._in_force[7] and not machine.shim(wanted[7] * 10.0):
            wanted[7] = self._in_force[7]
        if wanted[8] != self._in_force[8] and not machine.fit_plates(wanted[8] * 1e-4):
            wanted[8] = self._in_force[8]
        for axis, number in enumerate((wanted[0], wanted[0], wanted[1])):
            machine.set_drive(axis, _DRIVES[number])
        machine.valves = [_VALVES[number] for number in wanted[2:4]]
        machine.targets = [number * 100.0 for number in wanted[4:6]]
        machine.chambers_joined = [bool(wanted[6] & 1), bool(wanted[6] & 2)]
        machine.sides_joined = bool(wanted[6] & 4)
        self._in_force = wanted

    def _path(self) -> np.ndarray:
        """Return the way of the axes in this cycle."""
        return self._interpolation.path(self.machine, self._goal() if self.state is State.RUN else None)

    def _goal(self) -> np.ndarray:
        """Return where the set-points want the axes."""
        numbers = _numbers(self._holding[POSITIONS:])
        goal = np.array((*numbers[:DRIVES], *numbers[2 * DRIVES :])) * 1e-6
        for axis in range(DRIVES):
            if self.machine.drives[axis] is Drive.FORCE:
                goal[axis] = numbers[DRIVES + axis]
        return goal

    def _publish(self) -> None:
        """Write a new process image, all at once."""
        read = self.machine.read
        image = [self._cycles & 0xFFFF, self.state, self._acknowledged, self.fault]
        image += [0] * 6
        image += [round((0.4 - read(f"{side}_height")) / 1e-5) & 0xFFFF for side in ("left", "right")]
        for chamber in ("bellows", "auxiliary"):
            image += [_word(read(f"{side}_{chamber}_pressure") / 50.0) for side in ("left", "right")]
        image += [_word(read("supply_pressure") / 1000.0)]
        image += [_word((read(f"{side}_bellows_temperature") - 273.15) / 0.1) for side in ("left", "right")]
        image += [0]
        drives = ("vertical_left", "vertical_right", "lateral")
        for values, step in (
            ([read(f"{drive}_force") for drive in drives], 1.0),
            ([read(f"{drive}_displacement") for drive in drives], 1e-6),
            ([read(f"load_cell_{cell}") for cell in range(1, 7)], 1.0),
            ([read(f"platform_{axis}") for axis in ("vertical", "lateral", "roll")], 1e-6),
        ):
            for value in values:
                image += _words(round(value / step))
        image += [0] * (IN_FORCE - len(image)) + self._in_force
        self._image = image


def _word(number: float) -> int:
    return max(-0x8000, min(0x7FFF, round(number))) & 0xFFFF


def _words(number: int) -> tuple[int, int]:
    low, high = struct.unpack("<HH", struct.pack("<i", number))
    return low, high


def _numbers(words: list[int]) -> tuple[int, ...]:
    count = len(words) // 2
    return struct.unpack(f"<{count}i", struct.pack(f"<{2 * count}H", *words))


def main() -> None:
    """Serve the rig in real time until the input ends."""
    rig = PlcRig(seed=1)
    rig.cycle()
    server = Server(int(sys.argv[1]) if len(sys.argv) > 1 else 0, rig.answer)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    ended = threading.Event()
    threading.Thread(target=lambda: (sys.stdin.read(), ended.set()), daemon=True).start()
    print(f"ready modbus=127.0.0.1:{server.port}", flush=True)
    due = time.monotonic()
    while not ended.is_set():
        due += CYCLE * 1e-3
        time.sleep(max(0.0, due - time.monotonic()))
        with server.lock:
            rig.cycle()
    server.shutdown()


if __name__ == "__main__":
    main()
