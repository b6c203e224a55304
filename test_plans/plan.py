"""A test plan, and the decorator that turns a function into a plan."""

from __future__ import annotations

import inspect
import re
import sys
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from typing import TYPE_CHECKING, Any, Final, get_type_hints, overload

from bench_protocol.table import TABLE
from bench_protocol.units import kN
from test_plans.description import is_dimension
from test_plans.loads import CARS
from test_plans.parameters import Parameter, Value, declared_parameters, read_all
from test_plans.preconditions import Precondition
from test_plans.run import PlanError, Run
from test_plans.steps import make_safe, power_up

if TYPE_CHECKING:
    from test_plans.check_names import CheckName
    from test_plans.specimen import Specimen

_PRELOAD: Final = re.compile(r"\{(\w+)\.preload\}")

#: A part of a plan: a function that receives the run, and those parameters of the plan that it names.
Part = Callable[..., None]


@dataclass(frozen=True, slots=True)
class Plan:
    """A test instruction: set-up, main part and tear-down. The tear-down always runs.

    The instruction is the docstring of the main part; its first line is the title. In both, ``{AW0.preload}`` stands
    for the preload of the specimen in that load case; :meth:`on` inserts the value. ``lasts`` is the duration in s of
    the bench's time (0: unknown); it only scales the progress bar. ``parameters`` are the parameters of
    the main part, ``values`` (SI) their present values. The plan is blocked before any motion if the rig lacks one of
    the signals ``needs``, or if one of the preconditions ``requires`` is not met. ``checks`` are the names of its
    checks, each with a sentence for readers of the plan.
    """

    name: str
    title: str
    instruction: str
    main: Part
    setup: Part
    teardown: Part
    lasts: float = 0.0
    parameters: tuple[Parameter, ...] = ()
    values: Mapping[str, Value] = field(default_factory=dict)
    needs: tuple[str, ...] = ()
    requires: tuple[Precondition, ...] = ()
    checks: tuple[CheckName, ...] = ()
    judges: bool = (
        True  #: whether its checks judge the product; False if it only moves the springs for a diagnosis
    )

    def given(self, texts: Mapping[str, Any]) -> Plan:
        """Return the plan with the values in ``texts``, such as ``20 mm``. Parameters that are not in it have their
        defaults.

        Raises ParameterRefused, with name, value, unit and range, for an unknown parameter or an invalid value.
        """
        return replace(self, values=read_all(self.name, self.parameters, texts))

    def bound(self, part: Part) -> Callable[[Run], None]:
        """Return one part of this plan as a function of the run alone. The plan passes the parameters that the part
        names.
        """
        names = inspect.signature(part).parameters
        return partial(part, **{name: value for name, value in self.values.items() if name in names})

    def on(self, specimen: Specimen) -> Plan:
        """Return the plan for ``specimen``: the loads of this specimen are inserted into title and instruction."""

        def preload(found: re.Match[str]) -> str:
            load = specimen.loads.get(found[1])
            return (
                f"{load.preload / kN:g} kN" if load else f"a load {found[1]} that the specimen does not state"
            )

        title, instruction = (_PRELOAD.sub(preload, text) for text in (self.title, self.instruction))
        return replace(self, title=title, instruction=instruction)

    @property
    def written(self) -> dict[str, str]:
        """The values of the parameters as text with unit."""
        return {one.name: one.show(self.values[one.name]) for one in self.parameters}


@overload
def plan(main: Part, /) -> Plan: ...
@overload
def plan(
    *,
    setup: Part = power_up,
    teardown: Part = make_safe,
    lasts: float = 0.0,
    needs: Iterable[str] = (),
    requires: Iterable[Precondition] = (),
    checks: Iterable[CheckName] = (),
) -> Callable[[Part], Plan]: ...
def plan(
    main: Part | None = None,
    /,
    *,
    setup: Part = power_up,
    teardown: Part = make_safe,
    lasts: float = 0.0,
    needs: Iterable[str] = (),
    requires: Iterable[Precondition] = (),
    checks: Iterable[CheckName] = (),
) -> Plan | Callable[[Part], Plan]:
    """Turn a function into a plan, as a decorator: ``@plan``, or ``@plan(setup=..., needs=..., requires=...)``.

    The name of the plan is that of the function. The instruction is the docstring of the function, or that of its
    module. By default the set-up arms the bench, and the tear-down vents the springs and disarms the bench. The
    arguments after the run are the plan's parameters; set-up and tear-down may use them by name. Raises PlanError if
    there is no docstring, if a parameter has no default, unit or range, or if one of ``needs`` is not a signal.
    """

    def made(function: Part) -> Plan:
        one = _plan(function, setup, teardown, tuple(needs))
        return replace(one, lasts=lasts, requires=tuple(requires), checks=tuple(checks))

    return made if main is None else made(main)


def plan_under(load: str, main: Callable[..., None], name: str, **how: Any) -> Plan:
    """Return a plan called ``name`` for one load. The function ``main`` receives the load as its second argument. See
    `plan`.

    In the docstring of ``main``, ``{load}`` is replaced by the load, ``{car}`` by the car with this load, and
    ``{preload}`` by the preload of a spring. The arguments after run and load are the plan's parameters.
    """

    def under(run: Run, **given: Value) -> None:
        main(run, load, **given)

    words = {"{load}": load, "{car}": CARS[load], "{preload}": f"{{{load}.preload}}"}
    under.__doc__ = re.sub(r"\{\w+\}", lambda found: words[found[0]], main.__doc__ or "")
    under.__name__, under.__module__ = name, main.__module__
    of_run, _, *own = inspect.signature(main).parameters.values()
    under.__signature__ = inspect.Signature([of_run, *own])  # type: ignore[attr-defined]
    hints = get_type_hints(main, include_extras=True) if own else {}
    under.__annotations__ = {one.name: hints[one.name] for one in own if one.name in hints}
    return plan(**how)(under)


def _plan(main: Part, setup: Part, teardown: Part, needs: tuple[str, ...]) -> Plan:
    instruction = inspect.cleandoc(main.__doc__ or sys.modules[main.__module__].__doc__ or "")
    if not instruction:
        raise PlanError(f"plan {main.__name__} has no docstring; state the tested property and its limits")
    for name in needs:
        if name not in TABLE.index and not is_dimension(name):
            raise PlanError(
                f"plan {main.__name__} needs {name!r}, which is neither a signal of the table nor a "
                "dimension; correct the argument needs"
            )
    try:
        parameters = declared_parameters(main)
    except (TypeError, NameError) as error:
        raise PlanError(f"plan {main.__name__}: {error}") from None
    known = {one.name for one in parameters}
    for part in (setup, teardown):
        for name in list(inspect.signature(part).parameters)[1:]:
            if name not in known:
                raise PlanError(
                    f"plan {main.__name__} has no parameter {name}, which {part.__name__} needs; add it"
                )
    title = instruction.splitlines()[0]
    values = {one.name: one.default for one in parameters}
    return Plan(main.__name__, title, instruction, main, setup, teardown, 0.0, parameters, values, needs)
