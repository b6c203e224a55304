"""Errors of the operating system, as text with a remedy."""

from __future__ import annotations

import errno
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from types import MappingProxyType
from typing import Final

from bench_protocol.suggestion import did_you_mean
from bench_protocol.text import Unfit

_REMEDIES: Final = MappingProxyType(
    {
        errno.ENOENT: "check the path",
        errno.ENOTDIR: "check the path",
        errno.EISDIR: "use the path of a file",
        errno.EEXIST: "use another path",
        errno.EACCES: "change the permissions, or use another path",
        errno.EPERM: "change the permissions, or use another path",
        errno.EROFS: "use a path on a writable disk",
        errno.ENOSPC: "free space on the disk, or use another one",
        errno.EDQUOT: "free space on the disk, or use another one",
        errno.ENAMETOOLONG: "use a shorter name",
        errno.EADDRINUSE: "use another port, or end the program that uses it",
        errno.EADDRNOTAVAIL: "use an address of this machine",
    }
)


def error_text(error: BaseException) -> str:
    """Return an error as text, which is never empty; for an error of the operating system without number and path."""
    return str(getattr(error, "strerror", None) or str(error) or type(error).__name__)


def reason(error: BaseException) -> str:
    """Return an error as text; for a frequent error of a file, disk or port the remedy follows."""
    text = error_text(error)
    remedy = _REMEDIES.get(getattr(error, "errno", None) or 0)
    return f"{text}; {remedy}" if remedy else text


def named_file_error(error: OSError, name: object, names: Iterable[str]) -> str:
    """Return an error of reading a file that has a name or a path as text with a remedy; ``names`` are the valid ones.

    A text that ends in ``.toml`` is a path.
    """
    if str(name).endswith(".toml"):
        return f"{error_text(error)}; check the path, or use {', '.join(names)}"
    return f"{error_text(error)}; {did_you_mean(name, names)} (or give a path that ends in .toml)"


@contextmanager
def file_errors(file: object, kind: Callable[[str], BaseException]) -> Iterator[None]:
    """Convert errors of reading a file inside the block to ``kind``; the text begins with ``file`` and has a remedy."""
    try:
        yield
    except OSError as error:
        raise kind(f"{file} cannot be read: {reason(error)}") from None
    except Unfit as error:
        raise kind(f"{file} {error}") from None
