"""Reservation of disk space."""

import os


def reserve(descriptor: int, size: int) -> None:
    """Reserve ``size`` bytes for an open file. Raises OSError if the disk is full, or if its file system cannot
    reserve. Does nothing on systems that cannot.
    """
    if hasattr(os, "posix_fallocate"):
        os.posix_fallocate(descriptor, 0, size)
