"""What a test plan is, and the decorator that makes one of a function."""

from __future__ import annotations

import inspect
import sys
from collections.abc import Callable
from dataclasses import dataclass
from typing import overload

from test_plans.run import PlanError, Run
from test_plans.steps import make_safe, power_up

#: A part of a plan: a function that is given the run.
Part = Callable[[Run], None]


@dataclass(frozen=True, slots=True)
class Plan:
    """A test instruction: set-up, main part and tear-down, which always runs.

    The instruction is the docstring of the main part, the title its first line. ``lasts`` is how long it takes (s of
    the bench's time, 0 if nobody knows): it moves the progress bar and limits nothing.
    """

    name: str
    title: str
    instruction: str
    main: Part
    setup: Part
    teardown: Part
    lasts: float = 0.0


@overload
def plan(main: Part, /) -> Plan: ...
@overload
def plan(
    *, setup: Part = power_up, teardown: Part = make_safe, lasts: float = 0.0
) -> Callable[[Part], Plan]: ...
def plan(
    main: Part | None = None,
    /,
    *,
    setup: Part = power_up,
    teardown: Part = make_safe,
    lasts: float = 0.0,
) -> Plan | Callable[[Part], Plan]:
    """Make a plan of a function: ``@plan``, or ``@plan(setup=..., teardown=..., lasts=...)``.

    The name is the function's, the instruction its docstring (or that of its module). Without parts of its own a plan
    begins by arming the bench and ends by letting the air off and disarming. PlanError without a docstring.
    """
    if main is not None:
        return _plan(main, setup, teardown, lasts)
    return lambda function: _plan(function, setup, teardown, lasts)


def _plan(main: Part, setup: Part, teardown: Part, lasts: float) -> Plan:
    instruction = inspect.cleandoc(main.__doc__ or sys.modules[main.__module__].__doc__ or "")
    if not instruction:
        raise PlanError(f"plan {main.__name__} has no docstring; it must say what is tested and what is good")
    return Plan(main.__name__, instruction.splitlines()[0], instruction, main, setup, teardown, lasts)
