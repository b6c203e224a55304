"""Notes that a user adds to a finished run: comments, photos and files with time and author. They are not signed.

Notes are stored in a separate folder, each with the checksum of its file. A new note changes neither the files of the
run nor earlier notes.
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import Final
from uuid import uuid4

import msgspec

from bench_protocol.clock import utc_date
from bench_protocol.input_limits import RESULT_BYTES, Unfit, read_bounded
from bench_protocol.os_errors import file_errors
from bench_records.checksums import sha256_of
from bench_records.disk import kept
from bench_records.layout import RecordError

NOTES: Final = "notes"
#: Size limit of a file, because notes are copied with their run.
FILE_MAX: Final = 50_000_000


class Note(msgspec.Struct, frozen=True, kw_only=True):
    """A comment with an optional file. ``at`` is the time (ISO 8601 in UTC), and ``by`` is the author."""

    at: str
    by: str
    text: str
    file: str = ""  #: its name in the folder of the notes
    sha256: str = ""  #: of the file


def add_note(
    directory: Path, text: str, by: str, file: Path | None = None, content: bytes | None = None
) -> Note:
    """Add a note to the run in ``directory`` and return it. ``content`` is the content of ``file``; without it, the
    file is read.

    Raises RecordError if the author is missing, if both text and file are missing, or if the file cannot be stored.
    """
    if not by.strip():
        raise RecordError(
            "the author of the note is missing; give --by NAME, or set the variable ASTB_OPERATOR"
        )
    if not text.strip() and file is None:
        raise RecordError("the note is empty; give a text or a file")
    if file is not None and content is None:
        content = _content(file)
    folder = directory / NOTES
    with kept(folder):
        folder.mkdir(exist_ok=True)
        number = 1 + max((int(path.stem) for path in _places(folder)), default=0)
        while True:
            try:
                return _add(
                    folder, number, Note(at=utc_date(), by=by.strip(), text=text.strip()), file, content
                )
            except FileExistsError:  # another user adds one just now
                number += 1


def _add(folder: Path, number: int, note: Note, file: Path | None, content: bytes | None) -> Note:
    """Write a note with a number, complete at once for readers. Raises FileExistsError if the number is
    already used.
    """
    copy = None
    if file is not None and content is not None:
        copy = folder / f"{number:04}-{file.name}"
        with copy.open("xb") as new:
            new.write(content)
        note = msgspec.structs.replace(note, file=copy.name, sha256=sha256_of(copy))
    unfinished = folder / f".{uuid4().hex}.part"
    try:
        unfinished.write_bytes(msgspec.json.format(msgspec.json.encode(note), indent=2) + b"\n")
        os.link(unfinished, folder / f"{number:04}.json")
    except OSError:
        if copy is not None:
            copy.unlink(missing_ok=True)
        raise
    finally:
        unfinished.unlink(missing_ok=True)
    return note


def _places(folder: Path) -> list[Path]:
    return sorted(path for path in folder.glob("*.json") if path.stem.isdigit())


def _content(file: Path) -> bytes:
    with file_errors(file, RecordError):
        return read_bounded(file, FILE_MAX)


def notes_of(directory: Path) -> list[Note]:
    """Return the notes of the run in ``directory``, oldest first. For an unreadable note, its text is an error
    message.
    """
    found = []
    for path in _places(directory / NOTES):
        try:
            found.append(msgspec.json.decode(read_bounded(path, RESULT_BYTES), type=Note))
        except (OSError, Unfit, msgspec.MsgspecError, UnicodeError):
            found.append(Note(at="", by="", text=f"{path.name} cannot be read as a note"))
    return found


def is_as_added(directory: Path, note: Note) -> bool:
    """Return whether the file of a note exists and is unchanged. A note without a file gives True."""
    path = directory / NOTES / Path(note.file).name
    return not note.file or (path.is_file() and sha256_of(path) == note.sha256)
