"""Prints a report to PDF with an installed Chromium."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import tempfile
from pathlib import Path
from typing import Final

from bench_protocol.runtime import is_root
from bench_records.disk import kept
from bench_records.layout import RecordError

#: Programs with equal print output, and the environment variable for another program.
BROWSERS: Final = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "microsoft-edge")
CHOSEN: Final = "ASTB_CHROMIUM"
#: From this version on page numbers are printed.
NUMBERS_PAGES: Final = 131
MEND: Final = f"apt install chromium, or set the variable {CHOSEN} to the path of a browser"
_WITHIN: Final = 120.0  # s


def browser() -> str | None:
    """Return the path of the browser for printing, or None if there is none."""
    chosen = os.environ.get(CHOSEN)
    return next(filter(None, map(shutil.which, [chosen] if chosen else BROWSERS)), None)


def browser_version(path: str) -> int | None:
    """Return the main version of a browser, or None if it does not report one."""
    try:
        done = subprocess.run([path, "--version"], check=False, capture_output=True, text=True, timeout=30.0)
    except (OSError, subprocess.SubprocessError):
        return None
    found = re.search(r"\b(\d+)\.\d", done.stdout)
    return int(found[1]) if found else None


def write_pdf(page: Path) -> Path:
    """Print the report ``page`` as PDF to the same folder. Return its path. Raises RecordError, with a remedy, if
    that fails.
    """
    program = browser()
    if program is None:
        looked_for = os.environ.get(CHOSEN) or ", ".join(BROWSERS)
        raise RecordError(f"a PDF needs Chromium, which was not found ({looked_for}): {MEND}")
    target = page.with_suffix(".pdf")
    with tempfile.TemporaryDirectory(prefix="astb-print-") as home:
        new = Path(home) / target.name
        command = [
            program,
            "--headless=new",
            "--disable-gpu",
            "--no-first-run",
            "--no-pdf-header-footer",
            f"--user-data-dir={home}",
            f"--print-to-pdf={new}",
            # Chromium has no sandbox for root, the user in containers; the page is our own.
            *(["--no-sandbox"] if is_root() else []),
            page.resolve().as_uri(),
        ]
        try:
            done = subprocess.run(
                command, check=False, capture_output=True, text=True, timeout=_WITHIN, errors="replace"
            )
        except subprocess.TimeoutExpired:
            raise RecordError(f"{program} did not print {page} within {_WITHIN:.0f} s; try again") from None
        except OSError as error:
            raise RecordError(f"{program} cannot be started: {error.strerror}; {MEND}") from None
        if not new.is_file():
            lines = done.stderr.strip().splitlines()
            raise RecordError(
                f"{program} did not print {page}: {lines[-1] if lines else f'exit {done.returncode}'}; "
                "print the page with another browser"
            )
        with kept(target):
            shutil.copyfile(new, target)
    return target
