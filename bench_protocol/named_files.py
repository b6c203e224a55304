"""Files that come with the bench and have a name: rigs, specimens, instruments, wirings, parameter sets."""

import hashlib
from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import Any, Final

from bench_protocol.input_limits import Unfit, parse_toml, read_bounded

#: The packages of files lie beside this one, in a checkout as well as installed. Asked for by their own names, which
#: are anybody's words, they might be somebody else's.
_HOME: Final = Path(str(files("bench_protocol"))).parent


@cache
def named_folders(package: str) -> dict[str, Path]:
    """Return the folders of a package by their names."""
    return {path.name: path for path in sorted((_HOME / package).iterdir()) if path.is_dir()}


@cache
def named_files(package: str) -> dict[str, Path]:
    """Return the TOML files of a package by their names."""
    return {path.stem: path for path in sorted((_HOME / package.replace(".", "/")).glob("*.toml"))}


def place_of(package: str, name: str | Path, home: Path = Path()) -> Path:
    """Return where the file of a name lies, or the file of a path, which is seen from ``home``.

    What ends in ``.toml`` is a path. A name that nobody has gives the path where its file would lie.
    """
    if str(name).endswith(".toml"):
        return home / name
    return named_files(package).get(str(name), home / name)


def read_named(
    package: str, name: str | Path, home: Path, refused: type[ValueError]
) -> tuple[Path, str, dict[str, Any]]:
    """Return where the file of a name or a path lies, the SHA-256 of its bytes, and what it says.

    ``refused``, with the file and what would be right, if it cannot be read or is no TOML.
    """
    path = place_of(package, name, home)
    try:
        text = read_bounded(path)
        return path, hashlib.sha256(text).hexdigest(), parse_toml(text)
    except OSError as error:
        raise refused(
            f"{package} {path} cannot be read: {error.strerror}; there is {', '.join(named_files(package))}, and any "
            "path that ends in .toml would do"
        ) from None
    except Unfit as error:
        raise refused(f"{package} {path} {error}") from None
