"""A run as it can be seen while it lasts: snapshots against what a scripted plan does, and how they are drawn."""

import json
import os
import pty
import re
import subprocess
import sys
from io import StringIO

import msgspec
import pytest
from click.testing import CliRunner
from rich.console import Console

from astb.cli import commands
from astb.display import ProgressDisplay, drawn
from astb.live.door import Door
from astb.live.model import Live
from astb.live.outline import NONE, Follower, Outline, kept_outline
from astb.live.snapshot import LiveReading, Snapshot
from astb.rig_file import RigFile
from astb.rig_limits import known_limits
from bench_protocol.units import mm, s
from bench_records.layout import Phase
from bench_records.result import check
from test_plans.execution import execute
from test_plans.operator import Question, QuestionBox
from test_plans.plan import plan
from test_plans.suspension import Suspension

HALL = RigFile("hall", limits=({"signal": "lateral.displacement", "kind": "upper", "at": "40 mm"},))


def walking(look):
    """A plan that goes to the side and back, and calls ``look`` on the way."""

    @plan
    def walk(run):
        """Go to the side and back."""
        with run.phase("begin"):
            run.bench.lateral.control = "displacement"
            look(run)
        with run.phase("there"):
            run.bench.lateral.move_to(20 * mm, rate=40 * mm / s)
            run.bench.wait(1 * s)
            look(run)
            run.check("place", run.bench.average("lateral.displacement"), "mm", low=19 * mm, high=21 * mm)
        with run.phase("back"):
            run.say("nearly done")
            look(run)
            run.bench.lateral.move_to(0.0, rate=40 * mm / s)

    return walk


@pytest.fixture
def watch(bench_composed, tmp_path):
    """Run the walk; return the snapshots and what the bench read at the same moments."""

    def run(name="walk", outline=NONE):
        with bench_composed() as made:
            live = Live("walk", made.bench, rig="hall", limits=known_limits(HALL), outline=outline)
            seen = []
            look = lambda run: seen.append((live.snapshot(), run.bench.lateral.displacement, run.now))  # noqa: E731
            execute(walking(look), made.bench, tmp_path / name, watcher=live)
            return [*seen, (live.snapshot(), made.bench.lateral.displacement, made.clock.now())]

    return run


def reading(seen: Snapshot, name: str) -> LiveReading:
    return next(one for one in seen.readings if one.name == name)


def test_a_snapshot_says_what_the_run_does(watch):
    (begin, _, before), (there, place, at), (back, *_), (end, *_) = watch()
    assert [one.step for one in (begin, there, back)] == [
        ("main", "begin"),
        ("main", "there"),
        ("main", "back"),
    ]
    assert (end.step, end.state) == ((), "DISABLED")
    assert {one.state for one in (begin, there, back)} == {"ACTIVE"}
    assert there.time - begin.time == pytest.approx((at - before) / 1e9)
    assert 1.5 < there.in_step < 3.0, "20 mm at 40 mm/s, and a second"
    assert (back.in_step, back.said) == (0.0, "nearly done")
    one = reading(there, "lateral.displacement")
    assert one.value == place == pytest.approx(20 * mm, abs=0.2 * mm)
    assert one.used == pytest.approx(0.5, abs=0.01), "half of the way to the 40 mm that the rig's file states"
    assert one.limit == "upper 40 mm"
    assert (there.checks, back.checks) == ({}, {"pass": 1})
    assert back.last_check.startswith("place = ")
    assert (there.late, there.assumed) == (0, 15)
    assert (begin.next, begin.left, begin.outline) == ("", None, ""), "this plan was never run before"


def test_the_run_before_tells_what_comes(watch, tmp_path):
    watch("walk")
    outline = kept_outline(tmp_path, "walk", {})
    assert outline.source == "walk"
    (tmp_path / "walk").rename(tmp_path / "a good one")
    assert kept_outline(tmp_path, "walk", {}).source == "a good one", "whatever it is called"
    (tmp_path / "a good one").rename(tmp_path / "walk")
    assert kept_outline(tmp_path, "walk", {"amplitude": "1 mm"}) is NONE
    assert kept_outline(tmp_path / "nowhere", "walk", {}) is NONE
    (begin, *_), (there, *_), (back, *_), (end, *_) = watch("walk-2", outline)
    assert [one.next for one in (begin, there, back, end)] == ["there", "back", "tear-down", ""]
    for one in (begin, there, back):
        assert one.time + one.left == pytest.approx(end.time, abs=0.05), "both runs are the same"
        assert one.fraction == pytest.approx(one.time / end.time, abs=0.01)
        assert one.outline == "walk"


def test_a_step_that_the_outline_does_not_have_makes_what_comes_unknown_until_it_is_met_again():
    phases = (Phase("main", 0, 9), Phase("a", 0, 3, 1), Phase("b", 3, 6, 1), Phase("a", 6, 9, 1))
    follower = Follower(Outline(phases, "before"))
    found = []
    for name, level in (("main", 0), ("a", 1), ("other", 1), ("b", 1), ("a", 1), ("a", 1)):
        follower.begin(name, level)
        found.append((follower.next, follower.left(1.0)))
    assert found == [("a", 8.0), ("b", 8.0), ("", None), ("a", 5.0), ("", 2.0), ("", None)]
    assert follower.left(99.0) is None


def test_a_snapshot_travels_as_json(watch):
    seen = watch()[1][0]
    assert msgspec.json.decode(msgspec.json.encode(seen), type=Snapshot) == seen
    assert json.loads(msgspec.json.encode(seen))["readings"][0]["name"] == "left.height"


def test_a_question_is_shown_and_the_screen_is_free_for_the_answer(bench_composed):
    box, paper = QuestionBox(), StringIO()
    with bench_composed() as made:
        held = Suspension()
        live = Live("walk", made.bench, box=box, suspension=held)
        held.request("me")
        assert (live.snapshot().hold_wanted_by, live.snapshot().held) == ("me", "")
        asked = Question("Put 200 kg on the bolster.")
        box.ask(asked)
        assert (live.snapshot().question, live.snapshot().answers) == (asked.text, asked.allowed)
        left = live.snapshot().answer_within
        assert left is not None and asked.within - 5.0 < left <= asked.within
        with ProgressDisplay(Console(file=paper, force_terminal=True, width=100)) as display:
            display.begin("walk", live)
            assert "late ticks" not in paper.getvalue()
            box.reply("done", "me")
            assert (live.snapshot().question, live.snapshot().answer_within) == ("", None)
            display.begin("walk", live)
            display.checked(check("place", 1.0, "mm", 1e-3, low=0.0, high=2.0))
        assert "late ticks" in paper.getvalue()
        assert "place = 1000 mm" in paper.getvalue()


def test_a_drawing_tells_trouble():
    seen = Snapshot(
        plan="walk",
        rig="hall",
        time=3.0,
        state="FAULT_HOLD",
        hold_wanted_by="me",
        reason="limit tripped",
        step=("main", "there"),
        readings=(
            LiveReading("left.height", None, "no reading"),
            LiveReading("x.y", 1.0, "1 m", 0.95, "upper 1 m"),
        ),
    )
    text = drawn(seen).plain
    for told in (
        "FAULT_HOLD",
        "limit tripped",
        "main › there",
        "not known",
        "not reported by the rig",
        "will be held",
        "no reading",
        " 95 %",
    ):
        assert told in text
    red = {text[span.start : span.end].strip() for span in drawn(seen).spans if "red" in span.style}
    assert {"FAULT_HOLD", "limit tripped", "no reading"} < red


@pytest.mark.slow
def test_through_a_pipe_come_plain_lines_with_the_steps(tmp_path):
    ended = CliRunner().invoke(commands, ["run", "leak_down", "--virtual", "--out", str(tmp_path)])
    assert ended.exit_code == 0
    lines = ended.output.splitlines()
    assert lines[0] == "SIMULATED · VIRTUAL TIME"
    steps = [match[1] for line in lines if (match := re.fullmatch(r" *\d+\.\d s ( *\S.*)", line))]
    assert [one.strip() for one in steps[:3]] == ["preconditions", "set-up", "shim"]
    assert len(steps[2]) - len(steps[2].lstrip()) == len(steps[1]) - len(steps[1].lstrip()) + 2
    assert any(line.startswith("  air lost per minute, left spring") for line in lines)
    assert "\x1b" not in ended.output


@pytest.mark.slow
def test_on_a_terminal_the_run_is_drawn(tmp_path):
    """In a pseudo-terminal, by time: in virtual time a run takes a second or two."""
    here, there = pty.openpty()
    command = [sys.executable, "-m", "astb", "run", "leak_down", "--virtual", "--out", str(tmp_path)]
    screen = {"TERM": "xterm-256color", "COLUMNS": "100", "LINES": "40"}
    with subprocess.Popen(
        command, stdin=there, stdout=there, stderr=there, env=os.environ | screen
    ) as process:
        os.close(there)
        drawn = b"".join(iter(lambda: read_from(here), b""))
        assert process.wait(60) == 0
    text = re.sub(r"\x1b\[[0-9;?]*[A-Za-z]", "", drawn.decode())
    assert re.search(r"(ACTIVE|AIR_HIGH|DISABLED|HOLD) +(set-up|main|tear-down)", text)
    assert re.search(r"left bellows pressure +-?[\d.]+ bar .* % of the way to upper 9 bar", text)
    assert "known after this plan was run or rehearsed once" in text
    assert "leak_down: PASS" in text


def read_from(descriptor: int) -> bytes:
    """The output of a terminal; empty after the end."""
    try:
        return os.read(descriptor, 65536)
    except OSError:
        return b""


def test_failed_checks_are_shown_during_the_run(bench_composed):
    with bench_composed() as made:
        live = Live("walk", made.bench, operator="A. Miller", can_hold=False)
        for value in (1.0, 3.0, float("nan")):
            live.checked(check(f"place {value}", value, "mm", 1.0, low=0.0, high=2.0))
        seen = live.snapshot()
    assert [one.partition(" =")[0] for one in seen.failed] == ["place 3.0", "place nan"]
    assert (seen.operator, seen.can_hold, seen.commands) == ("A. Miller", False, True)


def test_a_run_without_a_hold_point_left_refuses_to_be_held(bench_composed, tmp_path):
    suspension = Suspension()
    with bench_composed() as made:
        live = Live("walk", made.bench, suspension=suspension)
        assert live.cannot_hold == live.snapshot().cannot_hold == ""
        suspension.left = False
        text = Door(lambda: live, suspension, None).answer(b'{"do":"hold"}').decode()
        assert all(part in text for part in ("error", "walk"))
        assert live.snapshot().cannot_hold in text
    assert suspension.wanted_by == ""
