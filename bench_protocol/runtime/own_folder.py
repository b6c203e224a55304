"""A folder for what only one user of this machine may reach: sockets and tokens."""

import contextlib
import os
import stat
import tempfile
from pathlib import Path


def own_folder() -> Path:
    """Return where it is; `own_directory` makes it."""
    if own := os.environ.get("XDG_RUNTIME_DIR"):
        return Path(own) / "astb"
    # Where users have no numbers, the folder for temporary files is this user's alone.
    return Path(tempfile.gettempdir()) / (f"astb-{os.getuid()}" if hasattr(os, "getuid") else "astb")


def own_directory(folder: Path) -> None:
    """Make ``folder`` for this user alone; PermissionError if it is somebody else's or open to others."""
    with contextlib.suppress(FileExistsError):
        folder.mkdir(mode=0o700)
    require_own(folder)


def require_own(folder: Path) -> None:
    """PermissionError if ``folder`` is somebody else's or open to others; FileNotFoundError if there is none."""
    status = folder.lstat()
    others = hasattr(os, "getuid") and (status.st_uid != os.getuid() or status.st_mode & 0o077)
    if not stat.S_ISDIR(status.st_mode) or others:
        raise PermissionError(f"{folder} must be a directory that only this user can enter")
