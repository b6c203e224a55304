"""`astb rig conform`: messages and registers of a rig, compared with the specification and with another rig."""

from pathlib import Path
from typing import TYPE_CHECKING

import click

from astb.acceptance.conformance.report import Report, ReportError, common_tests, differences, read_report
from astb.exit_codes import FAIL, PASS, blocked, misuse
from astb.rig_file import RigFileError, find_rig
from astb.tables import open_console, open_table, styled
from drivers.errors import BenchError

if TYPE_CHECKING:
    from astb.acceptance.conformance.report import Difference


@click.command("conform")
@click.argument("target")
@click.option(
    "--against",
    "other",
    type=click.Path(path_type=Path, dir_okay=False),
    metavar="OTHER.json",
    help="Compare the rig with another one, by the report of its --json.",
)
@click.option(
    "--json",
    "json_path",
    type=click.Path(path_type=Path, dir_okay=False),
    metavar="FILE",
    help="Write the report as JSON, for programs and for --against.",
)
@click.option(
    "--allow-motion", is_flag=True, help="Also arm the rig, move its platform by 2 mm, and stop all messages."
)
def conform_command(target: str, other: Path | None, json_path: Path | None, allow_motion: bool) -> None:
    """Test the messages and registers of a rig against the protocol.

    It tests timing, states, refused commands, limits and Modbus exceptions. TARGET is the folder or
    file of a rig, or a name of `astb list rigs`. Without --allow-motion, a correct rig does not move.

    Exit codes: 0 if all tests pass and, with --against, both rigs are equal, 1 if not, 2 for wrong usage, 3 if no
    rig answers.
    """
    from astb.acceptance.conformance.suite import examine_rig

    def say(text: str) -> None:
        click.echo(text, err=True)

    try:
        rig, path = find_rig(target)
        there = read_report(other) if other else None
        findings = examine_rig(rig, path, motion=allow_motion, say=say)
    except (RigFileError, ReportError, ValueError) as error:
        misuse(error)
    except BenchError as error:
        blocked(error)
    report = Report(rig=rig.name, time=rig.time, motion=allow_motion, findings=findings)
    if json_path:
        json_path.write_bytes(report.to_json())
    _show(report)
    apart: list[Difference] = []
    if there:
        try:
            pairs = common_tests(report, there)
        except ReportError as error:
            misuse(error)
        apart = differences(pairs)
        _show_differences(report, there, len(pairs), apart)
    raise click.exceptions.Exit(FAIL if report.wrong or apart else PASS)


def _show(report: Report) -> None:
    marks = {"right": ("pass", "green"), "wrong": ("fail", "bold red"), "not asked": ("not tested", "dim")}
    table = open_table(f"{report.rig}, {report.time} time", "", "test", "found", "expected", whole=("",))
    group = ""
    for one in report.findings:
        if one.group != group:
            group = one.group
            table.add_section()
            table.add_row("", styled(group, "bold"))
        table.add_row(styled(*marks[one.outcome]), one.what, one.found, one.right)
    console = open_console()
    console.print(table)
    console.print(f"{len(report.findings)} tests, {len(report.wrong)} failed")


def _show_differences(here: Report, there: Report, compared: int, apart: "list[Difference]") -> None:
    console = open_console()
    tests = f"{compared} of {len(here.findings)} tests ran on both rigs"
    if not apart:
        console.print(f"{tests}: {here.rig} and {there.rig} agree")
        return
    columns = ("group", "test", here.rig, f"{there.rig} (other)")
    table = open_table(f"{tests}: {len(apart)} differences", *columns, whole=("group",))
    for one in apart:
        table.add_row(*one)
    console.print(table)
