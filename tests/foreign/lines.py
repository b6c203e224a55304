"""A transport to a controller that answers lines of text over TCP."""

import math
import socket
import threading
from pathlib import Path

from bench_protocol.units import ms, s
from drivers.errors import LinkLost, Refused, WiringError
from drivers.wiring.contract import Transport
from drivers.wiring.listener import Listener, WriteBuffer

PERIOD = 50 * ms


def controller(name: str, table: dict, where: Path) -> "Controller":
    """Make the transport; `kind = "lines.py:controller"` in a wiring file calls this function."""
    if not table.get("points"):
        raise WiringError(f'transports.{name}: add points = ["height", …], the points of the controller')
    return Controller(name, table["host"], table["port"], table["points"])


class Controller(Transport):
    """Reads all points every 50 ms; one thread at a time uses the socket."""

    period = PERIOD

    def __init__(self, name: str, host: str, port: int, points: list[str]) -> None:
        self._name, self._address, self._points = name, (host, port), points
        self._listener, self._buffer = Listener(f"{name} at {host}:{port}"), WriteBuffer()
        self._lock = threading.RLock()
        self._socket = None

    def require(self, name: str, *, writable: bool = False) -> None:
        if name not in self._points:
            raise WiringError(
                f"transports.{self._name} has no point {name!r}, only {', '.join(self._points)}"
            )

    def stale(self, name: str) -> float:
        self.require(name)
        return 1 * s

    def connect(self, clock, lost, *, within: float) -> None:
        try:
            self._socket = socket.create_connection(self._address, timeout=within)
        except OSError as error:
            raise LinkLost(f"no controller at {self._address[0]}:{self._address[1]}: {error}") from error
        self._clock, self._file = clock, self._socket.makefile("r", encoding="ascii")
        self._listener.open(clock, lost)
        self._listener.every(PERIOD, self._cycle)

    def subscribe(self, receive) -> None:
        self._listener.subscribe(receive)

    def read(self, names) -> dict[str, float]:
        for name in names:
            self.require(name)
        return {name: self._number(self._ask(f"? {name}")) for name in names}

    def write(self, points) -> None:
        for name in points:
            self.require(name, writable=True)
        for name, value in points.items():
            answer = self._ask(f"! {name} {value!r}")
            if answer != "ok":
                raise Refused(f"{name} = {value:g} was refused: {answer}", 0)

    def stream(self, points, time: int) -> None:
        self._listener.check()
        for name in points:
            self.require(name, writable=True)
        self._buffer.put({name: value for name, value in points.items() if not math.isnan(value)})

    def alive(self) -> float:
        return self._listener.silence()

    def close(self) -> None:
        self._listener.close()
        with self._lock:
            if self._socket is not None:
                self._file.close()
                self._socket.close()

    def _cycle(self) -> None:
        """Write the streamed set-points, then read all points and pass them on."""
        try:
            self.write(self._buffer.drain())
            before = self._clock.now()
            points = self.read(self._points)
            self._listener.receive((before + self._clock.now()) // 2, points)
        except (LinkLost, Refused):
            pass  # the listener has reported a loss; a refused write is repeated with the next set-points

    def _ask(self, line: str) -> str:
        """Return the answer to a line; report any failure as a lost connection."""
        with self._lock:
            self._listener.check()
            try:
                self._socket.sendall(f"{line}\n".encode("ascii"))
                answer = self._file.readline()
                if not answer:
                    raise OSError("the controller closed the connection")
            except OSError as error:
                reason = f"{self._name} lost its controller at {line!r}: {error}"
                self._listener.lose(reason)
                raise LinkLost(reason) from error
            self._listener.touch()
            return answer.strip()

    @staticmethod
    def _number(answer: str) -> float:
        return math.nan if answer == "none" else float(answer)
