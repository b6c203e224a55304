"""Text on the terminal without control characters, which names and messages from plans, rigs and files can contain."""

import re
import sys
from typing import Any, Final, TextIO

#: Control characters except tab and line feed (C0, DEL, C1), and those that reverse the direction of writing.
_UNSAFE: Final = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\u061c\u200e\u200f\u202a-\u202e\u2066-\u2069]")


def printable(text: str) -> str:
    """Return ``text`` with each control character as an escape of four digits, as in JSON."""
    return _UNSAFE.sub(lambda found: f"\\u{ord(found[0]):04x}", text)


class PrintableStream:
    """A text stream that writes only `printable` characters.

    A console of the library rich bypasses it to write colours.
    """

    def __init__(self, stream: TextIO) -> None:
        self.rich_proxied_file = stream  #: the name by which rich finds it

    def write(self, text: str) -> int:
        """Write a text; return its number of characters."""
        return self.rich_proxied_file.write(printable(text))

    def __getattr__(self, name: str) -> Any:
        return getattr(self.rich_proxied_file, name)


def print_safely() -> None:
    """Replace the standard output and error of this process by streams that write only `printable` characters."""
    sys.stdout, sys.stderr = PrintableStream(sys.stdout), PrintableStream(sys.stderr)
