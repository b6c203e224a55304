"""Orifice plates that the operator changes by hand: the operator is asked, and missing plates are not judged."""

from types import SimpleNamespace

import pytest

from astb.rig_in_memory import RigInMemory
from bench_protocol.dimensions import ordinary
from bench_protocol.units import mm
from bench_records.record import read
from bench_records.result import CheckVerdict, Outcome
from bench_sim.parameters import load
from bench_sim.rig.rig import Rig
from drivers.errors import RigFault
from test_plans import steps
from test_plans.discovery import plans
from test_plans.execution import execute
from test_plans.operator import Script
from test_plans.plans.orifice_plates import leave_as_found
from tests.refusals import refuses

PLATES = (10, 13, 16, 18)


@pytest.fixture
def plates_by_hand(tmp_path):
    """Run the plan with an operator who has these plates, ``bored`` as they say; return the result, the record, and
    which plate he fitted at which pressure and in which state.
    """

    def run(*at_hand, bored=1.0):
        memory = RigInMemory(Rig(load("astb"), seed=1))
        fitted = []

        def fit(plate):
            def reply(_):
                pressure = max(bench.left.bellows_pressure, bench.right.bellows_pressure)
                fitted.append((plate, pressure, memory.rig.state.name))
                memory.rig.plant.parameters.orifice_diameter[:] = bored * plate * mm
                return "done"

            return reply

        replies = {f"*of {plate} mm*": fit(plate) if plate in at_hand else "not possible" for plate in PLATES}
        with memory.bench(absent={"rig.orifice_diameter": "its plates are bolted in"}) as bench:
            bench.dimensions = ordinary()
            one = plans()["orifice_plates"]
            result = execute(one, bench, tmp_path / "out", rig="short", operator=Script(replies, by="Ada"))
        return result, fitted, read(tmp_path / "out")

    return run


@pytest.mark.slow
def test_the_operator_fits_each_plate_on_springs_without_air_and_the_ordinary_one_at_the_end(plates_by_hand):
    result, fitted, _ = plates_by_hand(*PLATES)
    assert result.verdict is Outcome.PASS, result.reason
    assert [plate for plate, *_ in fitted] == [*PLATES, 13]
    assert all(pressure < 20_000 and state not in {"ACTIVE", "HOLD"} for _, pressure, state in fitted)


def test_a_missing_plate_is_not_judged(plates_by_hand):
    result, fitted, record = plates_by_hand(16)
    assert result.verdict is Outcome.INCOMPLETE
    assert [plate for plate, *_ in fitted] == [16]
    verdicts = {one.name: one.verdict for one in result.checks}
    assert {one for name, one in verdicts.items() if "16 mm" in name} <= {
        CheckVerdict.PASS,
        CheckVerdict.MARGINAL,
    }
    others = {name for name in verdicts if "16 mm" not in name}
    assert len(others) == 12
    assert {verdicts[name] for name in others} == {CheckVerdict.NOT_AVAILABLE}
    assert any("Ada" in str(event) for event in record.events)


def test_an_operator_who_says_done_and_fits_another_plate_is_found_out(plates_by_hand):
    result, *_ = plates_by_hand(10, bored=1.3)
    assert {one.name for one in result.checks if one.verdict is CheckVerdict.FAIL} >= {
        f"{side} K' with 10 mm" for side in ("left", "right")
    }


def test_opening_unvented_springs_is_not_requested(monkeypatch):
    def stuck(run):
        raise RigFault("the springs keep their air")

    asked = []
    bench = SimpleNamespace(has=lambda *names: False)
    monkeypatch.setattr(steps, "make_safe", stuck)
    with refuses(RigFault):
        leave_as_found(SimpleNamespace(bench=bench, confirm=lambda *what: asked.append(what)))
    assert not asked
