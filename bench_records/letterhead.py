"""The letterhead of a report: laboratory, customer, order number and a logo."""

from __future__ import annotations

import base64
from pathlib import Path
from typing import Final

import msgspec

from bench_protocol.input_limits import read_bounded, read_toml
from bench_protocol.misfit import misfit
from bench_protocol.os_errors import file_errors
from bench_records.layout import RecordError

#: The variable of the environment that names the file for every report.
CHOSEN: Final = "ASTB_LETTERHEAD"
#: Size limit of a logo, which is part of every page.
LOGO_MAX: Final = 300_000
_KINDS: Final = {
    ".png": "image/png",
    ".jpg": "image/jpeg",
    ".jpeg": "image/jpeg",
    ".svg": "image/svg+xml",
}
_BEGINS: Final = {"image/png": b"\x89PNG\r\n\x1a\n", "image/jpeg": b"\xff\xd8\xff"}


class Letterhead(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The head of a report. Empty fields are left out. In the TOML file, ``logo`` is a path; in this object it is the
    image as a URL.
    """

    laboratory: str = ""
    customer: str = ""
    order: str = ""
    logo: str = ""


def read_letterhead(path: Path) -> Letterhead:
    """Return the letterhead from a TOML file. Raises RecordError, which states the wrong key and the correct form."""
    with file_errors(f"letterhead {path}", RecordError):
        content = read_toml(path)
    try:
        found = msgspec.convert(content, Letterhead)
    except msgspec.ValidationError as error:
        raise RecordError(f"letterhead {path}: {misfit(error, content, Letterhead)}") from None
    return msgspec.structs.replace(found, logo=_picture(path, found.logo)) if found.logo else found


def _picture(path: Path, logo: str) -> str:
    picture = path.parent / logo
    kind = _KINDS.get(picture.suffix.lower())
    if kind is None:
        raise RecordError(
            f"letterhead {path}: logo = {logo!r} is not a picture; use a file with the suffix {', '.join(_KINDS)}"
        )
    with file_errors(f"letterhead {path}: logo {picture}", RecordError):
        data = read_bounded(picture, LOGO_MAX)
    if not data.startswith(_BEGINS.get(kind, b"")) or (kind == "image/svg+xml" and b"<svg" not in data):
        raise RecordError(
            f"letterhead {path}: the content of logo {picture} is not a {picture.suffix} picture; use another file"
        )
    return f"data:{kind};base64,{base64.b64encode(data).decode()}"
