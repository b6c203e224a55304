"""A scripted peer, made from the protocol alone: it knows nothing of the simulated rig."""

import struct
from collections.abc import Callable, Iterator

import numpy as np
import pytest

from bench_protocol import modbus
from bench_protocol.can_codec import Decoder, Encoder
from bench_protocol.clock import VirtualClock
from bench_protocol.frames import Block, join
from bench_protocol.registers import PROBE_FLOAT, PROBE_WORD
from bench_protocol.signals import Kind
from bench_protocol.table import TABLE
from bench_protocol.words import ACTUATORS, CONTROL_MODES, REASONS, STATES
from drivers.bench import Bench
from drivers.memory import Faults, FaultyCan, InMemoryCan
from drivers.modbus_port import InMemoryModbus
from drivers.wiring.own import own_wiring

STEP = 5_000_000
#: What this peer gives to everybody who takes the lease.
TOKEN = 0x1234
FAULTED = ("FAULT_HOLD", "FAULT_DISABLED", "ESTOP")


class Peer:
    """A bench of one line per rule: whatever is commanded is measured one step later."""

    def __init__(self) -> None:
        self.values = {signal.name: 0.0 for signal in TABLE.of_kind(Kind.MEASUREMENT, Kind.STATUS)}
        self.values["rig.map_hash"] = float(TABLE.map_hash)
        # Registers hold singles.
        self.settings = {
            signal.name: float(np.float32(signal.default)) for signal in TABLE.of_kind(Kind.SETTING)
        }
        self.staged = dict(self.settings)
        self.state, self.reason = "OFF", "none"
        self.bits = (0.0, 0.0, 0.0, 0.0)
        self.commands: dict[str, float] = {}
        self.blocks: list[Block] = []  # all that was received
        self.requests: list[int] = []  # function codes
        self.actions: list[str] = []
        self.lease, self.foreign = 0, False
        self.estop = False
        self.silent_can = self.silent_modbus = False
        self.watchdog = self.fed = 0
        self.refuse_apply = False
        self.sluggish = False  # the actuators do not follow
        self.map_hash, self.probe_word = TABLE.map_hash, PROBE_WORD
        self.program_end = 0.0
        self.time = 0
        self.tracks: list[tuple[int, str, dict[str, float]]] = []  # (time, state, commands) every 20 ms
        self._encoder, self._decoder = Encoder(TABLE), Decoder(TABLE, from_rig=False)
        self._messages = [message for message in TABLE.messages if message.from_rig and message.rate]

    # -- CAN ---------------------------------------------------------------------------------------------------

    def receive(self, block: Block) -> None:
        self.blocks.append(block)
        stamped = block.copy()
        stamped["time"] = self.time
        samples = self._decoder.decode(stamped)
        for row, value in zip(samples.signals, samples.values, strict=True):
            self.commands[TABLE.signals[row].name] = float(value)
        bits = tuple(
            self.commands.get(f"control.{bit}", 0.0) for bit in ("enable", "hold", "active", "reset")
        )
        self._command(bits)

    def _command(self, bits: tuple[float, ...]) -> None:
        rises = [new > old for new, old in zip(bits, self.bits, strict=True)]
        self.bits = bits
        enable, hold, active, _ = bits
        live = self.state in ("AIR_LOW", "AIR_HIGH", "HOLD", "ACTIVE")
        if not enable and (live or self.state == "FAULT_HOLD"):
            self.state = "DISABLED" if live else "FAULT_DISABLED"
        elif rises[3]:
            self.reset()
        elif self.state == "AIR_HIGH" and rises[1]:
            self.state = "HOLD"
        elif self.state in ("HOLD", "ACTIVE") and not hold:
            self.state = "AIR_HIGH"
        elif self.state == "HOLD" and rises[2]:
            self.state = "ACTIVE"
        elif self.state == "ACTIVE" and not active:
            self.state = "HOLD"

    def reset(self) -> None:
        after = {"DISABLED": "AIR_LOW", "FAULT_HOLD": "HOLD", "FAULT_DISABLED": "DISABLED"}
        if self.state == "ESTOP" and not self.estop:
            self.state, self.reason = "DISABLED", "none"
        elif self.state in after and self.bits[0]:
            self.state, self.reason = after[self.state], "none"

    def fault(self, state: str, reason: str) -> None:
        self.state, self.reason = state, reason

    def advance(self, until: int) -> Block:
        """Let time pass to ``until``; return the frames sent meanwhile."""
        blocks = []
        while self.time + STEP <= until:
            self.time += STEP
            self._step()
            if not self.silent_can:
                blocks.append(self._frames())
        return join(blocks)

    def _step(self) -> None:
        if self.state == "OFF" and self.time >= 20_000_000:
            self.state = "DISABLED"
        values, settings = self.values, self.settings
        for actuator in ACTUATORS:
            axis = "lateral" if actuator == "lateral" else "vertical"
            mode = CONTROL_MODES[round(settings[f"{axis}.control"])]
            target = self.commands.get(f"{actuator}.{mode}_setpoint", np.nan)
            if self.state == "ACTIVE" and not self.sluggish and not np.isnan(target):
                values[f"{actuator}.{mode}"] = target
        for axis in ("vertical", "lateral", "roll"):
            if self.state == "ACTIVE":
                values[f"platform.{axis}"] = self.commands.get(f"platform.{axis}_setpoint", 0.0)
        for side in ("left", "right"):
            name, target = f"{side}.bellows_pressure", settings[f"air.{side}_target"]
            if settings[f"air.{side}_mode"] == 2:
                values[name] = (
                    min(target, values[name] + 1e5 * STEP / 1e9) if values[name] < target else values[name]
                )
            elif settings[f"air.{side}_mode"] == 3:
                values[name] = max(target, values[name] - 1e5 * STEP / 1e9)
        if values["rig.program"] == 1:
            left = max(0.0, self.program_end - self.time / 1e9)
            done = settings["generator.cycles"] - left * settings["generator.frequency"]
            values["rig.generator_cycle"] = float(np.floor(done + 1e-9))
            if left == 0:
                values["rig.program"] = 0.0
        values["rig.state"] = float(STATES.index(self.state))
        values["rig.reason"] = float(REASONS.index(self.reason))

    def _frames(self) -> Block:
        full = np.full(len(TABLE.signals), np.nan)
        for name, value in self.values.items():
            full[TABLE.index[name]] = value
        due = [m.name for m in self._messages if self.time % round(1e9 / m.rate) == 0]
        if self.time % 20_000_000 == 0:
            self.tracks.append((self.time, self.state, dict(self.commands)))
        return self._encoder.encode(full, self._encoder.rows(due), self.time)

    # -- Modbus ------------------------------------------------------------------------------------------------

    def answer(self, request: bytes) -> bytes:
        self.requests.append(request[7])
        if self.silent_modbus:
            return b""
        return modbus.answer(request, self)

    def read_coils(self, address: int, count: int) -> list[bool]:
        del address
        return [False] * count

    def read_discrete(self, address: int, count: int) -> list[bool]:
        bits = {r.address: r.signal for r in TABLE.registers if r.space == "discrete"}
        return [bits[address + k] == "interlock.estop" and self.estop for k in range(count)]

    def read_input(self, address: int, count: int) -> list[int]:
        words = {0: [7], 1: _two(self.map_hash), 3: _float(PROBE_FLOAT), 5: _two(self.probe_word)}
        for register in TABLE.registers:
            if register.space == "input" and register.signal == "modbus.sequence":
                words[register.address] = [self.time // STEP & 0xFFFF]
            elif register.space == "input" and register.encoding == "float32":
                told = self.settings | self.values
                words[register.address] = _float(told.get(register.signal, PROBE_FLOAT))
        flat = {place + k: word for place, pair in words.items() for k, word in enumerate(pair)}
        return [flat[address + k] for k in range(count)]

    def read_holding(self, address: int, count: int) -> list[int]:
        flat = {0: self.lease, 1: 0}
        for register in _holding().values():
            flat.update(enumerate(_float(self.staged[register.signal]), register.address))
        return [flat[address + k] for k in range(count)]

    def write_coils(self, address: int, values: list[bool]) -> None:
        self._authorise()
        coils = {r.address: r.signal for r in TABLE.registers if r.space == "coil"}
        for k, value in enumerate(values):
            if value:
                self._act(coils[address + k])

    def _act(self, name: str) -> None:
        self.actions.append(name)
        match name:
            case "action.apply":
                if self.refuse_apply:
                    raise modbus.ModbusError(modbus.DEVICE_FAILURE)
                self.settings = dict(self.staged)
            case "action.air_high" if self.state == "AIR_LOW":
                self.state = "AIR_HIGH"
            case "action.program_run":
                self.values["rig.program"] = 1.0
                self.values["rig.generator_cycle"] = 0.0
                duration = self.settings["generator.cycles"] / self.settings["generator.frequency"]
                self.program_end = self.time / 1e9 + duration
            case "action.program_add":
                pass
            case "action.program_stop":
                self.values["rig.program"] = 3.0
            case "action.reset":
                self.reset()

    def write_holding(self, address: int, values: list[int]) -> None:
        self._authorise()
        if address == 0:
            self.lease = self._decoder.token = TOKEN if values[0] else 0
            return
        if address == 1:
            self.watchdog, self.fed = values[0], self.fed + 1
            return
        staged = dict(self.staged)
        for name, register in _holding().items():
            k = register.address - address
            if 0 <= k < len(values):
                staged[name] = struct.unpack(">f", struct.pack(">HH", *values[k : k + 2]))[0]
        self.staged = staged

    def _authorise(self) -> None:
        if self.foreign:
            raise modbus.ModbusError(modbus.NO_AUTHORITY)

    def read_file(self, file: int, record: int, count: int) -> list[int]:
        raise modbus.ModbusError(modbus.ILLEGAL_FUNCTION)

    def identification(self) -> dict[int, bytes]:
        return {0: b"scripted"}


def _holding() -> dict:
    return {r.signal: r for r in TABLE.registers if r.space == "holding" and r.signal in TABLE.index}


def _two(word: int) -> list[int]:
    return [word >> 16, word & 0xFFFF]


def _float(value: float) -> list[int]:
    return list(struct.unpack(">HH", struct.pack(">f", value)))


class World:
    """A peer, a bench and the virtual time in which they live."""

    def __init__(self, faults: Faults | None = None, seed: int = 0) -> None:
        self.peer, self.clock = Peer(), VirtualClock()
        self.can = InMemoryCan(self.peer.receive)
        self.clock.attach(lambda until: self.can.receive(self.peer.advance(until)))
        port = self.can if faults is None else FaultyCan(self.can, faults, seed)
        self.modbus = InMemoryModbus(self.peer.answer)
        self.bench = Bench(own_wiring(port, self.modbus), self.clock)

    def pass_time(self, seconds: float) -> None:
        """Let time pass without the bench looking."""
        self.clock.sleep_until(self.clock.now() + round(seconds * 1e9))


@pytest.fixture(scope="session")
def make_world() -> Callable[..., World]:
    return World


@pytest.fixture
def world() -> World:
    return World()


@pytest.fixture
def bench(world: World) -> Iterator[Bench]:
    """A connected bench."""
    with world.bench as bench:
        yield bench


@pytest.fixture
def armed(bench: Bench) -> Bench:
    """A bench in ACTIVE."""
    bench.arm()
    return bench
