"""Whether a plan can be held anywhere, which its code tells: a plan is a program, and has no list of its places."""

import sys
from collections.abc import Iterator
from functools import partial
from types import CodeType, FunctionType, ModuleType
from typing import TYPE_CHECKING, Any, Final

if TYPE_CHECKING:
    from test_plans.plan import Plan

_PLACE: Final = "hold_point"
#: What no plan stands in.
_FOREIGN: Final = sys.stdlib_module_names | {"bench_protocol", "bench_records", "drivers", "numpy", "scipy"}


def can_be_held(plan: "Plan") -> bool:
    """Return whether one of the plan's parts, or a function that it names, asks whether the run is to be held.

    Whether the run comes by there is for its parameters to say.
    """
    waiting: list[Any] = [plan.setup, plan.main, plan.teardown]
    seen: set[int] = set()
    while waiting:
        one = waiting.pop()
        if id(one) in seen:
            continue
        seen.add(id(one))
        if isinstance(one, partial):
            waiting += [one.func, *one.args, *one.keywords.values()]
        elif isinstance(one, tuple | list):
            waiting += one
        elif isinstance(one, dict):
            waiting += one.values()
        elif isinstance(one, type) and not _foreign(one.__module__):
            waiting += [value for value in vars(one).values() if isinstance(value, FunctionType)]
        elif isinstance(one, FunctionType) and not _foreign(one.__module__):
            names = set(_names(one.__code__))
            if _PLACE in names:
                return True
            waiting += _named(one, names)
    return False


def _foreign(module: str) -> bool:
    return module.partition(".")[0] in _FOREIGN


def _names(code: CodeType) -> Iterator[str]:
    yield from code.co_names
    for inner in code.co_consts:
        if isinstance(inner, CodeType):
            yield from _names(inner)


def _named(function: FunctionType, names: set[str]) -> Iterator[Any]:
    """Yield what a function may call by its names, or was made with."""
    yield getattr(function, "__wrapped__", None)
    yield from (cell.cell_contents for cell in function.__closure__ or () if _filled(cell))
    for name in names & function.__globals__.keys():
        value = function.__globals__[name]
        if isinstance(value, ModuleType):
            if not _foreign(value.__name__):  # to ask numpy for `np.str`, say, is to be warned
                yield from (getattr(value, inner) for inner in names if hasattr(value, inner))
        else:
            yield value


def _filled(cell: Any) -> bool:
    try:
        return cell.cell_contents is not None
    except ValueError:
        return False
