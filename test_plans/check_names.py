"""The name of a check, with a sentence about its quantity and purpose, and the requirement that it verifies."""

from __future__ import annotations

import re
from typing import Final

_PLACE: Final = re.compile(r"\{(\w+)(?::\w+)?\}")


class CheckName(str):
    """The name of a check, with one sentence ``about`` it. The name may contain placeholders such as ``{side}``; `of`
    fills them.

    ``requirement`` is the clause of a standard, or the number of a requirement, that the check verifies.
    """

    about: str
    requirement: str

    def __new__(cls, name: str, about: str = "", *, requirement: str = "") -> CheckName:
        made = super().__new__(cls, name)
        made.about, made.requirement = about, requirement
        return made

    def of(self, ending: str = "", **places: object) -> CheckName:
        """Return the name with its placeholders filled, and with an ``ending``. Sentence and requirement stay
        the same.
        """
        return CheckName(self.format(**places) + ending, self.about, requirement=self.requirement)

    @property
    def shown(self) -> str:
        """The name for a list of checks, with its placeholders in angle brackets: ``<side> valve, dead band``."""
        return _PLACE.sub(r"<\1>", self)


def about(name: str) -> str:
    """Return the sentence about a check; "" for a plain string."""
    return name.about if isinstance(name, CheckName) else ""
