"""What must be so before a plan begins, and a run that is held and goes on."""

import threading
from contextlib import suppress
from datetime import date
from functools import partial
from types import SimpleNamespace
from typing import Literal

import numpy as np
import pytest

from bench_protocol.clock import RealClock
from bench_protocol.units import bar, minutes
from bench_records.record import read
from bench_records.report import write_report
from bench_records.result import CheckVerdict, Outcome, read_result
from drivers.bench import Bench
from drivers.errors import RigFault
from test_plans import preconditions as pre
from test_plans.discovery import plans
from test_plans.execution import execute
from test_plans.holding import can_be_held
from test_plans.instruments import UNKNOWN, Instrument, Instruments, Piece
from test_plans.operator import Script
from test_plans.plan import plan
from test_plans.suspension import Suspension


def empty_plan(run):
    pass


@pytest.fixture
def ran(bench_composed, tmp_path):
    """Run a main part on a virtual rig without arming; return the result and which parts ran."""

    def run(main=None, requires=(), *, instruments=None, prepare=empty_plan, **rest):
        moved = []

        def setup(run):
            moved.append("set-up")

        def checked(run):
            """Check something."""
            (main or empty_plan)(run)
            run.check("something", 1.0, "1", low=0.0)

        one = plan(setup=setup, teardown=empty_plan, requires=requires)(checked)
        with bench_composed() as made:
            if instruments is not None:
                made.bench.instruments = instruments
            prepare(made.bench)
            result = execute(one, made.bench, tmp_path / "out", **rest)
        return SimpleNamespace(result=result, moved=moved, directory=tmp_path / "out")

    return run


PIECE = Piece("left.height", Instrument("laser", "triangulation laser"), "L-7", "C1", due=date(2026, 3, 1))


@pytest.mark.parametrize(
    ("condition", "found"),
    [
        (pre.gas(283.15, 308.15), "20.0 °C"),
        (pre.load_cases("AW0", "AW3"), "astb.toml has AW0, AW3"),
        (pre.rested(10 * minutes), "since it was made"),
        (pre.calibrated(), "due dates are not checked"),
        (pre.calibrated("left.height"), "all have certificates"),
    ],
)
def test_a_plan_whose_preconditions_are_met_runs_and_the_report_says_what_was_found(ran, condition, found):
    run = ran(requires=[condition])
    assert run.result.verdict is Outcome.PASS
    assert run.moved == ["set-up"]
    (told,) = read_result(run.directory).preconditions
    assert told.met is True
    assert found in told.found
    page = write_report(run.directory).read_text(encoding="utf-8")
    assert f"<td>{condition.text}</td><td>met: " in page


@pytest.mark.parametrize(
    ("condition", "why"),
    [
        (pre.supply(9 * bar), "open the supply until it has 9 bar"),
        (pre.gas(278.15, 283.15), "wait until the hall has 5 to 10 °C"),
        (
            pre.gas(303.15, 308.15),
            "needs some 5 min to warm up: wait, and start again; the hall must have 30 to 35 °C",
        ),
        (pre.load_cases("AW0", "AW2"), "AW2 would be needed"),
        (
            pre.confirmed("the specimen has no cracks"),
            "the specimen has no cracks (the operator did not answer)",
        ),
        (pre.calibrated("supply.pressure"), "supply.pressure has no instrument in ours.toml"),
    ],
)
def test_a_plan_whose_precondition_is_not_met_is_blocked_before_anything_moves(ran, condition, why):
    run = ran(requires=[condition], instruments=Instruments("ours.toml", "", {"left.height": PIECE}))
    assert run.result.verdict is Outcome.BLOCKED
    assert run.moved == []
    assert run.result.reason.startswith("not ready: ")
    assert why in run.result.reason
    assert [one.met for one in run.result.preconditions] == [False]


def test_a_bench_that_could_not_be_armed_to_look_is_brought_to_rest(ran, monkeypatch):
    arm, states = Bench.arm, []

    def half(bench, within):
        arm(bench, within)
        raise RigFault("the second pump does not start")

    monkeypatch.setattr(Bench, "arm", half)
    monkeypatch.setattr("test_plans.execution.incident_since", lambda bench, _: states.append(bench.state))
    run = ran(requires=[pre.supply(6 * bar)])
    assert run.result.reason == "the rig: the second pump does not start"
    assert (states, run.moved) == (["DISABLED"], [])


def test_what_is_confirmed_by_the_operator_is_met(ran):
    condition = pre.confirmed("the specimen has no cracks")
    assert ran(requires=[condition], operator=Script({"is this so: *": "yes"})).result.verdict is Outcome.PASS
    said_no = ran(requires=[condition], operator=Script({"is this so: *": "no"}), instruments=UNKNOWN)
    assert "the operator answered no" in said_no.result.reason


def test_missing_information_of_the_rig_is_reported_and_blocks_in_strict_mode(ran):
    def blind(bench):
        bench.wiring.absent = {"supply.pressure": "no transducer in the supply"}

    run = ran(requires=[pre.supply(6 * bar)], prepare=blind)
    assert run.result.verdict is Outcome.PASS
    assert run.result.preconditions[0].met is None


def test_a_specimen_that_has_just_been_moved_has_not_rested(ran):
    def moved_now(bench):
        bench.last_run = bench.clock.now()

    run = ran(requires=[pre.rested(10 * minutes)], prepare=moved_now)
    assert "specimen at rest for 600 s (0 s; wait 600 s more)" in run.result.reason


def test_an_expired_calibration_is_reported_for_each_use():
    ours = Instruments("ours.toml", "", {"left.height": PIECE})
    assert ours.troubles(date(2026, 3, 1)) == []
    assert ours.troubles(None) == []  # virtual time has no day
    (told,) = ours.troubles(date(2026, 3, 2))
    assert told == "left.height (triangulation laser, no. L-7): calibration C1 was due on 2026-03-01"


def test_a_piece_without_a_certificate_is_a_warning_in_result_and_report(ran):
    bare = Piece("left.height", Instrument("laser", "laser"), "L-8")
    run = ran(instruments=Instruments("ours.toml", "", {"left.height": bare}))
    assert run.result.verdict is Outcome.PASS
    assert run.result.warnings == ["left.height (laser, no. L-8) has no certificate of calibration"]
    assert run.result.warnings[0] in write_report(run.directory).read_text(encoding="utf-8")


# -- holding ----------------------------------------------------------------------------------------------------------


def resume_when_held(suspension):
    """Continue a run from another thread as soon as it is held; return the thread and the place."""
    places, clock = [], RealClock()

    def watch():
        while not suspension.held_at:
            clock.sleep_until(clock.now() + 1_000_000)
        places.append(suspension.held_at)
        suspension.resume()

    thread = threading.Thread(target=watch, daemon=True)
    thread.start()
    return thread, places


def test_a_run_is_held_at_the_next_place_with_shut_valves_and_goes_on_with_what_they_were(ran):
    suspension, modes = Suspension(), []

    def main(run):
        bench = run.bench
        bench.air.level()
        suspension.request("the panel")
        with run.phase("a measurement"):
            pass
        run.hold_point("between two loads")
        modes.append((bench.air.left_mode, bench.air.right_mode))
        run.hold_point("where nobody asks any more")

    thread, places = resume_when_held(suspension)
    run = ran(main, suspension=suspension)
    thread.join(10)
    assert places == ["between two loads"]
    assert modes == [("level", "level")]
    assert run.result.verdict is Outcome.PASS
    assert "held between two loads" in [phase.name for phase in run.result.phases]
    events = read(run.directory).events
    said = [event.text for event in events if event.kind == "note"]
    assert said[0] == "the panel requests a hold: the plan continues to its next hold point"
    assert len(said) == 3
    assert said[1].startswith("held between two loads, on request of the panel")
    settings = [event.data for event in events if event.kind == "setting" and "air.left_mode" in event.data]
    assert [one["air.left_mode"] for one in settings][-3:] == ["level", "hold", "level"]


def test_what_was_measured_across_a_suspension_is_not_available(ran):
    suspension = Suspension()

    def main(run):
        since = run.now
        run.check("before", 1.0, "1", low=0.0, since=since)
        suspension.request("the panel")
        run.hold_point("in between")
        run.check("across", 1.0, "1", low=0.0, since=since)
        run.check("afterwards", 1.0, "1", low=0.0, since=run.now + 1)

    thread, _ = resume_when_held(suspension)
    result = ran(main, suspension=suspension).result
    thread.join(10)
    assert [one.verdict.value for one in result.checks] == ["pass", "not available", "pass", "pass"]
    assert result.checks[1].note == "the run was held while it was measured"
    assert result.checks[1].verdict is CheckVerdict.NOT_AVAILABLE


def test_a_run_without_a_permit_is_given_up(ran, monkeypatch):
    monkeypatch.setattr("test_plans.run.HOLD_WITHIN", 0.05)
    suspension = Suspension()
    suspension.toggle("Ctrl-Z")
    result = ran(lambda run: run.hold_point("here"), suspension=suspension).result
    assert result.verdict is Outcome.BLOCKED
    assert "stopped by the operator: held here for 0.05 s, and the run was not resumed" in result.reason
    assert suspension.wanted_by == ""


@pytest.mark.slow
def test_held_springs_are_level_again_before_the_next_sine(bench_composed, tmp_path):
    suspension = Suspension()
    suspension.request("the panel")
    thread, places = resume_when_held(suspension)
    with bench_composed(1) as made:
        result = execute(plans()["axial_stiffness"], made.bench, tmp_path, suspension=suspension)
    thread.join(10)
    names = [phase.name for phase in result.phases]
    assert places == ["before the volumes are shut off"]
    after = names[names.index("held before the volumes are shut off") :]
    assert after[1:4] == ["stand again", "level to the preload", "settle"]
    assert "vertical triangle" in after
    assert result.verdict is Outcome.PASS, result.reason


def test_every_plan_that_judges_says_what_it_requires():
    assert {name for name, one in plans().items() if one.judges and not one.requires} == set()


def test_the_required_supply_depends_on_the_chosen_load(bench_composed, tmp_path):
    for load, verdict in (("AW0", Outcome.PASS), ("AW3", Outcome.BLOCKED)):
        one = plan(requires=[pre.supply_for("load")], setup=empty_plan, teardown=empty_plan)(carrying)
        with bench_composed(supply_pressure=5 * bar) as made:
            result = execute(one.given({"load": load}), made.bench, tmp_path / load)
        assert result.verdict is verdict, result.reason
    assert "open the supply until it has 6.5" in result.reason


def carrying(run, *, load: Literal["AW0", "AW3"] = "AW0"):
    """Carry a load."""
    run.check("something", 1.0, "1", low=0.0)


def test_an_overdue_instrument_blocks_but_not_one_without_a_date(ran, monkeypatch):
    day = date(2026, 6, 1)
    monkeypatch.setattr(pre, "today", lambda run: day)
    over = ran(requires=[pre.not_overdue()], instruments=Instruments("ours.toml", "", {"left.height": PIECE}))
    assert over.result.verdict is Outcome.BLOCKED
    assert "was due on 2026-03-01; calibrate again" in over.result.reason
    monkeypatch.setattr(pre, "today", lambda run: None)
    undated = ran(
        requires=[pre.not_overdue()], instruments=Instruments("ours.toml", "", {"left.height": PIECE})
    )
    assert [one.met for one in undated.result.preconditions] == [None]


def test_a_calibration_without_a_due_date_holds_a_year_and_one_without_any_date_is_doubted():
    laser = Instrument("laser", "laser")
    dated = Piece("left.height", laser, "L-7", "C1", calibrated=date(2025, 3, 1))
    assert dated.trouble(date(2026, 3, 1)) == ""
    assert "C1 is of 2025-03-01, 365 days are assumed" in dated.trouble(date(2026, 3, 2))
    assert "says neither when it was nor when it is due" in Piece("left.height", laser, "L-7", "C1").trouble(
        None
    )


def held_within(run):
    run.hold_point("within")


class Steps:
    def held(self, run):
        held_within(run)

    def look(self, run, left):
        with run.phase("look"):
            left.append(run.suspension.left)

    def look_and_hold(self, run, left):
        self.look(run, left)
        self.held(run)


def holding(part):
    """A plan that does nothing but ``part``."""

    def main(run):
        """Do something."""
        part(run)

    return plan(main)


@pytest.mark.parametrize(
    ("part", "can"),
    [
        (lambda run: run.hold_point("here"), True),
        (held_within, True),
        (lambda run: [held_within(run) for _ in "two"], True),
        (partial(lambda part, run: part(run), held_within), True),
        (lambda run: Steps().held(run), True),
        (empty_plan, False),
        (lambda run: run.say("hold_point"), False),
    ],
)
def test_where_a_plan_can_be_held_is_read_from_its_code(part, can):
    assert can_be_held(holding(part)) is can


def test_no_library_is_asked_whether_a_plan_can_be_held():
    """numpy warns about a call of `str`, which this plan names for itself."""

    def computes(run):
        """Compute."""
        return str(np.zeros(1))

    assert not can_be_held(plan(computes))


def test_plans_with_hold_points_are_detected():
    can = {name for name, one in plans().items() if can_be_held(one)}
    assert {"tightness", "axial_stiffness", "endurance", "leveling"} <= can
    assert not can & {"safety", "bump_stop", "lateral_stiffness", "screening"}


def looks_twice(run, left):
    """Be measured, held, and measured again."""
    for _ in range(2):
        left.append(run.suspension.left)
        with suppress(ValueError), run.phase("look"):
            left.append(run.suspension.left)
            held_within(run)
    with run.phase("afterwards"):
        left.append(run.suspension.left)


@pytest.mark.parametrize(
    ("main", "expected"),
    [
        (looks_twice, [True, True, True, True, False]),
        (lambda run, left: Steps().held(run) or Steps().look(run, left), [False]),
        (lambda run, left: (Steps().look(run, left), run.hold_point("after a look")), [True]),
        (lambda run, left: [Steps().look(run, left), *map(held_within, [run])], [True]),
        (lambda run, left: Steps().look_and_hold(run, left), [True]),
    ],
)
def test_whether_a_place_is_left_follows_from_the_code_that_is_still_to_come(ran, main, expected):
    left, suspension = [], Suspension()
    ran(lambda run: main(run, left), suspension=suspension)
    assert left == expected
    assert not suspension.left, "no part of the plan is left"


def test_a_request_after_the_last_place_is_dropped_and_the_run_says_so(ran):
    """It waited for a place that did not come, until the end of the run."""
    suspension, wanted = Suspension(), []

    def main(run):
        run.hold_point("once")
        suspension.request("the panel")
        with run.phase("a measurement"):
            wanted.append(suspension.wanted_by)

    run = ran(main, suspension=suspension)
    assert wanted == [""]
    assert run.result.verdict is Outcome.PASS
    said = [event.text for event in read(run.directory).events if event.kind == "note"]
    assert len(said) == 1
    assert "the panel" in said[0]
