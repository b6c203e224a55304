"""Each check has a separate sentence, which goes with it to the report."""

import pytest

from bench_records.check_table import meanings
from bench_records.recorder import Recorder
from bench_records.report import report_page
from bench_records.result import Result, check, conclude
from test_plans.check_names import CheckName, about
from test_plans.discovery import plans

CATALOGUE = plans()


@pytest.mark.parametrize("plan", CATALOGUE.values(), ids=CATALOGUE)
def test_every_check_of_a_plan_has_a_sentence_of_its_own(plan):
    assert plan.checks, "a plan checks something"
    for one in plan.checks:
        assert one.about, one
    assert len({one.about for one in plan.checks}) == len(set(plan.checks)) == len(plan.checks)


def test_no_two_checks_of_the_catalogue_share_a_sentence():
    names: dict[str, set[str]] = {}
    for plan in CATALOGUE.values():
        for one in plan.checks:
            names.setdefault(one.about, set()).add(one)
    assert [found for found in names.values() if len(found) > 1] == []


def test_a_name_keeps_its_sentence_when_its_places_are_filled():
    name = CheckName("{side} valve at {f:g} Hz", "What it is: why.")
    filled = name.of(", later", side="left", f=2.0)
    assert (filled, about(filled)) == ("left valve at 2 Hz, later", "What it is: why.")
    assert name.shown == "<side> valve at <f> Hz"
    assert about("plain") == ""


def test_the_report_prints_each_sentence_once_at_the_failed_check(tmp_path):
    kinds = {"wide": "How wide it is: it must fit.", "high": "How high it is: it must not strike."}
    found = [
        check(f"{kind} {n}", value, "m", low=0.0, high=1.0, about=why)
        for kind, why in kinds.items()
        for n, value in enumerate((0.5, 0.5, 0.5, 0.5) if kind == "wide" else (2.0,))
    ]
    names = [(one.names, one.about) for one in meanings(found)]
    assert names == [("wide 0; wide 1; and 2 like these", kinds["wide"]), ("high 0", kinds["high"])]
    result = conclude("aw0", "Title.", "Title.", found)
    assert Result.from_json(result.to_json()) == result
    with Recorder(tmp_path, [], {"plan": "aw0"}, start_ns=0):
        pass
    result.write(tmp_path)
    page = report_page(tmp_path)
    assert page.count(kinds["wide"]) == 1
    assert page.count(kinds["high"]) == 2, "also at the failed check"
