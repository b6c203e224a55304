"""Reservations never overlap, outlive their process, and keep runs of other operators away."""

import subprocess
import sys
import threading
from collections.abc import Callable
from datetime import UTC, datetime, timedelta
from itertools import count
from pathlib import Path

import pytest
from click.testing import CliRunner
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from astb import run, run_queue
from astb.cli import commands
from astb.exit_codes import BLOCKED
from astb.reservations import (
    NotReserved,
    Reservation,
    cancel,
    reservations,
    reservations_folder,
    reserve,
    reserved_for_others,
)
from astb.rig_file import RigFile, find_rig
from test_plans.discovery import plans
from tests.refusals import refuses

RIG = Path("hall.toml")
HOUR, MINUTE = timedelta(hours=1), timedelta(minutes=1)
NUMBERS = count()
OTHER_PROCESS = """
from datetime import UTC, datetime, timedelta
from pathlib import Path
from astb.reservations import Reservation, reserve
now = datetime.now(UTC)
reserve(Path("hall.toml"), Reservation(now, now + timedelta(hours=1), "A. Miller"))
"""


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(run_queue, "_LOOK", 0.01)


def soon(by: str, after: timedelta = timedelta(0), lasts: timedelta = HOUR) -> Reservation:
    start = datetime.now(UTC) + after
    return Reservation(start, start + lasts, by)


@settings(max_examples=50, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    st.lists(st.tuples(st.booleans(), st.integers(2, 40), st.integers(1, 12)), max_size=12),
    st.integers(1, 60),
)
def test_reservations_never_overlap(steps, lasts):
    """The oracle keeps the minutes of each reservation."""
    rig, now = Path(f"{next(NUMBERS)}.toml"), datetime.now(UTC)
    taken: dict[int, set[int]] = {}
    for add, start, length in steps:
        if not add:
            cancel(rig, now + start * MINUTE)
            taken.pop(start, None)
            continue
        minutes = set(range(start, start + length))
        new = Reservation(now + start * MINUTE, now + (start + length) * MINUTE, f"of {start}")
        met = [one for one, its in sorted(taken.items()) if its & minutes]
        if met:
            with refuses(NotReserved, f"of {met[0]} "):
                reserve(rig, new)
        else:
            reserve(rig, new)
            taken[start] = minutes
    assert [one.by for one in reservations(rig)] == [f"of {start}" for start in sorted(taken)]
    # A run that begins between the minutes 0 and 1, and ends in the middle of a minute.
    run_minutes = set(range(lasts))
    expected = [f"of {start}" for start in sorted(taken) if taken[start] & run_minutes and start != 7]
    assert [one.by for one in reserved_for_others(rig, " OF 7", (lasts - 0.5) * 60.0)] == expected


def test_reservations_outlive_their_process():
    subprocess.run([sys.executable, "-c", OTHER_PROCESS], check=True)
    (kept,) = reservations(RIG)
    assert kept.by == "A. Miller" and kept.start < datetime.now(UTC) < kept.end
    assert reservations(Path("other.toml")) == []


def test_expired_reservations_disappear():
    past = Reservation(datetime.now(UTC) - HOUR, datetime.now(UTC) + timedelta(milliseconds=50), "past")
    reserve(RIG, past)
    while past.end > datetime.now(UTC):
        pass
    assert reservations(RIG) == [] == reserved_for_others(RIG, "me", 60.0)
    reserve(RIG, soon("next"))
    assert b"past" not in (reservations_folder(RIG) / "reservations.json").read_bytes()


def test_no_reservation_is_lost_among_several_writers():
    """Eight threads want the same hour, and each an hour of its own."""
    same, refused = soon("all"), []

    def write(number: int) -> None:
        reserve(RIG, soon(f"own {number}", after=(number + 2) * HOUR, lasts=30 * MINUTE))
        try:
            reserve(RIG, same)
        except NotReserved:
            refused.append(number)

    threads = [threading.Thread(target=write, args=(number,)) for number in range(8)]
    for one in threads:
        one.start()
    for one in threads:
        one.join()
    assert [one.by for one in reservations(RIG)] == ["all", *(f"own {number}" for number in range(8))]
    assert len(refused) == 7


@pytest.mark.parametrize(
    "wrong",
    [
        soon(" "),
        soon("A\nB"),
        soon("A" * 101),
        soon("A", lasts=-HOUR),
        soon("A", lasts=timedelta(0)),
        soon("A", after=-2 * HOUR),
        soon("A", lasts=timedelta(days=400)),
        Reservation(datetime.min.replace(tzinfo=UTC), datetime.max.replace(tzinfo=UTC), "A"),
    ],
)
def test_an_impossible_reservation_is_refused(wrong):
    with pytest.raises(NotReserved):
        reserve(RIG, wrong)
    assert reservations(RIG) == []


def test_a_damaged_file_is_reported():
    reserve(RIG, soon("A"))
    path = reservations_folder(RIG) / "reservations.json"
    path.write_bytes(path.read_bytes()[:-3])
    with refuses(NotReserved, str(path)):
        reservations(RIG)


def turn(by: str, *, wait: bool, say: Callable[[str], None] = pytest.fail):
    return run._queue_turn([plans()["aw0"]], RigFile("hall"), RIG, run.Keeping(operator=by, wait=wait), say)


@pytest.mark.parametrize("after", [timedelta(0), MINUTE], ids=["now", "before the end of the run"])
def test_a_run_of_another_operator_is_refused(after):
    reserve(RIG, soon("A. Miller", after))
    with pytest.raises(NotReserved, match=r"A\. Miller") as caught, turn("B. Smith", wait=False):
        pass
    assert f"{reservations(RIG)[0].end.astimezone():%H:%M}" in str(caught.value)
    with turn("a. miller", wait=False):
        pass


def test_a_run_before_a_reservation_begins():
    reserve(RIG, soon("A. Miller", after=HOUR))
    for wait in (False, True):
        with turn("B. Smith", wait=wait):
            pass


def test_a_waiting_run_leaves_the_rig_to_the_reservation():
    reserve(RIG, soon("A. Miller"))
    told, begun = [], threading.Event()

    def smith() -> None:
        with turn("B. Smith", wait=True, say=told.append):
            begun.set()

    thread = threading.Thread(target=smith)
    thread.start()
    while not told:
        assert thread.is_alive()
    assert "A. Miller" in told[0]
    with turn("A. Miller", wait=True):  # B. Smith has no place before it
        assert not begun.is_set()
    assert not begun.wait(0.1)
    cancel(RIG, reservations(RIG)[0].start)
    thread.join(10.0)
    assert begun.is_set()


def test_the_command_refuses_before_it_connects():
    path = find_rig("local")[1]
    reserve(path, soon("A. Miller"))
    told = CliRunner().invoke(commands, ["run", "aw0", "--rig", "local", "--operator", "B. Smith"])
    assert told.exit_code == BLOCKED
    assert "A. Miller" in told.output and "--wait" in told.output
    assert not Path("runs").exists()
