"""A twin during whole runs, through the wires: it agrees with sound rigs, and reports a leak and its start."""

from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from msgspec.structs import replace

from astb.cli import commands
from astb.rig_in_memory import RigInMemory
from bench_records.layout import STREAM, SignalInfo
from bench_records.record import Record, read
from bench_records.recorder import Recorder
from bench_records.result import read_result
from bench_records.twin import PARTS, TwinStory, read_twin
from bench_sim.parameters import load
from bench_sim.rig.faults.panel import PlannedFault
from bench_sim.rig.rig import Rig
from diagnosis.contracts import DiagnosisError
from diagnosis.twin.twin import Twin
from test_plans.discovery import plans
from test_plans.execution import execute
from test_plans.plans.endurance import NOBODY_WATCHES


def run(plan: str, out: Path, seed: int, *faults: PlannedFault) -> Path:
    """Run a plan in virtual time on a rig with faults; return the folder of the run."""
    rig = Rig(load("astb"), seed=seed)
    for fault in faults:
        rig.faults.plan(fault)
    with RigInMemory(rig).bench(seed=seed) as bench:
        execute(plans()[plan], bench, out / plan, rig="virtual", seed=seed)
    return out / plan


def watched(folder: Path) -> TwinStory:
    return Twin(read(folder), load("astb"), "astb").look()


class Growing(Record):
    """What a record held at a time ``until`` (s) of its run."""

    def __init__(self, whole: Record) -> None:
        self.whole, self.until = whole, 0.0
        self.path, self.signals, self.meta, self.start_ns = (
            whole.path,
            whole.signals,
            whole.meta,
            whole.start_ns,
        )

    @property
    def events(self):
        return [event for event in self.whole.events if self.whole.time_of(event) <= self.until]

    @property
    def duration(self):
        return min(self.until, self.whole.duration)

    @property
    def phases(self):
        return self.whole.phases

    def series(self, name):
        times, values = self.whole.series(name)
        end = np.searchsorted(times, self.until, side="right")
        return times[:end], values[:end]


@pytest.mark.slow
@pytest.mark.parametrize("plan", ["aw0", "aw3", "leak_down", "tightness"])
def test_a_fault_free_rig_has_no_deviation(plan, tmp_path):
    story = watched(run(plan, tmp_path, 4711))
    assert not story.all_deviations
    assert story.judged_for > 25.0
    assert all(one.why for one in story.judged if one.along is None)
    edges = [(one.start, one.end) for one in story.judged]
    assert all(before[1] == pytest.approx(after[0], abs=1e-6) for before, after in pairwise(edges))


@pytest.mark.slow
def test_a_leak_is_detected_with_its_size_and_start(tmp_path):
    began = 70.0
    folder = run("aw0", tmp_path, 12, PlannedFault("leak", {"side": "right", "area": "0.5mm2"}, began, None))
    (parting,) = watched(folder).all_deviations
    assert began < parting.detected < began + 8.0
    assert abs(parting.since - began) < 2.0
    cause = next(one for one in parting.causes if one.name == "leak.right")
    assert cause.low < 0.5e-6 < cause.high
    assert {one.name for one in parting.causes} <= {"leak.right", "leak_laminar.right"}
    assert "leak of a bellows (orifice), right" in parting.sentence


def is_what_was_read(story: TwinStory, record: Record) -> None:
    """The last minute has the means of what the record holds, in blocks of half a second one after the other."""
    times = np.array(story.last_minute.times)
    assert np.all(np.diff(times) > 0.4) and times[-1] - times[0] <= 60.0 and times[-1] < record.duration
    for one in story.last_minute.channels:
        clock, values = record.series(one.channel)
        for time, measured in zip(times[::7], one.measured[::7], strict=True):
            if measured is not None:
                around = values[np.abs(clock - time) < 0.25]
                assert measured == pytest.approx(
                    around.mean(), rel=1e-4, abs=3.0 * np.ptp(around) / len(around) ** 0.5
                )


def found_by(story: TwinStory) -> TwinStory:
    """A story without its course and its last readings: both depend on how often a twin looked meanwhile."""
    all_deviations = tuple(replace(one, course=()) for one in story.all_deviations)
    return replace(story, all_deviations=all_deviations, last_minute=None)


@pytest.mark.slow
def test_during_the_run_the_report_agrees_and_has_no_earlier_deviation(tmp_path):
    began = 75.0
    folder = run("aw0", tmp_path, 13, PlannedFault("leak", {"side": "left", "area": "1mm2"}, began, None))
    growing = Growing(read(folder))
    twin, told = Twin(growing, load("astb"), "astb"), []
    for growing.until in np.arange(0.0, 8.0, 0.45):
        assert not twin.look(ended=False).judged_for, "nothing can be said so early, and nothing breaks"
    for growing.until in np.arange(54.0, 98.0, 4.0):
        story = twin.look(ended=False)
        told += [(growing.until, one) for one in story.all_deviations[len(told) :]]
        if story.judged_for:
            is_what_was_read(story, growing)
    (first,) = told
    assert began < first[0] < began + 10.0
    assert {"leak.left"} <= {one.name for one in first[1].causes}
    growing.until = 1e6
    (last,) = twin.look().all_deviations
    assert last.detected == first[1].detected
    assert abs(last.since - began) < 2.0
    story = twin.story
    is_what_was_read(story, growing)
    (leaking,) = (one for one in story.last_minute.channels if one.channel == "left.bellows_pressure")
    assert leaking.measured[-1] < leaking.expected[-1] - leaking.band[-1], "what leaks is beyond its band"


@pytest.mark.slow
def test_what_no_two_causes_explain_is_given_none(tmp_path):
    """A leak on each side, and two load cells that are off."""
    folder = run(
        "aw0",
        tmp_path,
        14,
        PlannedFault("leak", {"side": "left", "area": "0.5mm2"}, 60.0, None),
        PlannedFault("bias", {"sensor": "load_cell.2", "value": "2kN"}, 63.0, None),
        PlannedFault("leak", {"side": "right", "area": "0.8mm2"}, 66.0, None),
        PlannedFault("bias", {"sensor": "load_cell.4", "value": "-1kN"}, 69.0, None),
    )
    growing = Growing(read(folder))
    growing.until = 85.0
    (parting,) = Twin(growing, load("astb"), "astb").look().all_deviations
    assert parting.causes == parting.pairs == ()
    assert "No single cause" in parting.sentence and "two together" not in parting.sentence


@pytest.mark.slow
def test_the_command_keeps_what_it_found_and_the_report_tells_it(tmp_path):
    started = CliRunner().invoke(
        commands,
        [
            "run",
            "leak_down",
            "--virtual",
            "--watch",
            "--seed=3",
            "--effect=leak.left=0.5mm2",
            f"--out={tmp_path}",
        ],
    )
    assert "leak of a bellows (orifice), left" in " ".join(started.output.split())
    folder = tmp_path / "leak_down"
    story = read_twin(folder)
    assert story is not None and story.all_deviations[0].causes[0].name.startswith("leak")
    page = (folder / "report.html").read_text()
    assert "Comparison with the model" in page and all(
        getattr(story.all_deviations[0].summary, name) in page for name in PARTS
    )
    again = CliRunner().invoke(commands, ["watch", str(folder)])
    assert again.exit_code == 1
    same = read_twin(folder)
    assert same is not None and found_by(same) == found_by(story)
    assert not (folder / STREAM).exists()


def test_where_no_run_is_the_command_says_so(tmp_path, monkeypatch):
    monkeypatch.setattr("astb.watch.watching.BEGINS", 0.0)
    asked = CliRunner().invoke(commands, ["watch", str(tmp_path)])
    assert asked.exit_code == 3
    assert "holds no record.parquet" in asked.output
    assert CliRunner().invoke(commands, ["watch", str(tmp_path / "missing")]).exit_code == 2


def test_a_record_without_anything_to_compare_is_refused(tmp_path):
    with Recorder(tmp_path, [SignalInfo("left.height", "mm", 1e-3)], {}) as recorder:
        recorder.receive([0], [0], [0.0])
    with pytest.raises(DiagnosisError, match="no pressure and no force that can be compared with a model"):
        Twin(read(tmp_path), load("astb"), "astb")


RIG = """
time = "virtual"
name = "leaks"
description = "a bellows gets a hole while it cycles"

[simulation]
parameters = "astb"
seed = 3

[[simulation.faults]]
name = "leak"
values = { side = "left", area = "0.5 mm2" }
at = "230 s"
"""


@pytest.mark.slow
def test_an_endurance_plan_ends_with_the_reason_instead_of_a_broken_bellows(tmp_path):
    rig = tmp_path / "leaks.toml"
    rig.write_text(RIG)
    arguments = ["run", "endurance", f"--rig={rig}", "--set=parting=ends", f"--out={tmp_path}"]
    CliRunner().invoke(commands, [*arguments, "--watch"])
    result = read_result(tmp_path / "endurance")
    (why,) = (text for text in result.warnings if "the cycles were ended" in text)
    assert "leak of a bellows (orifice), left" in why
    made = next(one.number for one in result.checks if one.name == "cycles")
    assert 11 <= made <= 11 + 40, "it is queried every 20 s"
    page = (tmp_path / "endurance" / "report.html").read_text()
    assert why in page and "fault leak, side = left, area = 0.5 mm2, from 230 s" in page
    assert {phase.name for phase in result.phases} >= {f"look after {made:.0f} cycles"}


@pytest.mark.slow
def test_a_plan_without_a_twin_reports_that_and_continues(tmp_path):
    given = {"parting": "ends", "cycles": "200", "intervals": "1"}
    with RigInMemory(Rig(load("astb"), seed=3)).bench(seed=3) as bench:
        result = execute(plans()["endurance"].given(given), bench, tmp_path / "run", rig="virtual", seed=3)
    assert NOBODY_WATCHES in result.warnings
    assert next(one.number for one in result.checks if one.name == "cycles") == 200
