"""The plans on the virtual rig: sound springs pass, unsound ones fail, and broken rigs block."""

from html import unescape

import numpy as np
import pyarrow.parquet as pq
import pytest

from bench_protocol.units import bar, mm
from bench_records.record import read
from bench_records.report import write_report
from bench_records.result import Outcome, read_result
from bench_records.typography import primed
from drivers.memory import Faults
from tests.refusals import refuses

slow = pytest.mark.slow
#: Of sound rigs that differ in more than their seeds the mutation matrix counts hundreds.
SEEDS = [0, pytest.param(1, marks=slow)]
#: Bench time of a whole run (s): AW0 and AW3 together stay below four minutes in real time.
BUDGET = {"aw0": 105.0, "aw3": 115.0, "leak_down": 70.0}


def centred(one):
    """Where a value lies in its band: 0 in the middle, 1 at a limit."""
    return abs(one.number - (one.low + one.high) / 2) / ((one.high - one.low) / 2)


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("name", ["aw0", pytest.param("aw3", marks=slow)])
def test_a_sound_spring_passes_on_every_rig(bench_run, name, seed):
    run = bench_run(name, seed)
    assert run.result.verdict is Outcome.PASS, run.result.reason or run.failed
    assert (run.state, run.pressure < 0.5 * bar) == ("DISABLED", True)
    assert run.result.phases[-1].name == "depressurise"
    assert run.result.duration < BUDGET[name]
    # What the equations predict lies in the middle of each band: half of the tolerance is left to the product.
    harmonic = [one for one in run.result.checks if "vertical" in one.name]
    assert len(harmonic) == 2 * (1 + 2 * 4)
    assert max(centred(one) for one in harmonic) < 0.6
    groups = {curve.group for curve in run.result.curves}
    assert {
        f"{what}: force over displacement" for what in ("Left spring", "Right spring", "Lateral")
    } < groups
    text = unescape(write_report(run.directory).read_text(encoding="utf-8"))
    assert not [one.name for one in run.result.checks if primed(one.name) not in text]


def test_a_tight_spring_passes_the_leak_down(bench_run):
    run = bench_run("leak_down")
    assert run.result.verdict is Outcome.PASS
    assert run.result.duration < BUDGET["leak_down"]
    assert not (run.directory / "black_box.txt").exists(), "nothing happened"
    # The mass balance is good for a tenth of a per cent a minute though the pressure falls by 4 % meanwhile.
    assert max(abs(one.number) for one in run.result.checks) < 0.001


@pytest.mark.parametrize(
    ("name", "changes", "expected"),
    [
        pytest.param("aw0", {"orifice_diameter": 16 * mm}, {"left vertical c at 1 Hz"}, marks=slow),
        pytest.param("aw3", {"orifice_diameter": 11.5 * mm}, {"right vertical K' at 1 Hz"}, marks=slow),
        pytest.param(
            "aw0",
            {"effective_area": 0.247},
            {"pressure in the left bellows", "pressure in the right bellows"},
            marks=slow,
        ),
        pytest.param(
            "aw0", {"leak_conductance": [0.0, 5e-11]}, {"air lost per minute, right spring"}, marks=slow
        ),
        ("leak_down", {"leak_conductance": [5e-11, 0.0]}, {"air lost per minute, left spring"}),
        pytest.param("aw0", {"friction_lateral": 700.0}, {"lateral c at 1 Hz"}, marks=slow),
        # A differential pressure valve that does not shut: rolled, the springs lose their air to each other.
        pytest.param("aw3", {"dpv_opening": 2000.0, "dpv_reclosing": 1000.0}, {"roll stiffness"}, marks=slow),
    ],
)
def test_an_unsound_product_fails_where_it_should(bench_run, name, changes, expected):
    run = bench_run(name, 1, **changes)
    assert run.result.verdict is Outcome.FAIL
    assert run.failed >= expected


@slow
def test_one_bad_spring_is_distinguished_from_its_neighbour(bench_run):
    run = bench_run("aw0", 1, orifice_diameter=[13 * mm, 14.5 * mm])
    assert "right vertical c at 1 Hz" in run.failed
    assert not any("left" in name for name in run.failed)


@slow
def test_the_same_seed_gives_the_same_bytes(bench_run):
    one, same = (bench_run("leak_down", 3, directory=name) for name in ("one", "same"))
    for file in ("record.parquet", "meta.json", "result.json", "junit.xml"):
        assert (one.directory / file).read_bytes() == (same.directory / file).read_bytes(), file


def test_a_supply_that_is_too_weak_blocks_and_says_so(bench_run):
    run = bench_run("aw0", supply_pressure=1.5 * bar)
    assert run.result.verdict is Outcome.BLOCKED
    assert "1.51 bar; open the supply until it has 3.058 bar" in run.result.reason
    assert [phase.name for phase in run.result.phases] == ["preconditions"], "nothing moves"


def test_a_supply_that_is_lost_while_the_springs_fill_blocks_and_says_so(bench_run):
    run = bench_run("aw0", at=(3.0, lambda made: made.rig.faults.on("supply_loss", {"pressure": "1.5 bar"})))
    assert run.result.verdict is Outcome.BLOCKED
    assert "left filled to 2.208 bar" in run.result.reason
    assert "not reached within" in run.result.reason
    assert run.pressure < 0.5 * bar  # the tear-down has vented the air


def test_the_emergency_stop_blocks_and_is_the_first_cause(bench_run):
    run = bench_run("leak_down", at=(25.0, lambda made: made.rig.press_estop()))
    assert run.result.verdict is Outcome.BLOCKED
    assert "emergency stop" in run.result.reason
    assert run.result.reason.startswith("the rig: ")
    assert [p.name for p in run.result.phases if p.level == 0] == [
        "preconditions",
        "set-up",
        "main",
        "tear-down",
    ]
    assert run.pressure < 0.5 * bar  # the stop itself has vented the air
    told = [(event.kind, event.text) for event in read(run.directory).events]
    assert ("state", "rig.state: ESTOP") in told
    # What the black box kept was fetched over Modbus, into the run's directory and its report.
    story = (run.directory / "black_box.txt").read_text(encoding="utf-8")
    assert story.splitlines()[0].endswith("emergency stop pressed")
    assert "emergency stop pressed: ACTIVE → ESTOP" in story
    kept = pq.read_table(run.directory / "black_box.parquet")
    times, pressure = (np.array(kept[name]) for name in ("time_s", "left.bellows_pressure"))
    assert (times[0], times[-1], times.size) == (-10.0, 10.0, 4001)
    assert pressure[2000] > 2 * bar > 0.5 * bar > pressure[-1], "vented in the ten seconds after it"
    page = unescape(write_report(run.directory).read_text(encoding="utf-8"))
    assert "Black box of the rig" in page
    assert story.splitlines()[0] in page
    assert page.count("around the incident") == 1


def test_a_cut_bus_blocks_as_the_links_fault_and_the_rig_unloads_by_itself(bench_run):
    run = bench_run("aw0", at=(30.0, lambda made: made.cut("the cable is cut")))
    assert run.result.verdict is Outcome.BLOCKED
    first, _, rest = run.result.reason.partition("; ")
    assert first.startswith("keep away from the springs until their gauges read zero: they hold pressure (2.")
    assert rest.startswith(
        "the bench, in ACTIVE, keeps the air as last commanded, until it detects the loss of its commander: then it "
        "vents the springs by itself"
    ), "which the PLC still reports at that moment"
    assert "; the link to the rig: the CAN bus is lost: the cable is cut" in rest


@slow
def test_a_bad_and_slow_link_changes_no_verdict(bench_run):
    faults = Faults(lose=0.01, double=0.01, delay=0.01, echo=0.05)
    run = bench_run("aw0", 2, faults=faults, latency=0.03)
    assert run.result.verdict is Outcome.PASS, run.result.reason or run.failed


def interrupt(_):
    raise KeyboardInterrupt


def test_a_run_that_is_stopped_lets_the_air_off_and_says_so(bench_run, tmp_path):
    with refuses(KeyboardInterrupt, "pressure"):
        bench_run("aw0", at=(30.0, interrupt))
    result = read_result(tmp_path / "out")
    assert result.reason.startswith("stopped by the operator; the springs are without pressure")


def test_a_tear_down_that_is_stopped_says_what_the_springs_hold(bench_run, after, tmp_path):
    """Twice Ctrl-C: once in the plan, once in its tear-down, a second later."""

    def twice(made):
        after(made.clock, 1.0, lambda: interrupt(made))
        raise KeyboardInterrupt

    with refuses(KeyboardInterrupt, "pressure"):
        bench_run("aw0", at=(30.0, twice))
    result = read_result(tmp_path / "out")
    assert result.reason.startswith(
        "keep away from the springs until their gauges read zero: they hold pressure"
    )
    assert result.reason.endswith("in tear-down: stopped by the operator")
    held = float(result.reason.split("hold pressure (")[1].split(" bar")[0])
    assert 1.5 < held < 2.5
