"""Search for mistakes in the source of a plan before any motion: names, readings, signals, units."""

from __future__ import annotations

import ast
import builtins
import dis
import inspect
import re
from collections.abc import Callable, Iterator
from pathlib import Path
from textwrap import dedent
from types import CodeType
from typing import TYPE_CHECKING, Any, Final

from bench_protocol.suggestion import did_you_mean
from bench_protocol.table import TABLE
from bench_protocol.units import FACTORS
from drivers.bench import Bench
from drivers.declarations import Device
from test_plans.run import Run

if TYPE_CHECKING:
    from test_plans.plan import Plan

#: Methods of a bench that take names of signals.
_OF_SIGNALS: Final = ("averages", "capture")


def mistakes(plan: Plan, run: Run) -> list[str]:
    """Return a text for each mistake in the parts of ``plan``, with file, line and correction.

    Only mistakes that are certain to raise an error when the line is executed are reported.
    """
    found: list[str] = []
    for part in dict.fromkeys((plan.setup, plan.main, plan.teardown)):
        if not (inspect.isfunction(part) and _begins_with_a_run(part)):
            continue
        lines = dict.fromkeys((*_unknown_names(part), *_wrong_words(part, run)))
        file = Path(part.__code__.co_filename).name
        found += [f"{file}, line {line}: {what}" for line, what in sorted(lines)]
    return found


def _begins_with_a_run(part: Callable[..., None]) -> bool:
    return bool(inspect.signature(part).parameters)


def _unknown_names(part: Any) -> Iterator[tuple[int, str]]:
    """Yield line and text for each global name without a value, in a function and in the functions inside it."""
    known = part.__globals__.keys() | vars(builtins).keys()
    for code in _codes(part.__code__):
        for step in dis.get_instructions(code):
            line = step.positions.lineno if step.positions else None
            if step.opname != "LOAD_GLOBAL" or step.argval in known or not line:
                continue
            if not _is_made_later(part, step.argval):
                yield (
                    line,
                    f"there is no {step.argval!r} here; {did_you_mean(step.argval, known, 'is an import missing?')}",
                )


def _codes(code: CodeType) -> Iterator[CodeType]:
    yield code
    for inner in code.co_consts:
        if isinstance(inner, CodeType):
            yield from _codes(inner)


def _is_made_later(part: Any, name: str) -> bool:
    """Return whether a function in the file of the plan may define a global name while the plan runs."""
    try:
        text = Path(part.__code__.co_filename).read_text(encoding="utf-8")
    except (OSError, UnicodeError):
        return True
    return bool(re.search(rf"\bglobal\b.*\b{re.escape(name)}\b", text))


def _wrong_words(part: Any, run: Run) -> Iterator[tuple[int, str]]:
    """Yield line and text for each unknown attribute of run, bench or device, and for each unknown signal or unit."""
    try:
        lines, start = inspect.getsourcelines(part)
        tree = ast.parse(dedent("".join(lines)))
    except (OSError, SyntaxError, TypeError):
        return
    name = next(iter(inspect.signature(part).parameters))
    stored = {
        one.id for one in ast.walk(tree) if isinstance(one, ast.Name) and isinstance(one.ctx, ast.Store)
    }
    if name in stored:  # the name represents something else somewhere
        return
    for node in ast.walk(tree):
        if isinstance(node, ast.Attribute):
            owner = _object(node.value, name, run)
            if isinstance(owner, Run | Bench | Device) and node.attr not in dir(owner):
                public = [one for one in dir(owner) if not one.startswith("_")]
                yield start + node.lineno - 1, f"{ast.unparse(node)}: {did_you_mean(node.attr, public)}"
        elif isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute):
            yield from (
                (start + node.lineno - 1, text)
                for text in _wrong_arguments(node, _object(node.func.value, name, run), node.func.attr)
            )


def _wrong_arguments(call: ast.Call, owner: object, method: str) -> Iterator[str]:
    if isinstance(owner, Run) and method == "check":
        given = [one.value for one in call.keywords if one.arg == "unit"] or call.args[2:3]
        for unit in _texts(given):
            if unit not in FACTORS:
                yield f"{unit!r} is no unit; {did_you_mean(unit, FACTORS)}"
    if isinstance(owner, Bench) and method in _OF_SIGNALS:
        for signal in _texts(call.args):
            if signal not in TABLE.index:
                yield f"{signal!r} is no signal; {did_you_mean(signal, TABLE.index, '`astb rig signals` lists them')}"


def _texts(nodes: list[ast.expr]) -> list[str]:
    return [one.value for one in nodes if isinstance(one, ast.Constant) and isinstance(one.value, str)]


def _object(node: ast.expr, name: str, run: Run) -> object:
    """Return the run, the bench or the device that an expression such as ``run.bench.left`` refers to; None for other
    expressions.
    """
    if isinstance(node, ast.Name):
        return run if node.id == name else None
    if not isinstance(node, ast.Attribute):
        return None
    owner = _object(node.value, name, run)
    if isinstance(owner, Run):
        return owner.bench if node.attr == "bench" else None
    if isinstance(owner, Bench) and node.attr in Bench.__slots__:
        return getattr(owner, node.attr, None)
    return None
