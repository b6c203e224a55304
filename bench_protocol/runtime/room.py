"""Room on a disk that is promised before it is needed."""

import os


def reserve(descriptor: int, size: int) -> None:
    """Let an open file have ``size`` bytes (OSError if there is no such room); where nobody can promise, do nothing."""
    if hasattr(os, "posix_fallocate"):
        os.posix_fallocate(descriptor, 0, size)
