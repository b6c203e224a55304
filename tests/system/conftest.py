"""A rig to test against, on each of its three wires: in memory, on the TCP hub, on SocketCAN."""

import io
import os
import select
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, redirect_stderr, redirect_stdout
from itertools import groupby
from pathlib import Path

import numpy as np
import pytest

from astb.cli import main as astb_main
from astb.rig_in_memory import RigInMemory
from astb.run import undisturbed
from bench_protocol.can_codec import Decoder
from bench_protocol.clock import RealClock, VirtualClock
from bench_protocol.frames import Block, join
from bench_protocol.table import TABLE
from bench_protocol.units import NS
from bench_protocol.words import STATES
from bench_sim.parameters import load
from bench_sim.rig.rig import Rig
from drivers.bench import Bench
from drivers.can_port import CanPort, has_interface, open_can
from drivers.modbus_port import ModbusPort, open_modbus
from drivers.wiring.own import own_wiring

ASTB = [sys.executable, "-m", "astb"]
ROOT = Path(__file__).parents[2]
ANYWHERE = ("--can", "tcp", "--can-port", "0", "--modbus-port", "0")
SIMULATED = 'name = "test"\n[simulation]\nseed = 1\n'
IDENTIFIER = {message.name: message.identifier for message in TABLE.messages}
PERIOD = {message.identifier: 1 / message.rate for message in TABLE.messages if message.rate}


class Listener:
    """Another client on the bus, which receives the frames of rig and commander, in the bus's order."""

    def __init__(self, port: CanPort) -> None:
        self.port = port
        self._blocks: list[Block] = []
        port.subscribe(self._blocks.append)

    def frames(self) -> Block:
        return join(list(self._blocks))

    def positions(self, message: str) -> np.ndarray:
        """Return where in ``frames()`` the frames of ``message`` stand."""
        return np.flatnonzero(self.frames()["id"] == IDENTIFIER[message])

    def series(self, signal: str, end: int | None = None) -> np.ndarray:
        """Return all values of ``signal`` before position ``end``, as our own codec decodes them."""
        samples = Decoder(TABLE).decode(self.frames()[:end])
        return samples.values[samples.signals == TABLE.index[signal]]

    def states(self) -> list[str]:
        """Return the states of the bench in their order; but for the reaction of one tick, which few messages catch."""
        names = [STATES[int(code)] for code in self.series("rig.state")]
        return [name for name, _ in groupby(names) if name != "FAULT_REACTION"]

    def rig_time(self, start: int, end: int) -> float:
        """Return how much of the rig's time (s) passed between two positions: it sends a sample every 5 ms."""
        samples = self.positions("SpringLeft")
        return float(((samples > start) & (samples < end)).sum() * PERIOD[IDENTIFIER["SpringLeft"]])


class Site:
    """A place where a rig runs, and all ways to it."""

    transport: str
    clock: VirtualClock | RealClock
    #: Whether all of this shares one processor on which a frame costs milliseconds.
    slow = os.environ.get("WITH_VCAN") == "uml"
    #: Whether the rig can identify the sender of a CAN frame, and its end: a bus without connections does not.
    connections = True
    _shared: Bench | None = None

    def can(self) -> CanPort:
        raise AssertionError

    def modbus(self) -> ModbusPort:
        raise AssertionError

    def wait(self, seconds: float) -> None:
        self.clock.sleep_until(self.clock.now() + round(seconds * NS))

    def bench(self) -> Bench:
        """Return a bench, not yet connected."""
        return Bench(own_wiring(self.can(), self.modbus()), self.clock)

    def shared(self) -> Bench:
        """Return a connected bench that tests use one after the other: arming takes a second of real time."""
        if self._shared is None:
            self._shared = self.bench()
            self._shared.connect()
        return self._shared

    def close_shared(self) -> None:
        if self._shared is not None:
            self._shared.close()
            self._shared = None

    @contextmanager
    def listening(self) -> Iterator[Listener]:
        listener = Listener(self.can())
        try:
            yield listener
        finally:
            listener.port.close()


class MemorySite(Site):
    """Rig and clients in this process, in virtual time."""

    transport = "memory"

    def __init__(self) -> None:
        self._memory = RigInMemory(Rig(load(), seed=1))
        self.rig, self.clock = self._memory.rig, self._memory.clock

    def can(self) -> CanPort:
        return self._memory.can()

    def modbus(self) -> ModbusPort:
        return self._memory.modbus()

    def press_estop(self) -> None:
        self.rig.press_estop()

    def release_estop(self) -> None:
        self.rig.release_estop()


class RigProcess:
    """``astb rig`` in a separate process."""

    def __init__(self, *options: str, rig_file: Path) -> None:
        command = [*ASTB, "rig", "--rig", str(rig_file), *options]
        pipe = subprocess.PIPE
        self.process = subprocess.Popen(command, stdout=pipe, stderr=pipe, text=True, cwd=ROOT)
        self.ready = self._first_line()
        parts = dict(part.split("=", 1) for part in self.ready.split()[1:])
        self.can, self.modbus_port = parts["can"], int(parts["modbus"].rpartition(":")[2])
        self.can_port = int(self.can.rpartition(":")[2]) if "://" in self.can else None

    def _first_line(self) -> str:
        out = self.process.stdout
        assert out is not None
        line = out.readline() if select.select([out], [], [], 250)[0] else ""
        if not line.startswith("ready "):
            self.process.kill()
            raise AssertionError(f"the rig said {line!r} and {self.process.communicate()[1]!r}")
        return line.strip()

    def send_signal(self, number: signal.Signals) -> None:
        self.process.send_signal(number)

    def stop(self) -> str:
        """End it if it still runs; return what it complained about."""
        self.process.terminate()
        try:
            return self.process.communicate(timeout=5)[1]
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.communicate()
            raise


class LiveSite(Site):
    """A rig process in real time."""

    def __init__(self, transport: str, rig: RigProcess) -> None:
        self.transport, self.rig, self.clock = transport, rig, RealClock()
        self.connections = transport == "tcp"
        self._opened: list[CanPort] = []

    def can(self) -> CanPort:
        on_a_bus = self.rig.can_port is None
        port = open_can(self.rig.can) if on_a_bus else open_can("tcp", port=self.rig.can_port)
        self._opened.append(port)
        return port

    def close_others(self) -> None:
        """Close what a test that failed has left open: each ear costs the next tests time."""
        kept = [] if self._shared is None else [self._shared.wiring.carrier.can]
        for port in self._opened:
            if port not in kept:
                port.close()
        self._opened = kept

    def modbus(self) -> ModbusPort:
        return open_modbus("127.0.0.1", self.rig.modbus_port, timeout=2.0)

    def press_estop(self) -> None:
        self.rig.send_signal(signal.SIGUSR1)

    def release_estop(self) -> None:
        self.rig.send_signal(signal.SIGUSR2)


@pytest.fixture(scope="session")
def rig_file(tmp_path_factory) -> Path:
    """A rig file for a simulated rig; ports come from options."""
    path = tmp_path_factory.mktemp("rig") / "rig.toml"
    path.write_text(SIMULATED)
    return path


@pytest.fixture
def start_rig(rig_file) -> Iterator[Callable[..., RigProcess]]:
    """Start ``astb rig`` with the given options; whatever still runs at the end is stopped."""
    started: list[RigProcess] = []

    def start(*options: str, file: Path = rig_file) -> RigProcess:
        started.append(RigProcess(*(options or ANYWHERE), rig_file=file))
        return started[-1]

    yield start
    for rig in started:
        if rig.process.returncode is None:
            rig.stop()


@pytest.fixture(scope="module")
def shared_rig(rig_file) -> Iterator[RigProcess]:
    """A running rig that all tests of a file share."""
    rig = RigProcess(*ANYWHERE, rig_file=rig_file)
    try:
        yield rig
    finally:
        complaints = rig.stop()
    assert complaints == "", "the rig complained"
    assert rig.process.returncode == 0


TRANSPORTS = ("memory", "tcp", pytest.param("socketcan", marks=pytest.mark.vcan))


_live: list[LiveSite] = []


# Not of the session: a SocketCAN bus is everybody's, and a rig that stays on it talks into the tests of the wires.
@pytest.fixture(scope="package", params=TRANSPORTS)
def site(request, rig_file) -> Iterator[Site]:
    """A running rig that all tests of a transport share, as people do; each leaves it disarmed."""
    if request.param == "memory":
        yield MemorySite()
        return
    if request.param == "socketcan" and not has_interface("vcan0"):
        pytest.skip("this kernel has no vcan0; `make test-vcan` runs these where there is one")
    can = "vcan0" if request.param == "socketcan" else "tcp"
    rig = RigProcess("--can", can, "--can-port", "0", "--modbus-port", "0", rig_file=rig_file)
    try:
        site = LiveSite(request.param, rig)
        # With a thousand collected tests in memory a full garbage collection takes some 200 ms, in which the
        # commander in this process is silent and the rig rightly holds. `astb run` takes the same precaution.
        with undisturbed():
            _live.append(site)
            yield site
            site.close_shared()
    finally:
        _live.clear()
        complaints = rig.stop()
    assert complaints == "", "the rig complained"
    assert rig.process.returncode == 0


@pytest.fixture(scope="session")
def memory_site() -> Callable[[], MemorySite]:
    """Make a new rig in memory."""
    return MemorySite


@pytest.fixture(autouse=True)
def only_the_shared_bench_stays() -> Iterator[None]:
    yield
    for site in _live:
        site.close_others()


@pytest.fixture
def bench(site) -> Iterator[Bench]:
    """A connected bench of this test's own, disarmed."""
    site.close_shared()
    bench = site.bench()
    bench.connect()
    try:
        yield bench
    finally:
        site.release_estop()
        bench.close()


@pytest.fixture
def armed(site) -> Iterator[Bench]:
    """A bench that is ACTIVE, with all axes at the measured values; shared, so that tests leave it able to be armed."""
    bench = site.shared()
    try:
        bench.arm()
        yield bench
    except BaseException:
        site.close_shared()
        raise
    finally:
        site.release_estop()


@pytest.fixture(scope="session")
def astb_command() -> list[str]:
    return ASTB


@pytest.fixture(scope="session")
def listen() -> Callable[[CanPort], AbstractContextManager[Listener]]:
    """Listen on a CAN port while the block lasts."""

    @contextmanager
    def listening(port: CanPort) -> Iterator[Listener]:
        try:
            yield Listener(port)
        finally:
            port.close()

    return listening


@pytest.fixture(scope="session")
def astb_here() -> Callable[..., tuple[int, str, str]]:
    """Run ``astb`` in this process, which has everything loaded already: exit code, stdout, stderr."""

    def run(directory: Path, *arguments: object) -> tuple[int, str, str]:
        out, err = io.StringIO(), io.StringIO()
        handlers = {
            number: signal.getsignal(number) for number in (signal.SIGTERM, signal.SIGINT, signal.SIGHUP)
        }
        with pytest.MonkeyPatch.context() as patch, redirect_stdout(out), redirect_stderr(err):
            patch.chdir(directory)
            patch.setenv("COLUMNS", "200")
            patch.setattr(sys, "argv", ["astb", *map(str, arguments)])
            with pytest.raises(SystemExit) as end:
                astb_main()
        for number, handler in handlers.items():
            signal.signal(number, handler)
        return end.value.code, out.getvalue(), err.getvalue()

    return run


@pytest.fixture(scope="session")
def eventually() -> Callable[..., None]:
    """Wait in real time until something is true; fail, with what it was, if that takes too long."""

    def wait(condition: Callable[[], object], within: float = 5.0, what: str = "the condition") -> None:
        deadline = time.monotonic() + within
        while not condition():
            assert time.monotonic() < deadline, f"{what} did not come true within {within} s"
            time.sleep(0.005)

    return wait
