"""The forms of the files that are read and written: how a file is recognised, and what reads and writes it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, Final, NamedTuple

_PACKED: Final = ".gz"


class FileForm(NamedTuple):
    """One form of files; a reader is one function in a file of its own, and one row with it in a table of these."""

    name: str  #: as a key calls it
    endings: tuple[str, ...]  #: in small letters; the first one is the usual one
    read: Callable[..., Any] | None = None
    write: Callable[..., Any] | None = None
    recognises: Callable[[Path], bool] | None = None  #: whatever a file is called


def ending_of(path: Path) -> str:
    """Return the ending that says the form, in small letters; that of what is packed."""
    ending = path.suffix.lower()
    return Path(path.stem).suffix.lower() if ending == _PACKED else ending


def form_of(path: Path, forms: Sequence[FileForm]) -> FileForm | None:
    """Return the form that recognises a file, else the first one that has its ending; None if there is none."""
    for one in forms:
        if one.recognises is not None and path.is_file() and one.recognises(path):
            return one
    return next((one for one in forms if ending_of(path) in one.endings), None)


def endings(forms: Sequence[FileForm]) -> list[str]:
    """Return the endings of forms, each once."""
    return list(dict.fromkeys(ending for one in forms for ending in one.endings))
