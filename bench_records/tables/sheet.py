"""A sheet: the columns of a file, with equal length, and the line of each row in the file."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from bench_records.layout import RecordError

if TYPE_CHECKING:
    import numpy as np
    import numpy.typing as npt

    from bench_records.tables.keys import ColumnName

#: text: Arrow strings, null if empty; number: numpy; stamp: ns since 1970; span: ns; other: types that are not read.
Kind = Literal["text", "number", "stamp", "span", "other"]


@dataclass
class Column:
    """One column. ``cells`` (n,) depend on its ``kind``. ``there`` (n,) is true for each stamp or span that is not
    missing.
    """

    name: str
    kind: Kind
    cells: Any
    unit: str = ""  #: as the file reports it
    zoned: bool = False  #: of stamps: whether they are in UTC
    there: npt.NDArray[np.bool_] | None = None
    what: str = ""  #: for the kind "other": the type of the cells
    of_day: bool = (
        False  #: of spans: they are times of day, of which the first is at ``begin`` (ns after midnight)
    )
    begin: int = 0

    @property
    def example(self) -> str:
        """Return the first text that is not empty, or "" if all are empty."""
        return next((text for cell in self.cells if (text := (cell.as_py() or "").strip())), "")


@dataclass
class Sheet:
    """The columns of a file, with equal length. ``rows`` (n,) are the numbers of the lines or rows in the file."""

    path: Path
    columns: list[Column]
    rows: npt.NDArray[np.int64]
    row_word: str = "line"
    delimiter: str = ""  #: of a text
    clock: int | None = None  #: index of the clock's column, if the file states it
    title: str = ""  #: of a group in a file with several
    notes: dict[str, str] = field(default_factory=dict)

    @property
    def names(self) -> list[str]:
        """Return the names of the columns in their order."""
        return [column.name for column in self.columns]

    def at(self, index: int) -> str:
        """Return a text on the position of a row in the file."""
        return f"{self.row_word} {self.rows[index]}"

    def places(self, name: ColumnName) -> list[int]:
        """Return the indices of the columns with this name or number: none, one or several."""
        if isinstance(name, int):
            return [name - 1] if 1 <= name <= len(self.columns) else []
        return [index for index, column in enumerate(self.columns) if column.name == name]

    def place(self, column: ColumnName, where: str) -> int:
        """Return the index of the only column with this name or number. Otherwise raises RecordError, whose text
        begins with ``where``.
        """
        found = self.places(column)
        if len(found) == 1:
            return found[0]
        given = f'{where} = "{column}"' if isinstance(column, str) else f"{where} = {column}"
        if found:
            numbers = " and ".join(str(index + 1) for index in found)
            raise RecordError(
                f"{given}: the columns {numbers} have this name; give the number of the right column, "
                f"such as {found[0] + 1}"
            )
        if isinstance(column, int):
            raise RecordError(
                f"{given}: there is no such column; the file has the columns 1 to {len(self.columns)}"
            )
        raise RecordError(
            f"{given}: there is no such column; the columns are {', '.join(self.names) or 'none'}"
        )
