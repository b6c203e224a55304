"""Cost of the panel for its rig: tick lateness with two open pages, compared with the same rig without pages."""

import contextlib
import sys
import threading
import time
import urllib.request
from collections.abc import Iterator
from pathlib import Path
from typing import Final

import msgspec
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect

from astb_studies.benchmarks.measure import BenchmarkRow, Effort, Section, Spread, child, compare
from astb_studies.benchmarks.ticks import CALLED, Lateness, lateness_during, rig_of_its_own
from bench_protocol.units import s

SECONDS, QUICK_SECONDS = 20, 8
PAIRS, QUICK_PAIRS = 9, 3
PAGES: Final = 2
#: The request of a page: the plots that it shows first.
TRACES: Final = (
    (["left.height", "right.height"], 30.0, 600),
    (["vertical_left.force", "vertical_right.force"], 30.0, 600),
    (["left.height", "vertical_left.force"], 10.0, 4000),
)
PATIENCE: Final = 180 * s


class Page(threading.Thread):
    """Receives all data that the panel sends to a page."""

    def __init__(self, port: int, number: int) -> None:
        super().__init__(daemon=True)
        self.pictures = 0
        self.stream = connect(f"ws://127.0.0.1:{port}/api/stream?page={number}", max_size=None)
        traces = [
            {"id": k, "signals": names, "span": span, "columns": columns}
            for k, (names, span, columns) in enumerate(TRACES)
        ]
        self.stream.send(msgspec.json.encode({"traces": traces}).decode())

    def run(self) -> None:
        with contextlib.suppress(ConnectionClosed):
            for message in self.stream:
                self.pictures += isinstance(message, bytes)


def run(effort: Effort) -> Section:
    """Measure in turns, with and without, on one rig."""
    seconds, pairs = (QUICK_SECONDS, QUICK_PAIRS) if effort.quick else (SECONDS, PAIRS)
    alone: list[Lateness] = []
    watched: list[Lateness] = []
    rates: list[float] = []
    with rig_of_its_own() as (file, modbus):
        for turn in range(pairs):
            for panel in (turn % 2 == 0, turn % 2 == 1):
                if panel:
                    with _pages(file) as pages:
                        before = sum(page.pictures for page in pages)
                        watched.append(lateness_during(modbus, lambda: time.sleep(seconds)))
                        rates.append(
                            (sum(page.pictures for page in pages) - before) / seconds / PAGES / len(TRACES)
                        )
                else:
                    alone.append(lateness_during(modbus, lambda: time.sleep(seconds)))
    rows = [
        compare(what, [one[k] for one in watched], "without a panel", [one[k] for one in alone], unit="")
        for k, what in enumerate(CALLED)
    ]
    pictures = "pictures a second of each plot"
    rows.append(BenchmarkRow(pictures, "", Spread.of(rates), aim="at least 10", met=min(rates) >= 10))
    note = (
        f"{pairs} times {seconds} s each way, in turns, on one rig: the rig's own account of its ticks. With the panel "
        f"its server runs on the same machine and sends {PAGES} pages the plots that they show first."
    )
    return Section("A panel during a run", rows, (note,))


@contextlib.contextmanager
def _pages(file: Path) -> Iterator[list[Page]]:
    """Open a panel and its pages while the block lasts."""
    given = ("--rig", str(file), "--port", "0", "--out", str(file.parent))
    with child(sys.executable, "-m", "astb", "panel", *given) as panel:
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
