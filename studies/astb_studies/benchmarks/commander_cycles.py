"""Jitter of the set-points while a plan computes, compared with a stream that needs the interpreter in every cycle.

python -m astb_studies.benchmarks.commander_cycles PORT PLAN WAY
    streams until its input ends; WAY is compiled or interpreted
"""

import contextlib
import ctypes
import socket
import sys
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from typing import Final

import numpy as np
from numpy.typing import NDArray

from astb_studies.benchmarks.measure import Effort, Section, child, compare
from bench_protocol.clock import RealClock, hurry, hurry_process
from bench_protocol.units import ms, s
from drivers.can_port import PythonCanPort, open_can
from drivers.commander import Commander
from drivers.memory import Faults, FaultyCan
from drivers.modbus_port import InMemoryModbus
from drivers.wiring.astb.can import AUTONOMY
from drivers.wiring.own import own_wiring

SECONDS, QUICK_SECONDS = 20, 4
WARM_UP: Final = 1 * s
BURNERS: Final = 4
#: Duration of a call of a C library that holds the interpreter's lock.
CALL: Final = 60 * ms
#: The rig takes more than this for the loss of its commander.
SILENCE: Final = 100 * ms
WAYS: Final = ("compiled", "interpreted")
_BURN: Final = "while True: pass"
_LISTENER_PRIORITY: Final = 20
PATIENCE: Final = 180 * s


def _count() -> None:
    sum(range(50_000))


def _call() -> None:
    # Other than through CDLL, the interpreter is kept.
    ctypes.PyDLL(None).usleep(round(CALL * 1e6))


#: The work that the plan's thread repeats.
PLANS: Final[Mapping[str, Callable[[], object]]] = {
    "waits": lambda: time.sleep(20 * ms),
    "computes in Python": _count,
    "computes in C": _call,
}


class Listener(threading.Thread):
    """A server that accepts one client and stores the arrival times of its lines."""

    def __init__(self) -> None:
        super().__init__(daemon=True)
        self._socket = socket.create_server(("127.0.0.1", 0))
        self.port: int = self._socket.getsockname()[1]
        self.arrivals: list[int] = []

    def run(self) -> None:
        hurry(_LISTENER_PRIORITY)
        client, _ = self._socket.accept()
        with client, self._socket, contextlib.suppress(OSError):
            for answer in (b"< hi >", b"< ok >", b"< ok >"):
                client.sendall(answer)
                if answer != b"< hi >":
                    continue
                client.recv(4096)
            while data := client.recv(4096):
                if b"send" in data:
                    self.arrivals.append(time.monotonic_ns())


def _gaps(listener: Listener, start: int) -> NDArray[np.float64]:
    return np.diff([instant for instant in listener.arrivals if instant >= start]) * 1e-9


@contextlib.contextmanager
def _burning() -> Iterator[None]:
    with contextlib.ExitStack() as stack:
        for _ in range(BURNERS):
            stack.enter_context(child(sys.executable, "-c", _BURN))
        yield


def run(effort: Effort) -> Section:
    """Stream both ways at the same time, for each kind of plan, with other processes that compute next to them."""
    seconds = QUICK_SECONDS if effort.quick else SECONDS
    rows = []
    with _burning():
        for plan in PLANS:
            compiled, interpreted = measure(plan, seconds)
            for quantile, name in ((99.0, "p99"), (100.0, "the longest")):
                rows.append(
                    compare(
                        f"silence while the plan {plan}, {name}",
                        [float(np.percentile(compiled, quantile))],
                        "the interpreter sends",
                        [float(np.percentile(interpreted, quantile))],
                        aim=f"under {SILENCE / ms:g} ms" if quantile == 100.0 else "",
                        met=bool(compiled.max() < SILENCE) if quantile == 100.0 else None,
                    )
                )
    notes = (
        f"Both streams at the same time, 50 blocks a second, {seconds} s each, with {BURNERS} processes that "
        "compute, as another process hears them. "
        f"In C the plan's thread keeps the interpreter for {CALL / ms:g} ms a call. "
        f"The stream outlives a stuck interpreter by {AUTONOMY * 1e-6:g} ms, no longer.",
    )
    return Section("The commander's cycles", rows, notes)


def measure(plan: str, seconds: int) -> list[NDArray[np.float64]]:
    """Return the times between blocks (s) that a listener receives, for each way."""
    listeners = [Listener() for _ in WAYS]
    with contextlib.ExitStack() as stack:
        for listener, way in zip(listeners, WAYS, strict=True):
            listener.start()
            command = (
                sys.executable,
                "-m",
                "astb_studies.benchmarks.commander_cycles",
                str(listener.port),
                plan,
                way,
            )
            stack.enter_context(child(*command)).stdout.readline()
        time.sleep(WARM_UP)
        start = time.monotonic_ns()
        time.sleep(seconds)
    return [_gaps(listener, start) for listener in listeners]


def main(port: str, plan: str, way: str) -> None:
    """Stream to the listener at ``port`` until the input ends."""
    hurry_process()
    bus: PythonCanPort | FaultyCan = open_can("tcp", port=int(port))
    if way == "interpreted":
        bus = FaultyCan(bus, Faults(), 0)  # without a fault: what it wraps is written to by Python only
    commander = Commander(own_wiring(bus, InMemoryModbus(lambda request: b"")), RealClock())
    commander.start()
    print("streaming", flush=True)
    ended = threading.Event()
    threading.Thread(target=lambda: (sys.stdin.read(), ended.set()), daemon=True).start()
    while not ended.is_set():
        PLANS[plan]()


if __name__ == "__main__":
    main(*sys.argv[1:])
