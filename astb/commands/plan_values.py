"""The options of commands that run plans: parameters, specimen, answers and output folder."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import click

from astb.commands.completion import complete_settings, complete_specimens
from astb.commands.lists import plans_named
from astb.commands.options import out_option, pairs
from astb.exit_codes import misuse
from bench_protocol.input_limits import read_toml
from bench_protocol.os_errors import file_errors

if TYPE_CHECKING:
    from test_plans.plan import Plan

_OPTIONS: Final = (
    click.option(
        "--specimen",
        "specimen_name",
        metavar="FILE",
        shell_complete=complete_specimens,
        help="Specimen with its limits: a name of `astb list specimens`, or a TOML file.  [default: astb]",
    ),
    click.option(
        "--set",
        "settings",
        multiple=True,
        metavar="NAME=VALUE",
        shell_complete=complete_settings,
        help="Set a parameter of all plans, such as amplitude=20mm, or of one, such as aw3.load=AW3; repeatable. "
        "`astb plans PLAN` lists the parameters.",
    ),
    click.option(
        "--with",
        "values_path",
        type=click.Path(path_type=Path),
        metavar="FILE",
        help='TOML file with parameters of the plans: NAME = "VALUE", for one plan in a table [PLAN]. '
        "--set overrides them.",
    ),
    click.option(
        "--answers",
        metavar="FILE",
        help='TOML file with answers to questions of the plans: "QUESTION" = "ANSWER", with * for any text. '
        "Use - for lines of the standard input.",
    ),
    out_option("Folder for the runs."),
)


def plan_value_options(command: Callable[..., None]) -> Callable[..., None]:
    """Add the options for specimen, parameters, answers and the output folder of plans."""
    for option in reversed(_OPTIONS):
        command = option(command)
    return command


def chosen_plans(names: Sequence[str], settings: Sequence[str], path: Path | None) -> "list[Plan]":
    """Return the plans, with parameters from the TOML file ``path``, overridden by ``settings`` (NAME=VALUE).

    PLAN.NAME applies to one plan and overrides NAME, which applies to all of them. Unknown parameters end the command
    before any motion.
    """
    from test_plans.parameters import ParameterRefused

    plans = plans_named(names)
    chosen = {plan.name for plan in plans}
    given = _read(path) if path else {}
    given |= pairs(settings, "has no value; write NAME=VALUE, such as amplitude=20mm", option="--set ")
    for name in given:
        plan, dot, _ = name.partition(".")
        if dot and plan not in chosen:
            misuse(f"{name} is a parameter of the plan {plan}, but the plans to run are {', '.join(chosen)}")
    try:
        return [plan.given(_values_for_plan(plan.name, given)) for plan in plans]
    except ParameterRefused as error:
        misuse(error)


def _values_for_plan(plan: str, given: Mapping[str, Any]) -> dict[str, Any]:
    common = {name: value for name, value in given.items() if "." not in name}
    own = {
        name.removeprefix(f"{plan}."): value for name, value in given.items() if name.startswith(f"{plan}.")
    }
    return common | own


def _read(path: Path) -> dict[str, Any]:
    with file_errors(f"--with {path}", misuse):
        content = read_toml(path)
    given: dict[str, Any] = {}
    for name, value in content.items():
        if isinstance(value, dict):
            given |= {f"{name}.{inner}": one for inner, one in value.items()}
        else:
            given[name] = value
    return given
