"""Display of a run for the operator: its progress, a line for every check, the verdict."""

from collections.abc import Iterable
from pathlib import Path
from typing import Final, Self

from rich.console import Console, RenderableType
from rich.progress import BarColumn, Progress, SpinnerColumn, TaskID, TextColumn, TimeElapsedColumn
from rich.text import Text

from astb.live.model import Live
from astb.live.snapshot import LiveReading, Snapshot
from bench_protocol.units import us
from bench_records.layout import REPORT
from bench_records.report import headline
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

#: Interval at which a terminal is redrawn.
_PER_SECOND: Final = 4


class _Screen(Progress):
    """A progress bar, and below it the latest snapshot of a run, drawn at regular intervals.

    Nothing is drawn while a question waits, because the user types the answer in this place.
    """

    run: Live | None = None
    _empty = False

    @property
    def _question_open(self) -> bool:
        run = self.run  # read once, because it may have ended at the next read
        return run is not None and run.question is not None

    def refresh(self) -> None:
        """Draw the screen. While a question waits, the empty screen is drawn only once."""
        if not (self._empty and self._question_open):
            super().refresh()

    def get_renderables(self) -> Iterable[RenderableType]:
        self._empty = self._question_open
        if self._empty:
            return
        yield from super().get_renderables()
        if (run := self.run) is not None:
            yield drawn(run.snapshot())


class ProgressDisplay:
    """The display for the operator, which is the watcher of a plan.

    On a terminal it shows a bar and the state of the run, otherwise it prints lines.
    """

    def __init__(self, console: Console) -> None:
        self._console = console
        self._screen = _Screen(
            SpinnerColumn(),
            TextColumn("{task.fields[plan]}", style="bold", markup=False),
            BarColumn(),
            TextColumn("{task.percentage:>3.0f} %"),
            TimeElapsedColumn(),
            TextColumn("{task.description}", markup=False),
            console=console,
            transient=True,
            refresh_per_second=_PER_SECOND,
            disable=not console.is_terminal,
        )
        self._task: TaskID | None = None
        self._live: Live | None = None
        self._introduced = ""

    @property
    def live(self) -> Live | None:
        """The present run, or the last one."""
        return self._live

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._screen.run = None
        if self._task is not None:
            self._screen.stop()

    def introduce(self, text: str) -> None:
        """Show the circumstances of the measurement, unless the same text was shown last."""
        if text and text != self._introduced:
            self._introduced = text
            self._print(text, "bold")

    def warn(self, text: str) -> None:
        """Show a warning that a user must read before touching the bench."""
        self._print(f"  {text}", "bold")

    def begin(self, plan: str, live: Live | None = None) -> None:
        """Show that ``plan`` begins; with ``live`` also show its progress."""
        if self._task is not None:
            self._screen.remove_task(self._task)
        self._live = self._screen.run = live
        self._screen.start()
        self._task = self._screen.add_task("", total=1.0, plan=plan)

    def say(self, text: str) -> None:
        """Show the present action of the plan."""
        if self._live is not None:
            self._live.say(text)
        if self._task is None or not self._console.is_terminal:
            self._print(text, "dim")
        else:
            self._screen.update(self._task, description=text)

    def phase(self, path: tuple[str, ...], *, begins: bool) -> None:
        """Show which step begins."""
        if self._live is not None:
            self._live.phase(path, begins=begins)
        if not begins:
            return
        if self._console.is_terminal:
            if self._task is not None:
                self._screen.update(self._task, description="" if self._live else path[-1])
        else:
            time = "" if self._live is None else f"{self._live.time:8.1f} s"
            self._print(f"{time}  {'  ' * (len(path) - 1)}{path[-1]}")

    def progress(self, fraction: float) -> None:
        """Show the completed fraction of the plan."""
        if self._live is not None:
            self._live.progress(fraction)
        if self._task is not None:
            self._screen.update(self._task, completed=fraction)

    def follow(self, text: str, fraction: float) -> None:
        """Show the present action and the progress."""
        self.say(text)
        self.progress(fraction)

    def checked(self, check: Check) -> None:
        """Show a check and its verdict."""
        if self._live is not None:
            self._live.checked(check)
        self._print(f"  {check}", _COLOURS[check.verdict])

    def conclude(self, result: Result, directory: Path, *, deviates: bool) -> None:
        """Show the verdict of a plan, whether the rig deviates from its model, and the path of the report."""
        if self._live is not None:
            self._live.conclude(result)
            self._screen.run = None
        colour = _OUTCOMES[result.verdict]
        self._print(f"{result.plan}: {result.verdict.upper()}: {headline(result)}", f"bold {colour}")
        if deviates:
            self._print(
                "  the rig deviates from its model; the report gives the possible causes",
                "bold yellow",
            )
        self._print(f"  report: {directory / REPORT}")

    def _print(self, text: str, style: str = "") -> None:
        # A text with its own style: a style for the whole print would also colour the screen below.
        self._console.print(Text(text, style), soft_wrap=True)


_BAR: Final = 12
_CLOSE: Final = 0.9
_NEAR: Final = 0.75
_NAME: Final = 28


def drawn(seen: Snapshot) -> Text:
    """Return the state of a run as text: state and steps, remaining time, late ticks of the rig, and the key
    readings.
    """
    text = Text(no_wrap=True, overflow="ellipsis")
    text.append(f"{seen.state:<14}", "bold" if not seen.reason else "bold red")
    text.append(seen.reason and f"{seen.reason}  ", "red")
    text.append(" › ".join(seen.step) or "–", "bold")
    text.append(f"  {seen.in_step:.0f} s")
    if seen.held or seen.hold_wanted_by:
        text.append(
            f"  held {seen.held}" if seen.held else "  will be held at the next hold point", "bold yellow"
        )
    text.append("\n")
    text.append(f"{'next':<14}", "dim")
    text.append((seen.next or ("not known" if seen.left is None else "the end")) + "  ")
    text.append(_time_left(seen), "dim")
    text.append(f"\n{'late ticks':<14}", "dim")
    text.append(_punctuality(seen) + "\n", "yellow" if seen.late else "")
    for one in seen.readings:
        _draw_reading(text, one)
    if seen.assumed:
        text.append(
            f"{seen.assumed} of these limits are assumed because the rig file does not state them\n", "dim"
        )
    return text


def _time_left(seen: Snapshot) -> str:
    if seen.left is None:
        return (
            "known after this plan was run or rehearsed once"
            if not seen.outline
            else f"the steps differ from {seen.outline}"
        )
    return f"{seen.left:.0f} s to go, as in {seen.outline}"


def _punctuality(seen: Snapshot) -> str:
    if seen.late is None:
        return "not reported by the rig"
    worst = "" if seen.latest is None else f", at most {seen.latest / us:.0f} µs since the rig started"
    return f"{seen.late}{worst}"


def _draw_reading(text: Text, one: LiveReading) -> None:
    text.append(f"{one.name.replace('.', ' ').replace('_', ' '):<{_NAME}}", "dim")
    text.append(f"{one.shown:>14}", "red" if one.value is None else "")
    if one.used is not None:
        style = "red" if one.used >= _CLOSE else "yellow" if one.used >= _NEAR else "green"
        full = min(round(one.used * _BAR), _BAR)
        text.append("  " + "━" * full, style)
        text.append("╌" * (_BAR - full), "dim")
        text.append(f" {100 * one.used:3.0f} % of the way to {one.limit}", "dim")
    text.append("\n")
