"""The catalogue of plans that judge, as tests: `pytest --pyargs astb.catalogue --rig local`.

One test a plan, and where a parameter has a few choices (a load, an axis) one for each of them. `-k lateral` takes some
of them; `--plan-set amplitude=20mm` gives a parameter, as `astb run --set` does, to all plans that have one of that
name. The plugin of pytest gives the fixtures; a plan that is blocked, or cannot measure everything, does not pass.
"""

import warnings
from collections.abc import Iterator, Mapping
from itertools import product
from typing import TYPE_CHECKING

import pytest

from test_plans.discovery import plans, unusable
from test_plans.parameters import ParameterRefused
from test_plans.plan import Plan

if TYPE_CHECKING:
    from collections.abc import Callable

    from bench_records.result import Result


def variants(plan: Plan, given: Mapping[str, str]) -> Iterator[Plan]:
    """Yield ``plan`` with each combination of those choices that are not ``given``. ParameterRefused as it says."""
    own = {one.name: given[one.name] for one in plan.parameters if one.name in given}
    open_choices = [
        [(one.name, choice) for choice in one.choices]
        for one in plan.parameters
        if one.choices and one.name not in own
    ]
    for choices in product(*open_choices):
        yield plan.given({**own, **dict(choices)})


def pytest_generate_tests(metafunc: pytest.Metafunc) -> None:
    """Make a test of every plan that judges."""
    if "plan" not in metafunc.fixturenames:
        return
    given = dict(text.partition("=")[::2] for text in metafunc.config.getoption("astb_settings"))
    for one in unusable():
        warnings.warn(one, stacklevel=1)
    judging = [one for one in plans().values() if one.judges]
    known = {one.name for plan in judging for one in plan.parameters}
    if unknown := given.keys() - known:
        raise pytest.UsageError(
            f"--plan-set: no plan has a parameter {', '.join(sorted(unknown))}; there are {', '.join(sorted(known))}"
        )
    try:
        chosen = [variant for plan in judging for variant in variants(plan, given)]
    except ParameterRefused as error:
        raise pytest.UsageError(f"--plan-set: {error}") from None
    metafunc.parametrize("plan", chosen, ids=[_name(one) for one in chosen])


def _name(plan: Plan) -> str:
    written = ",".join(f"{name}={value}" for name, value in plan.written.items())
    return f"{plan.name} {written}".rstrip()


def test_plan(run: "Callable[[Plan], Result]", plan: Plan) -> None:
    """Run the plan; it passes if everything that it measures does."""
    result = run(plan)
    assert result.verdict == "pass", "\n".join(str(one) for one in result.checks if one.verdict != "pass")
