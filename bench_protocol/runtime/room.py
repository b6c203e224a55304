"""Reservation of disk space."""

import os


def reserve(descriptor: int, size: int) -> None:
    """Reserve ``size`` bytes for an open file. Raises OSError if the disk is full. Does nothing if unsupported."""
    if hasattr(os, "posix_fallocate"):
        os.posix_fallocate(descriptor, 0, size)
