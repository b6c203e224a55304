"""`astb rig check`: the signals of a rig, their sources, rates and plausibility."""

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

#: Terminal width from which remarks are next to a signal. On a narrower one they are below, and only JSON has sources.
_WIDE: Final = 120
#: Shown for signals and motions without a verdict.
_NOT_JUDGED: Final = {"not told": "not judged"}


@click.command("check")
@click.argument("target")
@click.option("--json", "as_json", is_flag=True, help="Print JSON instead of text.")
@click.option(
    "--allow-motion",
    is_flag=True,
    help="Also arm the rig, and move each axis by a few millimetres. The rig must be at rest, without air.",
)
def check_command(target: str, as_json: bool, allow_motion: bool) -> None:
    """Check the signals of a rig before plans run on it.

    For each signal it prints source, rate, value and whether the value is plausible. TARGET is the folder or
    file of a rig, or a name of `astb list rigs`. Without --allow-motion it only reads: nothing moves, and another
    program can command the rig meanwhile.

    \b
    Exit codes:
      0  all signals are fine
      1  a signal is doubtful
      2  wrong usage
      3  no rig answers
      4  no signal is doubtful, but some plans cannot run
    """

    def say(text: str) -> None:
        click.echo(text, err=True)

    try:
        rig, path = find_rig(target)
        report = _listen(rig, path, say)
        if allow_motion and report.doubtful:  # a motion must not start from a wrong reading
            say("The rig is not moved. Correct the readings that are in doubt at rest first.")
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
    console.print(styled(report.rig, "bold") + f": state {report.state}; {report.identity}")
    for line in report.summary:
        console.print(styled(line, "bold"))
    console.print("capabilities of the rig:")
    for line in report.capabilities:
        console.print(f"  {line}")
    wide = console.width >= _WIDE
    columns = ("", "signal", "value", "rate") + (("age", "from", "remark") if wide else ())
    table = open_table("signals", *columns, whole=columns[:5])
    for one in report.signals:
        rate = "" if one.rate is None else f"{one.rate:.3g} Hz"
        age = "" if one.age is None else f"{one.age * 1e3:.0f} ms"
        mark = styled(_NOT_JUDGED.get(one.verdict, one.verdict), style[one.verdict])
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
        moves = open_table("moves", "", "quantity", "found", "expected", whole=("",))
        for move in report.moves:
            moves.add_row(
                styled(_NOT_JUDGED.get(move.verdict, move.verdict), style[move.verdict]),
                move.what,
                move.found,
                move.right,
            )
        console.print(moves)
    for what, names in report.checks.items():
        console.print(f"{what} cannot be measured in aw0 and aw3: the rig has no {names}")
    if report.remembered:
        console.print(f"not read back from the rig, shown as last written: {', '.join(report.remembered)}")
