"""All wrong lines of a wiring are reported in one run, and third-party units are known."""

import tomllib
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bench_protocol.table import TABLE
from bench_protocol.units import mm
from drivers.errors import WiringError
from drivers.wiring.described import open_described
from drivers.wiring.description import describe
from drivers.wiring.modbus.registers import read_points
from tests.drivers.test_description import GOOD


def described(text: str):
    return describe(tomllib.loads(text), Path("hall.toml"), TABLE)


def test_all_wrong_lines_are_reported_in_one_run():
    text = GOOD.replace('unit = "mm", sign = -1', 'unit = "bar"').replace("[5, 6]", '"six"')
    text = text.replace("gain = 1.01", "gian = 1.01")
    with pytest.raises(WiringError) as told:
        described(text)
    said = str(told.value)
    for signal in ("left.height", "air.left_mode", "left.bellows_pressure"):
        assert said.count(f'hall.toml: signals."{signal}"') == 1
    assert said.endswith("(3 lines are wrong)")


WRONG: list[tuple[str, str, str]] = [
    ('unit = "mm", sign = -1', 'unit = "bar"', 'signals."left.height".unit'),
    (
        '"lateral.force" =',
        '"lateral.farce" =',
        'signals."lateral.farce" is not a signal',
    ),
    ('latency = "100 ms"', 'latency = "100"', "latency = '100' is not a time"),
    ('{ "plc.device" = 4711 }', '{ "plc.device" = "no" }', "identity.plc.device = 'no'"),
    ('at_rest = ["DISABLED", "ESTOP"]', 'at_rest = ["DISABLED", "IDLE"]', "'IDLE' is not a state of a bench"),
    ('start = ["HOLD"]', 'start = ["HELD"]', "sequences.up[2].start: 'HELD' is not a state"),
    (
        'rest = [{ "plc.command" = 0 }]',
        'rest = [{ "plx.command" = 0 }]',
        "'plx.command' is neither a signal nor",
    ),
    ("{ plc.command = 1 }", '{ plc.command = "one" }', "sequences.up[1].orders[1].plc.command = 'one'"),
    ("{ DISABLED = [0, 1]", "{ DISABLE = [0, 1]", "'DISABLE' is not a choice of rig.state"),
    ('kind = "can"', 'kind = "can "', "transports.bus: kind = 'can ' is not a transport"),
    ('type = "int16", address = 3', 'type = "int17", address = 3', "mode: type = 'int17'"),
    ('lateral = { table = "holding"', 'laterall = { table = "holding"', "has no point 'lateral'"),
]
POINTS = """kind = "modbus"
host = "127.0.0.1"
[transports.plc.points]
device = { table = "input", address = 0 }
state = { table = "input", address = 1 }
left_height = { table = "input", address = 2 }
f1 = { table = "input", address = 3 }
f2 = { table = "input", address = 4 }
mode_active = { table = "input", address = 5 }
mode = { table = "holding", type = "int16", address = 3 }
lateral = { table = "holding", address = 4 }
command = { table = "holding", address = 6 }
"""


@settings(deadline=None, max_examples=40)
@given(st.sets(st.sampled_from(WRONG), min_size=1))
def test_all_errors_of_a_file_are_reported_in_one_run(wrong):
    text = GOOD.replace('kind = "modbus"\n', POINTS)
    for right, becomes, _ in wrong:
        assert right in text
        text = text.replace(right, becomes)
    with pytest.raises(WiringError) as told:
        description = describe(tomllib.loads(text), Path("hall.toml"), TABLE, whole=True)
        open_described("hall", description)
    said = str(told.value)
    assert [words for *_, words in wrong if words not in said] == []
    assert "transports.bus: " in said, "it has neither a DBC nor messages"
    assert "is missing" not in said, "consequences of another line are not reported"


def test_all_wrong_points_are_reported_in_one_run():
    points = {
        "height": {"table": "inputs", "address": 1},
        "force": {"table": "input", "address": 2, "type": "int24"},
        "good": {"table": "input", "address": 3},
    }
    with pytest.raises(WiringError) as told:
        read_points("points", points, (), "high", "big")
    text = str(told.value)
    assert "points: height: table = 'inputs'" in text
    assert "points: force: type = 'int24'" in text
    assert "good" not in text


def test_units_of_other_houses_are_known():
    text = GOOD.replace(
        '{ absent = "no thermometer in the chambers" }', '{ from = "plc.gas", unit = "degF" }'
    )
    sources = described(text.replace('unit = "mm", sign = -1 }', 'unit = "in" }')).sources
    assert sources["left.auxiliary_temperature"].conversion.si(68.0) == pytest.approx(293.15)
    assert sources["left.height"].conversion.si(2.0) == pytest.approx(50.8 * mm)
