"""Tables on the terminal: names in full at 80 columns, and no lines folded where a program or a file reads them."""

import sys
from collections.abc import Collection
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from rich.console import Console
    from rich.table import Table

#: What does not go to a terminal is as wide as it needs to be.
_UNFOLDED: Final = 200


def open_console() -> "Console":
    """Return the console of this terminal, or a wide one for a pipe."""
    from rich.console import Console

    return Console() if sys.stdout.isatty() else Console(width=_UNFOLDED)


def open_table(title: str, *columns: str, whole: Collection[str] = ()) -> "Table":
    """Return an empty table; the columns ``whole`` are never folded or cut."""
    from rich import box
    from rich.table import Table

    table = Table(title=title, title_justify="left", box=box.SIMPLE_HEAD, pad_edge=False)
    for column in columns:
        table.add_column(column, no_wrap=column in whole)
    return table


def print_json(rows: object) -> None:
    """Print what a table shows for a program instead: structs, mappings and lists of them, as one JSON document."""
    import click
    import msgspec

    click.echo(msgspec.json.format(msgspec.json.encode(rows), indent=2).decode())
