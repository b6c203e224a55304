"""Parameters of a plan: declared at the function, parsed with units, refused before motion."""

import math
import re
from typing import Annotated, Literal

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bench_protocol.units import Hz, mm, s
from bench_records.junit import junit
from bench_records.record import read
from bench_records.report import write_report
from bench_records.result import read_result
from test_plans.execution import execute
from test_plans.parameters import ParameterRefused, Range
from test_plans.plan import plan
from test_plans.run import PlanError, Run
from tests.refusals import refuses


def take_up(run: Run, load: str) -> None:
    run.say(f"takes up {load}")


@plan(setup=take_up, teardown=lambda run: None)
def probe(
    run: Run,
    *,
    amplitude: Annotated[float, Range(1 * mm, 50 * mm, "mm")] = 20 * mm,
    cycles: Annotated[int, Range(1, 20)] = 3,
    load: Literal["AW0", "AW3"] = "AW0",
) -> None:
    """Probe: a plan with parameters."""
    run.check("amplitude", amplitude, "mm", low=0.0, high=1.0)
    run.check("cycles", cycles, "1", low=0.0, high=100.0)
    run.say(f"main {load}")


def test_a_plan_knows_its_parameters_with_unit_range_and_default():
    told = [(one.name, one.show(one.default), one.allowed) for one in probe.parameters]
    assert told == [
        ("amplitude", "20 mm", "1 to 50 mm"),
        ("cycles", "3", "1 to 20"),
        ("load", "AW0", "AW0, AW3"),
    ]
    assert probe.values == {"amplitude": 0.020, "cycles": 3, "load": "AW0"}


def test_values_are_read_as_people_write_them_and_a_set_plan_leaves_the_first_as_it_was():
    made = probe.given({"amplitude": "3.5mm", "load": "AW3", "cycles": 7})
    assert made.values == {"amplitude": 0.0035, "cycles": 7, "load": "AW3"}
    assert probe.given({"amplitude": "0.05 m"}).values["amplitude"] == 50 * mm, "both ends belong to it"
    assert probe.values["amplitude"] == 20 * mm


@given(st.floats(0.001, 0.05))
def test_what_is_shown_reads_as_the_same_number(value):
    (amplitude, *_) = probe.parameters
    if value in amplitude.range:
        assert amplitude.read(amplitude.show(value)) == pytest.approx(value, rel=1e-11)


@pytest.mark.parametrize(
    ("texts", "told"),
    [
        ({"amplitude": "80mm"}, "probe: amplitude = 80 mm is outside 1 to 50 mm"),
        ({"amplitude": "-5 mm"}, "probe: amplitude = -5 mm is outside 1 to 50 mm"),
        ({"amplitude": "nan mm"}, "probe: amplitude = nan mm is outside 1 to 50 mm"),
        (
            {"amplitude": "20"},
            "probe: amplitude = '20' has a missing or wrong unit; use m or mm; the range is 1 to 50 mm",
        ),
        (
            {"amplitude": "20 bar"},
            "probe: amplitude = '20 bar' has a missing or wrong unit; use m or mm; the range is 1 to 50 mm",
        ),
        (
            {"amplitude": "wide"},
            "probe: amplitude = 'wide' is not a number with its unit; use a number in m or mm; the range is 1 to 50",
        ),
        ({"amplitude": True}, "probe: amplitude = True is not a number with its unit"),
        ({"cycles": "2.5"}, "probe: cycles = 2.5 is not a whole number; use one from 1 to 20"),
        ({"load": "AW9"}, "probe: load = 'AW9' is unknown; use one of AW0, AW3"),
        ({"amplitud": "20mm"}, "probe has no parameter amplitud; did you mean 'amplitude'?"),
        ({"x": "1"}, "probe has no parameter x; use one of amplitude, cycles, load"),
    ],
)
def test_a_bad_value_is_refused_with_name_value_unit_and_range(texts, told):
    with pytest.raises(ParameterRefused, match=re.escape(told)):
        probe.given(texts)


def test_parts_receive_named_values_which_the_result_records(bench_composed, tmp_path):
    with bench_composed() as made:
        result = execute(probe.given({"amplitude": "12.5 mm", "load": "AW3"}), made.bench, tmp_path)
    assert [one.number for one in result.checks] == [12.5 * mm, 3.0]
    notes = [event.text for event in read(tmp_path).events if event.kind == "note"]
    assert ("takes up AW3" in notes, "main AW3" in notes) == (True, True)
    assert read_result(tmp_path).parameters == {"amplitude": "12.5 mm", "cycles": "3", "load": "AW3"}
    assert b'name="parameter amplitude" value="12.5 mm"' in junit(result)
    assert read(tmp_path).meta["set"]["load"] == "AW3"
    page = write_report(tmp_path).read_text(encoding="utf-8")
    assert "<dt>amplitude</dt><dd>12.5 mm</dd>" in page[: page.index("</header>")]


def without_default(run: Run, *, time: Annotated[float, Range(1 * s, 2 * s, "s")]) -> None:
    """A parameter that has to be given."""


def without_range(run: Run, *, time: float = 1 * s) -> None:
    """A parameter without a range."""


def outside(run: Run, *, time: Annotated[float, Range(1 * s, 2 * s, "s")] = 3 * s) -> None:
    """A default that the plan itself would refuse."""


def no_choice(run: Run, *, load: Literal["AW0"] = "AW3") -> None:
    """A default that is no choice."""


@pytest.mark.parametrize(
    ("main", "told"),
    [
        (without_default, "plan without_default: parameter time has no default"),
        (without_range, "plan without_range: parameter time is declared <class 'float'>; use Annotated"),
        (outside, "plan outside: parameter time has the default 3 s, which is not allowed; use 1 to 2 s"),
        (no_choice, "plan no_choice: parameter load has the default AW3, which is not allowed; use AW0"),
    ],
)
def test_a_parameter_that_is_declared_badly_is_the_plans_fault(main, told):
    with pytest.raises(PlanError, match=re.escape(told)):
        plan(main)


def test_a_set_up_with_an_unknown_plan_parameter_is_reported():
    def idle(run: Run) -> None:
        """Nothing to set."""

    with refuses(PlanError, "take_up"):
        plan(setup=take_up)(idle)


@pytest.mark.parametrize(
    ("ends", "told"),
    [((2, 1, "mm"), "2 1 lower"), ((1, 2, "furlong"), "'furlong'")],
)
def test_an_empty_range_is_refused(ends, told):
    with refuses(ValueError, told):
        Range(*ends)


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_no_range_contains_a_non_number(value):
    assert value not in Range(0.1 * Hz, 10 * Hz, "Hz")
