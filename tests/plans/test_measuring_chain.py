"""The measuring chain: a sound one passes on stops and on blocks, and each fault fails its own check."""

from contextlib import nullcontext
from types import SimpleNamespace

import pytest

from bench_protocol.table import TABLE
from bench_protocol.units import MN, mm
from bench_records.result import CheckVerdict, Outcome
from bench_sim.model.layout import Sensor
from bench_sim.parameters import load
from drivers.errors import BenchTimeout
from test_plans.description import ours
from test_plans.discovery import plans
from test_plans.execution import execute
from test_plans.operator import NoOperator, Script
from test_plans.plans import measuring_chain

slow = pytest.mark.slow
AGAINST = "what the cells bear against each other"
SIDES = ("left", "right")
#: Steel in the springs' place: it reaches design height, and nothing gives way.
BLOCKS = {"contact_height": 0.0, "contact_stiffness": 1000 * MN, "emergency_spring": 0.0}
WRONG = {
    "a pressure that is off by twice its data sheet": (
        {"faults": [("bias", {"sensor": "left.bellows_pressure", "value": "60 mbar"})]},
        {"left.bellows_pressure"},
    ),
    "a load cell that is stuck": (
        {"faults": [("stuck", {"sensor": "load_cell.3"})]},
        {
            "left cells over actuator",
            *(f"left stiffness of the {what}" for what in ("dummy", "frame")),
            "force upward, ahead of the middle",
            AGAINST,
        },
    ),
    "a wire of a cell across that is broken": (
        {"faults": [("broken_wire", {"sensor": "load_cell.5", "reads": "low"})]},
        {"load_cell.5", "lateral cells over actuator", "force sideways, ahead of the middle"},
    ),
    "cells across that feel the load": (
        {"effects": [("crosstalk", "2 %")]},
        {*(f"load_cell.{cell} over vertical force" for cell in (5, 6)), "load_cell.5", "load_cell.6"},
    ),
    "a seat off the middle, and a support that gives way": (
        {"effects": [("seat_offset.left", "30 mm"), ("soft_support.2", "20 %")]},
        {*(f"force {way}, ahead of the middle" for way in ("upward", "sideways")), AGAINST, "load_cell.3"},
    ),
    "a frame that gives way": (
        {"effects": [("frame_compliance", "0.01 mm/kN")]},
        {f"{side} stiffness of the frame" for side in SIDES},
    ),
    "lasers that are plugged in crosswise": (
        {"faults": [("swapped", {"sensor": "left.height", "other": "right.height"})]},
        {f"{side} stiffness of the {what}" for side in SIDES for what in ("dummy", "frame")},
    ),
    "a soft emergency spring": (
        {"emergency_stiffness_vertical": 5 * MN},
        {f"{side} stiffness of the dummy" for side in SIDES},
    ),
}


def test_gas_that_stays_cold_says_how_long_to_wait(monkeypatch):
    cold = "in the last 2 s left.bellows_temperature moved from 16.42 °C to 16.77 °C"

    def never(*names, **how):
        raise BenchTimeout(f"not settled within 300 s: {cold}")

    bench = SimpleNamespace(
        air=SimpleNamespace(vent=lambda within: None),
        has=lambda name: True,
        disarm=lambda: None,
        wait=lambda seconds: None,
        settle=never,
    )
    run = SimpleNamespace(bench=bench, phase=lambda name: nullcontext())
    monkeypatch.setattr(measuring_chain.steps, "power_up", lambda run: None)
    with pytest.raises(
        BenchTimeout,
        match=f"not yet as warm as the hall: .*{cold}; .* some 5 min to warm up: wait, and start again",
    ):
        measuring_chain.without_air(run)


def test_places_are_printed_readably():
    assert TABLE["left.bellows_temperature"].reads(289.97123) == "16.82 °C"
    assert TABLE["left.height"].reads(0.0123456) == "12.35 mm"
    assert TABLE["rig.state"].reads(0.0) == TABLE["rig.state"].show(0.0)


def test_zeros_allow_what_any_rig_within_its_data_sheets_reads():
    """Every corner of all accuracies; the platform is held where its own transducers read 0, so it stands off."""
    accuracy = load("astb").entries["sensor_accuracy"].value
    for title, sum_of, _, tolerance, _ in measuring_chain._zeros(ours(), lambda name: True):
        reach = sum(
            abs(share) * accuracy[Sensor[name.upper().replace(".", "_")]] for name, share in sum_of.items()
        )
        platform = {"platform.vertical", "platform.roll"} & set(sum_of)
        assert reach <= tolerance * (1 + 1e-9), title
        assert len(platform) == 2 if ".height less" in title else not platform


@slow
@pytest.mark.parametrize("what", WRONG)
def test_each_fault_fails_its_own_check(judged, what):
    broken, expected = WRONG[what]
    result, failed = judged("measuring_chain", **broken)
    assert result.verdict is Outcome.FAIL, result.reason
    assert failed == expected


@slow
def test_steel_blocks_are_stiffer_than_can_be_seen_and_springs_are_not_taken_for_blocks(judged):
    result, failed = judged("measuring_chain", given={"dummy": "blocks"}, **BLOCKS)
    assert result.verdict is Outcome.PASS, result.reason or failed
    stiffness = {one.name: one.number for one in result.checks if one.name.endswith("the dummy")}
    assert all(one == pytest.approx(1000 * MN, rel=0.2) for one in stiffness.values())
    result, _ = judged("measuring_chain", given={"dummy": "blocks"})
    assert result.verdict is Outcome.BLOCKED
    assert "the bolster rests at -52" in result.reason


@slow
def test_blocks_on_a_soft_support_fail(judged):
    soft = BLOCKS | {"contact_stiffness": 100 * MN, "contact_height": -1 * mm}
    result, failed = judged("measuring_chain", given={"dummy": "blocks"}, **soft)
    assert result.verdict is Outcome.FAIL
    assert failed == {f"{side} stiffness of the dummy" for side in SIDES}


@pytest.fixture
def weighed(bench_composed, tmp_path):
    """Run the plan with a mass of 500 kg, which a ``hand`` handles; return result, verdicts and the bolster's mass."""

    def run(hand=None, **changes):
        with bench_composed(1, **changes) as made:
            operator = (
                NoOperator() if hand is None else Script({"*kg*": lambda question: hand(made, question.text)})
            )
            one = plans()["measuring_chain"].given({"mass": "500 kg"})
            result = execute(one, made.bench, tmp_path / "out", rig="virtual", operator=operator)
            return SimpleNamespace(
                result=result,
                mass=made.rig.plant.parameters.bolster_mass,
                verdicts={check.name: check.verdict for check in result.checks},
            )

    return run


def puts_it_on(made, question):
    made.rig.plant.parameters.bolster_mass += 500.0 if question.startswith("Put") else -500.0
    return "done"


FORCES = (
    Sensor.VERTICAL_LEFT_FORCE,
    Sensor.VERTICAL_LEFT_FORCE + 1,
    *range(Sensor.LOAD_CELL_1, Sensor.LOAD_CELL_5),
)
MASS = "cells over the known mass"


@slow
def test_a_known_mass_is_weighed_and_taken_off_again(weighed):
    run = weighed(puts_it_on)
    assert run.result.verdict is Outcome.PASS, run.result.reason
    assert run.mass == 1200.0
    assert {one.name: one.number for one in run.result.checks}[MASS] == pytest.approx(1.0, abs=0.002)


def test_a_common_scale_error_of_cells_and_actuators_shows_by_the_mass(weighed):
    """Load cells and transducers read 2 % too much; cross-checks do not show it."""
    run = weighed(puts_it_on, sensor_gain=dict.fromkeys(FORCES, 0.02))
    assert {name for name, verdict in run.verdicts.items() if verdict is CheckVerdict.FAIL} == {MASS}


def test_no_pressure_until_removal_of_the_mass_is_confirmed(weighed):
    run = weighed(lambda made, question: "done" if question.startswith("Put") else "not possible")
    assert run.result.verdict is Outcome.BLOCKED
    assert "it was not confirmed that the 500 kg" in run.result.reason
    assert "press" not in {phase.name for phase in run.result.phases}


@slow
@pytest.mark.parametrize("hand", [None, lambda *_: "not possible"])
def test_without_a_hand_or_a_mass_the_rest_is_judged(weighed, hand):
    run = weighed(hand)
    assert run.result.verdict is Outcome.INCOMPLETE
    assert run.verdicts.pop(MASS) is CheckVerdict.NOT_AVAILABLE
    assert set(run.verdicts.values()) <= {CheckVerdict.PASS, CheckVerdict.MARGINAL}


@slow
def test_a_false_confirmation_by_the_operator_is_detected(weighed):
    assert weighed(lambda *_: "done").verdicts[MASS] is CheckVerdict.FAIL
