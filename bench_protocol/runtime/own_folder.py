"""A folder that only one user of this machine can access: for sockets and tokens."""

import contextlib
import os
import stat
import tempfile
from pathlib import Path


def own_folder() -> Path:
    """Return the path of the folder that only this user can access. `own_directory` creates it if it is missing."""
    if own := os.environ.get("XDG_RUNTIME_DIR"):
        return Path(own) / "astb"
    # On systems without user numbers, the folder for temporary files belongs to this user alone.
    return Path(tempfile.gettempdir()) / (f"astb-{os.getuid()}" if hasattr(os, "getuid") else "astb")


def own_directory(folder: Path) -> None:
    """Create ``folder`` for this user alone. Raises PermissionError if another user owns it or has access."""
    with contextlib.suppress(FileExistsError):
        folder.mkdir(mode=0o700)
    require_own(folder)


def require_own(folder: Path) -> None:
    """Raise PermissionError if another user owns ``folder`` or has access, FileNotFoundError if it is missing."""
    status = folder.lstat()
    others = hasattr(os, "getuid") and (status.st_uid != os.getuid() or status.st_mode & 0o077)
    if not stat.S_ISDIR(status.st_mode) or others:
        raise PermissionError(
            f"{folder} is not a directory that only this user can enter; remove it, or set its mode to 700"
        )
