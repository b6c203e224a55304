"""The measuring chain: a sound one passes on stops and on blocks, and each fault fails its own check."""

import pytest

from bench_protocol.units import MN, mm
from bench_records.result import Outcome

slow = pytest.mark.slow
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
        {"left cells over actuator", *(f"left stiffness of the {what}" for what in ("dummy", "frame"))},
    ),
    "a wire of a cell across that is broken": (
        {"faults": [("broken_wire", {"sensor": "load_cell.5", "reads": "low"})]},
        {"load_cell.5", "lateral cells over actuator"},
    ),
    "cells across that feel the load": (
        {"effects": [("crosstalk", "2 %")]},
        {*(f"load_cell.{cell} over vertical force" for cell in (5, 6)), "load_cell.5", "load_cell.6"},
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


@pytest.mark.parametrize(
    "what", [name if "cells" in name else pytest.param(name, marks=slow) for name in WRONG]
)
def test_each_fault_fails_its_own_check(judged, what):
    broken, expected = WRONG[what]
    result, failed = judged("measuring_chain", **broken)
    assert result.verdict is Outcome.FAIL, result.reason
    assert failed == expected


def test_steel_blocks_are_stiffer_than_can_be_seen_and_springs_are_not_taken_for_blocks(judged):
    result, failed = judged("measuring_chain", given={"dummy": "blocks"}, **BLOCKS)
    assert result.verdict is Outcome.PASS, result.reason or failed
    stiffness = {one.name: one.number for one in result.checks if one.name.endswith("the dummy")}
    assert all(one == pytest.approx(1000 * MN, rel=0.2) for one in stiffness.values())
    result, _ = judged("measuring_chain", given={"dummy": "blocks"})
    assert result.verdict is Outcome.BLOCKED
    assert "no blocks in the springs' place: the bolster rests at -52" in result.reason


def test_blocks_on_something_soft_fail(judged):
    soft = BLOCKS | {"contact_stiffness": 100 * MN, "contact_height": -1 * mm}
    result, failed = judged("measuring_chain", given={"dummy": "blocks"}, **soft)
    assert result.verdict is Outcome.FAIL
    assert failed == {f"{side} stiffness of the dummy" for side in SIDES}
