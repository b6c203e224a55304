"""How late the ticks of the real rig process are, under load, beside a C loop that runs at the same time."""

import contextlib
import socket
import sys
import tempfile
import threading
import time
from pathlib import Path
from typing import Final

import can
import numpy as np
from numpy.typing import NDArray

from bench_protocol.units import NS, ms, s, us
from benchmarks import gcc
from benchmarks.measure import BenchmarkRow, Effort, Section, Skipped, Spread, child, compare
from benchmarks.peers import MODBUS_REPLY, MODBUS_REQUEST, REGISTERS
from drivers.hub_bus import HubBus

SECONDS, QUICK_SECONDS = 60, 10
WARM_UP: Final = 1 * s
FRAMES: Final = 12
CLIENTS: Final = 8
POLL: Final = 10 * ms
#: The quantiles are taken of so many slices, for their spread.
SLICES: Final = 6
QUANTILES: Final = (50.0, 99.0, 99.9)
LIMITS: Final = {99.0: 100 * us, 99.9: 250 * us}
#: How long a rig may take to come up (a first start compiles it) and to end.
PATIENCE: Final = 180 * s


class Listener(threading.Thread):
    """Reads every frame of the hub and remembers the time stamps."""

    def __init__(self, port: int) -> None:
        super().__init__(daemon=True)
        self.bus = HubBus(port=port)
        self.stamps: list[NDArray[np.int64]] = []

    def run(self) -> None:
        with contextlib.suppress(can.CanOperationError):  # the rig has ended
            while True:
                self.stamps.append(self.bus.recv_block(PATIENCE)["time"].copy())
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
    """A Modbus client that asks on a steady beat until the rig has gone."""

    def __init__(self, port: int) -> None:
        super().__init__(daemon=True)
        self.socket = socket.create_connection(("127.0.0.1", port), timeout=2.0)
        self.trips: list[int] = []

    def run(self) -> None:
        beat = time.perf_counter()
        with contextlib.suppress(OSError):
            while True:
                start = time.perf_counter_ns()
                self.socket.sendall(MODBUS_REQUEST)
                if len(self.socket.recv(512)) != len(MODBUS_REPLY):
                    break
                self.trips.append(time.perf_counter_ns() - start)
                beat += POLL
                time.sleep(max(0.0, beat - time.perf_counter()))
        self.socket.close()


def run(effort: Effort) -> Section:
    """Let both loops run in the same minute, the rig with its clients, and compare."""
    seconds = QUICK_SECONDS if effort.quick else SECONDS
    with contextlib.ExitStack() as stack:
        directory = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        try:
            loop = str(gcc.compiled("deadlines.c", directory))
        except Skipped as reason:
            return Section("Lateness at 1 kHz", (), (f"Skipped: {reason}.",))
        ours_file, control_file = directory / "ours", directory / "control"
        rig = stack.enter_context(
            child(sys.executable, "-m", "benchmarks.lateness_rig", str(seconds), str(ours_file))
        )
        can_port, modbus_port = (int(word) for word in rig.stdout.readline().split())
        listener = Listener(can_port)
        pollers = [Poller(modbus_port) for _ in range(CLIENTS)]
        for thread in (listener, *pollers):
            thread.start()
        time.sleep(WARM_UP)
        control = stack.enter_context(child(loop, str(seconds), str(control_file)))
        rig.wait(PATIENCE)
        control.wait(PATIENCE)
        for thread in (listener, *pollers):
            thread.join(PATIENCE)
        ours_late = np.fromfile(ours_file, np.int64) / NS
        control_late = np.fromfile(control_file, np.int64) / NS
    return section(
        ours_late, control_late, listener, np.concatenate([poller.trips for poller in pollers]) / NS
    )


def section(
    ours: NDArray[np.float64], control: NDArray[np.float64], listener: Listener, trips: NDArray[np.float64]
) -> Section:
    """Return the rows: quantiles, the worst, late and lost ticks, and what the clients saw."""
    rows = []
    for quantile in QUANTILES:
        late, late_control = (
            [float(np.percentile(part, quantile)) for part in np.array_split(series, SLICES)]
            for series in (ours, control)
        )
        limit = LIMITS.get(quantile)
        rows.append(
            compare(
                f"lateness p{quantile:g}",
                late,
                "C, clock_nanosleep",
                late_control,
                aim=f"at most {limit / us:g} µs" if limit else "",
                met=float(np.median(late)) <= limit if limit else None,
            )
        )
    rows.append(compare("lateness, the worst", [ours.max()], "C, clock_nanosleep", [control.max()]))
    late_ticks, late_control_ticks = int((ours >= 1 * ms).sum()), int((control >= 1 * ms).sum())
    rows.append(
        compare(
            "ticks late by 1 ms or more", [late_ticks], "C, clock_nanosleep", [late_control_ticks], unit=""
        )
    )
    expected, missing = listener.ticks()
    rows.append(BenchmarkRow("ticks lost on the bus", "", Spread.of([missing]), aim="none", met=missing == 0))
    rows.append(
        BenchmarkRow("Modbus answer p50, as the clients see it", "s", Spread.of([float(np.median(trips))]))
    )
    rows.append(BenchmarkRow("Modbus answer p99", "s", Spread.of([float(np.percentile(trips, 99))])))
    notes = (
        f"The rig in its own process ticked {ours.size} times at 1 kHz in real time with {FRAMES} frames in every "
        f"tick, a hub client that read them all ({expected} ticks) and {CLIENTS} Modbus clients that asked for "
        f"{REGISTERS} registers every {POLL / ms:g} ms each ({trips.size} answers). The C loop kept the same deadlines "
        f"at the same time on the same machine, under the same load. Medians and quartiles of {SLICES} slices.",
        "A late tick is made up for at once; a lost one would be missing from the time stamps on the bus.",
    )
    return Section("Lateness at 1 kHz", rows, notes)
