"""Wherever the disk fails: the run says so at once, brings the springs to rest, keeps what it can, and is blocked."""

import errno
import random
import shutil
import subprocess
import sys
from math import inf

import pytest

from bench_protocol.units import bar, mm
from bench_records.conversion import recover
from bench_records.disk import NotKept
from bench_records.layout import PARQUET, RESULT, STREAM
from bench_records.record import read
from bench_records.result import Outcome, read_result
from test_plans import steps
from test_plans.execution import execute
from test_plans.loads import AW0
from test_plans.plan import plan
from tests.failing_disk import REFUSED, failing_disk


@plan
def fills(run):
    """Fill the springs, and wait."""
    steps.raise_the_air(run, run.specimen.load(AW0))
    with run.phase("waiting"):
        run.bench.wait(3.0)
    run.check("height", run.bench.left.height, "mm", low=-100 * mm, high=100 * mm)


def carried_out(bench_composed, folder, at=inf, number=errno.ENOSPC):
    """Return the result of a run, None if it never began, what the disk did, and what the springs hold."""
    with bench_composed() as made, failing_disk(folder, at, number, made.clock.now) as disk:
        result = None
        try:
            result = execute(fills, made.bench, folder / "run")
        except NotKept as error:
            assert REFUSED[number] in str(error)
        with made.bench.despite_faults():
            return result, disk, made.bench.left.bellows_pressure


@pytest.fixture(scope="module")
def places(bench_composed, tmp_path_factory):
    """When a sound run writes something (s): as often as there are places for a failure."""
    result, disk, _ = carried_out(bench_composed, tmp_path_factory.mktemp("sound") / "out")
    assert result.verdict is Outcome.PASS, result.reason
    return [time / 1e9 for time in disk.times]


def holds(result, disk, pressure, number, folder):
    """What must be so of a run whose disk has failed."""
    assert pressure < 0.2 * bar
    if result is None:  # the folder was refused before anything moved
        return
    assert result.verdict is Outcome.BLOCKED
    assert "the record: " in result.reason and REFUSED[number] in result.reason, result.reason
    tear_down = next(phase for phase in result.phases if phase.name == "tear-down")
    assert tear_down.start - disk.failed_at / 1e9 < 1.0  # the run began at 0 s
    if number == errno.ENOENT:  # there is room: the folder is made again, with all that was known
        assert read_result(folder).verdict is Outcome.BLOCKED
        assert not (folder / STREAM).exists() or recover(folder).samples > 0
        assert (folder / PARQUET).exists()
    elif (folder / STREAM).exists():
        record = read(folder)
        assert record.duration <= disk.failed_at / 1e9 + 0.1
        assert not list(folder.glob("*.part"))


def run_with_fault(bench_composed, places, tmp_path, seed):
    chance = random.Random(seed)
    at, number = chance.randint(1, len(places)), chance.choice(list(REFUSED))
    result, disk, pressure = carried_out(bench_composed, tmp_path / "out", at, number)
    assert disk.failed_at is not None
    holds(result, disk, pressure, number, tmp_path / "out" / "run")


@pytest.mark.parametrize("seed", range(4))
def test_wherever_the_disk_fails_the_bench_comes_to_rest(bench_composed, places, tmp_path, seed):
    run_with_fault(bench_composed, places, tmp_path, seed)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(100, 112))
def test_wherever_the_disk_fails_the_bench_comes_to_rest_many_times(bench_composed, places, tmp_path, seed):
    run_with_fault(bench_composed, places, tmp_path, seed)


@pytest.mark.parametrize("number", REFUSED)
def test_a_disk_that_fails_while_the_springs_are_full_ends_the_run_at_once(
    bench_composed, places, tmp_path, number
):
    at = next(
        place for place, time in enumerate(places, 1) if time > 5.0
    )  # the springs are filled from 4.4 s on
    result, disk, pressure = carried_out(bench_composed, tmp_path / "out", at, number)
    holds(result, disk, pressure, number, tmp_path / "out" / "run")
    assert result.reason.startswith("the record: ")
    assert "waiting" in [phase.name for phase in result.phases]
    assert result.duration < 30.0


TINY = """
set -e
mkdir -p "$1"
mount -t tmpfs -o size=$2k tmpfs "$1"
set +e
"$3" -m astb run tightness --virtual --set "hold=10 min" --out "$1"
echo "ended with $?"
cat "$1"/tightness/result.json > "$4"
"$3" -m astb runs --out "$1"
echo "listed"
"$3" -m astb report "$1/tightness"
echo "ended with $?"
rm -f "$1/ballast"
"""


def in_a_tiny_file_system(tmp_path, size):
    if shutil.which("unshare") is None:
        pytest.skip("there is no unshare")
    run = ["unshare", "-rm", "sh", "-c", TINY, "sh", str(tmp_path / "tiny"), str(size), sys.executable]
    done = subprocess.run(
        [*run, str(tmp_path / RESULT)], capture_output=True, text=True, timeout=110, check=False
    )
    if "ended with" not in done.stdout:
        pytest.skip(f"no tiny file system here: {done.stderr.strip()[-200:]}")
    return done


@pytest.mark.slow
def test_on_a_full_disk_result_and_list_of_runs_are_there(tmp_path):
    """A real one, of 5 MB: the record of ten minutes has more, and the result has room."""
    done = in_a_tiny_file_system(tmp_path, 5000)
    assert "Traceback" not in done.stderr + done.stdout
    assert "ended with 3" in done.stdout
    result = read_result(tmp_path)
    assert result.verdict is Outcome.BLOCKED
    assert result.reason.startswith("the record: ") and "the disk is full" in result.reason
    listed, _, reported = done.stdout.split("ended with 3", 1)[1].partition("listed\n")
    assert "tightness" in listed and "blocked" in listed
    # The record takes less than its stream did: the report may have room again; where it has none, that is said.
    assert "report.html\nended with 0" in reported or "ended with 3" in reported


@pytest.mark.slow
def test_a_disk_without_room_for_a_result_begins_no_run(tmp_path):
    done = in_a_tiny_file_system(tmp_path, 1000)
    assert "ended with 3" in done.stdout and "Traceback" not in done.stderr + done.stdout
    assert "no space for the result of a run, 2 MiB: the disk is full" in done.stderr
