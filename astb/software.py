"""The commit of this software, if it can be determined."""

from __future__ import annotations

import json
import subprocess
from functools import cache
from importlib import metadata
from pathlib import Path
from typing import Final

_WITHIN: Final = 5.0  # s
_HOME: Final = Path(__file__).resolve().parents[1]
#: Next to this file: the commit that sdist and wheel were made of (setup.py).
TOLD: Final = "commit.txt"


@cache
def commit() -> str:
    """Return the commit of the software, with "+ changes" if files differ from it; "" if it is unknown.

    The commit comes from git in a checkout, from a file written at build time in a wheel, and from the metadata of pip
    for an installation from a repository.
    """
    if (_HOME / ".git").exists():
        revision = _git("rev-parse", "HEAD")
        changed = revision and _git("status", "--porcelain", "--untracked-files=no")
        return f"{revision[:12]} + changes" if changed else revision[:12]
    file = Path(__file__).with_name(TOLD)
    if file.exists():
        return file.read_text(encoding="ascii").strip()
    try:
        source = metadata.distribution("astb").read_text("direct_url.json")
    except metadata.PackageNotFoundError:
        return ""
    origin = json.loads(source or "{}").get("vcs_info", {})
    return str(origin.get("commit_id", ""))[:12]


def _git(*arguments: str) -> str:
    """Return the output of git, "" without git or in a folder of another user."""
    try:
        done = subprocess.run(
            ["git", "-C", str(_HOME), "--no-optional-locks", *arguments],
            capture_output=True,
            text=True,
            timeout=_WITHIN,
            check=True,
        )
    except (OSError, subprocess.SubprocessError):
        return ""
    return done.stdout.strip()
