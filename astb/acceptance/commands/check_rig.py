"""`astb check-rig`: who is there, what it says, and whether that can be, before a plan runs on it."""

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Final

import click
from msgspec.structs import replace

from astb.exit_codes import FAIL, INCOMPLETE, PASS, blocked, misuse
from astb.rig_file import RigFileError, find_rig
from astb.tables import open_console, open_table, styled
from drivers.errors import BenchError, WiringError

if TYPE_CHECKING:
    from astb.acceptance.checking.report import CheckReport, MoveLine
    from astb.rig_file import RigFile

#: Width of a terminal from which on all is told beside a signal; else remarks stand below, and sources in the JSON.
_WIDE: Final = 120


@click.command("check-rig")
@click.argument("target")
@click.option(
    "--json", "as_json", is_flag=True, help="Print the report as JSON, for programs, instead of tables."
)
@click.option(
    "--allow-motion",
    is_flag=True,
    help="Also arm the bench, and move each axis by a few millimetres. It must be at rest, without air.",
)
def check_rig_command(target: str, as_json: bool, allow_motion: bool) -> None:
    """Tell of each signal of a rig where it comes from, how often, and whether it can be.

    TARGET is a rig file, or a name of `astb rigs`. Without --allow-motion it only listens and reads: nothing moves, and
    whoever commands the rig goes on. Ends with 0 if all is fine, 1 if something is doubtful, 2 for misuse, 3 if no rig
    answers, 4 if nothing is doubtful but plans cannot run.
    """

    def say(text: str) -> None:
        click.echo(text, err=True)

    try:
        rig, path = find_rig(target)
        report = _listen(rig, path, say)
        if allow_motion and report.doubtful:  # a wrong reading is a wrong place to start from
            say("nothing is moved: what is doubtful at rest must be corrected first")
        elif allow_motion:
            report = replace(report, moves=_move(rig, path, say))
    except (RigFileError, WiringError) as error:
        misuse(error)
    except BenchError as error:
        blocked(error)
    if as_json:
        click.echo(report.to_json(), nl=False)
    else:
        _show(report)
    raise click.exceptions.Exit(FAIL if report.doubtful else INCOMPLETE if report.missing else PASS)


def _listen(rig: "RigFile", path: Path, say: Callable[[str], None]) -> "CheckReport":
    from astb.acceptance.checking.examining import WITHIN, examine
    from astb.listening import Listening
    from astb.session import dimensions_of, open_session

    with (
        open_session(rig, path, say=say) as session,
        Listening(session.bench.wiring, session.clock, WITHIN) as one,
    ):
        return examine(one, rig.name, dimensions_of(rig, path))


def _move(rig: "RigFile", path: Path, say: Callable[[str], None]) -> "list[MoveLine]":
    from astb.acceptance.checking.moving import move_each
    from astb.session import open_session

    with open_session(rig, path, say=say) as session, session.bench as bench:
        return move_each(bench)


def _show(report: "CheckReport") -> None:
    style = {"fine": "green", "doubtful": "bold red", "absent": "yellow", "not told": "dim"}
    console = open_console()
    console.print(styled(report.rig, "bold") + f", {report.state}; identity: {report.identity}")
    for line in report.summary:
        console.print(styled(line, "bold"))
    for line in report.capabilities:
        console.print(f"  {line}")
    wide = console.width >= _WIDE
    columns = ("", "signal", "value", "rate") + (("age", "from", "remark") if wide else ())
    table = open_table("signals", *columns, whole=columns[:5])
    for one in report.signals:
        rate = "" if one.rate is None else f"{one.rate:.3g} Hz"
        age = "" if one.age is None else f"{one.age * 1e3:.0f} ms"
        mark = styled(one.verdict, style[one.verdict])
        further = (age, one.source, one.remark) if wide else ()
        table.add_row(mark, one.name, one.shown, rate, *further)
    console.print(table)
    for one in report.signals:
        if one.remark and not wide:
            console.print(f"{one.name}: {one.remark}")
    for noticed in report.connections:
        mark = styled(noticed.verdict, style[noticed.verdict])
        console.print(mark + f" transport {noticed.name}: {noticed.remark}")
    if report.moves:
        moves = open_table("moves", "", "what", "found", "right", whole=("",))
        for move in report.moves:
            moves.add_row(styled(move.verdict, style[move.verdict]), move.what, move.found, move.right)
        console.print(moves)
    for what, names in report.checks.items():
        console.print(f"{what} cannot be measured in aw0 and aw3: no {names}")
    if report.remembered:
        console.print(f"only remembered, as last written: {', '.join(report.remembered)}")
