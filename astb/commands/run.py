"""`astb run` and `astb report`: plans on a rig, and the reports of their records."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import click

from astb.commands.completion import complete_plans
from astb.commands.ending import end_in_order
from astb.commands.options import (
    RIG_OPTION,
    SEED_OPTION,
    read_rig,
    read_specimen,
    simulated,
    simulation_options,
)
from astb.commands.plan_values import chosen_plans, plan_value_options
from astb.exit_codes import BLOCKED, DEVIATES, FAIL, INCOMPLETE, PASS, blocked, misuse
from astb.messages import MessageError, Messages, receiver
from astb.operators import operator_for
from astb.rig_file import RigFileError
from astb.tables import shared_console
from bench_records.conversion import recover
from bench_records.layout import STREAM, RecordError
from bench_records.letterhead import read_letterhead
from bench_records.printing import write_pdf
from bench_records.report import write_report
from drivers.errors import BenchError

if TYPE_CHECKING:
    from astb.run import Keeping
    from bench_records.result import Result

#: Exit codes by verdict; of several plans the last in this order counts.
_EXIT: Final = {"pass": PASS, "incomplete": INCOMPLETE, "fail": FAIL, "blocked": BLOCKED}
#: Additional files of a run, and receivers of its messages.
_KEPT: Final = (
    click.option(
        "--keep-frames",
        is_flag=True,
        help="Also record all CAN frames, in can.blf; `astb export` converts them.",
    ),
    click.option(
        "--pdf", is_flag=True, help="Also write the report as PDF for signature; this needs Chromium."
    ),
    click.option(
        "--watch",
        "twin",
        is_flag=True,
        help="Compare the rig with its model during the run, and print deviations as `astb watch` does.",
    ),
    click.option(
        "--wait",
        is_flag=True,
        help="Wait until earlier runs and reservations of others have ended, and print the place in the queue.",
    ),
    click.option(
        "--operator",
        "run_by",
        envvar="ASTB_OPERATOR",
        default="",
        help="Name of the operator, for record, report and queue.  [default: ASTB_OPERATOR of the environment; "
        "for the queue, else the user account]",
    ),
    click.option(
        "--ambient",
        envvar="ASTB_AMBIENT",
        default="",
        help='Ambient conditions, such as "21 °C, 1013 hPa", for record and report.  [default: ASTB_AMBIENT of the '
        "environment]",
    ),
    click.option(
        "--message",
        metavar="TO",
        envvar="ASTB_MESSAGE",
        default="",
        help="Send a message at each question and at the end: to a command, or to a webhook on this machine such as "
        "http://127.0.0.1:8080/hook.  [default: ASTB_MESSAGE of the environment]",
    ),
    click.option(
        "--message-elsewhere",
        envvar="ASTB_MESSAGE_ELSEWHERE",
        is_flag=True,
        help="Allow a webhook on another machine. The messages name plan, specimen and rig.",
    ),
)


def kept_options(command: Callable[..., None]) -> Callable[..., None]:
    """Add the options for additional files of a run and receivers of its messages: see `_keeping`."""
    for option in reversed(_KEPT):
        command = option(command)
    return command


@click.command("run")
@click.argument("plans", nargs=-1, required=True, metavar="PLAN...", shell_complete=complete_plans)
@RIG_OPTION
@click.option(
    "--virtual",
    is_flag=True,
    help="Simulate the rig in virtual time, without sockets; the verdicts are the same.",
)
@SEED_OPTION
@simulation_options
@plan_value_options
@kept_options
def run_command(
    plans: tuple[str, ...],
    rig_named: str | None,
    virtual: bool,
    seed: int | None,
    model: str | None,
    effects: tuple[str, ...],
    sealed: str | None,
    specimen_name: str | None,
    answers: str | None,
    settings: tuple[str, ...],
    values_path: Path | None,
    out: Path,
    **kept: Any,
) -> None:
    """Run test plans on a rig, and write records and reports.

    Each plan gets a folder OUT/PLAN with record, result and report. Runs are never overwritten: the next run of a plan
    goes to OUT/PLAN-2, and so on. PLAN is a name of astb plans, or a .py file with your own plans.

    Ctrl-C, SIGTERM, SIGQUIT or closing the terminal stops the plan. Then the rig vents the springs, and the report says
    how much air is left. A second signal stops the venting, too. The results are written in each case.

    \b
    Exit codes:
      0  all plans pass
      1  a plan fails
      2  wrong usage
      3  a plan is blocked by the rig or by a precondition
      4  all measured checks pass, but some checks were not measured
      6  all plans pass, but the rig deviates from its model (--watch)
    """
    from astb.run import deviates, run_plans

    chosen = chosen_plans(plans, settings, values_path)
    specimen = read_specimen(specimen_name)
    rig, path = read_rig(rig_named)
    rig = simulated(rig, path, model, effects, sealed)
    keeping = _keeping(**kept)
    deviating: list[bool] = []
    end_in_order()
    try:
        results = run_plans(
            chosen,
            rig,
            path,
            virtual=virtual,
            seed=seed,
            out=out,
            specimen=specimen,
            operator=operator_for(answers, shared_console()),
            keeping=keeping,
            ended=lambda _, directory: deviating.append(deviates(directory)),
        )
    except (RigFileError, ValueError, RecordError) as error:
        misuse(error)
    except BenchError as error:
        blocked(error)
    raise click.exceptions.Exit(_status(results, any(deviating)))


def _status(results: Sequence["Result"], deviates: bool) -> int:
    status = _EXIT[max((result.verdict for result in results), key=list(_EXIT).index)]
    return DEVIATES if deviates and status in (PASS, INCOMPLETE) else status


def _keeping(
    *,
    keep_frames: bool,
    pdf: bool,
    twin: bool,
    wait: bool,
    run_by: str,
    ambient: str,
    message: str,
    message_elsewhere: bool,
) -> "Keeping":
    from astb.run import Keeping

    try:
        messages = Messages(receiver(message, elsewhere=message_elsewhere)) if message else None
    except MessageError as error:
        misuse(error)
    return Keeping(run_by, ambient, keep_frames, pdf, messages, twin, wait)


@click.command("report")
@click.argument("directory", type=click.Path(path_type=Path, exists=True, file_okay=False))
@click.option("--pdf", is_flag=True, help="Also write report.pdf for signature; this needs Chromium.")
@click.option(
    "--letterhead",
    type=click.Path(path_type=Path, dir_okay=False),
    help="TOML file with laboratory, customer, order and logo.  [default: ASTB_LETTERHEAD of the environment]",
)
def report_command(directory: Path, pdf: bool, letterhead: Path | None) -> None:
    """Write the report of a run again.

    If the run was killed, its record is recovered first.
    """
    try:
        if (directory / STREAM).exists():
            click.echo(recover(directory))
        report = write_report(directory, read_letterhead(letterhead) if letterhead else None)
        click.echo(report)
        if pdf:
            click.echo(write_pdf(report))
    except RecordError as error:
        misuse(error)
