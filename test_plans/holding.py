"""Search of a plan's code for hold points. A plan is a program, so there is no list of them."""

import dis
import sys
from collections.abc import Iterable, Iterator
from functools import lru_cache, partial
from types import CodeType, FrameType, FunctionType, ModuleType
from typing import Any, Final

_PLACE: Final = "hold_point"
#: The modules that carry out a plan, and have no hold point of their own.
_RUN: Final = "test_plans.run"
_EXECUTION: Final = "test_plans.execution"
_JUMPING: Final = frozenset((*dis.hasjrel, *dis.hasjabs))
#: The instruction below these is reached from elsewhere only.
_NOT_FOLLOWED: Final = frozenset(
    {"RETURN_VALUE", "RETURN_CONST", "RAISE_VARARGS", "RERAISE", "JUMP_FORWARD", "JUMP_BACKWARD"}
    | {"JUMP_BACKWARD_NO_INTERRUPT"}
)
#: Packages that contain no plan.
_FOREIGN: Final = sys.stdlib_module_names | {"bench_protocol", "bench_records", "drivers", "numpy", "scipy"}


def can_be_held(plan: Any) -> bool:
    """Return whether a plan (`test_plans.plan.Plan`) has a hold point, in one of its parts or in a function that a part
    uses.

    Depending on its parameters, a run may not reach that point.
    """
    return _has_place([plan.setup, plan.main, plan.teardown])


def can_still_be_held(frame: FrameType | None, to_come: Iterable[Any]) -> bool:
    """Return whether a run may still reach a hold point: after its present ``frame``, or in the parts ``to_come``.

    Searches the code that this frame and its callers, up to `test_plans.execution`, can still reach.
    """
    waiting: list[Any] = list(to_come)
    while frame is not None:
        module = frame.f_globals.get("__name__", "")
        if not _foreign(module) and module != _RUN:
            names = _ahead(frame.f_code, frame.f_lasti)
            if _PLACE in names:
                return True
            named = [value for name, value in frame.f_locals.items() if name in names]
            waiting += named
            if module == _EXECUTION:
                break
            waiting += [type(value) for value in named if type(value).__module__ != _RUN]
            waiting += _of_globals(frame.f_globals, names)
        frame = frame.f_back
    return _has_place(waiting)


@lru_cache(maxsize=1024)
def _ahead(code: CodeType, last: int) -> frozenset[str]:
    """Return the names used by the instructions that may run after the instruction at offset ``last``."""
    body = dis.Bytecode(code)
    instructions = list(body)
    places = {one.offset: k for k, one in enumerate(instructions)}
    handlers = [(one.start, one.end, one.target) for one in vars(body)["exception_entries"]]

    def after(one: dis.Instruction) -> Iterator[int]:
        if one.opcode in _JUMPING:
            yield places[one.argval]
        if one.opname not in _NOT_FOLLOWED:
            yield places[one.offset] + 1
        yield from (places[target] for start, end, target in handlers if start <= one.offset < end)

    names: set[str] = set()
    # Inside of a call, ``last`` may be one of the cache entries that follow its instruction.
    called = [one for one in instructions if one.offset <= last][-1:]
    waiting, seen = [k for one in called for k in after(one)] or [0], set[int]()
    while waiting:
        if (k := waiting.pop()) in seen:
            continue
        seen.add(k)
        one = instructions[k]
        if isinstance(one.argval, CodeType):
            names.update(_names(one.argval))
        elif isinstance(one.argval, str) and one.opcode not in dis.hasconst:
            names.add(one.argval)
        waiting += after(one)
    return frozenset(names)


def _has_place(waiting: list[Any]) -> bool:
    """Return whether one of the functions in ``waiting``, or a function that they use, has a hold point."""
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
    """Yield the objects that ``function`` uses: globals with one of ``names``, variables of its closure, and the
    function that it wraps.
    """
    yield getattr(function, "__wrapped__", None)
    yield from (cell.cell_contents for cell in function.__closure__ or () if _filled(cell))
    yield from _of_globals(function.__globals__, names)


def _of_globals(variables: dict[str, Any], names: Iterable[str]) -> Iterator[Any]:
    for name in variables.keys() & names:
        value = variables[name]
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
