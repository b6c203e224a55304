"""All lines of a wiring that are wrong are told in one run, and units of other houses are known."""

import tomllib
from pathlib import Path

import pytest

from bench_protocol.table import TABLE
from bench_protocol.units import mm
from drivers.errors import WiringError
from drivers.wiring.description import describe
from drivers.wiring.registers import read_points
from tests.drivers.test_description import GOOD


def described(text: str):
    return describe(tomllib.loads(text), Path("hall.toml"), TABLE)


def test_all_lines_that_are_wrong_are_told_in_one_run():
    text = GOOD.replace('unit = "mm", sign = -1', 'unit = "bar"').replace("[5, 6]", '"six"')
    text = text.replace("gain = 1.01", "gian = 1.01")
    with pytest.raises(WiringError) as told:
        described(text)
    said = str(told.value)
    for signal in ("left.height", "air.left_mode", "left.bellows_pressure"):
        assert said.count(f'hall.toml: signals."{signal}"') == 1
    assert said.endswith("(3 lines are wrong)")


def test_all_points_that_are_wrong_are_told_in_one_run():
    points = {
        "height": {"table": "inputs", "address": 1},
        "force": {"table": "input", "address": 2, "type": "int24"},
        "good": {"table": "input", "address": 3},
    }
    with pytest.raises(WiringError) as told:
        read_points("points", points, (), "high", "big")
    said = str(told.value)
    assert "points: height: table = 'inputs'" in said
    assert "points: force: type = 'int24'" in said
    assert "good" not in said


def test_units_of_other_houses_are_known():
    text = GOOD.replace(
        '{ absent = "no thermometer in the chambers" }', '{ from = "plc.gas", unit = "degF" }'
    )
    readings = described(text.replace('unit = "mm", sign = -1 }', 'unit = "in" }')).readings
    assert readings["left.auxiliary_temperature"].conversion.si(68.0) == pytest.approx(293.15)
    assert readings["left.height"].conversion.si(2.0) == pytest.approx(50.8 * mm)
