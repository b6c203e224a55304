"""The test suite: its groups, their order, and its end if the rig stops answering."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Final, TypeVar

from astb.acceptance.conformance import signals
from astb.acceptance.conformance.asking import ask
from astb.acceptance.conformance.commanding import command
from astb.acceptance.conformance.listening import listen
from astb.acceptance.conformance.moving import move
from astb.acceptance.conformance.raw_access import RawAccess, open_access
from astb.acceptance.conformance.report import Notebook, Observation, joined
from astb.acceptance.conformance.succeeding import succeed
from astb.api import open_bench
from drivers.errors import BenchError

if TYPE_CHECKING:
    from astb.rig_file import RigFile
    from drivers.bench import Bench

#: Groups without motion, and groups with motion.
_AT_REST: Final = (("messages", listen), ("requests", ask), ("commands", command))
_MOVING: Final = (("motion", move), ("next commander", succeed))

Subject = TypeVar("Subject")


def examine_rig(rig: "RigFile", path: Path, *, motion: bool, say: Callable[[str], None]) -> list[Observation]:
    """Return all findings about ``rig``, whose file is ``path``; nothing moves without ``motion``.

    A rig with our messages is tested with CAN frames and Modbus requests. A rig with a wiring file is tested by its
    signals. Raises BenchError if no rig answers.
    """
    if rig.wiring:
        with open_bench(path) as bench:
            return examine_bench(bench, motion=motion, say=say)
    with open_access(rig, path, say=say) as access:
        return examine(access, motion=motion, say=say)


def examine(access: RawAccess, *, motion: bool, say: Callable[[str], None]) -> list[Observation]:
    """Return all findings about the rig behind ``access``; nothing moves without ``motion``."""
    return _findings(access, (*_AT_REST, *(_MOVING if motion else ())), motion, say)


def examine_bench(bench: "Bench", *, motion: bool, say: Callable[[str], None]) -> list[Observation]:
    """Return the findings about a rig with other messages, by the signals of a connected ``bench``."""
    return _findings(bench, (*signals.AT_REST, *(signals.MOVING if motion else ())), motion, say)


def _findings(
    subject: Subject,
    parts: Sequence[tuple[str, Callable[[Subject], list[Notebook]]]],
    motion: bool,
    say: Callable[[str], None],
) -> list[Observation]:
    books: list[Notebook] = []
    for name, part in parts:
        say(name)
        try:
            books += part(subject)
        except BenchError as error:
            book = Notebook(name)
            book.note("all requests answered", False, str(error), "an answer")
            books.append(book)
    if not motion:
        book = Notebook("motion")
        book.skip(
            "states, motion, loss of commands, next commander",
            "not tested without --allow-motion",
        )
        books.append(book)
    return joined(books)
