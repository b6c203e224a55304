"""A wiring file: its contents are read, and errors are reported with file, key and fix."""

import math
import tomllib
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bench_protocol.table import TABLE
from bench_protocol.units import bar, kN, mm, s
from drivers.errors import WiringError
from drivers.wiring.contract import Order
from drivers.wiring.described import open_described
from drivers.wiring.description import describe, read_description
from tests.refusals import refuses

GOOD = """
description = "A stranger's rig"
latency = "100 ms"
identity = { "plc.device" = 4711 }

[transports.plc]
kind = "modbus"
[transports.bus]
kind = "can"

[signals]
"rig.state" = { from = "plc.state", choices = { DISABLED = [0, 1], HOLD = 2, ACTIVE = 3, ESTOP = 12 } }
"left.height" = { from = "plc.left_height", unit = "mm", sign = -1 }
"left.bellows_pressure" = { from = "bus.Air.P1", unit = "bar", calibration = { gain = 1.01, offset = "10 mbar" } }
"left.auxiliary_temperature" = { absent = "no thermometer in the chambers" }
"lateral.force" = { from = ["plc.f1", "plc.f2"], value = "(f1 + f2) / 2", unit = "kN" }
"lateral.displacement_setpoint" = { to = "bus.Set.Lateral", unit = "mm" }
"air.left_mode" = { to = "plc.mode", read = "plc.mode_active", choices = { hold = 0, fill = [5, 6] } }
"air.dpv" = { fixed = "on" }
"lateral.control" = { to = "plc.lateral", choices = { off = 0, displacement = 2 }, initial = "off" }
"action.power_off" = { to = "plc.command", value = [7, 0] }
load_cell.1 = { from = "bus.Cells.Cell1", unit = "kg", calibration = { gain = "9.80665 N/kg" }, sign = -1 }

[sequences]
rest = [{ "plc.command" = 0 }]
at_rest = ["DISABLED", "ESTOP"]
[[sequences.up]]
start = ["DISABLED"]
orders = [{ plc.command = 1 }, { "plc.command" = 2, "air.left_mode" = "hold" }]
end = ["HOLD"]
within = "5 s"
[[sequences.up]]
start = ["HOLD"]
bumpless = true
end = ["ACTIVE"]
"""


def described(text: str):
    return describe(tomllib.loads(text), Path("hall.toml"), TABLE)


@pytest.fixture(scope="module")
def good():
    return described(GOOD)


def test_a_number_of_the_rig_becomes_si_by_unit_sign_and_calibration(good):
    assert good.sources["left.height"].si([12.5]) == pytest.approx(-12.5 * mm)
    assert good.sources["left.bellows_pressure"].si([5.0]) == pytest.approx(5.05 * bar + 0.01 * bar)
    assert good.sources["load_cell.1"].si([1000.0]) == pytest.approx(-9.80665 * kN)
    assert good.sources["lateral.force"].si([3.0, 5.0]) == pytest.approx(4 * kN)
    assert math.isnan(good.sources["lateral.force"].si([3.0, math.nan]))


def test_states_and_choices_are_numbers_of_the_rig(good):
    state = good.sources["rig.state"]
    names = TABLE["rig.state"].choices
    assert [names[int(state.si([number]))] for number in (0, 1, 2, 12)] == [
        "DISABLED",
        "DISABLED",
        "HOLD",
        "ESTOP",
    ]
    assert math.isnan(state.si([4]))
    assert good.settings["air.left_mode"].conversion.number(2) == 5  # fill, the first of its numbers
    assert math.isnan(
        good.settings["air.left_mode"].conversion.number(1)
    )  # level: the rig has no such choice


def test_the_rest_of_the_file(good):
    assert good.capabilities.latency == pytest.approx(0.1)
    assert good.identity == {"plc.device": 4711}
    assert good.absent["left.auxiliary_temperature"] == "no thermometer in the chambers"
    assert good.absent["right.height"] == "the wiring does not mention it"
    assert good.settings["air.dpv"].fixed == 1
    assert good.settings["lateral.control"].initial == 0
    assert good.actions["action.power_off"] == ("plc.command", (7, 0))
    up, active = good.sequences.up
    assert up.orders == (Order({"plc.command": 1}), Order({"plc.command": 2, "air.left_mode": 0}))
    assert (up.start, up.end, up.within, up.bumpless) == (("DISABLED",), ("HOLD",), 5 * s, False)
    assert active.bumpless
    assert good.sequences.at_rest == ("DISABLED", "ESTOP")


def test_a_file_of_version_0_1_calls_the_sequences_conduct(good):
    earlier = GOOD.replace("sequences", "conduct")
    assert described(earlier).sequences == good.sequences
    assert described(earlier).digest == good.digest
    with refuses(WiringError, "hall.toml"):
        described(f"{earlier}\n[sequences]\n")
    with refuses(WiringError, "conduct.at_rest OFF"):
        described(earlier.replace('"DISABLED", "ESTOP"', '"OFF"'))


def test_without_a_generator_the_bench_answers_for_it(good):
    assert "generator.axis" in good.played
    assert "rig.program" in good.played
    assert not good.played & good.absent.keys()
    own = described(GOOD + "[capabilities]\ngenerator = true\n")
    assert not own.played
    assert "generator.axis" in own.absent


SIGNAL = '[transports.plc]\nkind = "modbus"\n[signals]\n'
STATE = '"rig.state" = { from = "plc.state", choices = { DISABLED = 0, ACTIVE = 1 } }\n'

#: Lines of a wiring file, and the reported parts.
BAD_FILES = r"""
[signals]
-> the key transports is missing

[transports]
[signals]
-> hall.toml: transports is empty; add a table

sinals = 1
SIGNALS
-> hall.toml: there is no key 'sinals' here; did you mean 'signals'?

functions = "none.py"
SIGNALS
-> functions = 'none.py': there is no such file in

identity = { "plc.device" = "x" }
SIGNALS
-> identity.plc.device = 'x' is not a number

latency = "soon"
SIGNALS
-> latency = 'soon' is not a time above 0

[player]
speed = "-1 m/s"
SIGNALS
-> player.speed = '-1 m/s' is not above 0; use a positive value

[player]
lever = "1 bar"
SIGNALS
-> player.lever = '1 bar': 'bar' is a unit of another quantity
"""
BAD_SIGNALS = r"""
"left.hight" = { from = "plc.h", unit = "mm" }
-> signals."left.hight" is not a signal; did you mean 'left.height'?

"left.height" = { form = "plc.h", unit = "mm" }
-> signals."left.height": there is no key 'form' here; did you mean 'from'?

"left.height" = { from = "plc.h", unit = "mm" }
[signals.left]
height = { from = "plc.h", unit = "mm" }
-> signals."left.height" occurs twice

"left.height" = { from = "plc.h" }
-> signals."left.height".unit is missing: state the unit in which the rig reports left.height, such as 'mm'

"left.height" = { from = "plc.h", unit = "inch" }
-> "left.height".unit: 'inch' is not a known unit; use one of m, mm, um, cm

"left.height" = { from = "plc.h", unit = "bar" }
-> 'bar' is a unit of another quantity (Pa); use one of m, mm

"load_cell.1" = { from = "plc.h", unit = "kg" }
-> load_cell.1 a force: add calibration = { gain = "9.80665 N/kg" }

"load_cell.1" = { from = "plc.h", unit = "g", calibration = { gain = "9.8 N/kg" } }
-> is per kg, but unit = 'g'

"left.height" = { from = "plc.h", unit = "mm", sign = 2 }
-> signals."left.height": sign = 2;

"left.height" = { from = "plc.h", unit = "mm", calibration = { gain = 0 } }
-> calibration.gain = 0 is not a gain; use a number, such as 1.002

"left.height" = { from = "plc.h", unit = "mm", calibration = { offset = nan } }
-> calibration.offset = nan is not finite

"left.height" = { from = "plc.h", unit = "mm", calibration = { table = [[nan, 0], [1, 2]] } }
-> calibration.table: inf and nan are not allowed

"control.enable" = { to = "plc.h", choices = { on = 1 } }
-> "control.enable".choices lacks off; add the number that is sent for it

"left.height" = { from = "plc.h", unit = "mm", calibration = { offset = "1 bar" } }
-> calibration.offset = '1 bar': 'bar' is a unit of another quantity

"left.height" = { from = "plc.h", unit = "mm", calibration = { table = [[0, 0]] } }
-> must rise from row to row, with two or more rows

"left.height" = { from = "plc.h", unit = "mm", calibration = { table = [[0, 0], [1, 2], [2, 1]] } }
-> the second column must rise, or fall, from row to row

"left.height" = { from = "plc.h", unit = "mm", calibration = { gain = 2, table = [[0, 0], [1, 2]] } }
-> a table replaces gain and offset

"left.height" = { unit = "mm" }
-> from is missing; state the point of the rig, or absent = "reason"

"left.height" = { from = "height", unit = "mm" }
-> from = 'height' is not a point; write TRANSPORT.POINT, such as plc.…

"left.height" = { from = "pcl.h", unit = "mm" }
-> there is no transport 'pcl'; did you mean 'plc'?

"left.height" = { to = "plc.h", unit = "mm" }
-> "left.height".to is not a key of a measurement; the keys are from, value, function, unit

"left.height" = { from = "plc.h", unit = "mm", absent = "none" }
-> has absent and from, unit; keep one of them

"lateral.force" = { from = ["plc.f1", "plc.f2"], unit = "kN" }
-> from has 2 points; add value (an expression) or function

"lateral.force" = { from = ["plc.f1", "plc.f2"], value = "f1 + f3", unit = "kN" }
-> "lateral.force".value = 'f1 + f3': unknown name 'f3'; use one of f1, f2

"lateral.force" = { from = "plc.f1", value = "f1.real", unit = "kN" }
-> 'f1.real' is not allowed here; use numbers, names, + - * /

"lateral.force" = { from = "plc.f1", function = "total", unit = "kN" }
-> the key functions is missing

"lateral.force_setpoint" = { to = "plc.f", unit = "kN" }
"lateral.displacement_setpoint" = { to = "plc.f", unit = "mm" }
-> is already written by lateral.force_setpoint

"rig.state" = { from = "plc.state" }
-> choices is missing; state the number that the rig uses for each of OFF | BOOT

"rig.state" = { from = "plc.state", choices = { HOLD = [] } }
-> choices.HOLD has no number

"rig.state" = { from = "plc.state", choices = { HOLT = 1 } }
-> 'HOLT' is not a choice of rig.state; did you mean 'HOLD'?

"rig.state" = { from = "plc.state", choices = { HOLD = 1, ACTIVE = [2, 1] } }
-> the number 1 means HOLD and ACTIVE; use it for one of them only

"rig.state" = { from = "plc.state", unit = "mm" }
-> rig.state is a choice (OFF | BOOT

"left.height" = { from = "plc.h", unit = "mm", choices = { a = 1 } }
-> left.height is a number in mm; use unit instead of choices

"air.left_mode" = { fixed = "levl" }
-> fixed = 'levl' is not a choice of air.left_mode; did you mean 'level'?

"air.left_mode" = { fixed = "level", to = "plc.m" }
-> is fixed, so nothing is written or read

"air.left_target" = { fixed = 3 }
-> fixed = 3 has no unit; write it like "3 bar"

"air.left_target" = { fixed = "30 bar" }
-> is out of the range of air.left_target; use 0 to 9 bar

"air.left_target" = { to = "plc.t", unit = "bar", within = "2" }
-> within = '2' is not a time above 0 with its unit

"air.left_target" = { to = "plc.t", read = "plc.r", initial = "1 bar", unit = "bar" }
-> has read and initial

"generator.axis" = { to = "plc.axis", choices = { vertical = 1 } }
-> this computer plays the waves of a rig without a generator

[sequences]
rest = [{ "plc.c" = 0 }]
-> signals."rig.state" is missing or absent; state the point of "rig.state"
"""
BAD_SEQUENCES = r"""
[[sequences.up]]
start = ["DISABLED"]
end = ["HOLD"]
-> sequences.up[1].end: the rig never reports HOLD; signals."rig.state".choices has DISABLED, ACTIVE

[[sequences.up]]
start = ["DISABLD"]
end = ["ACTIVE"]
-> 'DISABLD' is not a state of a bench; did you mean 'DISABLED'?

[[sequences.up]]
start = ["DISABLED"]
end = []
-> sequences.up[1].end is empty

[sequences]
rest = [{ "plk.c" = 0 }]
-> sequences.rest[1]: 'plk.c' is neither a signal nor a point

[sequences]
rest = [{ "plc.c" = "off" }]
-> sequences.rest[1].plc.c = 'off' is not a number

[sequences]
rest = [{ "left.height" = 0 }]
-> left.height is a measurement and cannot be ordered

[sequences]
rest = [{ "air.left_mode" = "vent" }]
-> the rig has no air.left_mode (the wiring does not mention it)

[sequences]
open = [{ "lease.nonce" = 1 }]
-> the rig has no lease.nonce (the wiring does not mention it)

"air.dpv" = { to = "plc.dpv" }
[sequences]
apply = [{ "plc.apply" = 1, "air.dpv" = "on" }]
-> sequences.apply: air.dpv is a setting; use points and actions

[sequences]
at_rest = ["OFF"]
-> sequences.at_rest: the rig never reports OFF
"""


def _cases():
    """Yield invalid files, each with the expected report."""
    for texts, head in ((BAD_FILES, ""), (BAD_SIGNALS, SIGNAL), (BAD_SEQUENCES, SIGNAL + STATE)):
        for case in texts.strip().split("\n\n"):
            lines, message = case.split("\n-> ")
            yield head + lines.replace("SIGNALS", SIGNAL), message


@pytest.mark.parametrize(("text", "message"), list(_cases()))
def test_a_bad_description_says_what_would_be_right(text, message):
    with pytest.raises(WiringError) as told:
        described(text)
    assert message in str(told.value)
    assert str(told.value).startswith("hall.toml: ")


def test_the_example_of_the_reference_page_is_a_wiring_whose_points_are_there():
    page = (Path(__file__).parents[2] / "docs" / "reference" / "wiring.md").read_text()
    example = next(block for block in page.split("```toml\n") if block.startswith("description")).split(
        "```"
    )[0]
    wiring = open_described("hall", described(example))
    assert wiring.absent["left.bellows_temperature"] == "no thermometer in the bellows"


def test_what_stands_under_a_key_of_a_rig_file_says_so():
    with refuses(WiringError, 'rig.toml wiring.signals."left.hight"'):
        describe(tomllib.loads(SIGNAL + '"left.hight" = {}'), Path("rig.toml"), TABLE, "wiring")


def test_a_file_that_cannot_be_read(tmp_path):
    with refuses(WiringError):
        read_description(tmp_path / "none.toml", TABLE)
    (tmp_path / "bad.toml").write_text("a = \n")
    with refuses(WiringError, "bad.toml TOML"):
        read_description(tmp_path / "bad.toml", TABLE)


_LEAVES = st.one_of(
    st.none(), st.booleans(), st.integers(-3, 70_000), st.floats(), st.text(max_size=8), st.just("plc.state"),
    st.sampled_from(["5 bar", "N/kg", "-1 mm", "nan s", "plc.", ".x", "ACTIVE", "rig.state", "lease.nonce"]),
    st.lists(st.integers(0, 9) | st.just("a"), max_size=2),
    st.dictionaries(st.text(max_size=3), st.integers(), max_size=2),
)  # fmt: skip


def _places(value, path=()):
    """Yield the path of every value in nested tables and lists."""
    for key, one in value.items() if isinstance(value, dict) else enumerate(value):
        yield (*path, key)
        if isinstance(one, dict | list):
            yield from _places(one, (*path, key))


@settings(max_examples=60, deadline=None)
@given(st.data())
def test_whatever_a_file_says_it_is_read_or_refused_in_words(data):
    keys = tomllib.loads(GOOD)
    for _ in range(data.draw(st.integers(1, 3))):
        path = data.draw(st.sampled_from(list(_places(keys))))
        place = keys
        for key in path[:-1]:
            place = place[key]
        if isinstance(place, dict) and data.draw(st.booleans()):
            place[data.draw(st.text(max_size=6) | st.sampled_from(["to", "absent", "fixed", "value"]))] = (
                place.pop(path[-1])
            )
        else:
            place[path[-1]] = data.draw(_LEAVES)
    try:
        describe(keys, Path("hall.toml"), TABLE)
    except WiringError as error:
        assert str(error).startswith("hall.toml")


# -- functions of the user's own ---------------------------------------------------------------------------------


def _with_function(tmp_path, code: str, function: str = "total"):
    (tmp_path / "own.py").write_text(code)
    text = (
        'functions = "own.py"\n'
        + SIGNAL
        + f'"lateral.force" = {{ from = ["plc.a", "plc.b"], function = "{function}", unit = "kN" }}'
    )
    (tmp_path / "hall.toml").write_text(text)
    return read_description(tmp_path / "hall.toml", TABLE)


def test_a_function_of_the_users_own(tmp_path):
    read = _with_function(tmp_path, "def total(a, b):\n    return a - 2 * b\n")
    assert read.sources["lateral.force"].si([5.0, 1.0]) == pytest.approx(3 * kN)


@pytest.mark.parametrize(
    ("code", "message"),
    [
        ("def totel(a, b):\n    return a\n", "'total' is not a function of own.py; did you mean 'totel'?"),
        ("def total(a):\n    return a\n", "it must accept 2 numbers, one for each point"),
        ("1 / 0\n", "own.py cannot be run: ZeroDivisionError"),
    ],
)
def test_a_function_that_cannot_be_called(tmp_path, code, message):
    with pytest.raises(WiringError) as told:
        _with_function(tmp_path, code)
    assert message in str(told.value)
