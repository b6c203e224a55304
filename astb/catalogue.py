"""Tests that run all plans with a verdict: `pytest --pyargs astb.catalogue --rig local`.

There is one test for each plan, and for each choice of parameters with a few choices (a load, an axis). `-k lateral`
selects tests; `--plan-set amplitude=20mm` sets a parameter, like `astb run --set`, for all plans that have it. The
pytest plugin provides the fixtures. A plan that is blocked, or cannot measure everything, fails its test.
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
    """Yield ``plan`` with the ``given`` parameters and each combination of choices of the others.

    Raises ParameterRefused for an invalid value in ``given``.
    """
    own = {one.name: given[one.name] for one in plan.parameters if one.name in given}
    open_choices = [
        [(one.name, choice) for choice in one.choices]
        for one in plan.parameters
        if one.choices and one.name not in own
    ]
    for choices in product(*open_choices):
        yield plan.given({**own, **dict(choices)})


def pytest_generate_tests(metafunc: pytest.Metafunc) -> None:
    """Generate the tests of all plans that give a verdict, one for each of their `variants`."""
    if "plan" not in metafunc.fixturenames:
        return
    given = dict(text.partition("=")[::2] for text in metafunc.config.getoption("astb_settings"))
    for one in unusable():
        warnings.warn(one, stacklevel=1)
    judging = [one for one in plans().values() if one.judges]
    known = {one.name for plan in judging for one in plan.parameters}
    if unknown := given.keys() - known:
        raise pytest.UsageError(
            f"--plan-set: no plan has a parameter {', '.join(sorted(unknown))}; the parameters are "
            f"{', '.join(sorted(known))}"
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
    """Run the plan. The test passes if the verdict of the plan is *pass*."""
    result = run(plan)
    assert result.verdict == "pass", "\n".join(str(one) for one in result.checks if one.verdict != "pass")
