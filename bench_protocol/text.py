"""The text of files from other programs, decoded by byte order mark, else as UTF-8, else by the Windows code page."""

from __future__ import annotations

import codecs
from typing import Final

UTF_8: Final = "UTF-8"
#: The code page of Windows in western Europe and America for text that is not Unicode.
WINDOWS: Final = "cp1252"
#: The longer marks first: that of UTF-32 begins as that of UTF-16 does.
_MARKS: Final = (
    (codecs.BOM_UTF8, UTF_8),
    (codecs.BOM_UTF32_LE, "UTF-32-LE"),
    (codecs.BOM_UTF32_BE, "UTF-32-BE"),
    (codecs.BOM_UTF16_LE, "UTF-16-LE"),
    (codecs.BOM_UTF16_BE, "UTF-16-BE"),
)
_LOOKED_AT: Final = 4096


class Unfit(ValueError):
    """A file is not accepted; the text continues a sentence that begins with its name."""


def decode(content: bytes, encoding: str = "") -> tuple[str, str]:
    """Return the text of a file without its byte order mark, and the name of its encoding. If ``encoding`` is given, it
    is used.

    Without a mark the text is UTF-16 if every second byte of Latin letters is 0. Otherwise it is UTF-8 if valid, or
    else cp1252. Raises Unfit, to follow the file's name, for an unknown encoding and for content that is not text.
    """
    if encoding:
        return _by_name(content, encoding), encoding
    for mark, name in _MARKS:
        if content.startswith(mark):
            return _strictly(content[len(mark) :], name), name
    if name := _without_mark(content):
        return _strictly(content, name), name
    try:
        text, name = content.decode("utf-8"), UTF_8
    except UnicodeDecodeError:
        text, name = _strictly(content, WINDOWS), WINDOWS
    if "\0" in text:
        line = text.count("\n", 0, text.index("\0")) + 1
        raise Unfit(f"is not a text file: line {line} has a byte 0; save it as UTF-8 text")
    return text, name


def _by_name(content: bytes, encoding: str) -> str:
    try:
        known = codecs.lookup(encoding).name
        "".encode(encoding)  # some codecs, such as "zip", do not encode text
    except (LookupError, ValueError):
        raise Unfit(
            f'cannot be read: encoding = "{encoding}" is unknown; use one such as "utf-8", "utf-16" or "cp1252"'
        ) from None
    for mark, name in _MARKS:
        if content.startswith(mark) and known in (name.lower(), name.lower()[:-3], "utf-8-sig"):
            return _strictly(content[len(mark) :], name)
    return _strictly(content, encoding)


def _without_mark(content: bytes) -> str:
    """Return the UTF-16 encoding of content without a mark; "" for other content.

    In UTF-16 every Latin character has a byte 0, always the first or always the second one.
    """
    head = content[: _LOOKED_AT // 2 * 2]
    low, high = head[::2].count(0), head[1::2].count(0)
    half = len(head) // 2
    if half and max(low, high) > 0.7 * half and not min(low, high):
        return "UTF-16-LE" if high > low else "UTF-16-BE"
    return ""


def _strictly(content: bytes, encoding: str) -> str:
    try:
        return content.decode(encoding)
    except UnicodeDecodeError as error:
        line = content.count(b"\n", 0, error.start) + 1
        raise Unfit(
            f"is not valid {encoding}: byte {error.start + 1}, in line {line}, is not a character; "
            "state its encoding, or save it as UTF-8"
        ) from None


def only_utf_8(content: bytes) -> str:
    """Return ``content`` as text, which must be UTF-8, with or without a mark. Raises Unfit, with line and likely
    encoding, for any other content.
    """
    text, name = decode(content)
    if name == UTF_8:
        return text
    if name != WINDOWS:
        raise Unfit(f"is in {name}; save it as UTF-8")
    try:
        content.decode("utf-8")
    except UnicodeDecodeError as error:
        line = content.count(b"\n", 0, error.start) + 1
        seen = content[error.start : error.start + 1].decode(WINDOWS)
        raise Unfit(f'is not in UTF-8: line {line} has "{seen}" in cp1252; save it as UTF-8') from None
    return text
