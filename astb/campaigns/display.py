"""Display of a campaign: on a terminal a bar with the remaining time, otherwise a line every 10 s."""

from collections import Counter
from collections.abc import Mapping, Sequence
from statistics import median
from typing import Any, Final, Self

from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, MofNCompleteColumn, Progress, SpinnerColumn, TextColumn
from rich.table import Table

from astb.campaigns.findings import Kind, distributions, kind_of, verdict_of
from astb.campaigns.plan_case import PlanCase
from astb.campaigns.run import Standing
from bench_protocol.units import hours, minutes, s
from test_plans.discovery import plans

#: Period of lines through a pipe.
BETWEEN: Final = 10 * s
#: Ratio of test time to computing time of one processor, including the report. 20 to 40 were measured.
SPEED: Final = 25.0


class CampaignDisplay:
    """Shows the progress of a campaign and every failed case. It is the argument ``watch`` of `run_cases`."""

    def __init__(self, console: Console) -> None:
        self._console = console
        self._reported = 0.0
        self._bar = Progress(
            SpinnerColumn(),
            BarColumn(),
            MofNCompleteColumn(),
            TextColumn("{task.description}", markup=False),
            console=console,
            transient=True,
            disable=not console.is_terminal,
        )
        self._task = self._bar.add_task("")

    def __enter__(self) -> Self:
        self._bar.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._bar.stop()

    def __call__(self, standing: Standing) -> None:
        """Show the present state of the campaign."""
        row = standing.row
        if not row and standing.before:
            self._print_line(f"{standing.before} of {standing.total} cases have results from earlier")
        if row and row["error"]:
            self._print_line(f"{row['key']}: {row['error']}")
        self._bar.update(
            self._task,
            total=standing.total,
            completed=standing.before + standing.done,
            description=_progress(standing).removeprefix(", "),
        )
        due = standing.elapsed - self._reported >= BETWEEN or not standing.left
        if row and due and not self._console.is_terminal:
            self._reported = standing.elapsed
            self._print_line(
                f"{standing.before + standing.done} of {standing.total} cases{_progress(standing)}"
            )

    def _print_line(self, text: str) -> None:
        self._console.print(text, soft_wrap=True)


def _progress(standing: Standing) -> str:
    failed = f", {standing.failed} failed" if standing.failed else ""
    left = standing.time_left
    return failed + (f", {duration(left)} left" if left else "")


def duration(seconds: float) -> str:
    """Return a rounded time as text."""
    if seconds < 1.5 * minutes:
        return f"{seconds:.0f} s"
    return f"{seconds / minutes:.0f} min" if seconds < 1.5 * hours else f"{seconds / hours:.1f} h"


def cost(
    cases: Mapping[str, PlanCase],
    rows: Sequence[Mapping[str, Any]],
    processes: int | None,
    *,
    again: bool = False,
) -> str:
    """Return a sentence on the ``cases`` without a row in ``rows``: their number, test time and computing time.

    ``processes`` is the number of processes that compute, None if unknown. The duration of a case is the median of the
    rows of its plan. For a plan without rows, its test time (s of the bench) is divided by the speed of all rows, or by
    `SPEED`. With ``again``, failed cases also run.
    """
    kept = {row["key"] for row in rows if not (again and row["error"])}
    left = [case.plan for key, case in cases.items() if key not in kept]
    total = f"{len(cases)} cases: {len(cases) - len(left)} have results, {len(left)} will run"
    if not left:
        return total
    lasts = {name: plans()[name].lasts for name in set(left)}
    good = [row for row in rows if not row["error"] and row["seconds"]]
    speed = median([row["lasted"] / row["seconds"] for row in good]) if good else SPEED
    each = {
        name: median([row["seconds"] for row in good if row["plan"] == name] or [lasts[name] / speed])
        for name in lasts
    }
    used = min(processes or 1, len(left))
    computing = sum(each[name] for name in left) / used
    return (
        f"{total}; test time {duration(sum(lasts[name] for name in left))}, "
        f"{'computing' if processes else 'processor'} time about {duration(computing)}"
        f"{f' on {used} processes' * (used > 1)}"
        f"{'' if good else ' (a first estimate)'}"
    )


def verdicts(rows: Sequence[Mapping[str, Any]]) -> Table:
    """Return a table with the number of runs by verdict, for each plan and kind of case."""
    counted: dict[Kind, Counter[str]] = {}
    for row in rows:
        counted.setdefault(kind_of(row), Counter())[verdict_of(row)] += 1
    names = sorted({name for one in counted.values() for name in one})
    table = Table(box=None, pad_edge=False)
    for column in ("plan", "case"):
        table.add_column(column)
    for name in names:
        table.add_column(name, justify="right")
    for kind, one in counted.items():
        table.add_row(escape(kind.plan), escape(kind.words), *(str(one[name] or "") for name in names))
    return table


def failed_checks(rows: Sequence[Mapping[str, Any]]) -> Table | None:
    """Return a table of the checks that failed, most often first; None if none did."""
    failed = [one for one in distributions(rows) if one.failed]
    if not failed:
        return None
    table = Table(box=None, pad_edge=False)
    for column in ("failed check", "of", "plan", "case"):
        table.add_column(column)
    for one in failed:
        table.add_row(
            escape(one.check), f"{one.failed} of {one.cases}", escape(one.kind.plan), escape(one.kind.words)
        )
    return table
