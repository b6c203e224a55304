"""Suggestion of the known name that is nearest to a wrong one."""

from collections.abc import Iterable
from difflib import get_close_matches
from typing import Final

#: The most names that are listed; of more, the first three are examples.
_LISTED: Final = 40


def did_you_mean(name: object, known: Iterable[str], otherwise: str = "") -> str:
    """Return the end of an error message: the name of ``known`` that is nearest to ``name``.

    If none is near: ``otherwise``, else the names themselves or, of many, their number and three examples.
    """
    names = list(known)
    if near := get_close_matches(str(name), names, n=1):
        return f"did you mean {near[0]!r}?"
    if otherwise or not names:
        return otherwise or "no name is defined here; remove it"
    if len(names) > _LISTED:
        return f"use one of {len(names)} names, such as {', '.join(names[:3])}"
    return f"use one of {', '.join(names)}"
