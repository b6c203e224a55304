"""Cost of a twin for its rig, and delay of the twin: a plan in real time, with and without a twin."""

import math
import os
import sys
import time
from collections.abc import Sequence
from contextlib import suppress
from itertools import pairwise
from pathlib import Path
from typing import Any, Final, NamedTuple

import msgspec

from astb.rig_file import read as read_rig
from astb_studies.benchmarks.measure import BenchmarkRow, Effort, Section, Spread, child, compare
from astb_studies.benchmarks.ticks import CALLED, Lateness, lateness_during, rig_of_its_own
from bench_records.growing import GrowingRecord
from bench_records.layout import RecordError
from bench_records.twin import TwinStory, read_twin
from bench_sim.rig.control_socket import ask, control_path
from drivers.modbus_port import ModbusPort

PLAN: Final = "aw0"
#: Faults during the run with a twin: start time (s of the run), fault and parameters.
LEAK: Final = (60.0, "leak", {"side": "left", "area": "0.5mm2"})
CELL: Final = (66.0, "bias", {"sensor": "load_cell.2", "value": "1kN"})
CASES: Final = {"a sound rig": (), "one cause": (LEAK,), "two causes at once": (LEAK, CELL)}
Fault = tuple[float, str, dict[str, str]]
#: Period (s) of the checks of record and story.
_LOOK: Final = 0.05


class Watched(NamedTuple):
    """Speed of a twin: processors that it used during the run, and its delay (s) before each check."""

    share: float
    behind: list[float]


def run(effort: Effort) -> Section:
    """Run the plan in turns with and without a twin, on one rig: sound, with one cause, and with two."""
    alone: list[Lateness] = []
    watched_ticks: list[Lateness] = []
    watched: dict[str, Watched] = {}
    cases = dict(list(CASES.items())[: 1 if effort.quick else None])
    with rig_of_its_own() as (file, modbus):
        for turn, (name, faults) in enumerate(cases.items()):
            for twin in (turn % 2 == 0, turn % 2 == 1):
                out = file.parent / f"{turn}{'with' if twin else 'without'}"
                command = ("run", PLAN, "--rig", str(file), "--out", str(out))
                with child(sys.executable, "-m", "astb", *command) as test:
                    if twin:
                        late, watched[name] = _lateness_with_twin(modbus, test, out / PLAN, file, faults)
                        watched_ticks.append(late)
                    else:
                        alone.append(lateness_during(modbus, test.communicate))
    rows = [
        compare(what, [one[k] for one in watched_ticks], "without a twin", [one[k] for one in alone], unit="")
        for k, what in enumerate(CALLED)
    ]
    for name, one in watched.items():
        share = Spread.of([one.share])
        rows.append(
            BenchmarkRow(f"{name}: processors it uses", "", share, aim="at most 0.5", met=one.share <= 0.5)
        )
        rows.append(
            BenchmarkRow(
                f"{name}: behind, just before a look ends",
                "s",
                Spread.of(one.behind),
                aim="at most 2 s",
                met=max(one.behind) <= 2.0,
            )
        )
    most = "; ".join(
        f"{name}: {one.share:.2f} processors, {max(one.behind):.1f} s" for name, one in watched.items()
    )
    note = (
        f"`{PLAN}` in real time, with and without a twin, in turns, on one rig: the rig's own account of its ticks. "
        f"At most, while the run went on: {most}. One cause is a leak from 60 s on; two are the same, and a load cell "
        "that is off from 66 s on."
    )
    return Section("A twin during a run", rows, (note,))


def _lateness_with_twin(
    modbus: ModbusPort, test: Any, directory: Path, file: Path, faults: Sequence[Fault]
) -> tuple[Lateness, Watched]:
    found: list[Watched] = []
    late = lateness_during(modbus, lambda: found.append(follow(test, directory, file, faults)))
    return late, found[0]


class Follower:
    """Record and story of the run in a ``directory`` as they grow, by this machine's clock."""

    def __init__(self, directory: Path) -> None:
        self._directory = directory
        self._record: GrowingRecord | None = None
        #: When the record began (s): a sample is kept some time later, so that it is the earliest that fits.
        self.began = math.inf
        #: When (s) a story was first seen that goes until so many s of the run.
        self.seen: list[tuple[float, float]] = []

    def __enter__(self) -> "Follower":
        return self

    def __exit__(self, *_: object) -> None:
        if self._record is not None:
            self._record.__exit__()

    @property
    def record(self) -> GrowingRecord | None:
        """The record so far; None if it is empty."""
        return self._record if self._record is not None and len(self._record) else None

    def look(self) -> TwinStory | None:
        """Return the story of the twin so far; None if there is none."""
        with suppress(RecordError):
            self._record = self._record or GrowingRecord(self._directory)
            self._record.look()
            now = time.monotonic()
            if record := self.record:
                self.began = min(self.began, now - record.duration)
            story = read_twin(self._directory)
            if story and (not self.seen or story.until > self.seen[-1][1]):
                self.seen.append((now, story.until))
            return story
        return None


def follow(test: Any, directory: Path, file: Path, faults: Sequence[Fault] = ()) -> Watched:
    """Start a twin next to a run, and switch ``faults`` of the rig of a ``file`` on; return its speed."""
    while not directory.exists():
        assert test.poll() is None, "the run did not begin"
        time.sleep(_LOOK)
    left = list(faults)
    with (
        child(sys.executable, "-m", "astb", "watch", str(directory)) as twin,
        Follower(directory) as follower,
    ):
        began, used = time.monotonic(), 0.0
        while test.poll() is None:
            follower.look()
            while left and time.monotonic() - follower.began >= left[0][0]:
                _, name, values = left.pop(0)
                switch(file, {"do": "on", "name": name, "values": values})
            used = _used(twin.pid)
            time.sleep(_LOOK)
        share = used / (time.monotonic() - began)
        switch(file, {"do": "off", "name": "all"})
    behind = [seen_at - follower.began - before for (_, before), (seen_at, _) in pairwise(follower.seen)]
    return Watched(share, behind)


def switch(file: Path, order: dict[str, Any]) -> None:
    """Switch faults of the rig that a file describes on or off, as `astb rig fault` does."""
    rig = read_rig(file)
    answer = msgspec.json.decode(
        ask(control_path(rig.modbus.host, rig.modbus.port), msgspec.json.encode(order))
    )
    assert "error" not in answer, answer


def _used(process: int) -> float:
    """Return the processor time that a running process has used (s)."""
    fields = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")
