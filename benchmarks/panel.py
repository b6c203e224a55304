"""What the panel costs its rig: how late ticks are with two pages open, beside the same rig without."""

import contextlib
import socket
import sys
import tempfile
import threading
import time
import urllib.request
from collections.abc import Iterator
from pathlib import Path
from typing import Final

import msgspec
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect

from bench_protocol.rates import LATENESS_BINS
from bench_protocol.table import TABLE
from bench_protocol.units import s
from benchmarks.measure import BenchmarkRow, Effort, Section, Spread, child, compare
from drivers.modbus_port import ModbusPort, open_modbus

SECONDS, QUICK_SECONDS = 20, 8
PAIRS, QUICK_PAIRS = 9, 3
PAGES: Final = 2
#: What a page asks for: the plots that it shows first.
TRACES: Final = (
    (["left.height", "right.height"], 30.0, 600),
    (["vertical_left.force", "vertical_right.force"], 30.0, 600),
    (["left.height", "vertical_left.force"], 10.0, 4000),
)
PATIENCE: Final = 180 * s
_TAIL: Final = tuple(one.signal for one in LATENESS_BINS if one.edge > 250e-6)


class Page(threading.Thread):
    """Reads everything that a page of the panel is sent."""

    def __init__(self, port: int, number: int) -> None:
        super().__init__(daemon=True)
        self.pictures = 0
        self.stream = connect(f"ws://127.0.0.1:{port}/api/stream?page={number}", max_size=None)
        wanted = [
            {"id": k, "signals": names, "span": span, "columns": columns}
            for k, (names, span, columns) in enumerate(TRACES)
        ]
        self.stream.send(msgspec.json.encode({"traces": wanted}).decode())

    def run(self) -> None:
        with contextlib.suppress(ConnectionClosed):
            for message in self.stream:
                self.pictures += isinstance(message, bytes)


def run(effort: Effort) -> Section:
    """Measure in turns, with and without, on one rig."""
    seconds, pairs = (QUICK_SECONDS, QUICK_PAIRS) if effort.quick else (SECONDS, PAIRS)
    alone: list[tuple[float, float]] = []
    watched: list[tuple[float, float]] = []
    rates: list[float] = []
    with contextlib.ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        file, modbus_port = _rig_file(folder)
        rig = stack.enter_context(child(sys.executable, "-m", "astb", "rig", "--rig", str(file)))
        assert rig.stdout.readline().startswith("ready ")
        modbus = open_modbus("127.0.0.1", modbus_port)
        stack.callback(modbus.close)
        for turn in range(pairs):
            for panel in (turn % 2 == 0, turn % 2 == 1):
                if panel:
                    with _pages(file, folder) as pages:
                        before = sum(page.pictures for page in pages)
                        watched.append(_late(modbus, seconds))
                        rates.append(
                            (sum(page.pictures for page in pages) - before) / seconds / PAGES / len(TRACES)
                        )
                else:
                    alone.append(_late(modbus, seconds))
    rows = [
        compare(what, [one[k] for one in watched], "without a panel", [one[k] for one in alone], unit="")
        for k, what in enumerate(("ticks late by 1 ms or more", "of 1000 ticks, late by 250 µs or more"))
    ]
    pictures = "pictures a second of each plot"
    rows.append(BenchmarkRow(pictures, "", Spread.of(rates), aim="at least 10", met=min(rates) >= 10))
    note = (
        f"{pairs} times {seconds} s each way, in turns, on one rig: the rig's own account of its ticks. With the panel "
        f"its server runs on the same machine and sends {PAGES} pages the plots that they show first."
    )
    return Section("A panel beside the rig", rows, (note,))


def _rig_file(folder: Path) -> tuple[Path, int]:
    """Write the file of a rig on free ports; return it and the port of its Modbus."""
    with contextlib.ExitStack() as stack:
        free = [
            stack.enter_context(socket.create_server(("127.0.0.1", 0))).getsockname()[1] for _ in range(2)
        ]
    file = folder / "rig.toml"
    file.write_text(
        f'name = "measured"\n[can]\nbus = "tcp"\nport = {free[0]}\n[modbus]\nport = {free[1]}\n[simulation]\n'
    )
    return file, free[1]


@contextlib.contextmanager
def _pages(file: Path, folder: Path) -> Iterator[list[Page]]:
    """Open a panel and its pages while the block lasts."""
    command = [sys.executable, "-m", "astb", "panel", "--rig", str(file), "--port", "0", "--out", str(folder)]
    with child(*command) as panel:
        port = int(panel.stdout.readline().rpartition(":")[2].strip().strip("/"))
        _await(port)
        pages = [Page(port, number) for number in range(PAGES)]
        for page in pages:
            page.start()
        time.sleep(1 * s)
        yield pages


def _await(port: int) -> None:
    deadline = time.monotonic() + PATIENCE
    while True:
        try:
            with urllib.request.urlopen(f"http://127.0.0.1:{port}/api/rig", timeout=5):
                return
        except OSError:
            if time.monotonic() > deadline:
                raise
            time.sleep(0.1)


def _late(modbus: ModbusPort, seconds: float) -> tuple[float, float]:
    """Return how many ticks were late by 1 ms in so many seconds, and of 1000 ticks how many by 250 µs."""
    before = _counts(modbus)
    time.sleep(seconds)
    counts = {name: count - before[name] for name, count in _counts(modbus).items()}
    return counts[LATENESS_BINS[-1].signal], 1000 * sum(counts[name] for name in _TAIL) / max(
        1, sum(counts.values())
    )


def _counts(modbus: ModbusPort) -> dict[str, float]:
    from drivers.wiring.astb.modbus import AstbRegisters

    return AstbRegisters(TABLE, modbus).read([one.signal for one in LATENESS_BINS])
