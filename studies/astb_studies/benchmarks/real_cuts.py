"""Cuts in real time: a plan and a rig in separate processes, and connections between them that can be cut.

python -m astb_studies.benchmarks.real_cuts FILE
    the plan: arms the rig of a rig file, fills the springs, prints `armed`, and waits
"""

import contextlib
import select
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

import numpy as np

from astb.rig_file import read
from astb.run import undisturbed
from astb.session import real_session
from astb_studies.benchmarks.cuts import (
    BOTH_CLOSED,
    CAN_CLOSED,
    CAN_HOLE,
    ESTOP,
    KILLED,
    MODBUS_CLOSED,
    MODBUS_HOLE,
    STOPPED,
    Cut,
    Witness,
    give_up,
)
from bench_protocol.clock import wall_time_ns
from bench_protocol.units import bar, s
from drivers.can_port import open_can
from drivers.errors import BenchError

PRESSURE: Final = 0.6 * bar
_PATIENCE: Final = 60.0  # s, for a plan to arm and fill
_RIG: Final = 'name = "cut"\n[simulation]\nseed = 1\n'
_PLAN: Final = 'name = "cut"\nlike = "hall"\n[can]\nbus = "tcp"\nport = {can}\n[modbus]\nport = {modbus}\n'


class Wire:
    """A TCP connection to ``port`` of this machine that can be closed at both ends, or drop all data."""

    def __init__(self, port: int) -> None:
        self._target = port
        self._listening = socket.create_server(("127.0.0.1", 0))
        self.port: int = self._listening.getsockname()[1]
        self._pairs: list[tuple[socket.socket, socket.socket]] = []
        self.swallowing = False
        threading.Thread(target=self._accept, daemon=True).start()

    def cut(self) -> None:
        """Close both ends at once."""
        pairs, self._pairs = self._pairs, []
        for pair in pairs:
            for end in pair:
                with contextlib.suppress(OSError):
                    end.shutdown(socket.SHUT_RDWR)

    def close(self) -> None:
        """Accept no more connections, and cut the existing ones."""
        self._listening.close()
        self.cut()

    def _accept(self) -> None:
        with contextlib.suppress(OSError):
            while True:
                near, _ = self._listening.accept()
                try:
                    far = socket.create_connection(("127.0.0.1", self._target))
                except OSError:  # the rig has ended: close the connection of its client
                    near.close()
                    continue
                self._pairs.append((near, far))
                for source, sink in ((near, far), (far, near)):
                    source.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
                    threading.Thread(target=self._carry, args=(source, sink), daemon=True).start()

    def _carry(self, source: socket.socket, sink: socket.socket) -> None:
        with contextlib.suppress(OSError):
            while data := source.recv(65536):
                if not self.swallowing:
                    sink.sendall(data)
        for end in (source, sink):
            with contextlib.suppress(OSError):
                end.shutdown(socket.SHUT_RDWR)
        source.close()


@contextlib.contextmanager
def _process(*command: str) -> Iterator[Any]:
    """Run a process, which is killed at the end of the block, and wait for the end of it."""
    pipe = subprocess.PIPE
    with subprocess.Popen(command, stdin=pipe, stdout=pipe, text=True) as process:
        try:
            yield process
        finally:
            process.kill()


def _expect_line(process: Any, word: str) -> str:
    if not select.select([process.stdout], [], [], _PATIENCE)[0]:
        raise RuntimeError(f"{process.args} did not print {word!r} within {_PATIENCE:g} s")
    line: str = process.stdout.readline()
    if not line.startswith(word):
        raise RuntimeError(f"{process.args} printed {line!r} instead of {word!r}")
    return line


class RealCuts:
    """A rig in its own process, whose commander is lost repeatedly; a context manager."""

    def __init__(self) -> None:
        self._witness = Witness()

    def __enter__(self) -> "RealCuts":
        with contextlib.ExitStack() as stack:
            self._directory = Path(stack.enter_context(tempfile.TemporaryDirectory()))
            file = self._directory / "rig.toml"
            file.write_text(_RIG)
            ports = ("--can", "tcp", "--can-port", "0", "--modbus-port", "0")
            rig = stack.enter_context(
                _process(sys.executable, "-m", "astb", "rig", "--rig", str(file), *ports)
            )
            parts = dict(part.split("=", 1) for part in _expect_line(rig, "ready ").split()[1:])
            self._rig = rig
            self._can, self._modbus = (int(parts[port].rpartition(":")[2]) for port in ("can", "modbus"))
            listener = open_can("tcp", port=self._can)
            listener.subscribe(self._witness.receive)
            stack.callback(listener.close)
            self._stack = stack.pop_all()
        return self

    def __exit__(self, *_: object) -> None:
        self._stack.close()

    def cut(self, kind: Cut) -> tuple[float, float]:
        """Return the times until the bench held, and until it was safe (s)."""
        with contextlib.ExitStack() as stack:
            can, modbus = Wire(self._can), Wire(self._modbus)
            for wire in (can, modbus):
                stack.callback(wire.close)
            file = self._directory / "plan.toml"
            file.write_text(_PLAN.format(can=can.port, modbus=modbus.port))
            plan = stack.enter_context(
                _process(sys.executable, "-m", "astb_studies.benchmarks.real_cuts", str(file))
            )
            _expect_line(plan, "armed")
            time.sleep(0.2 + 0.02 * (time.perf_counter_ns() % 1000) / 1000)  # anywhere between two commands
            self._witness.start(wall_time_ns())
            if kind is KILLED:
                plan.kill()
            if kind is STOPPED:
                plan.send_signal(signal.SIGSTOP)
            if kind is ESTOP:
                self._rig.send_signal(signal.SIGUSR1)
            for wire, closed, hole in ((can, CAN_CLOSED, CAN_HOLE), (modbus, MODBUS_CLOSED, MODBUS_HOLE)):
                wire.swallowing = kind is hole
                if kind in (closed, BOTH_CLOSED):
                    wire.cut()
            deadline = time.monotonic() + 2 * kind.safe_within
            while np.isnan(self._witness.safe) and time.monotonic() < deadline:
                time.sleep(0.05)
        self._rig.send_signal(signal.SIGUSR2)
        return self._witness.held, self._witness.safe


def plan(path: Path) -> None:
    """Arm, hold the bolster down against springs with pressure, and wait for the cut."""
    with real_session(read(path), path) as session, undisturbed():
        bench = session.bench
        bench.connect(within=10 * s)
        bench.arm()
        bench.vertical.move_to(bench.vertical_left.displacement, bench.vertical_right.displacement)
        bench.air.fill(to=PRESSURE, tolerance=0.05 * bar)
        print("armed", flush=True)
        try:
            bench.wait(60)
        except BenchError:
            give_up(bench)
            time.sleep(60)


if __name__ == "__main__":
    plan(Path(sys.argv[1]))
