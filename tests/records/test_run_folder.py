"""The folder of a run shows its state at any moment: during the run, after a kill, and after its end."""

import shutil
from collections.abc import Iterator
from pathlib import Path

import msgspec
import pytest
from click.testing import CliRunner

from astb.commands.runs import runs_command
from astb.exit_codes import PASS
from bench_records.comparison import compare_runs
from bench_records.conversion import recover
from bench_records.index import RunIndex
from bench_records.layout import Condition, RecordError, SignalInfo
from bench_records.record import read
from bench_records.recorder import Recorder
from bench_records.report import report_page, write_report
from bench_records.result import check, unavailable
from bench_records.run_folder import Unfinished, open_run
from tests.refusals import refuses

SECOND = 1_000_000_000
SPECIMEN = {"type": "spring", "serial_number": "7", "drawing": "d", "file": "f", "sha256": "0"}
FACTS = {
    "plan": "aw0",
    "title": "The title",
    "instruction": "The title\n\nWhat is good.",
    "set": {"load": "AW0"},
    "specimen": SPECIMEN,
    "operator": "A. Tester",
    "rig": "local",
    "seed": 3,
}
CHECKS = [
    check("height", 1.0, "mm", 1e-3, low=0.0, high=2.0, u=0.1, parts={"noise": 0.1}, phase="main"),
    check("force", float("nan"), "N", low=0.0),
    unavailable("roll", "no roll here"),
]
CONDITION = Condition("cool", met=True, found="20 °C")


@pytest.fixture
def going_on(tmp_path: Path) -> Iterator[Recorder]:
    """A run that goes on, in ``tmp_path/run``, 4 s after it began."""
    recorder = Recorder(
        tmp_path / "run", [SignalInfo("x", "mm", 1e-3)], FACTS, start_ns=0, in_background=False
    )
    recorder.event(0, "phase", "main", edge="begin")
    recorder.event(SECOND, "phase", "shake", edge="begin")
    for one in CHECKS:
        recorder.event(
            2 * SECOND, "check", str(one), verdict=one.verdict.value, whole=msgspec.to_builtins(one)
        )
    recorder.event(3 * SECOND, "precondition", "cool: 20 °C", whole=msgspec.structs.asdict(CONDITION))
    recorder.receive([4 * SECOND], [0], [0.5])
    recorder.flush()
    yield recorder
    recorder.close()


@pytest.fixture
def killed(going_on: Recorder, tmp_path: Path) -> Path:
    """The rest after a kill: the same bytes, without an owner."""
    return Path(shutil.copytree(going_on.directory, tmp_path / "elsewhere" / "killed"))


def test_a_killed_run_is_listed_with_its_plan_and_checks(killed: Path) -> None:
    result, facts, verdict = open_run(killed)
    assert verdict == Unfinished.INTERRUPTED
    assert (result.plan, result.title, result.instruction) == ("aw0", FACTS["title"], FACTS["instruction"])
    assert (result.parameters, result.rig, result.seed) == ({"load": "AW0"}, "local", 3)
    assert result.specimen is not None and msgspec.to_builtins(result.specimen) == SPECIMEN
    assert facts["operator"] == "A. Tester"
    assert [str(one) for one in result.checks] == [str(one) for one in CHECKS]
    assert result.checks[0] == CHECKS[0]
    assert result.preconditions == [CONDITION]
    assert result.reason == "the run was cut off before its end, after 4.0 s, in main \u203a shake"


def test_a_killed_run_reads_the_same_before_and_after_its_record_was_made(killed: Path) -> None:
    before = open_run(killed)
    assert "What is good." in report_page(killed)
    recover(killed)
    assert open_run(killed) == before
    assert "What is good." in write_report(killed).read_text()


def test_the_head_of_a_run_is_there_before_anything_happened(tmp_path: Path) -> None:
    recorder = Recorder(tmp_path / "run", [SignalInfo("x")], FACTS, start_ns=0)
    killed = Path(shutil.copytree(tmp_path / "run", tmp_path / "killed"))
    recorder.close()
    assert open_run(killed).result.title == FACTS["title"]
    assert len(read(killed)) == 0


def test_a_running_run_is_reported_and_unchanged(going_on: Recorder, tmp_path: Path) -> None:
    index = RunIndex(tmp_path)
    assert open_run(going_on.directory).facts.keys() <= FACTS.keys()
    (run,) = index.runs()
    assert (run.verdict, run.title, run.operator) == ("running", FACTS["title"], "A. Tester")
    for touch in (read, recover):
        with refuses(RecordError):
            touch(going_on.directory)
    going_on.close()
    (run,) = index.runs()
    assert (run.verdict, run.duration) == ("interrupted", 4.0), "it left no result"


def test_interrupted_runs_are_listed_compared_and_have_no_checksums(killed: Path) -> None:
    folder = killed.parent
    (run,) = RunIndex(folder).runs(verdict="interrupted", serial_number="7")
    assert (run.plan, run.operator, run.parameters) == ("aw0", "A. Tester", {"load": "AW0"})
    assert [one.value for one in RunIndex(folder).checks("height")] == [1.0]
    done = CliRunner().invoke(runs_command, ["--out", str(folder), "--verify"])
    assert done.exit_code == PASS
    assert "1 did not end" in done.output
    found = compare_runs(killed, killed)
    assert (found.facts, found.verdicts) == ([], ("interrupted", "interrupted"))


def test_samples_that_were_never_a_run_are_not_listed(tmp_path: Path) -> None:
    with Recorder(tmp_path / "samples", [SignalInfo("x")], {"from": "elsewhere"}):
        pass
    assert RunIndex(tmp_path).runs() == []
