"""Tick lateness of the real rig process under load, compared with C loops that run at the same time."""

import contextlib
import socket
import sys
import tempfile
import threading
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import can
import numpy as np
from numpy.typing import NDArray

from astb_studies.benchmarks import gcc
from astb_studies.benchmarks.measure import BenchmarkRow, Effort, Section, Skipped, Spread, child, compare
from astb_studies.benchmarks.peers import MODBUS_REPLY, MODBUS_REQUEST, REGISTERS
from bench_protocol.table import TABLE
from bench_protocol.units import NS, ms, s
from drivers.hub_bus import HubBus

SECONDS, QUICK_SECONDS = 60, 10
WARM_UP: Final = 1 * s
FRAMES: Final = 12
CLIENTS: Final = 8
POLL: Final = 10 * ms
#: Number of slices of the data, for the spread of the quantiles.
SLICES: Final = 6
#: Time from a deadline of the rig to the next of the C loop (ns): longer than a tick runs.
_APART: Final = round(0.5 * ms * NS)
#: Priorities of the C loop half a period later, and of that with the deadlines of the rig, which runs before the tick.
_LIKE_RIG, _BEFORE_RIG = "10", "11"
_OF_THE_RIG: Final = [message.identifier for message in TABLE.messages if message.from_rig]
#: Targets: quantiles of the rig's lateness over those of the C loop.
RATIOS: Final = {50.0: 1.1, 99.0: 1.5, 99.9: 1.3}
#: Higher quantiles depend on single system calls of other programs: only a loop with the same deadlines meets the same.
_PAIRED_ABOVE: Final = 99.0
#: How long a rig may take to come up (a first start compiles it) and to end.
PATIENCE: Final = 180 * s


class Listener(threading.Thread):
    """Reads every frame of the hub and stores the time stamps."""

    def __init__(self, port: int) -> None:
        super().__init__(daemon=True)
        self.bus = HubBus(port=port)
        self.stamps: list[NDArray[np.int64]] = []

    def run(self) -> None:
        with contextlib.suppress(can.CanOperationError):  # the rig has ended
            while True:
                block = self.bus.recv_block(PATIENCE)
                self.stamps.append(block["time"][np.isin(block["id"], _OF_THE_RIG)])
        self.bus.shutdown()

    def ticks(self) -> tuple[int, int]:
        """Return how many ticks there should be between the first and the last stamp, and how many are missing."""
        stamps, counts = np.unique(np.concatenate(self.stamps), return_counts=True)
        expected = round(int(stamps[-1] - stamps[0]) / NS / ms) + 1
        whole = (
            int((counts[1:-1] >= FRAMES).sum()) + 2
        )  # the client came and went in the middle of the first and last
        return expected, expected - whole


class Poller(threading.Thread):
    """A Modbus client that sends requests at a steady rate until the rig ends."""

    def __init__(self, port: int) -> None:
        super().__init__(daemon=True)
        self.socket = socket.create_connection(("127.0.0.1", port), timeout=2.0)
        self.trips: list[int] = []

    def run(self) -> None:
        due = time.perf_counter()
        with contextlib.suppress(OSError):
            while True:
                start = time.perf_counter_ns()
                self.socket.sendall(MODBUS_REQUEST)
                if len(self.socket.recv(512)) != len(MODBUS_REPLY):
                    break
                self.trips.append(time.perf_counter_ns() - start)
                due += POLL
                time.sleep(max(0.0, due - time.perf_counter()))
        self.socket.close()


@dataclass(frozen=True)
class Measured:
    """The measurements of the rig, the C loops and the clients in the same minute (s)."""

    ours: NDArray[np.float64]
    control: NDArray[np.float64]  #: the C loop half a period later
    same: NDArray[np.float64]  #: the C loop with the rig's deadlines
    trips: NDArray[np.float64]
    ticks: int  #: that there should be on the bus
    missing: int


def run(effort: Effort) -> Section:
    """Run the rig with its clients and the C loops in the same minute and compare them; repeat under attack."""
    seconds = QUICK_SECONDS if effort.quick else SECONDS
    with tempfile.TemporaryDirectory() as directory:
        try:
            loop = gcc.compiled("deadlines.c", Path(directory))
        except Skipped as reason:
            return Section("Lateness at 1 kHz", (), (f"Skipped: {reason}.",))
        return section(measure(seconds, loop), measure(seconds, loop, attacked=True))


def measure(seconds: int, loop: Path, *, attacked: bool = False) -> Measured:
    """Run the rig with all its clients, and the C program ``loop`` twice next to it."""
    ours, control, same = (loop.with_name(name) for name in ("ours", "control", "same"))
    with contextlib.ExitStack() as stack:
        rig = stack.enter_context(
            child(sys.executable, "-m", "astb_studies.benchmarks.lateness_rig", str(seconds), str(ours))
        )
        *ports, start, processor = rig.stdout.readline().split()
        listener = Listener(int(ports[0]))
        pollers = [Poller(int(ports[1])) for _ in range(CLIENTS)]
        for thread in (listener, *pollers):
            thread.start()
        if attacked:
            stack.enter_context(
                child(sys.executable, "-m", "astb_studies.benchmarks.lateness_attack", *ports)
            )
        time.sleep(WARM_UP)
        loops = [
            stack.enter_context(
                child(str(loop), str(seconds), str(file), processor, str(int(start) + phase), priority)
            )
            for file, phase, priority in ((control, _APART, _LIKE_RIG), (same, 0, _BEFORE_RIG))
        ]
        rig.wait(PATIENCE)
        for process in loops:
            process.wait(PATIENCE)
        for thread in (listener, *pollers):
            thread.join(PATIENCE)
    late, late_control, late_same = (np.fromfile(file, np.int64) / NS for file in (ours, control, same))
    return Measured(
        late, late_control, late_same, np.concatenate([one.trips for one in pollers]) / NS, *listener.ticks()
    )


def _slices(series: NDArray[np.float64], quantile: float) -> list[float]:
    return [float(np.percentile(part, quantile)) for part in np.array_split(series, SLICES)]


def section(quiet: Measured, attacked: Measured) -> Section:
    """Return the rows: quantiles, the worst, late and lost ticks, and the times of the clients."""
    ours, control, trips = quiet.ours, quiet.control, quiet.trips
    rows = []
    apart, same = ("C, clock_nanosleep", control), ("C, clock_nanosleep, the same deadlines", quiet.same)
    for quantile, limit in RATIOS.items():
        name, series = same if quantile > _PAIRED_ABOVE else apart
        late, late_control = _slices(ours, quantile), _slices(series, quantile)
        rows.append(
            compare(
                f"lateness p{quantile:g}",
                late,
                name,
                late_control,
                aim=f"at most {limit:g}×",
                met=float(np.median(late)) <= limit * float(np.median(late_control)),
            )
        )
    rows.append(
        compare(
            "lateness p99 under attack",
            _slices(attacked.ours, 99.0),
            "C, under the same attack",
            _slices(attacked.control, 99.0),
        )
    )
    rows.append(compare("lateness, the worst", [ours.max()], same[0], [quiet.same.max()]))
    late_ticks, late_control_ticks = int((ours >= 1 * ms).sum()), int((control >= 1 * ms).sum())
    rows.append(
        compare(
            "ticks late by 1 ms or more", [late_ticks], "C, clock_nanosleep", [late_control_ticks], unit=""
        )
    )
    missing = quiet.missing + attacked.missing
    rows.append(BenchmarkRow("ticks lost on the bus", "", Spread.of([missing]), aim="none", met=missing == 0))
    rows.append(
        BenchmarkRow("Modbus answer p50, as the clients see it", "s", Spread.of([float(np.median(trips))]))
    )
    rows.append(BenchmarkRow("Modbus answer p99", "s", Spread.of([float(np.percentile(trips, 99))])))
    notes = (
        f"The rig in its own process ticked {ours.size} times at 1 kHz in real time with {FRAMES} frames in every "
        f"tick, a hub client that read them all ({quiet.ticks} ticks) and {CLIENTS} Modbus clients that asked for "
        f"{REGISTERS} registers every {POLL / ms:g} ms each ({trips.size} answers). A C loop kept "
        "deadlines on the same processor at the same time, under the same load, half a period after those of the rig. "
        f"Medians and quartiles of {SLICES} slices.",
        "The highest lateness comes from other programs of the machine: while one is in a long system call, no thread "
        "of that processor can wake. Therefore p99.9 is compared with a second C loop, whose deadlines are those of "
        "the rig. It runs before the tick, so it cannot profit from it.",
        "Under attack a stranger's commands, unknown frames and nonsense come on CAN, and writes without authority, "
        "reads outside the map and unknown functions on Modbus: some 20 000 frames and 4000 requests a second.",
        "A late tick is made up for at once; a lost one would be missing from the time stamps on the bus.",
    )
    return Section("Lateness at 1 kHz", rows, notes)
