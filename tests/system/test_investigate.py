"""The closed loop: the choice of the next run, on the virtual rig, with prescribed diagnoses."""

import json
import math
from contextlib import contextmanager

import numpy as np
import pytest
from rich.console import Console

import astb.run
from astb.diagnose import read_data
from astb.display import ProgressDisplay
from astb.investigate import LEAST_GAP, LOG, choose, history, investigate
from astb.menu import experiments, offers
from astb.rig_file import RigFile, Simulation
from astb.session import build_rig, virtual_session
from bench_protocol.units import NS, bar, minutes, mm, ms, s
from bench_protocol.words import SIDES
from bench_records.layout import RecordError
from bench_records.record import read
from bench_sim.parameters import load
from diagnosis.contracts import DiagnosisError
from diagnosis.engine.config import Config
from diagnosis.engine.diagnose import diagnose
from diagnosis.finding import Cause, Finding, Models, NextRun, Provenance, Rival, Verdict
from diagnosis.report.page import write_report
from test_plans.loads import AW0
from test_plans.plans.screening import SCREENING
from test_plans.plans.separating import MENU
from test_plans.programmes.motions import Part, Programme, RestPose, Stretch, Wave
from test_plans.programmes.perform import lasts


def programme(name, *stretches):
    return Programme(name, f"{name}.", (Part(AW0, stretches),), "For this test.")


LOOK = programme("look", Stretch((Wave("vertical", 4 * mm, 1.0, 3),)))
QUICK = programme("quick", Stretch((Wave("vertical", 2 * mm, 5.0, 10),)))
TWICE = programme("twice", *(Stretch((RestPose(h * mm, rest=2 * s),)) for h in (3, -3)))
SMALL_MENU = {one.name: one for one in (QUICK, TWICE)}


def cause(name):
    return Cause(
        effect=name,
        title=name,
        family="gas",
        parameters=[],
        strength=9.0,
        score=9.0,
        bic_gain=70.0,
        lpd_gain=30.0,
    )


def finding(verdict, causes=(), rivals=(), runs=()):
    return Finding(
        verdict=verdict,
        sentence=f"the finding is {verdict}",
        causes=[cause(name) for name in causes],
        threshold=4.0,
        alpha=0.01,
        provenance=Provenance(simulator="", seed=1, fit=[], select=[], report=[]),
        models=Models(before={}, after={}),
        ambiguous_with=[
            Rival(
                effect=name,
                title=name,
                family="gas",
                instead_of=causes[0],
                parameters=[],
                bic_gap=3.0,
                cosine=0.99,
            )
            for name in rivals
        ],
        next_runs=[NextRun(experiment=name, minutes=1.0, bic_gap=gap, per_minute=gap) for name, gap in runs],
    )


def ambiguous(*runs):
    return finding(Verdict.AMBIGUOUS, ["leak.left"], ["heat.left"], runs)


NAMED = finding(Verdict.NAMED, ["leak.left"])


def test_gaps_of_a_plans_runs_add_up_and_the_most_per_minute_comes_first():
    told = ambiguous(
        ("twice 1 AW0", 30.0), ("twice 2 AW0", 40.0), ("quick 1 AW0", 65.0), ("elsewhere 1", 1e6)
    )
    ranked = offers(told, SMALL_MENU)
    assert [one.plan for one in ranked] == ["quick", "twice"]
    assert [one.bic_gap for one in ranked] == [65.0, 70.0]
    assert ranked[1].minutes == pytest.approx(lasts(TWICE) / minutes)


def test_what_decides_most_per_minute_is_run_unless_it_was_or_costs_too_much():
    told = ambiguous(("quick 1 AW0", 65.0), ("twice 1 AW0", 70.0))
    assert choose(told, SMALL_MENU, 20.0, set())[0].plan == "quick"
    assert choose(told, SMALL_MENU, 20.0, {"quick"})[0].plan == "twice"
    short = (lasts(QUICK) + lasts(TWICE)) / 2 / minutes
    assert lasts(QUICK) < lasts(TWICE)
    offer, why = choose(told, SMALL_MENU, short, {"quick"})
    assert offer is None
    assert "budget is spent" in why
    assert "leak.left and heat.left" in why
    # What decides more per minute but does not fit leaves room for what does.
    told = ambiguous(("twice 1 AW0", 700.0), ("quick 1 AW0", 65.0))
    assert choose(told, SMALL_MENU, short, set())[0].plan == "quick"


def test_a_run_that_would_not_decide_is_not_run():
    once = 1.5 * lasts(QUICK) / minutes
    offer, why = choose(ambiguous(("quick 1 AW0", LEAST_GAP - 0.1)), SMALL_MENU, once, set())
    assert offer is None
    assert "no further run on the menu would decide between leak.left and heat.left" in why
    assert "a BIC gap of 9.9" in why
    assert choose(ambiguous(("quick 1 AW0", LEAST_GAP)), SMALL_MENU, once, set())[0].plan == "quick"


def test_a_run_that_decides_with_others_like_it_is_made_as_often_as_it_takes():
    told, each = ambiguous(("quick 1 AW0", 0.4 * LEAST_GAP)), lasts(QUICK) / minutes
    offer, why = choose(told, SMALL_MENU, 3.01 * each, ["look"])
    assert offer.plan == "quick"
    assert "a BIC gap of 4.0 is expected" in why and "10 after 3 such runs" in why
    assert choose(told, SMALL_MENU, 2.99 * each, set())[0] is None
    rare = ambiguous(("quick 1 AW0", 0.18 * LEAST_GAP))
    assert choose(rare, SMALL_MENU, 1e3, set())[0] is None  # takes six
    assert choose(told, SMALL_MENU, 1e3, ["quick"] * 2)[0].plan == "quick"
    assert choose(told, SMALL_MENU, 1e3, ["quick"] * 3)[0] is None  # and so does this
    # What decides alone comes first, however much longer it takes; but only once.
    both = ambiguous(("quick 1 AW0", 0.9 * LEAST_GAP), ("twice 1 AW0", LEAST_GAP))
    assert choose(both, SMALL_MENU, 20.0, set())[0].plan == "twice"
    assert choose(both, SMALL_MENU, 20.0, {"twice"})[0].plan == "quick"
    assert choose(ambiguous(("quick 1 AW0", LEAST_GAP)), SMALL_MENU, 20.0, {"quick"})[0] is None


@pytest.mark.parametrize("verdict", [Verdict.NO_EFFECT, Verdict.NAMED, Verdict.REMAINDER, Verdict.UNKNOWN])
def test_a_verdict_ends_the_investigation(verdict):
    causes = ["leak.left"] if verdict in {Verdict.NAMED, Verdict.REMAINDER} else []
    told = finding(verdict, causes, runs=[("quick 1 AW0", 1e3)])
    assert choose(told, SMALL_MENU, 1e3, set()) == (None, f"a verdict was reached: {verdict}")


@contextmanager
def virtual(seed=3, **change):
    simulation = Simulation(seed=seed, change=change)
    with virtual_session(build_rig(simulation), simulation) as session:
        yield session, RigFile(name="virtual", simulation=simulation)


def loop(out, told, budget=20.0, seed=3, **change):
    """Investigate on a virtual rig; the k-th diagnosis returns ``told[k]``. Returns the log and the inputs of each."""
    seen = []

    def diagnose(records):
        seen.append([record.name for record in records])
        return told[len(seen) - 1]

    with virtual(seed, **change) as (session, rig), ProgressDisplay(Console(quiet=True)) as display:
        log = investigate(
            session, rig, out, first=LOOK, menu=SMALL_MENU, budget=budget, diagnose=diagnose, display=display
        )
        pressure = max(session.bench.left.bellows_pressure, session.bench.right.bellows_pressure)
    return log, seen, pressure


@pytest.mark.slow
def test_the_loop_runs_what_decides_and_diagnoses_all_data_again(tmp_path):
    log, seen, _ = loop(tmp_path, [ambiguous(("quick 1 AW0", 50.0)), NAMED])
    assert seen == [["01-look"], ["01-look", "02-quick"]]
    assert [step.plan for step in log.steps] == ["look", "quick"]
    assert log.steps[0].rivals == ["heat.left"]
    assert "to decide between leak.left and heat.left" in log.steps[1].why
    assert log.ended == "a verdict was reached: named"
    assert log.spent == pytest.approx((lasts(LOOK) + lasts(QUICK)) / minutes, rel=0.1)
    told = json.loads((tmp_path / LOG).read_text())
    assert [step["verdict"] for step in told["steps"]] == ["ambiguous", "named"]
    assert told["ended"] == log.ended
    assert (tmp_path / "02-quick" / "report.html").exists()
    # One rig all along: its noise goes on, where a second rig of the same seed would repeat it.
    first, second = (read(tmp_path / name).series("left.height")[1][:200] for name in ("01-look", "02-quick"))
    assert not np.allclose(first - first.mean(), second - second.mean(), atol=0.5e-5)


@pytest.mark.slow
def test_the_budget_is_the_benchs_time(tmp_path):
    budget = (lasts(LOOK) + 0.9 * lasts(QUICK)) / minutes
    log, seen, _ = loop(tmp_path, [ambiguous(("quick 1 AW0", 50.0))], budget)
    assert len(seen) == 1
    assert log.spent < budget
    assert "the budget is spent" in log.ended


def test_a_budget_below_the_first_run_is_refused_before_anything_moves(tmp_path):
    with pytest.raises(RecordError, match=r"budget = 0.5 min, but look alone takes 1.\d min of the bench"):
        loop(tmp_path, [], budget=0.5)
    assert not list(tmp_path.iterdir())


@pytest.mark.slow
def test_a_rig_that_breaks_ends_the_investigation_with_its_reason(tmp_path):
    log, seen, pressure = loop(tmp_path, [NAMED], supply_pressure="1.5 bar")
    assert seen == []
    assert log.ended.startswith("look blocked: the rig: ")
    assert [step.outcome for step in log.steps] == ["blocked"]
    assert json.loads((tmp_path / LOG).read_text())["ended"] == log.ended
    assert pressure < 0.5 * bar


def silenced(monkeypatch, *runs):
    """Stop the commander for 150 ms in these runs, as on a busy machine."""
    import astb.investigate as module

    count = iter(range(1, 100))

    def run_plan(plan, session, *rest):
        if next(count) in runs:
            commander, clock = session.bench.commander, session.clock
            falls = [clock.now() + round(25 * s * NS)]

            def fall_silent():
                if clock.now() >= falls[0] and session.bench.state == "ACTIVE":
                    falls[0] = math.inf
                    commander.stop()
                    back.append(clock.every(round(150 * ms * NS), come_back))

            def come_back():
                back.pop().cancel()
                commander.start()

            back = []
            watching = clock.every(round(10 * ms * NS), fall_silent)
            try:
                return astb.run.run_plan(plan, session, *rest)
            finally:
                watching.cancel()
        return astb.run.run_plan(plan, session, *rest)

    monkeypatch.setattr(module, "run_plan", run_plan)


@pytest.mark.slow
def test_a_run_that_the_link_blocked_is_done_again(tmp_path, monkeypatch):
    silenced(monkeypatch, 1)
    log, seen, _ = loop(tmp_path, [NAMED])
    assert [step.outcome for step in log.steps] == ["blocked", "pass"]
    assert "repeated" in log.steps[1].why
    assert seen == [["02-look"]], "only the whole run is diagnosed"
    assert log.ended == "a verdict was reached: named"


@pytest.mark.slow
def test_a_link_that_blocks_again_and_again_ends_the_investigation(tmp_path, monkeypatch):
    silenced(monkeypatch, 1, 2, 3, 4)
    log, seen, _ = loop(tmp_path, [NAMED])
    assert seen == []
    assert [step.outcome for step in log.steps] == ["blocked"] * 3
    assert "look blocked: the link to the rig: the rig left ACTIVE" in log.ended
    assert "command late" in log.ended
    assert "3 times in a row" in log.ended


def test_no_run_is_repeated_beyond_the_budget(tmp_path, monkeypatch):
    silenced(monkeypatch, 1)
    log, seen, _ = loop(tmp_path, [NAMED], budget=1.01 * lasts(LOOK) / minutes)
    assert len(log.steps) == 1
    assert seen == []
    assert "the budget is spent" in log.ended


@pytest.mark.slow
def test_a_check_that_failed_is_no_reason_not_to_diagnose(tmp_path):
    """A compliant actuator moves the springs less than commanded: that may be the hidden cause."""
    log, seen, _ = loop(tmp_path, [NAMED], frame_stiffness="1 MN/m")
    assert [step.outcome for step in log.steps] == ["fail"]
    assert seen == [["01-look"]]
    assert log.ended == "a verdict was reached: named"


@pytest.mark.slow
def test_whatever_ends_it_the_log_says_what(tmp_path):
    def diagnose(records):
        raise DiagnosisError("no such channel")

    with (
        virtual() as (session, rig),
        ProgressDisplay(Console(quiet=True)) as display,
        pytest.raises(DiagnosisError),
    ):
        investigate(
            session,
            rig,
            tmp_path,
            first=LOOK,
            menu=SMALL_MENU,
            budget=20.0,
            diagnose=diagnose,
            display=display,
        )
    told = json.loads((tmp_path / LOG).read_text())
    assert told["ended"] == "DiagnosisError no such channel"
    assert [(step["plan"], step["outcome"], step["verdict"]) for step in told["steps"]] == [
        ("look", "pass", "")
    ]


@pytest.mark.slow
def test_the_report_tells_how_it_was_found_out(tmp_path):
    log, _, _ = loop(tmp_path, [ambiguous(("quick 1 AW0", 50.0)), NAMED])
    page = write_report(NAMED, tmp_path / "report.html", history(log)).read_text()
    for words in (
        "How this was found",
        "To see where the model is wrong",
        "To decide between leak.left and heat.left: a BIC gap of 50 is expected",
        "The finding is ambiguous",
        "20.0 minutes",
        "a verdict was reached: named",
    ):
        assert words in page, words
    assert "How this was found" not in write_report(NAMED, tmp_path / "alone.html").read_text()


@pytest.mark.slow
def test_a_sealed_delay_is_ambiguous_until_the_run_that_decides(tmp_path):
    """The whole loop: at 1 Hz a lag of 3 ms equals a delay; small fast sines separate them."""
    sealed = tmp_path / "sealed.toml"
    sealed.write_text('[effect.force_lag]\nlag = "3 ms"\n')
    first = programme(
        SCREENING.name,
        Stretch((Wave("vertical", 4 * mm, 1.0, 3), Wave("lateral", 6 * mm, 1.0, 3))),
        Stretch((Wave("vertical", 3 * mm, 1.5, 4),)),
        Stretch((Wave("vertical", 4 * mm, 0.7, 2),)),
    )
    fast = programme(
        "fast", Stretch((Wave("vertical", 0.5 * mm, 12.5, 50), Wave("lateral", 0.5 * mm, 10.0, 40)))
    )
    hold = programme("hold", Stretch((RestPose(5 * mm, rest=4 * s),)))
    menu = {one.name: one for one in (hold, fast)}
    said = []

    def look(records):
        simulator, dataset = read_data(records, None, load("astb"))
        config = Config(seed=3, effects=("force_lag", "force_latency", "heat"))
        said.append(diagnose(dataset, simulator, config, menu=experiments(menu)))
        return said[-1]

    simulation = Simulation(seed=3, sealed=str(sealed))
    out = tmp_path / "out"
    out.mkdir()
    with (
        virtual_session(build_rig(simulation), simulation) as session,
        ProgressDisplay(Console(quiet=True)) as display,
    ):
        rig = RigFile(name="virtual", simulation=simulation)
        log = investigate(
            session, rig, out, first=first, menu=menu, budget=20.0, diagnose=look, display=display
        )

    assert [step.plan for step in log.steps] == [SCREENING.name, "fast"]
    before, after = said
    assert before.verdict is Verdict.AMBIGUOUS
    assert {*before.names, *(rival.effect for rival in before.ambiguous_with)} == {
        "force_lag",
        "force_latency",
    }
    assert after.verdict is Verdict.NAMED
    assert after.names == ("force_lag",)
    (lag,) = after.causes[0].parameters
    assert lag.low < 3.0 < lag.high
    assert log.ended == "a verdict was reached: named"


def test_corners_of_set_points_have_no_guarantee():
    """Unobservable values are left out: the acceleration in the corners of a triangle, which no actuator has.

    A plan has no more of it than its sines, or 3 m/s² where they are slow.
    """
    sines: dict[str, float] = {}
    for name, programme in MENU.items():
        segments = [seg for part in programme.parts for stretch in part.stretches for seg in stretch.segments]
        waves = [
            one for one in segments if isinstance(one, Wave) and one.form == "sine" and one.axis == "vertical"
        ]
        sines[name] = max((one.amplitude * (2.0 * np.pi * one.frequency) ** 2 for one in waves), default=0.0)
    for one in experiments(MENU):
        limit = max(3.0, sines[one.name.partition(" ")[0]])
        for side in SIDES:
            acceleration = np.diff(one.inputs[f"{side}.height"], 2) / (one.time[1] - one.time[0]) ** 2
            assert np.abs(acceleration).max() < limit, one.name


def test_the_menu_lists_each_run_with_its_cost():
    told = experiments(MENU)
    assert len({one.name for one in told}) == len(told)
    for name, programme in MENU.items():
        runs = [one for one in told if one.name.partition(" ")[0] == name]
        assert len(runs) == sum(len(part.stretches) for part in programme.parts)
        assert sum(one.minutes for one in runs) == pytest.approx(lasts(programme) / minutes)
    for one in told:
        assert all(values.shape == one.time.shape for values in one.inputs.values())
        assert all(np.isfinite(values).all() for values in one.inputs.values())
    assert {one.name for one in told if one.inputs["left.leveling"].any()} == {"leveling_on 1 AW0"}
    assert {one.name for one in told if not one.inputs["left.reservoir"].all()} == {
        "isolated_reservoirs 1 AW0"
    }
