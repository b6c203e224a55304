"""Table rows for file formats: detection of the format, and the functions that read and write it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, Final, NamedTuple

_PACKED: Final = ".gz"


class FileForm(NamedTuple):
    """One file format. Its reader is a function in its own module."""

    name: str  #: its name in keys
    endings: tuple[str, ...]  #: in lower case; the first one is the usual one
    read: Callable[..., Any] | None = None
    write: Callable[..., Any] | None = None
    recognises: Callable[[Path], bool] | None = None  #: checks the content, whatever the file name is


def ending_of(path: Path) -> str:
    """Return the ending that selects the format, in lower case; for a packed file that of its content."""
    ending = path.suffix.lower()
    return Path(path.stem).suffix.lower() if ending == _PACKED else ending


def form_of(path: Path, forms: Sequence[FileForm]) -> FileForm | None:
    """Return the format that recognises the content of a file, else the first format with the ending of the file; None
    if there is none.
    """
    for one in forms:
        if one.recognises is not None and path.is_file() and one.recognises(path):
            return one
    return next((one for one in forms if ending_of(path) in one.endings), None)


def endings(forms: Sequence[FileForm]) -> list[str]:
    """Return the endings of formats, each once."""
    return list(dict.fromkeys(ending for one in forms for ending in one.endings))
