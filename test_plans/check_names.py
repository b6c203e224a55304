"""What a check is called, with the sentence that says what it measures and why that matters."""

from __future__ import annotations

import re
from typing import Final

_PLACE: Final = re.compile(r"\{(\w+)(?::\w+)?\}")


class CheckName(str):
    """The name of a check, perhaps with ``{places}`` that `of` fills, and one sentence ``about`` it."""

    about: str

    def __new__(cls, name: str, about: str = "") -> CheckName:
        made = super().__new__(cls, name)
        made.about = about
        return made

    def of(self, ending: str = "", **places: object) -> CheckName:
        """Return the name with its places filled, and an ``ending``; the sentence is the same."""
        return CheckName(self.format(**places) + ending, self.about)

    @property
    def shown(self) -> str:
        """The name for a list of what a plan checks: ``<side> valve, dead band``."""
        return _PLACE.sub(r"<\1>", self)


def about(name: str) -> str:
    """Return the sentence about a check, "" for a plain name, which has none."""
    return name.about if isinstance(name, CheckName) else ""
