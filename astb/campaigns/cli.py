"""The command `astb campaign`, which `astb` finds by its entry point."""

import shlex
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
from click.core import ParameterSource

from astb.campaigns.kept import KeptError, KeptFailed, read_rows
from astb.campaigns.page import write_page, write_workbook
from astb.campaigns.plan_case import run_plan_cases
from astb.campaigns.workers import ClusterError
from astb.exit_codes import blocked, misuse
from astb.tables import plain_console
from bench_protocol.extras import installed, lacking
from bench_protocol.runtime import processors
from bench_records.layout import RecordError

if TYPE_CHECKING:
    from astb.campaigns.plan_case import PlanCase


@click.command("campaign")
@click.argument("file", type=click.Path(path_type=Path, dir_okay=False))
@click.option(
    "--out",
    type=click.Path(path_type=Path),
    help="Folder for the results.  [default: runs/NAME for NAME.toml]",
)
@click.option(
    "--scheduler",
    metavar="ADDRESS",
    help="Compute on this dask scheduler, such as tcp://host:8786, instead of this machine.",
)
@click.option(
    "--workers", type=click.IntRange(1), help="Number of processes on this machine.  [default: one per core]"
)
@click.option(
    "--limit",
    default="10min",
    show_default=True,
    help="Maximum time of a case; a case that takes longer has failed.",
)
@click.option(
    "--records", type=click.Path(path_type=Path), help="Keep the records of all runs in this folder."
)
@click.option("--again", is_flag=True, help="Repeat failed cases.")
@click.option(
    "--list", "only_list", is_flag=True, help="List the cases and their total time without running them."
)
def campaign_command(
    file: Path,
    out: Path | None,
    scheduler: str | None,
    workers: int | None,
    limit: str,
    records: Path | None,
    again: bool,
    only_list: bool,
) -> None:
    """Run plans with all combinations of parameters, in virtual time.

    FILE lists plans, parameters, specimens, rigs and seeds (TOML). Each completed case adds a row to a Parquet data
    set. After an interruption, the same command continues with the remaining cases.

    Exit codes: 0 if every case has a verdict, 2 for wrong usage, 3 if a case failed or the cluster does not answer.
    """
    from astb.campaigns.display import CampaignDisplay, cost, failed_checks, verdicts

    if not only_list and not installed("campaign"):
        misuse(lacking("campaign", "campaigns"))
    console = plain_console()
    out = out or Path("runs", file.stem)
    cases, seconds = _asked_for(file, limit)
    try:
        processes = None if scheduler else workers or processors()
        click.echo(cost(cases, read_rows(out) if out.is_dir() else [], processes, again=again), err=True)
        if only_list:
            click.echo("\n".join(cases))
            return
        with CampaignDisplay(console) as display:
            rows = run_plan_cases(
                cases,
                out,
                records=records,
                scheduler=scheduler,
                workers=workers,
                limit=seconds,
                again=again,
                watch=display,
            )
    except KeptError as error:
        (blocked if isinstance(error, KeptFailed) else misuse)(error)
    except ClusterError as error:
        blocked(f"{error}; completed cases are kept in {out}. Continue with: {_command_line()}")
    except KeyboardInterrupt:
        blocked(f"stopped; completed cases are kept in {out}. Continue with: {_command_line()}")
    console.print(verdicts(rows))
    if failed_table := failed_checks(rows):
        console.print(failed_table)
    click.echo(f"rows: {out}")
    _write_page_and_workbook(rows, out)
    if failed := sum(bool(row["error"]) for row in rows):
        blocked(f"{failed} of {len(rows)} cases failed. Repeat them with: {_command_line()} --again")


def _command_line() -> str:
    """Return the command line of this process without --again."""
    context = click.get_current_context()
    words = ["astb", "campaign"]
    for one in context.command.params:
        name = str(one.name)
        if name != "again" and context.get_parameter_source(name) is ParameterSource.COMMANDLINE:
            words += [] if isinstance(one, click.Argument) else [one.opts[0]]
            words.append(str(context.params[name]))
    return shlex.join(words)


def _write_page_and_workbook(rows: list[dict[str, Any]], out: Path) -> None:
    """Write the page and the workbook of a campaign next to ``out``, the directory of its rows, and print their
    paths.
    """
    page, book = (out.with_name(f"{out.name}.{ending}") for ending in ("html", "xlsx"))
    try:
        write_page(rows, page, out.name)
        click.echo(f"page: {page}")
        if not installed("excel"):
            click.echo(lacking("excel", "tables for Excel"), err=True)
            return
        write_workbook(rows, book)
        click.echo(f"table: {book}")
    except RecordError as error:
        blocked(f"{error}; the rows are kept in {out}")


def _asked_for(file: Path, limit: str) -> "tuple[dict[str, PlanCase], float]":
    """Return the cases of a campaign file, and the time limit of each (s)."""
    from astb.campaigns.campaign_file import CampaignError, read_campaign
    from bench_protocol.written_values import NotAValue, read_written

    try:
        seconds = read_written("--limit", limit, "s")
        if seconds <= 0.0:
            misuse(f"--limit {limit}: the time limit of a case must be more than 0, such as 10min")
        return read_campaign(file), seconds
    except (CampaignError, NotAValue) as error:
        misuse(error)
