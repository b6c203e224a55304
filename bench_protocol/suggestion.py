"""What somebody may have meant by a name that there is not."""

from collections.abc import Iterable
from difflib import get_close_matches


def meant(name: str, known: Iterable[str], otherwise: str = "") -> str:
    """Return, as the end of a message, which of ``known`` is nearest to ``name``; ``otherwise`` if none is near.

    Without ``otherwise`` it lists them all.
    """
    names = list(known)
    if near := get_close_matches(name, names, n=1):
        return f"did you mean {near[0]!r}?"
    return otherwise or f"there are {', '.join(names)}"
