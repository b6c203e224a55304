"""A disk that fails at a chosen one of all the times that something is written into a folder, and from then on."""

import errno
import io
import os
import shutil
from contextlib import contextmanager
from pathlib import Path

import pytest

REFUSED = {
    errno.ENOSPC: "the disk is full",
    errno.EROFS: "the file system is read-only",
    errno.EIO: "the disk reports an input/output error",
    errno.ENOENT: "its folder was removed",
}


class FailingDisk:
    """Counts writes below ``folder``; from the ``at``-th one on the disk refuses with ``number``.

    With ENOENT the folder is removed then, and the disk is well.
    """

    def __init__(self, folder: Path, at: float, number: int, now=lambda: 0) -> None:
        self.folder, self.at, self.number, self.now = folder.resolve(), at, number, now
        self.times = []
        self.failed_at = None

    def touch(self, path) -> None:
        if not Path(path).resolve().is_relative_to(self.folder):
            return
        self.times.append(self.now())
        if len(self.times) < self.at:
            return
        first = self.failed_at is None
        if first:
            self.failed_at = self.now()
        if self.number != errno.ENOENT:
            raise OSError(self.number, os.strerror(self.number))
        if first:
            shutil.rmtree(self.folder)

    def file(self, real, path):
        disk = self

        class File:
            def __getattr__(self, name):
                return getattr(real, name)

            def write(self, data):
                disk.touch(path)
                return real.write(data)

            def flush(self):
                disk.touch(path)
                real.flush()

            def __enter__(self):
                return self

            def __exit__(self, *_):
                real.close()

        return File()


@contextmanager
def failing_disk(folder: Path, at: float = float("inf"), number: int = errno.ENOSPC, now=lambda: 0):
    """Let the disk below ``folder`` fail during the block; yield the counter of writes."""
    disk = FailingDisk(folder, at, number, now)
    opened, allocated = io.open, os.posix_fallocate

    def open_(path, mode="r", *rest, **more):
        if not set(mode) & set("wax+"):
            return opened(path, mode, *rest, **more)
        disk.touch(path)
        return disk.file(opened(path, mode, *rest, **more), path)

    def guarded(name):
        real = getattr(Path, name)

        def call(path, *rest, **more):
            disk.touch(path)
            return real(path, *rest, **more)

        return call

    def allocate(number, *rest):
        disk.touch(Path(f"/proc/self/fd/{number}").readlink())
        return allocated(number, *rest)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(io, "open", open_)
        patch.setattr(os, "posix_fallocate", allocate)
        for name in ("mkdir", "rename", "replace"):
            patch.setattr(Path, name, guarded(name))
        yield disk
