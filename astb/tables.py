"""Text and tables on the terminal, without markup: full names at 80 columns, and unfolded lines for programs and files.

Names, remarks and paths come from outside, so no text is markup; bold or red text is `styled`.
"""

import sys
from collections.abc import Collection, Iterable
from functools import cache
from typing import IO, Final

import click
import msgspec
from rich import box
from rich.console import Console, ConsoleOptions, RenderableType
from rich.segment import Segment
from rich.table import Table
from rich.text import Text

from astb.terminal import printable

#: Output to a file has no limit of width.
_UNFOLDED: Final = 200


def open_console() -> Console:
    """Return the console of this terminal, or a wide one for a pipe."""
    return plain_console() if sys.stdout.isatty() else plain_console(width=_UNFOLDED)


def plain_console(*, width: int | None = None, stderr: bool = False) -> Console:
    """Return a console that prints text unchanged, without markup and without colours for numbers."""
    return _PlainConsole(width=width, stderr=stderr, markup=False, emoji=False, highlight=False)


@cache
def shared_console() -> Console:
    """Return the one console of a run: the display and the questions of its plans alternate on it."""
    return plain_console()


class _PlainConsole(Console):
    """Writes its colours directly to the stream, and only `printable` characters of each text."""

    @property
    def file(self) -> IO[str]:
        stream = super().file
        return getattr(stream, "rich_proxied_file", stream)

    @file.setter
    def file(self, stream: IO[str]) -> None:
        self._file = stream

    def render(self, renderable: RenderableType, options: ConsoleOptions | None = None) -> Iterable[Segment]:
        for segment in super().render(renderable, options):
            yield segment if segment.control else Segment(printable(segment.text), segment.style)


def styled(text: str, style: str) -> Text:
    """Return a text in a style, such as ``bold red``."""
    return Text(text, style)


def open_table(title: str, *columns: str, whole: Collection[str] = ()) -> Table:
    """Return an empty table; the columns ``whole`` are never folded or cut."""
    table = Table(title=title, title_justify="left", box=box.SIMPLE_HEAD, pad_edge=False)
    for column in columns:
        table.add_column(column, no_wrap=column in whole)
    return table


def print_json(rows: object) -> None:
    """Print the content of a table for programs: structs, mappings and lists of them, as one JSON document."""
    click.echo(msgspec.json.format(msgspec.json.encode(rows), indent=2).decode())
