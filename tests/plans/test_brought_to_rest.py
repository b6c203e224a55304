"""Whatever breaks while the springs are full: they are let down, or somebody is told that they were not."""

import math
from contextlib import nullcontext
from types import SimpleNamespace

import pytest

from astb.run import left_in_trouble
from bench_protocol.units import bar, mm
from bench_records.layout import RecordError
from bench_records.recorder import Recorder
from bench_records.result import Outcome, check, conclude
from drivers.errors import RigFault
from test_plans import steps
from test_plans.execution import execute
from test_plans.loads import AW0
from test_plans.plan import plan
from test_plans.steps.carrying import depressurise


@pytest.fixture
def filled(bench_composed, tmp_path):
    """Fill the springs, do something, and return the result and what the springs hold at the end (Pa)."""

    def run(main):
        @plan
        def fills(run):
            """Fill the springs."""
            steps.raise_the_air(run, run.specimen.load(AW0))
            main(run)
            run.bench.wait(2.0)
            run.check("height", run.bench.left.height, "mm", low=-5 * mm, high=5 * mm)

        with bench_composed() as made:
            result = execute(fills, made.bench, tmp_path / "out")
            with made.bench.despite_faults():
                return result, max(made.bench.left.bellows_pressure, made.bench.right.bellows_pressure)

    return run


def test_a_disk_that_is_full_leaves_no_air_in_the_springs(filled, monkeypatch):
    def full(*_, **__):
        raise RecordError("no space left")

    result, pressure = filled(lambda run: monkeypatch.setattr(Recorder, "append", full))
    assert result.verdict is Outcome.BLOCKED
    assert result.reason == "the plan: what takes the samples failed: no space left"
    assert pressure < 0.2 * bar


@pytest.mark.parametrize("silent", ["left", "right"])
def test_springs_of_which_one_transducer_is_silent_do_not_count_as_empty(silent):
    sides = {
        side: SimpleNamespace(bellows_pressure=math.nan if side == silent else 0.0)
        for side in ("left", "right")
    }
    rig = SimpleNamespace(state="FAULT_HOLD")
    bench = SimpleNamespace(rig=rig, describe=lambda: "state FAULT_HOLD", **sides)
    with pytest.raises(RigFault, match="the springs keep their air"):
        depressurise(SimpleNamespace(bench=bench, phase=nullcontext))


def test_a_tear_down_that_failed_ends_a_series_though_the_product_failed_first():
    failed = check("pressure", 2.0, high=1.0)
    for warnings, troubled in (
        (["the laser has no certificate"], False),
        (["in tear-down: the rig: gone"], True),
    ):
        result = conclude("p", "P.", "P.", [failed], warnings=warnings)
        assert (result.verdict, left_in_trouble(result)) == (Outcome.FAIL, troubled)
    assert left_in_trouble(conclude("p", "P.", "P.", [], reason="the rig: gone"))
