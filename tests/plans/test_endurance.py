"""Endurance: a sound spring does not change, a check detects each change, a stopped run keeps its looks."""

from types import SimpleNamespace

import pytest

from bench_protocol.units import mm
from bench_records.result import Outcome, read_result
from drivers.errors import Refused
from test_plans.discovery import plans
from test_plans.execution import execute
from test_plans.instruments import ordinary
from test_plans.plans.endurance import Looks, _cycle

slow = pytest.mark.slow
SIDES = ("left", "right")
SHORT = {"cycles": "200", "intervals": "1"}
#: Amid the second of four intervals of a hundred fast cycles (s).
STOPPED = 298.0


def changes(*names):
    return {f"{name}, change in 1000 cycles" for name in names}


def numbers(result):
    return {one.name: one.number for one in result.checks}


@slow
@pytest.mark.parametrize("given", [{}, {"axis": "lateral"}])
def test_a_sound_spring_does_not_change(judged, given):
    result, failed = judged("endurance", given=given, instruments=ordinary())
    assert result.verdict is Outcome.PASS, result.reason or failed
    assert result.duration == pytest.approx(plans()["endurance"].lasts, rel=0.1)
    assert numbers(result)["cycles"] == 300
    assert all(len(curve.xs) == 4 and curve.xs[-1] == 300 for curve in result.curves)
    for curve in result.curves:  # what does not change stays within its error bars
        assert max(curve.ys) - min(curve.ys) < 2 * min(curve.expanded), curve


@slow
def test_intervals_that_are_too_short_to_warm_the_gas_find_it_as_warm_in_every_look(judged):
    """After a minute of these cycles it would carry the load 0.2 mm higher than after half a minute."""
    given = {"load": "AW3", "amplitude": "15 mm", "frequency": "3 Hz", "cycles": "200", "intervals": "2"}
    result, failed = judged("endurance", given=given)
    assert result.verdict is Outcome.PASS, result.reason or failed
    for curve in result.curves:
        if curve.y.label == "height":
            assert max(curve.ys) - min(curve.ys) < 0.02 * mm


@slow
def test_an_orifice_that_clogs_in_the_middle_is_stiffer_and_damps_more_on_its_side(judged):
    """Half way between the second and the third of three looks; the right spring, on the same beam, stays as it was."""
    clogged = ("blocked_orifice", {"side": "left", "share": "30 %"}, 250.0)
    result, failed = judged("endurance", given={"cycles": "200", "intervals": "2"}, faults=[clogged])
    assert result.verdict is Outcome.FAIL
    assert failed >= changes("left stiffness K'", "left damping c")
    assert not failed & changes("right stiffness K'", "right damping c")


@slow
def test_a_spring_that_leaks_sinks_and_loses_air_on_its_side(judged):
    result, failed = judged("endurance", given=SHORT, leak_conductance=[5e-11, 0.0])
    assert result.verdict is Outcome.FAIL
    assert failed >= changes("left stiffness K'", "left height") | {"air lost per minute, left spring"}
    assert "air lost per minute, right spring" not in failed


@slow
def test_a_rubber_that_creeps_sinks_and_keeps_its_air(judged):
    result, failed = judged("endurance", given=SHORT, effects=[("creep", "10 %, time=1000 s")])
    assert result.verdict is Outcome.FAIL
    assert failed >= changes("left height", "right height")
    assert not failed & {f"air lost per minute, {side} spring" for side in SIDES}


@pytest.mark.slow
def test_a_run_that_is_stopped_keeps_what_it_has_seen_and_how_many_cycles_it_made(
    bench_composed, after, tmp_path
):
    def stop():
        raise KeyboardInterrupt

    with bench_composed(1) as made:
        given = plans()["endurance"].given(
            {"cycles": "400", "intervals": "4", "frequency": "3 Hz", "amplitude": "2 mm"}
        )
        after(made.clock, STOPPED, stop)
        with pytest.raises(KeyboardInterrupt):
            execute(given, made.bench, tmp_path / "out", rig="virtual", seed=1)
        assert made.rig.state.name in {"DISABLED", "INIT"}
    result = read_result(tmp_path / "out")
    assert result.verdict is Outcome.BLOCKED
    assert result.reason.startswith("stopped by the operator")
    done = numbers(result)["cycles"]
    looks = max(curve.xs[-1] for curve in result.curves)
    assert 100 <= looks < done < 400  # stopped amid some more
    assert changes("left stiffness K'", "right height") <= set(numbers(result))


def test_a_program_that_is_refused_adds_no_cycles_of_the_one_before():
    def refuse(*_, **__):
        raise Refused("action.program_run was refused", 4)

    bench = SimpleNamespace(
        generator=SimpleNamespace(start=refuse, run=refuse),
        readings=SimpleNamespace(value=lambda name: 1000.0),
    )
    looks = Looks()
    with pytest.raises(Refused):
        _cycle(SimpleNamespace(bench=bench), "vertical", 10e-3, 1.0, 500, looks)
    assert looks.made == 0
