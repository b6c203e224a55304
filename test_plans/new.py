"""Writes the template of a new plan: a file that runs unchanged."""

import keyword
from collections.abc import Collection
from pathlib import Path
from typing import Final

from bench_protocol.os_errors import reason
from test_plans.run import PlanError

_TEXT: Final = '''"""{Title}: under the same load, both springs rest at the same pressure."""

from bench_protocol.units import mbar, s
from test_plans import steps
from test_plans.check_names import CheckName
from test_plans.loads import AW0
from test_plans.plan import plan
from test_plans.preconditions import on_the_bench
from test_plans.run import Run

LEFT, RIGHT = "left.bellows_pressure", "right.bellows_pressure"
EQUAL = CheckName(
    "pressure, left less right",
    "Pressure difference under the same load: if it is large, the springs differ, or one of them is tilted.",
)


@plan(setup=steps.carry(AW0), lasts=30 * s, needs=steps.CARRYING, requires=on_the_bench(AW0), checks=[EQUAL])
def {name}(run: Run) -> None:
    """{Title}: under the same load, both springs rest at the same pressure.

    Both springs carry the empty car, {{AW0.preload}} each, on their leveling valves until the gas has cooled. The
    pressures may differ by less than 70 mbar, because each transducer may have an error of 25 mbar.
    """
    with run.phase("at rest"):
        mean = run.bench.averages(LEFT, RIGHT, over=2 * s)
    difference = run.measured(lambda means: means[LEFT] - means[RIGHT], mean, over=2 * s)  # with its uncertainty
    run.check(EQUAL, difference, "bar", low=-70 * mbar, high=70 * mbar)
'''


def write_new(name: str, folder: Path, known: Collection[str]) -> Path:
    """Write a template of a plan ``name`` to a file in ``folder``, and return its path.

    Raises PlanError if the name is not allowed, if one of the plans ``known`` has it, or if the file exists.
    """
    if not name.isidentifier() or keyword.iskeyword(name) or name == "new":
        raise PlanError(
            f"{name!r} is not a name for a plan; use letters, digits and _, as in pressure_is_kept"
        )
    if name in known:
        raise PlanError(f"there is a plan {name} already; choose another name")
    path = folder / f"{name}.py"
    try:
        with path.open("x", encoding="utf-8") as file:
            file.write(_TEXT.format(name=name, Title=name.replace("_", " ").capitalize()))
    except FileExistsError:
        raise PlanError(f"{path} exists already; choose another name or remove it") from None
    except OSError as error:
        raise PlanError(f"{path} cannot be written: {reason(error)}") from None
    return path
