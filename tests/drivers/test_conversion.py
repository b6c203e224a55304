"""A rig's number in SI and back: expressions, units, calibrations."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bench_protocol.table import TABLE
from bench_protocol.units import mm
from drivers.errors import WiringError
from drivers.wiring.conversion import Calibration, conversion
from drivers.wiring.expression import expression


@pytest.mark.parametrize(
    ("text", "value"),
    [("a + b * 2", 7), ("-(a - b) / 4", 0.5), ("max(a, b, 2)", 3), ("min(a, b) + abs(-a)", 2), ("1e3", 1000)],
)
def test_an_expression(text, value):
    assert expression("value", text, ["a", "b"])([1.0, 3.0]) == value


def test_a_division_by_zero_is_no_value():
    assert math.isnan(expression("value", "1 / a", ["a"])([0.0]))


@pytest.mark.parametrize(
    "text",
    ["__import__('os')", "a ** 9", "a if b else 1", "(lambda: a)()", "[a][0]", "a < b", "'a'", "True", "a @ b",
     "max(*a)", "max(a)", "abs(a, b)", "min(a, key=b)", "a :=1", "", "a\nb", "f(a)", "0" * 600],
)  # fmt: skip
def test_anything_else_is_refused(text):
    with pytest.raises(WiringError):
        expression("value", text, ["a", "b"])


_GAINS = st.floats(0.01, 100) | st.floats(-100, -0.01)


@given(
    st.floats(-0.3, 0.3),
    _GAINS,
    st.floats(-50, 50),
    st.sampled_from([1, -1]),
    st.sampled_from(["mm", "m", "cm"]),
)
def test_what_is_written_is_what_would_be_read(value, gain, offset, sign, unit):
    signal = TABLE["lateral.displacement_setpoint"]
    calibration = Calibration(gain=gain, offset=offset)
    one = conversion("x", signal, unit=unit, sign=sign, calibration=calibration, choices={})
    assert one.si(one.number(value)) == pytest.approx(value, abs=1e-9)


@given(
    st.lists(st.tuples(st.floats(0.1, 10), st.floats(0.1, 10)), min_size=2, max_size=8),
    st.sampled_from([1, -1]),
    st.sampled_from([1, -1]),
    st.floats(-200, 200),
)
def test_a_table_is_the_same_line_both_ways(steps, falling, sign, number):
    signal = TABLE["left.height"]
    table, x, y = [], 0.0, 0.0
    for dx, dy in steps:
        x, y = x + dx, y + falling * dy
        table.append((x, y))
    one = conversion("x", signal, unit="mm", sign=sign, calibration=Calibration(table=table), choices={})
    assert one.number(one.si(number)) == pytest.approx(number, abs=1e-6, rel=1e-6)
    for raw, meaning in table:
        assert one.si(raw) == pytest.approx(sign * meaning * mm)


def test_a_temperature_has_its_zero():
    one = conversion(
        "x", TABLE["left.bellows_temperature"], unit="degC", sign=1, calibration=None, choices={}
    )
    assert one.si(20.0) == pytest.approx(293.15)
    assert one.number(293.15) == pytest.approx(20.0)
