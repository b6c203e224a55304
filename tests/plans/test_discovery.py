"""A file with a plan in it is a plan, without a list."""

import re
import sys
from importlib.metadata import EntryPoint
from pathlib import Path
from types import ModuleType

import pytest

import test_plans.plans
from bench_records.result import Outcome
from test_plans import discovery
from test_plans.execution import execute
from test_plans.plans.under_load import aw0

NEWCOMER = '''
"""Newcomer: hold the load for a while."""

from test_plans.plan import plan
from test_plans.run import Run


@plan
def newcomer_of_the_test(run: Run) -> None:
    """Newcomer: hold the load for a while."""
    run.bench.wait(1.0)
'''


@pytest.fixture
def find():
    """Find all plans again, now and after any change."""
    yield discovery.find_all.__wrapped__
    for name in (
        "our_plans",
        *(f"test_plans.{plan}" for plan in ("newcomer_of_the_test", "lateral_push", "symmetry")),
    ):
        sys.modules.pop(name, None)


def module(name: str, **content: object) -> ModuleType:
    made = ModuleType(name)
    vars(made).update(content)
    return made


def test_a_new_file_is_a_new_plan(find, tmp_path, monkeypatch):
    (tmp_path / "newcomer_of_the_test.py").write_text(NEWCOMER)
    monkeypatch.setattr(test_plans.plans, "__path__", [*test_plans.plans.__path__, str(tmp_path)])
    found = find().plans
    assert found["newcomer_of_the_test"].title == "Newcomer: hold the load for a while."
    assert list(found) == sorted(found)


def test_the_recipe_in_contributing_works_to_the_letter(find, tmp_path, monkeypatch, bench_composed):
    recipe = (Path(__file__).parents[2] / "CONTRIBUTING.md").read_text(encoding="utf-8")
    code = re.search(r"`test_plans/plans/symmetry\.py`:\n\n```python\n(.*?)```", recipe, re.DOTALL)[1]
    (tmp_path / "symmetry.py").write_text(code, encoding="utf-8")
    monkeypatch.setattr(test_plans.plans, "__path__", [*test_plans.plans.__path__, str(tmp_path)])
    plan = find().plans["symmetry"]
    with bench_composed() as made:
        assert execute(plan, made.bench, tmp_path / "sound").verdict is Outcome.PASS
    with bench_composed(effective_area=[0.26, 0.24]) as made:
        result = execute(plan, made.bench, tmp_path / "unlike")
    assert (result.verdict, result.duration) == (Outcome.FAIL, pytest.approx(plan.lasts, rel=0.2))


def test_the_plan_with_parameters_in_the_how_to_works_to_the_letter(
    find, tmp_path, monkeypatch, bench_composed
):
    page = Path(__file__).parents[2] / "docs" / "how-to" / "write-plans.md"
    code = re.search(r"```python\n(.*?)```", page.read_text(encoding="utf-8"), re.DOTALL)[1]
    (tmp_path / "lateral_push.py").write_text(f'"""A push."""\n{code}', encoding="utf-8")
    monkeypatch.setattr(test_plans.plans, "__path__", [*test_plans.plans.__path__, str(tmp_path)])
    plan = find().plans["lateral_push"]
    with bench_composed() as made:
        result = execute(plan.given({"load": "AW3", "way": "8 mm"}), made.bench, tmp_path / "sound")
    assert result.verdict is Outcome.PASS, result.reason or result.checks
    with bench_composed(shell_stiffness_lateral=0.0, membrane_length=0.15) as made:
        assert execute(plan, made.bench, tmp_path / "soft").verdict is Outcome.FAIL


def test_a_package_of_ones_own_brings_plans_through_an_entry_point(find, tmp_path, monkeypatch):
    (tmp_path / "our_plans.py").write_text(NEWCOMER)
    monkeypatch.syspath_prepend(tmp_path)
    entry = EntryPoint("ours", "our_plans", discovery.GROUP)
    monkeypatch.setattr(discovery, "entry_points", lambda group: [entry] if group == entry.group else [])
    assert "newcomer_of_the_test" in find().plans


def test_of_two_plans_with_one_name_the_first_counts():
    other = module("ours", mine=aw0.__class__("aw0", "", "", aw0.main, aw0.setup, aw0.teardown))
    found = discovery.by_name([module("theirs", aw0=aw0), other])
    assert found.plans == {"aw0": aw0}
    (told,) = found.unusable
    assert all(word in told for word in ("ours", "theirs", "aw0"))


def test_a_plan_that_a_file_only_imports_is_no_second_one():
    found = discovery.by_name([module("its", aw0=aw0), module("another", aw0=aw0, both=(aw0, aw0))])
    assert found == ({"aw0": aw0}, [])


def test_a_file_that_cannot_be_imported_is_named(find, tmp_path, monkeypatch):
    (tmp_path / "half_written.py").write_text("def f(:\n")
    monkeypatch.setattr(test_plans.plans, "__path__", [*test_plans.plans.__path__, str(tmp_path)])
    found = find()
    assert "aw0" in found.plans
    (told,) = found.unusable
    assert re.search(r"test_plans\.plans\.half_written cannot be imported: SyntaxError: .*line 1", told)
