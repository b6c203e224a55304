"""`astb runs`, `astb compare` and `astb trend`: the runs in a folder."""

from fnmatch import fnmatchcase
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, NoReturn

import click

from astb.commands.options import JSON_OPTION, out_option, pairs
from astb.exit_codes import FAIL, PASS, misuse
from astb.tables import open_console, open_table, print_json, styled
from bench_protocol.extras import installed, lacking
from bench_protocol.os_errors import reason
from bench_protocol.suggestion import did_you_mean
from bench_records.checksums import broken_files
from bench_records.comparison import CheckPair, compare_runs
from bench_records.index import RunIndex
from bench_records.kept_pages import comparison_row, trend_words, write_comparison, write_trends
from bench_records.layout import RecordError
from bench_records.run_folder import Unfinished
from bench_records.trend import trend_of
from bench_records.typography import significant
from bench_records.workbook import write_trends_book

if TYPE_CHECKING:
    from collections.abc import Iterator

    from bench_records.index import KeptCheck, KeptRun
    from bench_records.trend import Trend

OUT_OPTION: Final = out_option("Folder of the runs.", "folder")
PAGE_OPTION: Final = click.option(
    "--page",
    type=click.Path(path_type=Path, dir_okay=False),
    metavar="FILE",
    help="Also write an HTML page with diagrams.",
)
_STYLE: Final = {
    "pass": "green",
    "incomplete": "yellow",
    "fail": "bold red",
    "blocked": "magenta",
    "interrupted": "magenta",
    "running": "cyan",
}


@click.command("runs")
@OUT_OPTION
@click.option("--plan", help="Only runs of this plan.")
@click.option("--verdict", type=click.Choice(tuple(_STYLE)), help="Only runs with this verdict.")
@click.option("--specimen", help="Only runs of the specimen with this serial number.")
@click.option("--rig", help="Only runs on this rig.")
@click.option("--operator", help="Only runs of this operator.")
@click.option(
    "--rebuild",
    is_flag=True,
    help="Build the index of the runs again. Normally it is updated automatically.",
)
@click.option(
    "--verify",
    is_flag=True,
    help="Check all files against their checksums. Exit code 1: a file has changed, or a run has no checksums.",
)
@click.option(
    "--requirements",
    is_flag=True,
    help="List requirements with their checks, and the latest verdict of each.",
)
@click.option(
    "--mcp",
    is_flag=True,
    help="Serve the runs to an assistant, read-only, by the Model Context Protocol on standard input and output.",
)
@JSON_OPTION
def runs_command(
    folder: Path,
    plan: str | None,
    verdict: str | None,
    specimen: str | None,
    rig: str | None,
    operator: str | None,
    rebuild: bool,
    verify: bool,
    requirements: bool,
    mcp: bool,
    as_json: bool,
) -> None:
    """List the recorded runs, oldest first."""
    if mcp:
        _serve(folder)
        return
    index = _index(folder)
    try:
        if rebuild:
            click.echo(f"{index.rebuild()} runs in {folder}", err=True)
        chosen = {
            "plan": plan,
            "verdict": verdict,
            "serial_number": specimen,
            "rig": rig,
            "operator": operator,
        }
        runs = index.runs(**chosen)
        judged = index.checks(**chosen) if requirements else []
    except RecordError as error:
        misuse(error)
    _warn_unreadable(index)
    if verify:
        _verify(folder, runs)
    if requirements:
        _list_requirements(judged, as_json)
        return
    if as_json:
        print_json(runs)
    else:
        _list_runs(runs, folder)


def _serve(folder: Path) -> None:
    """Serve the runs until standard input ends."""
    if not installed("mcp"):
        misuse(lacking("mcp", "assistants"))
    from astb.mcp_server import mcp_server

    try:
        mcp_server(folder).run("stdio")
    except RecordError as error:
        misuse(error)


def _list_runs(runs: "list[KeptRun]", folder: Path) -> None:
    table = open_table(
        f"{len(runs)} runs in {folder}",
        "",
        "run",
        "when (UTC)",
        "plan",
        "specimen no.",
        "rig",
        "operator",
        "notes",
        whole=("",),
    )
    for one in runs:
        plan_words = " ".join([one.plan, *(f"{name}={value}" for name, value in one.parameters.items())])
        verdict_mark = styled(one.verdict, _STYLE.get(one.verdict, ""))
        began = one.began.replace("T", " ").removesuffix("Z")
        columns = (
            one.directory,
            began,
            plan_words,
            one.serial_number,
            one.rig_as_text,
            one.operator,
            str(one.notes or ""),
        )
        table.add_row(verdict_mark, *columns)
    open_console().print(table)


def _list_requirements(judged: "list[KeptCheck]", as_json: bool) -> None:
    """Print the latest check for each combination of requirement, name, plan, specimen and parameters."""
    latest = {
        (
            one.requirement,
            one.run.plan,
            one.name,
            one.run.serial_number,
            *sorted(one.run.parameters.items()),
        ): one
        for one in judged
    }
    found = [one for _, one in sorted(latest.items(), key=lambda item: item[0][:4])]
    if as_json:
        print_json(found)
        return
    table = open_table(
        f"{len({one.requirement for one in found})} requirements, {len(found)} checks",
        "",
        "requirement",
        "check",
        "plan",
        "specimen no.",
        "latest run",
        whole=("",),
    )
    for one in found:
        mark = styled(one.verdict, _STYLE.get(one.verdict, ""))
        plan = " ".join([one.run.plan, *(f"{name}={text}" for name, text in one.run.parameters.items())])
        table.add_row(mark, one.requirement, one.name, plan, one.run.serial_number, one.run.directory)
    open_console().print(table)


@click.command("compare")
@click.argument("a", type=click.Path(path_type=Path, exists=True, file_okay=False))
@click.argument("b", type=click.Path(path_type=Path, exists=True, file_okay=False))
@PAGE_OPTION
@JSON_OPTION
def compare_command(a: Path, b: Path, page: Path | None, as_json: bool) -> None:
    """Compare two runs: parameters, limits, results and curves.

    A and B are folders of runs.
    """
    try:
        found = compare_runs(a, b)
        if page:
            write_comparison(found, page)
    except RecordError as error:
        misuse(error)
    except OSError as error:
        misuse(f"{page} cannot be written: {reason(error)}")
    if as_json:
        print_json(found)
        return
    console = open_console()
    console.print(f"A = {a}, B = {b}", soft_wrap=True)
    facts = open_table("different conditions", "", "A", "B", whole=("",))
    for fact in found.facts:
        facts.add_row(fact.what.replace("_", " "), fact.a, fact.b)
    console.print(facts if found.facts else "The records show no difference in rig, specimen or parameters.")
    for run, verdict in zip("AB", found.verdicts, strict=True):
        if verdict in set(Unfinished):
            console.print(f"{run} is {verdict} and has no result; only its recorded part is compared")
    console.print(_results(found.checks) if found.checks else "Neither run has a check.")
    for pair in found.curves:
        if pair.apart is not None:
            name = ": ".join(filter(None, (pair.group, pair.name)))
            console.print(f"curve {name}: {significant(100 * pair.apart, 2)} % apart (r.m.s.)")
    for lonely in found.lonely_curves:
        console.print(f"curve {lonely}")
    if page:
        console.print(f"page: {page}")


def _results(checks: list[CheckPair]) -> Any:
    """Return the table of the checks of two runs, by phase."""
    results = open_table("results", "check", "A", "B", "B − A", "± U", "")
    phase = None
    for row in map(comparison_row, checks):
        if row.phase != phase:
            phase = row.phase
            results.add_section()
            results.add_row(styled(phase or "no phase", "bold"))
        tone = {"fail": "bold red", "marginal": "yellow"}.get(row.tone, "")
        remark = styled(row.remark, tone)
        results.add_row(row.name, row.a, row.b, row.change, row.uncertainty, remark)
    return results


@click.command("trend")
@click.argument("checks", nargs=-1, required=True, metavar="CHECK...")
@click.option("--specimen", required=True, metavar="NUMBER", help="Serial number of the specimen.")
@OUT_OPTION
@click.option("--plan", help="Only runs of this plan.")
@click.option("--phase", help="Only checks of this phase of the plan.")
@click.option("--rig", help="Only runs on this rig.")
@click.option(
    "--circumstances",
    help='Only runs with exactly these circumstances: "SIMULATED", "SIMULATED · VIRTUAL TIME", or "" for a real rig.',
)
@click.option(
    "--set",
    "settings",
    multiple=True,
    metavar="NAME=VALUE",
    help="Only runs with this value of a parameter, such as load=AW3; repeatable.",
)
@PAGE_OPTION
@click.option(
    "--table",
    type=click.Path(path_type=Path, dir_okay=False),
    metavar="FILE.xlsx",
    help="Also write all values to an Excel workbook.",
)
@JSON_OPTION
def trend_command(
    checks: tuple[str, ...],
    specimen: str,
    folder: Path,
    plan: str | None,
    phase: str | None,
    rig: str | None,
    circumstances: str | None,
    settings: tuple[str, ...],
    page: Path | None,
    table: Path | None,
    as_json: bool,
) -> None:
    """Show how the results of a specimen change over runs.

    It prints the values of a check with scatter and drift. CHECK is the name of a check, or a pattern such as
    "left vertical K' at *" for all frequencies. Only results of the same plan, phase, rig, circumstances and parameters
    are compared. If there are several kinds of results, the command prints the options that select each kind.
    """
    if table and table.suffix.lower() != ".xlsx":
        misuse(f"--table {table}: the name must end in .xlsx, such as {table.with_suffix('.xlsx')}")
    index = _index(folder)
    wanted = pairs(settings, "has no value; write NAME=VALUE, such as load=AW3", option="--set ")
    chosen = {"serial_number": specimen, "plan": plan, "rig": rig, "circumstances": circumstances}
    try:
        trends = [
            trend_of(check, _of_one_kind(check, found))
            for check, found in _measured(index, checks, chosen, phase, wanted)
        ]
        if not trends:
            misuse(_no_such(index, checks[0], specimen))
        if page:
            write_trends(trends, specimen, page)
        if table:
            write_trends_book(trends, table)
    except RecordError as error:
        misuse(error)
    except OSError as error:
        misuse(f"{error.filename or page or table} cannot be written: {reason(error)}")
    _warn_unreadable(index)
    if as_json:
        # For one check name the JSON is one object, not a list.
        print_json(trends[0] if len(checks) == 1 and trends[0].name == checks[0] else trends)
        return
    for trend in trends:
        _show_trend(trend, specimen)
    for what, path in (("page", page), ("table", table)):
        if path:
            open_console().print(f"{what}: {path}")


def _measured(
    index: RunIndex,
    checks: tuple[str, ...],
    chosen: dict[str, str | None],
    phase: str | None,
    wanted: dict[str, str],
) -> "Iterator[tuple[str, list[KeptCheck]]]":
    """Yield the name and the stored values of each check. A check in ``checks`` without values ends the command."""
    for check in _named(index, checks):
        found = [
            one
            for one in index.checks(check, **chosen)
            if phase in (None, one.phase) and wanted.items() <= one.run.parameters.items()
        ]
        if found:
            yield check, found
        elif check in checks:
            misuse(_no_such(index, check, chosen["serial_number"] or ""))


def _named(index: RunIndex, checks: tuple[str, ...]) -> list[str]:
    """Return the names of checks; a pattern is replaced by the names that match it."""
    known = index.names("check")
    found: dict[str, None] = {}
    for one in checks:
        fitting = [one] if one in known else [name for name in known if fnmatchcase(name, one)]
        found.update(dict.fromkeys(fitting or [one]))
    return list(found)


def _show_trend(found: "Trend", specimen: str) -> None:
    columns = ("", "when (UTC)", "run", "value", "± U")
    table = open_table(f"{found.name}, specimen {specimen}", *columns, whole=("", "value", "± U"))
    for one in found.checks:
        value = "–" if one.value is None else f"{one.value / one.scale:.6g} {one.unit}".rstrip()
        reach = "" if one.expanded is None else f"± {one.expanded / one.scale:.2g}"
        began = one.run.began.replace("T", " ").removesuffix("Z")
        table.add_row(one.verdict, began, one.run.directory, value, reach)
    console = open_console()
    console.print(table)
    for sentence in trend_words(found):
        console.print(sentence)


def _verify(folder: Path, runs: "list[KeptRun]") -> NoReturn:
    ended = [one.directory for one in runs if one.verdict not in tuple(Unfinished)]
    broken = {name: found for name in ended if (found := broken_files(folder / name))}
    for name, found in broken.items():
        click.echo(f"{name}: {', '.join(found)}")
    text = f"{len(ended) - len(broken)} of {len(ended)} runs are unchanged"
    if others := len(runs) - len(ended):
        text += f"; {others} did not end and have no checksums"
    click.echo(text)
    raise click.exceptions.Exit(FAIL if broken else PASS)


def _index(folder: Path) -> RunIndex:
    try:
        return RunIndex(folder)
    except RecordError as error:
        misuse(error)


def _warn_unreadable(index: RunIndex) -> None:
    for directory, why in index.unreadable.items():
        click.echo(f"{directory} is left out: {why}", err=True)


def _no_such(index: RunIndex, check: str, specimen: str) -> str:
    serials = index.names("serial_number")
    if specimen not in serials:
        there = ", ".join(filter(None, serials)) or "none"
        return f"no run in {index.folder} is of a specimen {specimen}; there are {there}"
    return f"specimen {specimen} has no check {check!r} in such runs; {did_you_mean(check, index.names('check'))}"


def _of_one_kind(check: str, checks: "list[KeptCheck]") -> "list[KeptCheck]":
    """Return the checks if all were measured in the same way.

    Otherwise end the command, and print the options for each way.
    """
    kinds = {
        (
            one.run.plan,
            one.phase,
            one.run.rig,
            one.run.circumstances,
            tuple(sorted(one.run.parameters.items())),
        ): None
        for one in checks
    }
    if len(kinds) > 1:
        lines = [
            " ".join(
                [
                    f'--plan {plan} --phase "{phase}" --rig "{rig}" --circumstances "{circumstances}"',
                    *(f"--set {n}='{v}'" for n, v in given),
                ]
            )
            for plan, phase, rig, circumstances, given in kinds
        ]
        misuse(f"{check} was measured in {len(kinds)} ways; choose one of\n  " + "\n  ".join(lines))
    return checks
