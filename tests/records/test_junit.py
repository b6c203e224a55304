"""CI servers count tests, failures and errors: the totals must be those of the cases."""

import math
from pathlib import Path
from xml.etree import ElementTree as ET

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bench_records.junit import junit, write_junit
from bench_records.layout import Phase
from bench_records.result import SpecimenFacts, check, conclude

values = st.sampled_from([1.0, 2.0, 5.0, math.nan])


@given(
    found=st.lists(values, max_size=8),
    reason=st.sampled_from(["", "the rig tripped"]),
    name=st.text(max_size=30),
)
def test_totals_are_those_of_the_cases(found: list[float], reason: str, name: str) -> None:
    checks = [check(f"{name} {i}", value, low=0.0, high=2.0, note=name) for i, value in enumerate(found)]
    result = conclude("aw0", name, name, checks, reason=reason, phases=[Phase("main", 0.0, 12.5)])
    root = ET.fromstring(junit(result))
    suite = root[0]
    cases = suite.findall("testcase")
    for element in (root, suite):
        assert int(element.get("tests")) == len(cases) == len(checks) + 1
        assert int(element.get("failures")) == len(suite.findall("testcase/failure"))
        assert int(element.get("errors")) == len(suite.findall("testcase/error"))
        assert element.get("time") == "12.500"
    assert len(suite.findall("testcase/failure")) == sum(value == 5.0 for value in found)
    bad = suite.findall("testcase/failure") + suite.findall("testcase/error")
    assert bool(bad) == (result.verdict != "pass")
    assert all(case.get("classname") and case.get("name") and case.get("time") for case in cases)


def test_messages_say_what_was_wrong() -> None:
    checks = [
        check("pressure", 2.24e5, "bar", 1e5, low=2e5, high=2.1e5, note="too full"),
        check("height", math.nan, "mm", 1e-3, high=1e-3),
    ]
    suite = ET.fromstring(
        junit(conclude("aw0", "", "", checks, reason="the supply failed", rig="local", seed=3))
    )[0]
    failure = suite.find("testcase[@name='pressure']/failure")
    assert failure.get("message") == "pressure = 2.24 bar (2 to 2.1 bar): fail"
    assert failure.text == "too full"
    assert "no value" in suite.find("testcase[@name='height']/error").get("message")
    assert suite.find("testcase[@name='run']/error").attrib == {
        "type": "blocked",
        "message": "the supply failed",
    }
    assert {p.get("name"): p.get("value") for p in suite.iter("property")} == {
        "rig": "local", "seed": "3", "verdict": "blocked",
    }  # fmt: skip


@pytest.mark.parametrize("odd", ["\x00", "\x1b[31m", "\ufffe", "\ud800", "<&\"'>]]>"])
def test_odd_characters_do_not_break_the_document(odd: str) -> None:
    root = ET.fromstring(junit(conclude("aw0", odd, odd, [check(odd, 3, high=2, note=odd)], reason=odd)))
    assert len(root[0].findall("testcase")) == 2


def test_the_file_is_the_same_each_time(tmp_path: Path, passed_run: Path) -> None:
    from bench_records.result import read_result

    first = write_junit(read_result(passed_run), tmp_path).read_bytes()
    assert write_junit(read_result(passed_run), tmp_path).read_bytes() == first
    assert first.startswith(b"<?xml version='1.0' encoding='utf-8'?>")


def test_times_are_those_of_the_run_and_only_real_time_has_a_date() -> None:
    checks = [check("a", 1, high=2, at=10.0), check("b", 1, high=2, at=10.0), check("c", 1, high=2, at=90.5)]
    result = conclude("aw0", "", "", checks, phases=[Phase("main", 0.0, 100.0)], began="2026-11-22T21:33:05Z")
    suite = ET.fromstring(junit(result))[0]
    assert suite.get("timestamp") == "2026-11-22T21:33:05"
    times = {case.get("name"): float(case.get("time")) for case in suite.iter("testcase")}
    assert times == {"run": 9.5, "a": 10.0, "b": 0.0, "c": 80.5}
    assert ET.fromstring(junit(conclude("aw0", "", "", checks)))[0].get("timestamp") is None


@given(
    st.lists(
        st.dictionaries(st.sampled_from(["a", "b"]), st.text("0.5 m[]=é", max_size=5)), min_size=2, max_size=4
    )
)
def test_runs_with_other_parameters_have_other_names(given_to: list[dict[str, str]]) -> None:
    """As CI servers distinguish cases: by suite, class and name."""
    found = {}
    for parameters in given_to:
        result = conclude("aw0", "", "", [check("pressure", 1.0, high=2.0)], parameters=parameters)
        suite = ET.fromstring(junit(result))[0]
        names = [(suite.get("name"), one.get("classname"), one.get("name")) for one in suite.iter("testcase")]
        assert len(set(names)) == 2
        told = ET.fromstring(
            junit(conclude("x", "", "", [], reason=str(sorted(parameters.items()))))
        )  # as XML states it
        found.setdefault(told[0].find("testcase/error").get("message"), set()).update(names)
    for key, names in found.items():
        assert not any(names & others for other, others in found.items() if other != key)


def test_runs_of_two_specimens_have_other_names() -> None:
    names = []
    for number in ("A1", "A2"):
        result = conclude("aw0", "", "", [check("pressure", 1.0, high=2.0)])
        facts = SpecimenFacts(type="spring", serial_number=number)
        suite = ET.fromstring(junit(msgspec.structs.replace(result, specimen=facts)))[0]
        names += [suite.get("name"), *(case.get("name") for case in suite.iter("testcase"))]
    assert len(set(names)) == len(names) == 6
