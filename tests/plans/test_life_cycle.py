"""Set-up, main part and tear-down: their order, the origin of a failure, and the written files."""

import math
import re
from contextlib import nullcontext
from types import SimpleNamespace

import msgspec
import numpy as np
import pytest

from astb.campaigns.on_a_worker import OutOfTime
from bench_protocol.clock import VirtualClock
from bench_protocol.table import TABLE
from bench_protocol.units import bar, kPa
from bench_protocol.words import AIR_BY_STATE, STATES
from bench_records.layout import RecordError
from bench_records.record import read
from bench_records.result import CheckVerdict, Outcome, read_result
from drivers.errors import BenchError, BenchTimeout, LinkLost, Misuse, Refused, RigFault
from drivers.wiring.contract import Capabilities
from test_plans.analysis import NotMeasured
from test_plans.discovery import plans
from test_plans.execution import execute
from test_plans.plan import Plan, plan
from test_plans.run import NullWatcher, PlanError, Run

SPRINGS = [f"{side}.{chamber}_pressure" for side in ("left", "right") for chamber in ("bellows", "auxiliary")]


class FakeBench:
    """As much of a bench as the life cycle touches: a clock, a sink, counters."""

    def __init__(self):
        self.clock, self.table = VirtualClock(), TABLE
        self.receiver = SimpleNamespace(sink=None)
        self.settings = SimpleNamespace(readings=self.account, in_force=dict)
        self.wiring = SimpleNamespace(rig="fake", stamp=lambda name: None, read_file=self.read_file)
        self.wiring.capabilities = Capabilities(files=True)
        self.wiring.sequences = SimpleNamespace(air=AIR_BY_STATE)
        self.counters = {name.name: 0.0 for name in TABLE.signals if name.name.startswith("rig.")}
        self.dead = False
        self.hand = self.instruments = self.dimensions = None
        self.strangers = lambda: ""
        self.state = "DISABLED"
        self.pressures = dict.fromkeys(SPRINGS, 0.0) | {"rig.state": STATES.index("DISABLED")}
        self.readings = SimpleNamespace(
            value_or_nan=lambda name: self.pressures.get(name, np.nan),
            glimpse=lambda name: np.nan,
            show=lambda name: f"{name} is missing",
        )
        self.lost = False
        self.lacks = lambda *names: ""

    def account(self, *names):
        if self.dead:
            raise LinkLost("nobody answers")
        return {name: self.counters[name] for name in names}

    @property
    def now(self):
        return self.clock.now() / 1e9

    def despite_faults(self):
        return nullcontext()

    def read_file(self, file, record, count):
        raise Refused("this rig has no black box", 1)

    def wait(self, seconds):
        self.clock.sleep_until(self.clock.now() + round(seconds * 1e9))

    def send(self, **values):
        rows = np.array([TABLE.index[name.replace("__", ".")] for name in values])
        self.receiver.sink(np.full(rows.size, self.clock.now()), rows, np.array(list(values.values()), float))


@pytest.fixture
def bench():
    return FakeBench()


@pytest.fixture
def made(bench, tmp_path):
    """Run a plan with the given main part on the fake bench; return its result and what ran."""

    def run(main, *, setup=None, teardown=None, **rest):
        ran = []

        def part(name, function):
            def wrapped(run: Run) -> None:
                ran.append(name)
                run.bench.wait(1.0)
                if function is not None:
                    function(run)

            return wrapped

        made = Plan(
            "fake", "Fake.", "Fake.", part("main", main), part("set-up", setup), part("tear-down", teardown)
        )
        return execute(made, bench, tmp_path / "out", **rest), ran

    return run


def good(run):
    run.check("pressure", 5 * kPa, "kPa", low=0.0, high=10 * kPa)


def bad(run):
    run.check("pressure", 50 * kPa, "kPa", low=0.0, high=10 * kPa)


def raising(error):
    def part(run):
        raise error

    return part


ALL = ["set-up", "main", "tear-down"]


def test_a_run_within_limits_passes_and_leaves_its_files(made, tmp_path):
    result, ran = made(good, rig="fake rig", seed=3)
    assert ran == ALL
    assert result.verdict is Outcome.PASS
    assert read_result(tmp_path / "out") == result
    assert [p.name for p in result.phases] == ALL
    assert [p.duration for p in result.phases] == pytest.approx([1.0, 1.0, 1.0])
    assert (tmp_path / "out" / "junit.xml").exists()
    assert result.checks[0].phase == "main"


def test_a_broken_limit_fails_and_the_plan_goes_on(made):
    result, ran = made(lambda run: (bad(run), good(run)))
    assert (result.verdict, ran) == (Outcome.FAIL, ALL)
    assert [one.verdict for one in result.checks] == [CheckVerdict.FAIL, CheckVerdict.PASS]


def test_near_a_limit_is_marginal_and_missing_data_is_no_pass(made):
    def main(run):
        run.check("a", 9.9, "1", low=0, high=10)
        run.check("b", math.nan, "1", low=0, high=10)

    result, _ = made(main)
    assert [one.verdict for one in result.checks] == [CheckVerdict.MARGINAL, CheckVerdict.ERROR]
    assert result.verdict is Outcome.BLOCKED


@pytest.mark.parametrize(
    ("error", "whose"),
    [
        (RigFault("the rig left ACTIVE: limit tripped"), "the rig: the rig left ACTIVE"),
        (BenchTimeout("level: not reached within 20 s"), "the rig: level"),
        (LinkLost("the CAN bus is lost"), "the link to the rig: the CAN bus"),
        (Misuse("no such thing"), "the plan: no such thing"),
        (NotMeasured("3 samples are too few for a line"), "the measurement: 3 samples"),
        (TypeError("unsupported operand"), "the plan: TypeError at test_life_cycle.py:"),
        (ZeroDivisionError("by zero"), "the plan: ZeroDivisionError at test_life_cycle.py:"),
    ],
)
@pytest.mark.parametrize("where", ["setup", "main"])
def test_an_external_failure_blocks_and_tear_down_runs(made, error, whose, where):
    parts = {"main": good, where: raising(error)}
    main = parts.pop("main")
    result, ran = made(main, **parts)
    assert result.verdict is Outcome.BLOCKED
    assert result.reason.startswith(whose)
    assert ran == (ALL if where == "main" else ["set-up", "tear-down"])


def test_samples_that_are_missing_are_named(made, bench):
    bench.readings.value_or_nan = lambda name: math.nan if name == "load_cell.1" else 0.0
    result, _ = made(raising(NotMeasured("0 samples are too few for a line")))
    assert (
        result.reason
        == "the measurement: 0 samples are too few for a line; no samples arrive of load_cell.1; check these sensors"
    )


def test_a_fault_after_a_broken_limit_blocks_for_the_rig_may_have_broken_the_check(made):
    result, _ = made(lambda run: (bad(run), raising(RigFault("gone"))(run)))
    assert result.verdict is Outcome.BLOCKED


def test_a_failure_in_tear_down_does_not_hide_the_first(made, tmp_path):
    result, _ = made(raising(RigFault("first")), teardown=raising(LinkLost("second")))
    assert result.reason == "the rig: first; then in tear-down: the link to the rig: second"


def test_third_party_programs_are_reported_with_a_blocked_plan(bench, made, tmp_path):
    bench.strangers = lambda: "another client tries to command the bench"
    result, _ = made(raising(RigFault("did not reach ACTIVE")))
    assert "another client" in " ".join(event.text for event in read(tmp_path / "out").events)
    assert result.reason.endswith("did not reach ACTIVE; another client tries to command the bench")


def test_a_failure_in_tear_down_blocks(made):
    result, _ = made(good, teardown=raising(RigFault("vent stuck")))
    assert result.verdict is Outcome.BLOCKED
    assert result.reason == "in tear-down: the rig: vent stuck"


def test_trouble_in_tear_down_does_not_hide_a_failed_product(made, tmp_path):
    result, _ = made(bad, teardown=raising(RigFault("vent stuck")))
    assert result.verdict is Outcome.FAIL
    assert result.warnings == ["in tear-down: the rig: vent stuck"], "the next user must know"
    assert "tear-down: the rig: vent stuck" in [
        e.text for e in read(tmp_path / "out").events if e.kind == "error"
    ]


@pytest.mark.parametrize(
    ("pressures", "told"),
    [
        (
            [],
            "keep away from the springs until their gauges read zero: it is not known whether they hold pressure; "
            + "; ".join(f"{name} is missing" for name in SPRINGS)
            + "; the bench, in DISABLED, vents the springs by itself",
        ),
        (
            [0.05, 0.07, 0.01, 0.02],
            "the springs are without pressure (0.07 bar on the left and 0.02 bar on the right)",
        ),
        (
            [0.05, 3.2, 0.01, 0.02],
            "keep away from the springs until their gauges read zero: they hold pressure (3.20 bar on the left and "
            "0.02 bar on the right); the bench, in DISABLED, vents the springs by itself",
        ),
    ],
)
def test_ctrl_c_tears_down_writes_and_comes_out_again(made, bench, tmp_path, pressures, told):
    def tear_down(_):
        bench.pressures = {"rig.state": STATES.index("DISABLED")}
        bench.pressures |= zip(SPRINGS, np.array(pressures) * bar, strict=False)

    with pytest.raises(KeyboardInterrupt, match=re.escape(told)):
        made(raising(KeyboardInterrupt()), teardown=tear_down)
    result = read_result(tmp_path / "out")
    parts = ("stopped by the operator", told)
    first_what_to_do = parts[::-1] if told.startswith("keep away") else parts
    assert (result.verdict, result.reason) == (Outcome.BLOCKED, "; ".join(first_what_to_do))


def test_a_rig_without_transducers_in_the_auxiliary_chambers_tells_by_its_bellows(made, bench, tmp_path):
    bench.lacks = lambda *names: "there are none" if any("auxiliary" in name for name in names) else ""
    bench.pressures = {f"{side}.bellows_pressure": 0.01 * bar for side in ("left", "right")}
    with pytest.raises(KeyboardInterrupt, match="the springs are without pressure"):
        made(raising(KeyboardInterrupt()))
    bench.pressures.pop("right.bellows_pressure")
    with pytest.raises(KeyboardInterrupt, match="not known whether they hold"):
        made(raising(KeyboardInterrupt()))


def test_a_disk_that_fails_does_not_keep_the_tear_down_from_its_work(made, monkeypatch):
    ran = []

    def full(*_, **__):
        raise RecordError("no space left")

    def main(run):
        monkeypatch.setattr(type(run.log), "event", full)
        run.check("x", 1.0, "1", high=2.0)
        raise RigFault("gone")

    result, _ = made(main, teardown=lambda run: ran.append("safe"))
    assert ran == ["safe"]
    assert result.reason == "the rig: gone"


class Deaf(NullWatcher):
    """A watcher that raises on a call."""

    def __init__(self, error, at):
        self.error, self.at = error, at

    def say(self, text):
        if self.at in text:
            raise self.error

    def phase(self, path, *, begins):
        self.say(path[-1] if path else "")


@pytest.mark.parametrize("error", [SystemExit(1), OSError(5, "Input/output error")])
def test_a_display_that_breaks_keeps_no_run_from_its_end(made, error):
    """The behaviour of rich in a program whose pipe has no reader, and a closed terminal."""
    result, ran = made(good, watcher=Deaf(error, "main"))
    assert (result.verdict, ran) == (Outcome.PASS, ALL)


def test_a_plan_that_ends_the_program_is_torn_down(made):
    result, ran = made(raising(SystemExit(0)))
    assert (result.verdict, ran) == (Outcome.BLOCKED, ALL)
    assert result.reason.startswith("the plan: SystemExit at test_life_cycle.py:")


def test_an_external_timeout_is_not_caught(made):
    with pytest.raises(OutOfTime):
        made(raising(OutOfTime()))


def test_a_second_ctrl_c_does_not_skip_the_tear_down(made, tmp_path):
    with pytest.raises(KeyboardInterrupt):
        made(raising(KeyboardInterrupt()), watcher=Deaf(KeyboardInterrupt(), "main: stopped"))
    assert "tear-down" in [phase.name for phase in read_result(tmp_path / "out").phases]


def test_a_plan_without_a_check_does_not_pass(made):
    assert made(lambda run: None)[0].verdict is Outcome.BLOCKED


def test_samples_and_changes_of_state_reach_the_record(bench, made, tmp_path):
    def main(run):
        good(run)
        bench.send(left__height=0.01, rig__state=STATES.index("ACTIVE"), rig__reason=0.0, rig__tripped=0.0)
        bench.wait(0.5)
        row = TABLE.trip_number("lateral.force")
        bench.send(rig__state=STATES.index("FAULT_HOLD"), rig__reason=5.0, rig__tripped=row)
        with run.phase("inner"):
            run.say("something")
            bench.wait(0.25)
        run.check("late", 1.0, "s", high=2.0)

    result, _ = made(main)
    record = read(tmp_path / "out")
    times, values = record.series("left.height")
    assert (list(times), list(values)) == ([2.0 - 0.0], [0.01]) or list(values) == [0.01]
    told = [(event.kind, event.text) for event in record.events]
    assert ("state", "rig.state: ACTIVE") in told
    assert ("trip", "limit of lateral.force tripped") in told
    assert ("reason", "rig.reason: limit tripped") in told
    assert told.index(("trip", "limit of lateral.force tripped")) < told.index(
        ("state", "rig.state: FAULT_HOLD")
    )
    assert [(p.name, p.level) for p in result.phases] == [
        ("set-up", 0),
        ("main", 0),
        ("inner", 1),
        ("tear-down", 0),
    ]
    assert bench.receiver.sink is None


def test_every_change_of_state_is_reported_in_a_burst(bench, made, tmp_path):
    row, active, hold = TABLE.index["rig.state"], STATES.index("ACTIVE"), STATES.index("HOLD")

    def main(run):
        good(run)
        states = np.array([active, hold, hold, active, active], float)
        bench.receiver.sink(np.arange(5) * 20_000_000, np.full(5, row), states)

    made(main)
    told = [event.text for event in read(tmp_path / "out").events if event.kind == "state"]
    assert told == ["rig.state: ACTIVE", "rig.state: HOLD", "rig.state: ACTIVE"]


def test_punctuality_is_what_the_counters_gained_during_the_run(bench, made):
    bench.counters |= {"rig.tick": 1000.0, "rig.lateness_50us": 500.0, "rig.late_ticks": 7.0}

    def main(run):
        good(run)
        bench.counters |= {
            "rig.tick": 3000.0,
            "rig.lateness_50us": 2480.0,
            "rig.lateness_1ms": 20.0,
            "rig.late_ticks": 8.0,
            "rig.lateness_max": 0.7e-3,
        }

    timing = made(main)[0].timing
    assert (timing.ticks, timing.late) == (2000, 1)
    assert timing.counts == [1980, 0, 0, 0, 20, 0]
    assert (timing.p50, timing.p99, timing.max) == pytest.approx((50e-6, 50e-6, 0.7e-3))


def test_a_rig_that_died_leaves_no_figures_but_a_result(bench, made):
    def main(run):
        bench.dead = True
        raise LinkLost("gone")

    result, _ = made(main)
    assert (result.verdict, result.timing) == (Outcome.BLOCKED, None)


def test_the_same_run_gives_the_same_bytes(tmp_path):
    def main(run):
        run.bench.wait(0.3)
        run.bench.send(left__height=0.01)
        run.check("x", 0.3, "bar", low=0.0, high=1.0)

    one = Plan("fake", "Fake.", "Fake.", main, lambda run: None, lambda run: None)
    for name in "ab":
        execute(one, FakeBench(), tmp_path / name, meta={"versions": {"x": "1"}}, seed=1)
    for file in ("record.parquet", "meta.json", "result.json", "junit.xml"):
        assert (tmp_path / "a" / file).read_bytes() == (tmp_path / "b" / file).read_bytes(), file


def test_the_decorator_reads_name_title_and_instruction():
    @plan
    def leak_down(run: Run) -> None:
        """Leak-down: watch the pressure.

        For five minutes.
        """

    assert (leak_down.name, leak_down.title) == ("leak_down", "Leak-down: watch the pressure.")
    assert leak_down.instruction.endswith("For five minutes.")
    assert leak_down.setup.__name__ == "power_up"
    assert leak_down.teardown.__name__ == "make_safe"


def test_a_plan_without_instruction_is_refused(monkeypatch):
    def idle(run: Run) -> None: ...

    idle.__module__ = "test_plans.nowhere"
    monkeypatch.setitem(__import__("sys").modules, "test_plans.nowhere", SimpleNamespace(__doc__=None))
    with pytest.raises(PlanError, match="idle has no docstring"):
        plan(idle)


def test_an_unknown_unit_is_the_plans_fault(made):
    result, _ = made(lambda run: run.check("x", 1.0, "furlong", low=0.0))
    assert result.verdict is Outcome.BLOCKED
    assert "unit 'furlong' is unknown; use one of" in result.reason


def test_every_plan_is_listed_under_its_name():
    assert list(plans())[:2] == ["aw0", "aw3"]
    for name, one in plans().items():
        assert one.name == name
        assert one.title.endswith(".")


def test_bench_errors_know_whose_fault_they_are():
    assert {error("x").fault for error in (BenchError, RigFault, LinkLost, Misuse)} == {"rig", "link", "plan"}


def test_a_result_tells_who_ran_it_and_in_which_surroundings(bench, tmp_path):
    content = {"operator": "A. Müller", "ambient": "21 °C, 1013 hPa"}

    def main(run):
        run.check("x", 1.0, "1", low=0.0)

    anything = Plan("anything", "Anything.", "Anything.", main, lambda run: None, lambda run: None)
    execute(anything, bench, tmp_path / "told", meta=content)
    execute(anything, bench, tmp_path / "untold")
    result = read_result(tmp_path / "told")
    assert {"operator": result.operator, "ambient": result.ambient} == content
    assert msgspec.json.decode((tmp_path / "told" / "result.json").read_bytes())["operator"] == "A. Müller"
    assert (read_result(tmp_path / "untold").operator, read_result(tmp_path / "untold").ambient) == ("", "")
