"""Direct access to CAN and Modbus of a rig, without our drivers: frames to receive and to send, and requests as
bytes.
"""

import socket
import struct
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

from astb.rig_in_memory import RigInMemory
from astb.session import answers, build_rig, started
from bench_protocol.can_codec import Decoder
from bench_protocol.clock import Clock, RealClock, VirtualClock
from bench_protocol.frames import Block, join
from bench_protocol.table import TABLE
from bench_protocol.units import NS, s
from bench_protocol.words import STATES
from drivers.can_port import open_can
from drivers.errors import LinkLost
from drivers.stamps import StampClock

if TYPE_CHECKING:
    from astb.rig_file import RigFile
    from drivers.can_port import CanPort

ANSWER_WITHIN: Final = 2 * s
_HEADER: Final = struct.Struct(">HHHBB")


class Answer(NamedTuple):
    """The answer to a request: the code of the exception (0 for none), the data, and its latency (s)."""

    code: int
    data: bytes
    took: float


class Cable(NamedTuple):
    """A Modbus connection as two functions: one sends a request and returns the answer, the other closes the
    connection.
    """

    exchange: Callable[[bytes], bytes]
    close: Callable[[], object]


class ModbusConnection:
    """One Modbus connection. Its requests are bytes, and are sent without a check."""

    def __init__(self, clock: Clock, cable: Cable, unit: int) -> None:
        self._clock, self._exchange, self._unit = clock, cable.exchange, unit
        self.close = cable.close
        self._number = 0

    def ask(self, function: int, body: bytes, *, unit: int | None = None) -> Answer:
        """Send a request, and return the answer.

        Raises LinkLost if no answer arrives, or if it belongs to another request.
        """
        self._number = (self._number + 1) % 0x1_0000
        unit = self._unit if unit is None else unit
        request = _HEADER.pack(self._number, 0, len(body) + 2, unit, function) + body
        before = self._clock.now()
        reply = self._exchange(request)
        took = (self._clock.now() - before) / NS
        if len(reply) < _HEADER.size + 1:
            raise LinkLost(
                f"no answer to function {function} came within {ANSWER_WITHIN:g} s; check that the rig runs"
            )
        number, protocol, length, _, answered = _HEADER.unpack_from(reply)
        if (number, protocol, length + 6, answered & 0x7F) != (self._number, 0, len(reply), function):
            raise LinkLost(
                f"the answer to function {function} begins with {reply[:8].hex(' ')}; return transaction, protocol "
                f"and function of the request, and the right length: "
                f"{_HEADER.pack(self._number, 0, len(reply) - 6, unit, function).hex(' ')}"
            )
        if answered & 0x80:
            return Answer(reply[8], b"", took)
        return Answer(0, reply[8:], took)

    def read(self, function: int, address: int, count: int) -> Answer:
        """Read ``count`` registers or bits (functions 1 to 4).

        The byte count is removed from ``data`` of the answer.
        """
        answer = self.ask(function, struct.pack(">HH", address, count))
        return answer._replace(data=answer.data[1:])

    def words(self, address: int, count: int, *, function: int = 4) -> list[int]:
        """Return ``count`` registers, by default input registers. Raises LinkLost if the rig refuses."""
        answer = self.read(function, address, count)
        if answer.code or len(answer.data) != 2 * count:
            raise LinkLost(
                f"registers {address} to {address + count - 1} must be readable, not give exception {answer.code}"
            )
        return list(struct.unpack(f">{count}H", answer.data))

    def number(self, address: int) -> float:
        """Return the float in the two input registers from ``address`` on."""
        return float(struct.unpack(">f", struct.pack(">HH", *self.words(address, 2)))[0])

    def write(self, address: int, words: bytes) -> int:
        """Write holding registers. Return the code of the Modbus exception, 0 for none."""
        head = struct.pack(">HHB", address, len(words) // 2, len(words))
        return self.ask(16, head + words).code

    def press(self, coil: int) -> int:
        """Set a coil. Return the code of the Modbus exception, 0 for none."""
        return self.ask(5, struct.pack(">HH", coil, 0xFF00)).code


class Listener:
    """A listener on the bus that stores every frame."""

    def __init__(self, port: "CanPort", clock: Clock) -> None:
        self.port, self._clock = port, clock
        # In virtual time stamps have the clock of the bench.
        self._stamps = None if isinstance(clock, VirtualClock) else StampClock()
        self._blocks: list[Block] = []
        self._decoder = Decoder(TABLE, from_rig=True)
        port.subscribe(self._receive)

    def _receive(self, block: Block) -> None:
        self._blocks.append(self._stamps.times(block, self._clock) if self._stamps else block.copy())
        self._decoder.decode(block)

    def latest(self, name: str) -> float:
        """Return the last value (SI) of a signal, NaN before the first."""
        return float(self._decoder.latest[TABLE.index[name]])

    @property
    def state(self) -> str:
        """The state of the bench, as the rig reported it last."""
        value = self.latest("rig.state")
        return STATES[int(value)] if 0 <= value < len(STATES) else "unknown"

    @property
    def steps(self) -> int:
        """Number of times that the clock of the time stamps was set."""
        return self._stamps.steps if self._stamps else 0

    def frames(self) -> Block:
        """Return all frames so far, with times of the bench's clock (ns)."""
        return join(list(self._blocks))

    def series(self, name: str) -> tuple[np.ndarray, np.ndarray]:
        """Return times (ns) and values (SI) of all samples of a signal."""
        return self.courses((name,))[name]

    def courses(
        self, names: Sequence[str], since: int | None = None
    ) -> dict[str, tuple[np.ndarray, np.ndarray]]:
        """Return times (ns of the bench's clock) and values (SI) of all samples from ``since`` on, by signal."""
        frames = self.frames()
        if since is not None:
            frames = frames[frames["time"] >= since]
        samples = Decoder(TABLE, from_rig=True).decode(frames)
        rows = {name: samples.signals == TABLE.index[name] for name in names}
        return {name: (samples.times[row], samples.values[row]) for name, row in rows.items()}


class RawAccess:
    """Direct access to a rig without our drivers: a listener on CAN, and connections on Modbus."""

    def __init__(
        self,
        clock: Clock,
        can: Callable[[], "CanPort"],
        connect: Callable[[], Cable],
        *,
        unit: int = 1,
    ) -> None:
        self.clock, self._unit = clock, unit
        #: Opens a further CAN connection.
        self.can = can
        self.listener = Listener(can(), clock)
        self._connect = connect

    def modbus(self) -> ModbusConnection:
        """Return a new Modbus connection."""
        return ModbusConnection(self.clock, self._connect(), self._unit)

    def wait(self, duration: float) -> None:
        """Wait for ``duration`` s."""
        self.clock.sleep_until(self.clock.now() + round(duration * NS))

    def wait_for(self, condition: Callable[[], bool], within: float) -> bool:
        """Wait until ``condition()`` is true, for ``within`` s at most; return whether it is."""
        deadline = self.clock.now() + round(within * NS)
        while not (reached := condition()) and self.clock.now() < deadline:
            self.wait(0.005)
        return reached


@contextmanager
def open_access(rig: "RigFile", path: Path, *, say: Callable[[str], None]) -> Iterator[RawAccess]:
    """Yield access to ``rig``.

    A simulated rig in real time is started if it does not answer. Raises LinkLost if no rig answers.
    """
    with ExitStack() as stack:
        if rig.time == "virtual":
            assert rig.simulation  # a rig file without one has real time
            memory = RigInMemory(build_rig(rig.simulation))
            peers = iter(f"modbus:stranger {number}" for number in range(1000))

            def lines_in_memory() -> Cable:
                peer = next(peers)
                stack.callback(memory.rig.peer_lost, peer)
                return Cable(lambda request: memory.answer(request, peer), lambda: memory.rig.peer_lost(peer))

            access = RawAccess(memory.clock, memory.can, lines_in_memory)
        else:
            if rig.simulation and not answers(rig):
                stack.enter_context(started(rig.simulation, path, None, say))
            clock = RealClock()

            def lines() -> Cable:
                return _socket_cable(stack, rig.modbus.host, rig.modbus.port)

            access = RawAccess(
                clock,
                lambda: open_can(rig.can.bus, host=rig.can.host, port=rig.can.port),
                lines,
                unit=rig.modbus.unit,
            )
        stack.callback(access.listener.port.close)
        yield access


def _socket_cable(stack: ExitStack, host: str, port: int) -> Cable:
    try:
        connection = stack.enter_context(socket.create_connection((host, port), timeout=ANSWER_WITHIN))
    except OSError as error:
        raise LinkLost(
            f"no Modbus device answers at {host}:{port}: {error.strerror or error}; check host and port"
        ) from None
    connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)

    def exchange(request: bytes) -> bytes:
        try:
            connection.sendall(request)
            reply = b""
            while len(reply) < 6 or len(reply) < 6 + int.from_bytes(reply[4:6], "big"):
                more = connection.recv(512)
                if not more:
                    break
                reply += more
        except TimeoutError:
            return b""
        except OSError as error:
            raise LinkLost(
                f"the Modbus connection is lost: {error.strerror or error}; check that the rig runs"
            ) from None
        return reply

    return Cable(exchange, connection.close)
