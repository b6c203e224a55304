"""What the operator sees of a run: a bar with the present phase, a line for every check, the verdict."""

from pathlib import Path
from typing import Final, Self

from rich.console import Console
from rich.progress import BarColumn, Progress, SpinnerColumn, TaskID, TextColumn, TimeElapsedColumn

from bench_records.layout import REPORT
from bench_records.result import Check, CheckVerdict, Outcome, Result

_COLOURS: Final = {
    CheckVerdict.PASS: "green",
    CheckVerdict.MARGINAL: "yellow",
    CheckVerdict.FAIL: "red",
    CheckVerdict.ERROR: "red",
    CheckVerdict.NOT_AVAILABLE: "cyan",
}
_OUTCOMES: Final = {
    Outcome.PASS: "green",
    Outcome.INCOMPLETE: "yellow",
    Outcome.FAIL: "red",
    Outcome.BLOCKED: "magenta",
}


class ProgressDisplay:
    """What the operator sees: a bar with the present phase, and a line for every check; a plan's watcher."""

    def __init__(self, console: Console) -> None:
        self._console = console
        self._progress = Progress(
            SpinnerColumn(),
            TextColumn("[bold]{task.fields[plan]}"),
            BarColumn(),
            TextColumn("{task.percentage:>3.0f} %"),
            TimeElapsedColumn(),
            TextColumn("{task.description}"),
            console=console,
            transient=True,
        )
        self._task: TaskID | None = None
        self._introduced = ""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        if self._task is not None:
            self._progress.stop()

    def introduce(self, text: str) -> None:
        """Show, once, under which circumstances is measured."""
        if text and text != self._introduced:
            self._introduced = text
            self._console.print(text, style="bold", highlight=False, markup=False, soft_wrap=True)

    def warn(self, text: str) -> None:
        """Show what somebody has to know before they touch the bench."""
        self._console.print(f"  {text}", style="bold", highlight=False, markup=False, soft_wrap=True)

    def begin(self, plan: str) -> None:
        """Show that ``plan`` begins."""
        if self._task is not None:
            self._progress.remove_task(self._task)
        self._progress.start()
        self._task = self._progress.add_task("", total=1.0, plan=plan)

    def say(self, text: str) -> None:
        """Show what the plan is doing now."""
        if self._task is not None:
            self._progress.update(self._task, description=text)
        else:
            self._console.print(text, style="dim", highlight=False)

    def progress(self, fraction: float) -> None:
        """Show how much of the plan is done."""
        if self._task is not None:
            self._progress.update(self._task, completed=fraction)

    def follow(self, text: str, fraction: float) -> None:
        """Show what is done now and how much of all is."""
        self.say(text)
        self.progress(fraction)

    def checked(self, check: Check) -> None:
        """Show a check and its verdict."""
        self._console.print(
            f"  {check}", style=_COLOURS[check.verdict], highlight=False, markup=False, soft_wrap=True
        )

    def conclude(self, result: Result, directory: Path) -> None:
        """Show the verdict on a plan and where its report lies."""
        from bench_records.report import headline

        colour = _OUTCOMES[result.verdict]
        said = headline(result) if result.verdict is Outcome.INCOMPLETE else result.reason
        reason = f": {said}" if said else ""
        self._console.print(
            f"{result.plan}: {result.verdict.upper()}{reason}", style=f"bold {colour}", markup=False
        )
        self._console.print(f"  report: {directory / REPORT}", highlight=False, markup=False, soft_wrap=True)
