"""The display of `astb watch` on a terminal during a run: every reading with its expected value."""

from pathlib import Path
from types import TracebackType
from typing import Self

import click
from rich.live import Live
from rich.table import Table

from astb.tables import open_console, open_table, styled
from astb.watch.watching import DiagnosisError, ParameterError, RecordError, watch
from bench_protocol.table import TABLE
from bench_protocol.units import FACTORS
from bench_records.twin import PARTS, Deviation, LastMinute, TwinStory

__all__ = ["DiagnosisError", "ParameterError", "RecordError", "Screen", "comparison_table", "watch_on_screen"]


def watch_on_screen(directory: Path, model: str) -> TwinStory:
    """Compare a run with its model until the run ends, and show the results on the terminal.

    Return the last results.
    """
    printed: dict[int, int] = {}
    with Screen() as screen:

        def report(story: TwinStory) -> None:
            for k, deviation in enumerate(story.all_deviations):
                if len(deviation.course) > printed.get(k, 0):
                    word = deviation.course[-1].word
                    screen.say("\n".join(lines(deviation, word)))
                printed[k] = len(deviation.course)
            screen.show(story)

        return watch(directory, model, report)


def lines(deviation: Deviation, word: str) -> list[str]:
    """Return the lines of text on a deviation.

    ``word`` states how it has changed; "told" stands for a new deviation.
    """
    head = "deviation" if word == "told" else f"deviation, {word}"
    if deviation.summary is None:
        return [f"{head}: {deviation.sentence}"]
    return [head, *(f"  {label}: {getattr(deviation.summary, name)}" for name, label in PARTS.items())]


class Screen:
    """Prints lines. On a terminal, it also shows below them a table of the latest mean of each reading."""

    def __init__(self) -> None:
        self._console = open_console()
        self._live = Live(console=self._console, auto_refresh=False, transient=True)

    def __enter__(self) -> Self:
        if self._console.is_terminal:
            self._live.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, where: TracebackType | None
    ) -> None:
        self._live.stop()

    def say(self, text: str) -> None:
        """Print a permanent line."""
        if self._live.is_started:
            self._console.print(text)
        else:
            click.echo(text)

    def show(self, story: TwinStory) -> None:
        """Show the last means of each reading in ``story``, if the output is a terminal."""
        if self._live.is_started and story.last_minute:
            self._live.update(comparison_table(story.last_minute, story), refresh=True)


def comparison_table(minute: LastMinute, story: TwinStory) -> Table:
    """Return a table of the last mean of each reading, its expected value, and their difference divided by its
    uncertainty.

    The uncertainty is expanded (k = 2). Differences that exceed it are red.
    """
    deviation = story.present_deviation
    word = f"deviates from its model since {deviation.since:.1f} s" if deviation else "agrees with its model"
    title = f"{story.until:.1f} s: the rig {word}; means over 0.5 s around {minute.times[-1]:.1f} s"
    table = open_table(title, "reading", "unit")
    for name in ("measured", "expected", "± (k = 2)", "difference / ±"):
        table.add_column(name, justify="right", no_wrap=True)
    for one in minute.channels:
        unit = TABLE[one.channel].unit
        found = [side[-1] for side in (one.measured, one.expected, one.band)]
        if None in found:
            table.add_row(one.channel, unit, "not received")
            continue
        measured, expected, band = (value / FACTORS[unit] for value in found if value is not None)
        bands = (measured - expected) / band
        texts = (f"{measured:.3f}", f"{expected:.3f}", f"{band:.2g}", f"{bands:+.1f}")
        table.add_row(
            one.channel, unit, *(styled(text, "bold red" if abs(bands) > 1.0 else "") for text in texts)
        )
    return table
