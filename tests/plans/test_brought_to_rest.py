"""After any failure with full springs: they are vented, or the operator is informed."""

import signal
import subprocess
import sys
from dataclasses import replace

import pytest

from astb.run import left_in_trouble
from bench_protocol.units import bar, kN, mm
from bench_records.layout import RecordError
from bench_records.recorder import Recorder
from bench_records.result import Outcome, check, conclude, read_result
from drivers.bench import Bench
from drivers.errors import BenchTimeout, RigFault
from test_plans import steps
from test_plans.execution import execute
from test_plans.loads import AW0, AW3
from test_plans.plan import plan
from test_plans.steps.fittings import fit_pipe, fit_plate


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


@pytest.mark.parametrize(
    ("name", "change", "value"),
    [
        ("rig.orifice_diameter", lambda run: fit_plate(run, 10 * mm), 10 * mm),
        ("rig.pipe", lambda run: fit_pipe(run, "on"), 1.0),
        ("rig.nominal_preload", lambda run: steps.shim(run, run.specimen.load(AW3)), 145 * kN),
    ],
)
def test_what_is_changed_by_hand_waits_for_the_air_that_a_bench_at_rest_lets_off(
    bench_composed, tmp_path, name, change, value
):
    found = {}

    @plan(setup=lambda run: None)
    def changes(run):
        """Change something as a plan does that comes at once after one that was interrupted."""
        steps.power_up(run)
        steps.raise_the_air(run, run.specimen.load(AW0))
        run.bench.disarm()
        found["pressure"] = run.bench.left.bellows_pressure
        change(run)
        found["value"] = run.bench.settings.in_force()[name]
        run.check("state", 1.0, "1", low=0.0)

    with bench_composed() as made:
        result = execute(changes, made.bench, tmp_path / "out")
    assert not result.reason
    assert found["pressure"] > 1 * bar, "it had nothing to wait for"
    assert found["value"] == pytest.approx(value)


@pytest.mark.parametrize("judges", [True, False])
def test_a_set_up_that_finds_no_air_names_the_supply(bench_composed, tmp_path, monkeypatch, judges):
    monkeypatch.setattr("test_plans.steps.carrying.FILL_WITHIN", 2.0)

    @plan(setup=steps.carry(AW0))
    def carries(run):
        """Carry the empty car."""

    with bench_composed() as made:
        made.rig.faults.on("supply_loss", {})
        result = execute(replace(carries, judges=judges), made.bench, tmp_path / "out")
    assert "the supply pressure is 0." in result.reason
    assert "open the supply until it has 3.058 bar" in result.reason


def test_a_disk_that_is_full_leaves_no_air_in_the_springs(filled, monkeypatch):
    def full(*_, **__):
        raise RecordError("no space left")

    result, pressure = filled(lambda run: monkeypatch.setattr(Recorder, "receive", full))
    assert result.verdict is Outcome.BLOCKED
    assert result.reason == "the record: no space left"
    assert pressure < 0.2 * bar


def test_a_tear_down_that_failed_ends_a_series_though_the_product_failed_first():
    failed = check("pressure", 2.0, high=1.0)
    for warnings, troubled in (
        (["the laser has no certificate"], False),
        (["in tear-down: the rig: gone"], True),
    ):
        result = conclude("p", "P.", "P.", [failed], warnings=warnings)
        assert (result.verdict, left_in_trouble(result)) == (Outcome.FAIL, troubled)
    assert left_in_trouble(conclude("p", "P.", "P.", [], reason="the rig: gone"))


def test_what_went_wrong_first_in_a_tear_down_is_not_hidden_by_what_came_after(
    bench_composed, tmp_path, monkeypatch
):
    def full(run):
        raise RigFault("the springs keep their air")

    def stuck(bench):
        raise BenchTimeout("the bench at rest: not reached within 10 s")

    monkeypatch.setattr("test_plans.steps.carrying.depressurise", full)

    @plan(setup=lambda run: None)
    def looks(run):
        """Look."""
        run.check("state", 1.0, "1", low=0.0)

    with bench_composed() as made, monkeypatch.context() as patched:
        patched.setattr(Bench, "disarm", stuck)
        result = execute(looks, made.bench, tmp_path / "out")
    assert result.reason == (
        "in tear-down: the rig: the springs keep their air; the rig: the bench at rest: not reached within 10 s"
    )


@pytest.mark.slow
@pytest.mark.timeout(
    300
)  # a run that heard nothing goes on for an hour of bench time, and then says so by its exit status
def test_a_terminal_that_is_closed_ends_the_run_in_order(tmp_path):
    """The kernel reports it, and then the shell: the second must not stop the tear-down."""
    command = [sys.executable, "-m", "astb", "run", "tightness", "--virtual", "--set", "hold=30 min"]
    before = signal.signal(
        signal.SIGHUP, signal.SIG_DFL
    )  # a suite under nohup would hand on that it is ignored
    process = subprocess.Popen([*command, "--out", str(tmp_path)], stdout=subprocess.PIPE, text=True)
    signal.signal(signal.SIGHUP, before)
    with process:
        for line in process.stdout:
            if "tear-down" in line or "cool" in line:
                process.send_signal(signal.SIGHUP)
        assert process.wait(60) == 3
    reason = read_result(tmp_path / "tightness").reason
    assert reason.startswith("stopped by the operator; the springs are without pressure"), reason
