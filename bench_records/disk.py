"""Disk errors as text, and disk space that is reserved for the result of a run."""

from __future__ import annotations

import errno
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Final

from bench_protocol.os_errors import reason
from bench_protocol.runtime.room import reserve
from bench_records.layout import RecordError

#: Errors of the machine, which another file name does not avoid.
REFUSALS: Final = {
    errno.ENOSPC: "the disk is full",
    errno.EDQUOT: "the disk quota is used up",
    errno.EFBIG: "the file would be larger than the system allows",
    errno.EROFS: "the file system is read-only",
    errno.EIO: "the disk reports an input/output error",
    errno.ESTALE: "the network file system is no longer available",
    errno.ENODEV: "the disk was removed",
    errno.ENXIO: "the disk was removed",
    errno.ENOENT: "its folder was removed",
    errno.ENOTDIR: "its folder was removed",
}
#: Reserved space: four times the result, check lists and checksums of the longest plans; often enough for a report.
ROOM: Final = 2 << 20
ROOM_FILE: Final = "room.part"
#: Errors of a file name, found before the first write.
_NAMES: Final = (errno.ENOENT, errno.ENOTDIR)
_CANNOT: Final = (errno.EOPNOTSUPP, errno.EINVAL, errno.ENOSYS)


class NotKept(RecordError):
    """A file of a run could not be saved. The text names the file and the reason."""


def disk_reason(error: BaseException) -> str:
    """Return the reason of a disk error as text. For an error of the machine, the text includes a remedy."""
    text = REFUSALS.get(getattr(error, "errno", None) or 0)
    return f"{text}; free or repair this disk, or use a folder on another one" if text else reason(error)


def of_the_disk(error: BaseException) -> bool:
    """Return whether the disk caused the error. Invalid file names and missing permissions are other causes."""
    return isinstance(error, OSError) and error.errno in REFUSALS and error.errno not in _NAMES


@contextmanager
def kept(path: Path, what: str = "") -> Iterator[None]:
    """Raise NotKept if a write to ``path`` fails inside the ``with`` block. ``what`` replaces the path in the
    message.
    """
    import pyarrow as pa

    try:
        yield
    except (OSError, pa.ArrowException) as error:
        raise NotKept(f"{what or path} cannot be saved: {disk_reason(error)}") from error


@contextmanager
def begun(path: Path, what: str = "") -> Iterator[None]:
    """Convert an OSError in the ``with`` block: to NotKept if the disk caused it, otherwise to RecordError."""
    try:
        yield
    except OSError as error:
        refused = of_the_disk(error)
        text = f"{what or path} cannot be written: {disk_reason(error) if refused else reason(error)}"
        raise (NotKept if refused else RecordError)(text) from error


def keep_room(directory: Path) -> None:
    """Reserve the disk space for the result of a run. Raises NotKept if there is not enough space."""
    path = directory / ROOM_FILE
    try:
        with path.open("wb") as file:
            reserve(file.fileno(), ROOM)
    except OSError as error:
        if error.errno in _CANNOT:  # a file system without reservation
            return
        give_room(directory)
        raise NotKept(
            f"{directory} has no space for the result of a run, {ROOM >> 20} MiB: {disk_reason(error)}"
        ) from error


def give_room(directory: Path) -> None:
    """Release the reserved disk space."""
    with suppress(OSError):
        (directory / ROOM_FILE).unlink()
