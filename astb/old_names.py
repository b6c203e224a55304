"""Names that commands had in the last release: they are read for one release."""

import re
from collections.abc import Sequence
from typing import Final

_KINDS: Final = "(rigs|specimens|instruments|dimensions|wirings|parameters|demos)"
#: Old beginnings of a command line and the new ones. Words are separated by `_GAP`, which no word contains.
RENAMED: Final = (
    (rf"{_KINDS} ([^ ]+) --copy[ =]([^ ]+)", r"copy \1 \2 \3"),
    (rf"{_KINDS} --copy[ =]([^ ]+) ([^ ]+)", r"copy \1 \3 \2"),
    (r"specimens new (.*?)--base[ =]([^ ]+)", r"copy specimen \2 \1"),
    (r"specimens new", r"copy specimen astb"),
    (rf"{_KINDS}|effects", r"list \g<0>"),
    (r"check-rig", r"rig check"),
    (r"wiring", r"rig"),
    (r"conform|limits|signals|fault", r"rig \g<0>"),
)
_GAP: Final = "\0"


def renamed(words: Sequence[str]) -> list[str]:
    """Return a command line with its new name; empty if its name is not an old one."""
    line = _GAP.join(words)
    for old, new in RENAMED:
        if match := re.match(f"(?:{old.replace(' ', _GAP)})(?={_GAP}|$)", line):
            return [
                word
                for word in (match.expand(new.replace(" ", _GAP)) + line[match.end() :]).split(_GAP)
                if word
            ]
    return []
