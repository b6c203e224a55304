"""File locks that the operating system releases when the process ends."""

from typing import IO, Any

try:
    import fcntl
except ImportError:  # not a Unix
    fcntl = None  # type: ignore[assignment]


def hold(file: IO[Any] | int, *, shared: bool = False, wait: bool = False) -> bool:
    """Lock an open ``file`` until it is closed; return True. If another process has the lock, wait if ``wait``, else
    return False. A ``shared`` lock excludes only locks that are not shared.

    Returns True also without a lock, if the system or the file system does not support locks.
    """
    if fcntl is None:
        return True
    try:
        fcntl.flock(file, (fcntl.LOCK_SH if shared else fcntl.LOCK_EX) | (0 if wait else fcntl.LOCK_NB))
    except BlockingIOError:
        return False
    except OSError:
        pass
    return True
