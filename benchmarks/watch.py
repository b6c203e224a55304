"""What a twin costs its rig, and how far it is behind: a plan in real time, with and without a twin beside it."""

import math
import os
import sys
import time
from contextlib import ExitStack, suppress
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import Any, Final

from bench_records.growing import GrowingRecord
from bench_records.layout import RecordError
from bench_records.twin import read_twin
from benchmarks.measure import BenchmarkRow, Effort, Section, Spread, child, compare
from benchmarks.ticks import CALLED, Lateness, lateness_during, rig_of_its_own

PLAN, QUICK_PLAN = "aw0", "leak_down"
PAIRS, QUICK_PAIRS = 3, 1
#: How often (s) record and story are looked at.
_LOOK: Final = 0.05


def run(effort: Effort) -> Section:
    """Run the plan in turns with and without a twin, on one rig."""
    plan, pairs = (QUICK_PLAN, QUICK_PAIRS) if effort.quick else (PLAN, PAIRS)
    alone: list[Lateness] = []
    watched: list[Lateness] = []
    shares: list[float] = []
    behind: list[float] = []
    with rig_of_its_own() as (file, modbus):
        for turn in range(pairs):
            for twin in (turn % 2 == 0, turn % 2 == 1):
                out = file.parent / f"{turn}{'with' if twin else 'without'}"
                command = ("run", plan, "--rig", str(file), "--out", str(out))
                with child(sys.executable, "-m", "astb", *command) as test:
                    if twin:
                        follow = partial(_follow, test, out / plan, shares, behind)
                        watched.append(lateness_during(modbus, follow))
                    else:
                        alone.append(lateness_during(modbus, test.communicate))
    rows = [
        compare(what, [one[k] for one in watched], "without a twin", [one[k] for one in alone], unit="")
        for k, what in enumerate(CALLED)
    ]
    used = Spread.of(shares)
    rows.append(BenchmarkRow("processors it uses", "", used, aim="at most 0.5", met=max(shares) <= 0.5))
    rows.append(
        BenchmarkRow(
            "behind, just before a look ends",
            "s",
            Spread.of(behind),
            aim="at most 2 s",
            met=max(behind) <= 2.0,
        )
    )
    note = (
        f"`{plan}` in real time, {pairs} times with and without, in turns, on one rig: the rig's own account of its "
        f"ticks. At most {max(behind):.1f} s behind, at most {max(shares):.2f} processors."
    )
    return Section("A twin beside the rig", rows, (note,))


def _follow(test: Any, directory: Path, shares: list[float], behind: list[float]) -> None:
    """Start a twin beside a run; add the processors that it used, and how far (s) it was behind before each look."""
    while not directory.exists():
        assert test.poll() is None, "the run did not begin"
        time.sleep(_LOOK)
    began = time.monotonic()
    with ExitStack() as stack:
        twin = stack.enter_context(child(sys.executable, "-m", "astb", "watch", str(directory)))
        record = None
        until: list[tuple[float, float]] = []
        # By this machine's clock, when the record began; a sample is kept some time later.
        written = math.inf
        while test.poll() is None:
            now = time.monotonic()
            with suppress(RecordError):
                record = record or stack.enter_context(GrowingRecord(directory))
                record.look()
                if len(record):
                    written = min(written, now - record.duration)
                story = read_twin(directory)
                if story and (not until or story.until > until[-1][1]):
                    until.append((now, story.until))
            time.sleep(_LOOK)
        behind += [told - written - before for (_, before), (told, _) in pairwise(until)]
        _, _, used = os.wait4(twin.pid, 0)
        twin.returncode = 0
        shares.append((used.ru_utime + used.ru_stime) / (time.monotonic() - began))
