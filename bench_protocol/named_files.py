"""Files that the software ships by name: rigs and their parts, specimens, demos."""

import hashlib
import warnings
from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import Any, Final

from bench_protocol.input_limits import Unfit, parse_toml, read_bounded
from bench_protocol.os_errors import named_file_error

#: The folder of these files, in a checkout as well as installed. It holds no module, so it is read without an import
#: of the package above.
_DATA: Final = Path(str(files("bench_protocol"))).parent / "astb" / "data"
#: The kinds of files that a rig consists of. All of them are in the folder of the rig, which has the rig's name.
OF_A_RIG: Final = {
    "rigs": "rig.toml",
    "wirings": "wiring.toml",
    "dimensions": "dimensions.toml",
    "instruments": "instruments.toml",
}
#: The rig that has the files of the virtual bench.
ORDINARY_RIG: Final = "local"
#: The name of these files in version 0.1, which records keep: runs are compared by it.
_FIRST_NAME: Final = "astb"


@cache
def named_folders(kind: str) -> dict[str, Path]:
    """Return the folders of a kind by their names."""
    return {path.name: path for path in sorted((_DATA / kind).iterdir()) if path.is_dir()}


@cache
def named_files(kind: str) -> dict[str, Path]:
    """Return the TOML files of a kind by their names; a part of a rig has the name of the rig."""
    if part := OF_A_RIG.get(kind):
        folders = named_folders("rigs")
        return {name: folder / part for name, folder in folders.items() if (folder / part).is_file()}
    return {path.stem: path for path in sorted((_DATA / kind).glob("*.toml"))}


def place_of(kind: str, name: str | Path, home: Path = Path()) -> Path:
    """Return the path of the file with this name, or of a path relative to ``home``.

    A text that ends in ``.toml`` is a path. For an unknown name, return the path where its file would be.
    """
    known = named_files(kind)
    if str(name).endswith(".toml"):
        return _shipped_earlier(kind, home / name) or home / name
    if str(name) == _FIRST_NAME and _FIRST_NAME not in known and ORDINARY_RIG in known:
        earlier(f'{kind} "{_FIRST_NAME}"', f'use "{ORDINARY_RIG}"')
        return known[ORDINARY_RIG]
    return known.get(str(name), home / name)


def _shipped_earlier(kind: str, path: Path) -> Path | None:
    """Return the present file for ``path`` in a checkout of version 0.1, such as rigs/local.toml; None if there is
    none.
    """
    if path.parent.name != kind or path.exists():
        return None
    known = named_files(kind)
    name = path.stem if path.stem in known else ORDINARY_RIG if path.stem == _FIRST_NAME else ""
    if name not in known:
        return None
    earlier(str(path), f'use the name "{name}"')
    return known[name]


def earlier(what: str, instead: str) -> None:
    """Warn of a form of version 0.1 that the next version will not support."""
    warnings.warn(
        f"{what} is the form of version 0.1, which the next version will not read; {instead}",
        FutureWarning,
        stacklevel=3,
    )


def source_of(path: Path) -> Path:
    """Return the files to copy for a named file: the whole folder of a rig, else the file itself."""
    return path.parent if path.name == OF_A_RIG["rigs"] else path


def label(path: Path) -> str:
    """Return the name of a file in records: that of a part of a rig includes the name of the rig."""
    if path.name not in OF_A_RIG.values():
        return path.name
    folder = path.parent.name
    if path.parent != named_folders("rigs").get(folder):
        return f"{folder}/{path.name}"
    return f"{_FIRST_NAME if folder == ORDINARY_RIG else folder}.toml"


def read_named(
    kind: str, name: str | Path, home: Path, refused: type[ValueError]
) -> tuple[Path, str, dict[str, Any]]:
    """Read the file with a name or path; return its path, the SHA-256 of its bytes, and its tables.

    Raises ``refused``, with the file and a remedy, if it cannot be read or is not TOML.
    """
    path = place_of(kind, name, home)
    try:
        text = read_bounded(path)
        return path, hashlib.sha256(text).hexdigest(), parse_toml(text)
    except OSError as error:
        raise refused(
            f"{kind} {name} cannot be read: {named_file_error(error, name, named_files(kind))}"
        ) from None
    except Unfit as error:
        raise refused(f"{kind} {path} {error}") from None
