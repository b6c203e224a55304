"""Checksums of the files of a run in the format of sha256sum. `sha256sum -c SHA256SUMS` checks them."""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import Final

from bench_records.disk import kept
from bench_records.layout import JUNIT, META, PARQUET, RESULT, put

SUMS: Final = "SHA256SUMS"
#: The results of a run and their data. The report can be generated again from these files.
KEPT: Final = (PARQUET, META, RESULT, JUNIT)
FRAMES: Final = "can.blf"


def write_sums(directory: Path) -> Path:
    """Write the checksums of the files of a run to the folder ``directory``. Return the path. Raises NotKept for a
    disk error.
    """
    path = directory / SUMS
    with kept(path):
        lines = [
            f"{sha256_of(directory / name)}  {name}\n"
            for name in (*KEPT, FRAMES)
            if (directory / name).exists()
        ]
        put(path, "".join(lines).encode())
    return path


def broken_files(directory: Path) -> list[str]:
    """Return one text for each file of a run that was changed or removed, or that has no checksum."""
    try:
        lines = (directory / SUMS).read_text(encoding="utf-8").splitlines()
    except OSError:
        return [f"{SUMS} is missing"]
    expected = {name: digest for digest, _, name in (line.partition("  ") for line in lines)}
    broken = [
        f"{name} has no checksum" for name in KEPT if name not in expected and (directory / name).exists()
    ]
    for name, digest in expected.items():
        if not (directory / name).is_file():
            broken.append(f"{name} is missing")
        elif sha256_of(directory / name) != digest:
            broken.append(f"{name} was changed")
    return broken


def sha256_of(path: Path) -> str:
    """Return the SHA-256 checksum of a file in hexadecimal digits."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
