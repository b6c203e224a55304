"""`astb plans`, `astb rig limits` and `astb rig signals`."""

import os
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from astb.commands.completion import complete_plans
from astb.commands.options import JSON_OPTION, RIG_OPTION, read_rig
from astb.exit_codes import misuse
from astb.tables import print_json
from bench_protocol.os_errors import reason

if TYPE_CHECKING:
    from collections.abc import Iterable

    from test_plans.plan import Plan


@click.command("plans")
@click.argument("names", nargs=-1, metavar="[NAME]...", shell_complete=complete_plans)
@JSON_OPTION
def plans_command(names: tuple[str, ...], as_json: bool) -> None:
    """List the test plans, or print instructions and parameters.

    With a NAME, it prints the instructions of this plan, its checks, and its parameters with range, unit and default.
    A NAME that ends in .py is the path of a file with your own plans.

    astb plans new NAME writes an example plan to NAME.py. If the environment variable ASTB_PLANS is set to a folder,
    the file goes to this folder, and its plans are found by name.
    """
    from test_plans.discovery import plans, unusable
    from test_plans.specimen import ordinary

    if names[:1] == ("new",):
        _write_new(names[1:])
        return
    if as_json:
        named = plans_named(names or plans())
        print_json([_facts(plan.on(ordinary())) for plan in named])
        return
    for plan in (plan.on(ordinary()) for plan in (plans_named(names) if names else ())):
        click.echo(f"{plan.name}\n\n{plan.instruction}\n")
        for one in plan.parameters:
            click.echo(f"    --set {one.name + '=' + one.show(one.default):<32} {one.allowed}")
        if not plan.parameters:
            click.echo("    no parameters")
        for condition in plan.requires:
            click.echo(f"    precondition: {condition.text}")
        for check in plan.checks:
            click.echo(f"    checks {check.shown}: {check.about}")
    if not names:
        known = plans()
        width = max(map(len, known))
        for heading, judges in (
            ("test plans with pass or fail", True),
            ("programmes that record data for a diagnosis", False),
        ):
            click.echo(f"{heading}:")
            for name, plan in known.items():
                if plan.judges is judges:
                    click.echo(f"  {name:<{width}}  {plan.on(ordinary()).title}")
        if unusable():
            click.echo("\n  ".join(["cannot be used:", *unusable()]))


def _facts(plan: "Plan") -> dict[str, Any]:
    """Return the content of `astb plans --json` for one plan."""
    return {
        "name": plan.name,
        "title": plan.title,
        "instruction": plan.instruction,
        "judges": plan.judges,
        "lasts_s": plan.lasts or None,
        "needs": plan.needs,
        "requires": [condition.text for condition in plan.requires],
        "checks": [{"name": check.shown, "about": check.about} for check in plan.checks],
        "parameters": [
            {"name": one.name, "default": one.show(one.default), "allowed": one.allowed}
            for one in plan.parameters
        ],
    }


@click.command("limits")
@RIG_OPTION
@JSON_OPTION
def limits_command(rig_named: str | None, as_json: bool) -> None:
    """List the limits of a simulated rig and its reactions."""
    from bench_sim.rig.limit_table import limits_of, listed

    rig, path = read_rig(rig_named)
    try:
        limits = limits_of(rig.simulation.limits if rig.simulation else ())
    except ValueError as error:
        misuse(f"{path}: {error}")
    if as_json:
        columns = ("signal", "kind", "at", "lasting", "hysteresis", "latch", "action")
        print_json([dict(zip(columns, row, strict=True)) for row in listed(limits)])
        return
    for signal, kind, at, lasting, hysteresis, latch, action in listed(limits):
        after = f"for {lasting}" if lasting != "0 ms" else "at once"
        click.echo(
            f"{signal:<28} {kind:<8} {at:<16} {after:<11} → {action:<13} {latch:<12} {hysteresis}".rstrip()
        )


@click.command("signals")
@click.option(
    "--dbc", type=click.Path(path_type=Path, dir_okay=False), help="Write the CAN messages to this DBC file."
)
@click.option(
    "--csv",
    type=click.Path(path_type=Path, dir_okay=False),
    help="Write the Modbus registers to this CSV file.",
)
@click.option(
    "--eds",
    type=click.Path(path_type=Path, dir_okay=False),
    help="Write the CANopen object dictionary to this EDS file.",
)
@JSON_OPTION
def signals_command(dbc: Path | None, csv: Path | None, eds: Path | None, as_json: bool) -> None:
    """List all signals, or write them as DBC, CSV or EDS file."""
    generated = files("bench_protocol") / "generated"
    for target, source in ((dbc, "astb.dbc"), (csv, "modbus_map.csv"), (eds, "astb.eds")):
        if target is not None:
            try:
                target.write_bytes((generated / source).read_bytes())
            except OSError as error:
                misuse(f"{target} cannot be written: {reason(error)}")
            click.echo(target)
    if dbc is csv is eds is None:
        from bench_protocol.table import TABLE

        if as_json:
            rows = [
                {
                    "name": row.name,
                    "kind": str(row.kind),
                    "range": row.range_text(),
                    "description": row.description,
                }
                for row in TABLE.signals
            ]
            print_json({"map": f"{TABLE.map_hash:08x}", "signals": rows})
            return
        click.echo(f"map {TABLE.map_hash:08x}")
        for row in TABLE.signals:
            click.echo(f"{row.name:<38} {row.kind:<12} {row.range_text():<28.60} {row.description}")


def _write_new(names: tuple[str, ...]) -> None:
    from test_plans.discovery import FOLDER, plans
    from test_plans.new import write_new
    from test_plans.run import PlanError

    if len(names) != 1:
        misuse("`astb plans new` needs one name, as in `astb plans new pressure_is_kept`")
    folder = os.environ.get(FOLDER, "")
    try:
        path = write_new(names[0], Path(folder), plans())
    except PlanError as error:
        misuse(error)
    click.echo(f"{path}: try it with `astb run {names[0] if folder else path} --virtual`")


def plans_named(names: "Iterable[str]") -> "list[Plan]":
    """Return the test plans with these names, and those in the Python files among ``names``.

    An unknown name ends the command.
    """
    from test_plans.discovery import in_file, plans, unknown, unusable
    from test_plans.run import PlanError

    found: list[Plan] = []
    for name in names:
        if name.endswith(".py"):
            try:
                found += in_file(Path(name)).values()
            except PlanError as error:
                misuse(error)
        else:
            if name not in plans():
                misuse(unknown(name, "`astb plans` lists them"))
            found.append(plans()[name])
    for one in unusable():
        click.echo(f"astb: {one}", err=True)
    return found
