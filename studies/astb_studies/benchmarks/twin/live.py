"""A case in real time: a rig and a run with its twin, in processes connected by sockets, and its detection times.

Times are of this machine's clock, after the instant at which the effect began in the rig.
"""

import math
import sys
import tempfile
import time
from pathlib import Path
from typing import Any, Final

import msgspec
import numpy as np

from astb_studies.benchmarks.measure import child
from astb_studies.benchmarks.ticks import lateness_during, rig_of_its_own
from astb_studies.benchmarks.twin.cases import Case
from astb_studies.benchmarks.twin.tables import Counted, Live, shortened
from astb_studies.benchmarks.watch import Follower
from bench_protocol.rates import TICK
from bench_records.record import Record, read
from bench_records.twin import read_twin

#: Typical delay between the starts of rig and plan (s).
_BEGINS: Final = 4.0
_LOOK: Final = 0.05


def count_live(case: Case) -> Counted:
    """Run a case in real time, and return the results of its twin with their times."""
    shifted = msgspec.structs.replace(case, at=case.at + _BEGINS)
    serving = ("astb_studies.benchmarks.twin.serving", msgspec.json.encode(shifted).decode())
    with tempfile.TemporaryDirectory() as folder, rig_of_its_own(serving) as (file, modbus):
        command = ("run", case.plan, "--watch", "--rig", str(file), "--out", folder)
        values = [f"--set={name}={value}" for name, value in case.values.items()]
        place = Path(folder) / case.plan
        seen: list[tuple[float, float, float]] = []
        with child(sys.executable, "-m", "astb", *command, *values) as test:
            late = lateness_during(modbus, lambda: seen.append(_detection_times(test, place, shifted.at)))
        record, story = read(place), read_twin(place)
        assert story is not None, "no twin has said anything"
        at = round(shifted.at - _ahead(record), 2)
        detected, explained, began = seen[0]
        after = [None if math.isinf(one) else round(one - began - at, 2) for one in (detected, explained)]
        live = Live(after[0], after[1], round(late.late), round(late.tail, 2))
        case = msgspec.structs.replace(case, at=at)
        return Counted(case, round(story.judged_for, 1), shortened(story, case), None, live)


def _detection_times(test: Any, directory: Path, at: float) -> tuple[float, float, float]:
    """Follow a run to its end; return the times of detection, of its explanation, and of the start of the record.

    Detections before the start of the effect, ``at`` s of the rig's time, do not count.
    """
    detected = explained = math.inf
    with Follower(directory) as follower:
        while test.poll() is None:
            now = time.monotonic()
            if story := follower.look():
                since = at - (_ahead(follower.record) if follower.record else 0.0)
                late = [one for one in story.all_deviations if one.detected >= since]
                detected = min(detected, now if late else math.inf)
                explained = min(explained, now if any(one.searched for one in late) else math.inf)
            time.sleep(_LOOK)
        test.communicate()
        return detected, explained, follower.began


def _ahead(record: Record) -> float:
    """Return the rig's time at the start of a record (s)."""
    times, ticks = record.series("rig.tick")
    return float(np.median(ticks * TICK - times))
