"""The index of kept runs follows the folders: added, changed, removed, unreadable, and the index itself destroyed."""

import os
import shutil
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from tempfile import TemporaryDirectory

import msgspec
import pytest
from click.testing import CliRunner
from hypothesis import given, settings
from hypothesis import strategies as st

from astb.commands.runs import runs_command
from astb.exit_codes import FAIL, PASS
from bench_records.checksums import SUMS, broken_files, write_sums
from bench_records.index import INDEX, RunIndex, facts_of
from bench_records.layout import META, RESULT, RecordError
from bench_records.result import SpecimenFacts, check, conclude
from tests.refusals import refuses


def keep(folder: Path, name: str, values: list[float], *, at: int = 0, **facts: str) -> Path:
    """Write a result with a check for each of ``values`` (limits 0 to 10), as if at ``at`` s of the epoch."""
    directory = folder / name
    checks = [
        check(f"check {number}", value, "mm", 1e-3, low=0.0, high=10.0) for number, value in enumerate(values)
    ]
    sample = SpecimenFacts(type="spring", serial_number=facts.get("serial", "7"))
    plan = facts.get("plan", "aw0")
    path = conclude(plan, "Title", "Text", checks, rig="local", specimen=sample, seed=1).write(directory)
    if "operator" in facts or "date" in facts:
        content = {key: facts[key] for key in ("operator", "date") if key in facts}
        (directory / META).write_bytes(msgspec.json.encode(content))
    os.utime(path, (at, at))
    return directory


def test_a_run_is_found_with_what_it_concluded(tmp_path) -> None:
    keep(tmp_path, "aw0", [1.0, 11.0], operator="A. Tester", date="2026-01-02T03:04:05Z", serial="42")
    (run,) = RunIndex(tmp_path).runs()
    assert (run.directory, run.plan, run.verdict, run.rig) == ("aw0", "aw0", "fail", "local")
    assert (run.operator, run.began, run.serial_number) == ("A. Tester", "2026-01-02T03:04:05Z", "42")
    (found,) = RunIndex(tmp_path).checks("check 1")
    assert (found.value, found.low, found.high, found.unit, found.verdict) == (11.0, 0.0, 10.0, "mm", "fail")


def test_runs_are_selected_by_columns_in_order_of_time(tmp_path) -> None:
    keep(tmp_path, "late", [1.0], at=200, plan="aw3")
    keep(tmp_path, "deep/early", [1.0], at=100)
    index = RunIndex(tmp_path)
    assert [run.directory for run in index.runs()] == ["deep/early", "late"]
    assert [run.directory for run in index.runs(plan="aw3", verdict=None)] == ["late"]
    assert index.runs(plan="aw3", verdict="fail") == []
    with refuses(ValueError, "colour"):
        index.runs(colour="red")


STEPS = st.lists(
    st.tuples(st.sampled_from(["add", "change", "remove", "ask"]), st.integers(0, 4), st.floats(-5, 15)),
    max_size=12,
)


@given(STEPS)
@settings(max_examples=25, deadline=None)
def test_whatever_happens_to_the_folders_the_index_says_what_a_new_one_says(tmp_path_factory, steps) -> None:
    folder = tmp_path_factory.mktemp("runs")
    index = RunIndex(folder)
    for time, (step, place, value) in enumerate(steps):
        if step == "ask":
            index.runs()
        elif step == "remove":
            shutil.rmtree(folder / str(place), ignore_errors=True)
        else:
            keep(folder, str(place), [value], at=1000 + time)
    runs, checks = index.runs(), index.checks("check 0")
    (folder / INDEX).unlink(missing_ok=True)
    assert RunIndex(folder).runs() == runs
    assert RunIndex(folder).checks("check 0") == checks
    there = sorted(path.parent.name for path in folder.rglob(RESULT))
    assert sorted(run.directory for run in runs) == there


@pytest.mark.parametrize("rubbish", [b"", b"no database at all, but some text", b"SQLite format 3\0"])
def test_an_index_that_is_none_is_made_anew(tmp_path, rubbish: bytes) -> None:
    keep(tmp_path, "aw0", [1.0])
    (tmp_path / INDEX).write_bytes(rubbish)
    assert [run.directory for run in RunIndex(tmp_path).runs()] == ["aw0"]


def test_an_unreadable_entry_is_reported_and_the_others_listed(tmp_path) -> None:
    keep(tmp_path, "good", [1.0])
    (keep(tmp_path, "bad", [1.0]) / RESULT).write_text("{")
    index = RunIndex(tmp_path)
    assert [run.directory for run in index.runs()] == ["good"]
    assert list(index.unreadable) == ["bad"]


def test_who_asks_first_at_the_same_time_finds_the_same(tmp_path) -> None:
    keep(tmp_path, "aw0", [1.0])
    for _ in range(10):
        (tmp_path / INDEX).unlink(missing_ok=True)
        with ThreadPoolExecutor(4) as pool:
            asked = [pool.submit(RunIndex(tmp_path).runs) for _ in range(4)]
            assert {len(one.result()) for one in asked} == {1}


def test_a_folder_that_cannot_be_written_is_listed_all_the_same() -> None:
    root = os.geteuid() == 0
    with TemporaryDirectory(dir="/tmp") as name:
        folder = Path(name)
        keep(folder, "aw0", [1.0])
        folder.chmod(0o555)
        try:
            if root:  # who may write anywhere
                os.seteuid(65534)
            assert [run.directory for run in RunIndex(folder).runs()] == ["aw0"]
            assert not (folder / INDEX).exists()
        finally:
            if root:
                os.seteuid(0)
            folder.chmod(0o755)


def test_an_existing_folder_is_not_reported_missing(tmp_path) -> None:
    with refuses(RecordError, "folder"):
        RunIndex(tmp_path / "missing")


@pytest.mark.parametrize("content", [b"", b"[1]", b"null", b'{"date": '])
def test_circumstances_that_are_none_are_none(tmp_path, content: bytes) -> None:
    (tmp_path / META).write_bytes(content)
    assert facts_of(tmp_path) == {}


def test_what_people_write_is_listed_as_they_wrote_it(tmp_path) -> None:
    keep(tmp_path, "one", [1.0], operator="[red]Ada[/x]")
    done = CliRunner().invoke(runs_command, ["--out", str(tmp_path)])
    assert done.exit_code == 0
    assert "[red]Ada[/x]" in done.output


def test_the_origin_of_a_run_is_shown(tmp_path) -> None:
    directory = keep(tmp_path, "aw0", [1.0])
    content = {"simulated": True, "effects": {"leak.left": "1 mm2"}}
    (directory / META).write_bytes(msgspec.json.encode(content))
    keep(tmp_path, "steel", [1.0])
    index = RunIndex(tmp_path)
    assert [one.directory for one in index.runs(circumstances="")] == ["steel"]
    assert [one.circumstances for one in index.runs()] == ["SIMULATED · effect leak.left = 1 mm2", ""]


def test_changes_since_the_writing_are_reported(tmp_path) -> None:
    directories = [keep(tmp_path, name, [1.0]) for name in ("whole", "broken")]
    for directory in directories:
        write_sums(directory)
    asked = ["--out", str(tmp_path), "--verify"]
    assert CliRunner().invoke(runs_command, asked).exit_code == PASS
    text = (directories[1] / RESULT).read_text()
    (directories[1] / RESULT).write_text(text.replace("Title", "Other"))
    done = CliRunner().invoke(runs_command, asked)
    assert done.exit_code == FAIL
    assert "broken: result.json was changed" in done.output
    assert "1 of 2 runs" in done.output


@pytest.mark.parametrize("rest", ["", "0  meta.json\n"], ids=["empty", "cut off"])
def test_checksums_that_leave_a_file_out_do_not_count_as_unbroken(tmp_path, rest: str) -> None:
    directory = keep(tmp_path, "aw0", [1.0])
    (directory / SUMS).write_text(rest)
    assert "result.json has no checksum" in broken_files(directory)
