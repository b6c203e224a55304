"""The test plans by name, found in the files that declare them: here, and where an installed package keeps its own."""

from collections.abc import Iterable, Iterator
from functools import cache
from importlib import import_module
from importlib.metadata import entry_points
from pkgutil import iter_modules
from types import ModuleType
from typing import Final

import test_plans
from test_plans.plan import Plan
from test_plans.run import PlanError

#: Entry points of this group name a module with plans outside this package: ``ours = "our_plans.creep"``.
GROUP: Final = "astb.plans"


@cache
def plans() -> dict[str, Plan]:
    """Return all plans by name, in the order of their names.

    PlanError if a file cannot be imported, or if two plans have one name.
    """
    return by_name(_modules())


def by_name(modules: Iterable[ModuleType]) -> dict[str, Plan]:
    """Return the plans that ``modules`` declare. PlanError if two have one name; it says where both stand."""
    found: dict[str, tuple[Plan, str]] = {}
    for module in modules:
        for plan in declared(module):
            other, where = found.setdefault(plan.name, (plan, module.__name__))
            if other is not plan:
                raise PlanError(
                    f"two plans are named {plan.name}, in {where} and in {module.__name__}: rename one"
                )
    return {name: found[name][0] for name in sorted(found)}


def declared(module: ModuleType) -> Iterator[Plan]:
    """Yield the plans that stand at the top of ``module``, on their own or in a tuple."""
    for value in vars(module).values():
        for one in value if isinstance(value, tuple) else (value,):
            if isinstance(one, Plan):
                yield one


def _modules() -> Iterator[ModuleType]:
    names = [f"{test_plans.__name__}.{module.name}" for module in iter_modules(test_plans.__path__)]
    for name in (*names, *(entry.module for entry in entry_points(group=GROUP))):
        try:
            yield import_module(name)
        except Exception as error:
            raise PlanError(f"{name} cannot be imported: {type(error).__name__}: {error}") from error
