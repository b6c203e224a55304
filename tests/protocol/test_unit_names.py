"""Units as people spell them: every spelling of a unit means the same, or is refused; never something else."""

import contextlib
import itertools
import re

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bench_protocol.unit_names import UnknownUnit, base_exponents, is_unit, read_unit, unit_in_name
from bench_protocol.units import UNITS


@pytest.mark.parametrize(
    ("text", "si", "factor", "zero"),
    [
        ("KN", "N", 1e3, 0.0),
        ("[kN]", "N", 1e3, 0.0),
        ("kgf", "N", 9.80665, 0.0),
        ("PSI", "Pa", 6894.757293168361, 0.0),
        ("mBar", "Pa", 100.0, 0.0),
        ("hPa", "Pa", 100.0, 0.0),
        ("kgf/cm²", "Pa", 98066.5, 0.0),
        ("N/mm^2", "Pa", 1e6, 0.0),
        ("µm", "m", 1e-6, 0.0),
        ("\u03bcm", "m", 1e-6, 0.0),
        ("msec", "s", 1e-3, 0.0),
        ("°C", "K", 1.0, 273.15),
        ("℃", "K", 1.0, 273.15),
        ("deg C", "K", 1.0, 273.15),
        ("m s⁻²", "m/s2", 1.0, 0.0),
        ("N·m/(rad·Pa)", "N*m/(rad*Pa)", 1.0, 0.0),
        ("mm per sec", "m/s", 1e-3, 0.0),
        ("l/min", "m3/s", 1e-3 / 60.0, 0.0),
        ("MHz", "Hz", 1e6, 0.0),
    ],
)
def test_spellings_of_a_unit_are_that_unit(text: str, si: str, factor: float, zero: float) -> None:
    found = read_unit(text)
    assert found.measures(si)
    assert (found.unit.factor, found.unit.zero) == pytest.approx((factor, zero), rel=1e-12)


@pytest.mark.parametrize(
    "text", ["", "xyz", "F/kN", "Nl/min", "10 mm", "mn", "MPA", "mN/M", "°C/s", "m/", "raw", "/", "()"]
)
def test_what_is_no_unit_or_may_be_two_is_refused(text: str) -> None:
    with pytest.raises(UnknownUnit):
        read_unit(text)


def test_a_pressure_may_state_what_it_is_relative_to() -> None:
    assert [read_unit(text).reading for text in ("barg", "bar(a)", "psia", "kPa abs", "bar")] == [
        "gauge",
        "absolute",
        "absolute",
        "absolute",
        "",
    ]


@given(st.sampled_from(sorted(UNITS)), st.randoms(use_true_random=False))
def test_another_spelling_of_a_unit_has_no_effect(name: str, random_) -> None:
    spelled = name
    for pattern, others in (
        (r"\*", ("·", " ", "*")),
        (r"(?<=[a-z])2", ("²", "^2", "**2", "2")),
        (r"u(?=[mrs])", ("µ", "u")),
    ):
        spelled = re.sub(pattern, lambda _, others=others: random_.choice(others), spelled)
    spelled = random_.choice(("{}", "[{}]", "({})", " {} ")).format(spelled)
    found = read_unit(spelled).unit
    assert base_exponents(found.si) == base_exponents(UNITS[name].si)
    assert (found.factor, found.zero) == pytest.approx((UNITS[name].factor, UNITS[name].zero), rel=1e-12)


@pytest.mark.parametrize("name", sorted(UNITS))
def test_a_unit_in_any_case_is_that_unit_or_is_refused(name: str) -> None:
    for letters in itertools.product(*({one.lower(), one.upper()} for one in name)):
        spelled = "".join(letters)
        able = [UNITS[name].factor]
        if name[0] in "mM" and spelled[1:] == name[1:]:  # mN is a unit as MN is
            able.append(able[0] * {"m": 1e9, "M": 1e-9}[name[0]])
        with contextlib.suppress(UnknownUnit):
            found = read_unit(spelled).unit
            assert base_exponents(found.si) == base_exponents(UNITS[name].si), spelled
            assert any(found.factor == pytest.approx(factor, rel=1e-12) for factor in able), spelled


@given(st.text(max_size=12))
def test_any_text_is_a_unit_or_is_refused(text: str) -> None:
    if is_unit(text):
        assert read_unit(text).unit.factor > 0.0
    unit_in_name(text)


@pytest.mark.parametrize(
    ("name", "unit"),
    [
        ("F [KN]", "KN"),
        ("F (N)", "N"),
        ("F/kN", "kN"),
        ("t/s", "s"),
        ("p in mbar", "mbar"),
        ("speed m/s", "m/s"),
        ("x [furlong]", "furlong"),
        ("F (left)", ""),
        ("p (g)", ""),
        ("m/s", ""),
        ("dp/dt", ""),
        ("x", ""),
    ],
)
def test_the_name_of_a_column_states_its_unit(name: str, unit: str) -> None:
    assert unit_in_name(name) == unit
