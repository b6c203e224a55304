"""The suite: what is asked of a rig, in which order, and what becomes of it when the rig falls silent on the way."""

from collections.abc import Callable
from typing import TYPE_CHECKING, Final

from astb.conformance.asking import ask
from astb.conformance.commanding import command
from astb.conformance.door import Door
from astb.conformance.finding import Finding, Notebook, joined
from astb.conformance.listening import listen
from astb.conformance.moving import move
from drivers.errors import BenchError

if TYPE_CHECKING:
    from collections.abc import Sequence

#: What moves nothing, and what does.
_AT_REST: Final = (("listening", listen), ("asking", ask), ("commanding", command))
_MOVING: Final = (("moving", move),)


def examine(door: Door, *, motion: bool, say: Callable[[str], None]) -> list[Finding]:
    """Return all that is found of the rig behind ``door``; nothing moves without ``motion``."""
    parts: Sequence[tuple[str, Callable[[Door], list[Notebook]]]] = (*_AT_REST, *(_MOVING if motion else ()))
    books: list[Notebook] = []
    for name, part in parts:
        say(name)
        try:
            books += part(door)
        except BenchError as error:
            book = Notebook(name)
            book.note("to the end", False, str(error), "an answer")
            books.append(book)
    if not motion:
        book = Notebook("motion")
        book.skip("states, a small move, loss of commands", "without --allow-motion nothing is moved")
        books.append(book)
    return joined(books)
