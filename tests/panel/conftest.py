"""A panel on a simulated rig with a short plan, and a browser in front of it."""

import math
import os
import re
import select
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

from astb.live.door import NoRun
from astb.panel import runs as runs_module
from astb.panel.access import Access
from astb.panel.answers import Parts
from astb.panel.connections import Server
from astb.panel.runs import Runs
from astb.panel.server import application
from astb.panel.watch import Status, Watch
from astb.rig_file import RigFile, Simulation
from bench_protocol.clock import VirtualClock
from bench_protocol.units import NS
from bench_records.layout import SignalInfo
from bench_records.recorder import Recorder
from bench_records.result import SpecimenFacts, check, conclude
from drivers.reading import Quality, Sample

ROOT = Path(__file__).parents[2]
#: Where pictures for the documentation go, if anybody wants them: ASTB_GALLERY=docs/gallery.
GALLERY = os.environ.get("ASTB_GALLERY", "")

PLAN = '''"""A short plan that asks, and can be held."""

from typing import Annotated

from bench_protocol.units import mm, s
from test_plans.parameters import Range
from test_plans.plan import plan


@plan(lasts=8 * s)
def shift(run, amplitude: Annotated[float, Range(5 * mm, 30 * mm, "mm")] = 20 * mm) -> None:
    """Shift: the bolster goes to the side and back."""
    run.bench.lateral.control = "displacement"
    with run.phase("out"):
        run.bench.lateral.move_to(-amplitude, rate=60 * mm / s)
        run.bench.lateral.move_to(amplitude, rate=60 * mm / s)
        run.check("place", run.bench.average("lateral.displacement", over=0.3 * s), "mm", low=4 * mm, high=31 * mm)
    if run.ask("Has the bolster moved?", ("yes", "no"), within=90 * s) != "no":
        for look in range(15):
            run.hold_point(f"before look {look}")
            run.bench.wait(0.1 * s)
    run.bench.lateral.move_to(0.0, rate=40 * mm / s)
'''


def free_ports(count: int) -> list[int]:
    sockets = [socket.socket() for _ in range(count)]
    try:
        for one in sockets:
            one.bind(("127.0.0.1", 0))
        return [one.getsockname()[1] for one in sockets]
    finally:
        for one in sockets:
            one.close()


class PanelProcess:
    """``astb panel`` in a separate process, which can be killed and started again."""

    def __init__(self, folder: Path, rig_file: Path | None = None, *options: str) -> None:
        self.folder, self.options = folder, options
        can, modbus, self.port = free_ports(3)
        self.rig_file, self.out = rig_file or folder / "rig.toml", folder / "runs"
        if rig_file is None:
            self.rig_file.write_text(
                f'name = "test"\n[can]\nbus = "tcp"\nport = {can}\n[modbus]\nport = {modbus}\n'
                "[simulation]\nseed = 1\n"
            )
        package = folder / "plans" / "short_plans-1.0.dist-info"
        package.mkdir(parents=True)
        (package / "METADATA").write_text("Metadata-Version: 2.1\nName: short-plans\nVersion: 1.0\n")
        (package / "entry_points.txt").write_text("[astb.plans]\nours = short_plans\n")
        (package.parent / "short_plans.py").write_text(PLAN)
        self.start()

    def start(self) -> None:
        """Start it, and wait until it serves."""
        paths = os.pathsep.join(filter(None, (str(self.folder / "plans"), os.environ.get("PYTHONPATH"))))
        command = [sys.executable, "-m", "astb", "panel", "--rig", str(self.rig_file), "--out", str(self.out)]
        self.process = subprocess.Popen(
            [*command, "--port", str(self.port), *self.options],
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            cwd=ROOT,
            env=os.environ | {"PYTHONPATH": paths},
        )
        self.said = b""
        self.address = self.printed("to command:")

    def printed(self, what: str) -> str:
        """Return the word that it prints behind ``what``."""
        out = self.process.stdout
        assert out is not None
        deadline = time.monotonic() + 200
        # Not by lines: if two come at once, the second would be lost.
        while not (found := re.search(rf"{what}\s+(\S+)\n", self.said.decode())):
            ready = select.select([out], [], [], max(0.0, deadline - time.monotonic()))[0]
            if not ready or not (part := os.read(out.fileno(), 4096)):
                self.process.kill()
                raise AssertionError(f"the panel printed {self.said.decode()}")
            self.said += part
        return found[1]

    @property
    def watching(self) -> str:
        """The address without the token."""
        return self.address.partition("#")[0]

    def kill(self) -> None:
        """End it in the worst way."""
        self.process.kill()
        self.process.communicate()

    def stop(self) -> None:
        """End it in order."""
        if self.process.poll() is None:
            self.process.send_signal(signal.SIGINT)
            self.process.communicate(timeout=20)


@pytest.fixture(scope="package")
def bench_panel(tmp_path_factory) -> Iterator[PanelProcess]:
    """A panel with its own rig, for all tests of this directory."""
    panel = PanelProcess(tmp_path_factory.mktemp("panel"))
    try:
        yield panel
    finally:
        panel.stop()


@pytest.fixture
def open_page(browser, bench_panel) -> Iterator[Callable]:
    """Open the panel as another user each time, with the token or without; no script may fail meanwhile."""
    contexts, failures = [], []

    def opened(*, command: bool = True, dark: bool = False, size: tuple[int, int] = (1024, 768)):
        width, height = size
        contexts.append(
            browser.new_context(
                viewport={"width": width, "height": height}, color_scheme="dark" if dark else "light"
            )
        )
        contexts[-1].set_default_timeout(60_000)
        page = contexts[-1].new_page()
        page.on("pageerror", lambda error: failures.append(str(error)))
        page.goto(bench_panel.address if command else bench_panel.watching)
        page.wait_for_selector(".readings")
        return page

    yield opened
    for context in contexts:
        context.close()
    assert not failures


@pytest.fixture(scope="session")
def picture() -> Callable:
    """Keep a picture of a page for the documentation, on request."""

    def taken(page, name: str) -> None:
        if GALLERY:
            page.screenshot(path=Path(GALLERY) / f"panel-{name}.png")

    return taken


FACTS = {
    "plan": "aw0",
    "title": "Title",
    "instruction": "Text",
    "rig": "test",
    "specimen": {"type": "a", "serial_number": "7"},
}


@pytest.fixture(scope="session")
def keep() -> Callable:
    """Leave a run with one check, or some more of that value, and its record in a folder."""

    def kept(folder, name: str, value: float, serial: str = "7", more: tuple[str, ...] = ()) -> None:
        directory = folder / name
        with Recorder(
            directory, [SignalInfo("x", "mm", 1e-3, quantity="Ways")], FACTS, start_ns=0
        ) as recorder:
            recorder.receive([0, NS], [0, 0], [0.0, 1.0])
        names = ("height", *more)
        made = [check(one, value, "mm", 1e-3, low=0.0, high=0.01, phase="main") for one in names]
        sample = SpecimenFacts(type="a", serial_number=serial)
        conclude("aw0", "Title", "Text", made, rig="test", specimen=sample).write(directory)

    return kept


# -- the server by itself, in this process --------------------------------------------------------------------------

RIG = RigFile("test", simulation=Simulation())
TOKEN = "a token"
#: One signal of each quality: value and unit in SI, and as served.
SAMPLES = {
    "left.height": (Sample(0.0125, 0.03, Quality.GOOD), 12.5, "mm"),
    "left.bellows_pressure": (Sample(math.nan, 2.0, Quality.STALE), math.nan, "bar"),
    "left.bellows_temperature": (Sample(math.nan, math.inf, Quality.MISSING), math.nan, "°C"),
    "lateral.force": (Sample(math.nan, math.inf, Quality.UNAVAILABLE), math.nan, "kN"),
}


class StubWatch(Watch):
    """A panel's watch that is connected to nothing and has these samples."""

    lost: Exception | None = None

    def samples(self) -> dict[str, Sample]:
        if self.lost is not None:
            raise self.lost
        return {name: sample for name, (sample, *_) in SAMPLES.items()}


@pytest.fixture(scope="module")
def stub_watch(tmp_path_factory) -> StubWatch:
    return StubWatch(RIG, tmp_path_factory.mktemp("rig") / "rig.toml")


class FakeDoor:
    """Instead of a run's control socket: its requests, and its answers."""

    def __init__(self):
        self.orders, self.answer = [], {"done": ""}

    def __call__(self, path, order, within=0.0):
        self.orders.append(order)
        if self.answer is None:
            raise NoRun("nobody")
        return self.answer


@pytest.fixture
def door(monkeypatch) -> FakeDoor:
    said = FakeDoor()
    monkeypatch.setattr(runs_module, "knock", said)
    return said


@pytest.fixture
def clock() -> VirtualClock:
    clock = VirtualClock()
    clock.sleep_until(NS)
    return clock


@pytest.fixture
def parts(tmp_path, door, clock) -> Parts:
    watch = Watch(RIG, tmp_path / "rig.toml")  # and not started: nothing is connected
    watch.status = Status(link="", state="HOLD")
    return Parts(watch, Runs(watch, tmp_path), Access(TOKEN, 1, clock), tmp_path)


@pytest.fixture
def client(parts):
    """Make a browser with the requests of one separate page."""

    pytest.importorskip("httpx2", reason="starlette's test client needs httpx2, which `make` installs")
    from starlette.testclient import TestClient

    def made(page="one", *, command=True, host="127.0.0.1:8137") -> TestClient:
        app = application(parts, host="127.0.0.1")
        one = TestClient(app, base_url=f"http://{host}", headers={"X-ASTB-Page": page})
        if command:
            assert one.post("/api/enter", json={"token": TOKEN}).status_code == 200
        return one

    return made


def fed(parts: Parts, end: threading.Event) -> None:
    """Let thirty signals come at 200 Hz."""
    tick = 0
    rows = np.arange(len(parts.watch.shown))
    while not end.wait(0.02):
        times = (tick + np.repeat(np.arange(4), rows.size)) * 5_000_000
        parts.watch.envelope.take(times, np.tile(rows, 4), np.full(times.size, float(tick), np.float32))
        tick += 4


@pytest.fixture
def served(parts):
    """The panel on a real socket, with thirty signals."""
    listening = socket.create_server(("127.0.0.1", 0))
    server, end = Server(application(parts, host="127.0.0.1"), parts.access), threading.Event()
    threads = [
        threading.Thread(target=server.run, kwargs={"sockets": [listening]}),
        threading.Thread(target=fed, args=(parts, end)),
    ]
    for thread in threads:
        thread.start()
    yield listening.getsockname()[1], server
    end.set()
    server.should_exit = server.force_exit = True
    for thread in threads:
        thread.join(10)
    listening.close()
