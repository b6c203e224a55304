"""Common parts of all benchmarks: interleaved repetitions, medians with their spread, and a row for the table."""

import contextlib
import platform
import subprocess
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np


class Skipped(Exception):
    """A program that the control needs is missing on this machine; the text names it."""


@dataclass(frozen=True)
class Effort:
    """Duration of the measurement: ``quick`` for a first result, the long one for the page."""

    quick: bool

    @property
    def repetitions(self) -> int:
        return 5 if self.quick else 15


@dataclass(frozen=True)
class Spread:
    """The median of several repetitions between their quartiles."""

    middle: float
    low: float
    high: float

    @classmethod
    def of(cls, samples: Sequence[float]) -> "Spread":
        low, middle, high = np.percentile(np.asarray(samples, float), (25, 50, 75))
        return cls(float(middle), float(low), float(high))


@dataclass(frozen=True)
class BenchmarkRow:
    """One measurement with its control. ``unit`` is "s" for times, otherwise the text after the number."""

    what: str
    unit: str
    ours: Spread
    against: str = ""
    control: Spread | None = None
    ratio: Spread | None = None
    aim: str = ""
    met: bool | None = None


@dataclass(frozen=True)
class Section:
    """The rows of one benchmark, and notes to read them."""

    title: str
    rows: Sequence[BenchmarkRow]
    notes: Sequence[str] = field(default=())


def compare(
    what: str,
    ours: Sequence[float],
    against: str,
    control: Sequence[float],
    *,
    unit: str = "s",
    aim: str = "",
    met: bool | None = None,
) -> BenchmarkRow:
    """Return the row of two interleaved series; the ratio is taken repetition by repetition."""
    ratios = [a / b for a, b in zip(ours, control, strict=True) if b > 0]
    ratio = Spread.of(ratios) if ratios else None
    return BenchmarkRow(what, unit, Spread.of(ours), against, Spread.of(control), ratio, aim, met)


def interleaved(repetitions: int, subjects: Mapping[str, Callable[[], float]]) -> dict[str, list[float]]:
    """Measure all subjects in turn, ``repetitions`` times, with alternating order, after one warm-up. Therefore a
    temporary slowdown of the machine affects all subjects equally.
    """
    found: dict[str, list[float]] = {name: [] for name in subjects}
    order = list(subjects)
    for name in order:
        subjects[name]()
    for _ in range(repetitions):
        for name in order:
            found[name].append(subjects[name]())
        order.reverse()
    return found


def cpu(action: Callable[[], object], items: float) -> float:
    """Return the processor time of this thread for one of the ``items`` that ``action`` processes (s)."""
    start = time.thread_time_ns()
    action()
    return (time.thread_time_ns() - start) * 1e-9 / items


def wall(action: Callable[[], object], items: float) -> float:
    """Return the wall-clock time for one of the ``items`` that ``action`` processes (s)."""
    start = time.perf_counter_ns()
    action()
    return (time.perf_counter_ns() - start) * 1e-9 / items


def trips(trip: Callable[[], object], count: int) -> float:
    """Return the median time of ``count`` round trips (s)."""
    times = np.empty(count)
    for k in range(count):
        start = time.perf_counter_ns()
        trip()
        times[k] = time.perf_counter_ns() - start
    return float(np.median(times)) * 1e-9


@contextlib.contextmanager
def child(*command: str) -> Iterator[Any]:
    """Run a process, which is killed at the end of the block."""
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as process:
        try:
            yield process
        finally:
            process.kill()


def machine() -> dict[str, str]:
    """Return the machine and the software versions of the measurement."""
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        lines = []
    models = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    versions = (f"{name} {version(name)}" for name in ("numpy", "numba", "scipy", "pymodbus", "python-can"))
    return {
        "processor": f"{len(models)} × {models[0]}" if models else platform.machine(),
        "system": f"{platform.system()} {platform.release()}",
        "software": f"Python {platform.python_version()}, {', '.join(versions)}",
        "date": time.strftime("%Y-%m-%d", time.gmtime()),
    }
