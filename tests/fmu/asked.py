"""FMUs that are not ours, made by pythonfmu and pythonfmu3, and what a map says of them."""

import re
import zipfile
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np

HERE = Path(__file__).parent
PAGE = HERE.parents[1] / "docs" / "how-to" / "use-fmus.md"


def page_files(folder: Path) -> None:
    """Save what the page says to save."""
    pattern = r"`(\w+\.(?:py|toml))`[^`\n]*:\n\n```\w+\n(.*?)```"
    for name, text in re.findall(pattern, PAGE.read_text(), flags=re.DOTALL):
        (folder / name).write_text(text)


def build(model: Path, folder: Path, fmi: int = 2, **options: str) -> Path:
    """Make an FMU of a file of Python."""
    if fmi == 2:
        from pythonfmu.builder import FmuBuilder as Builder
    else:
        from pythonfmu3.builder import FmuBuilder as Builder
    Builder.build_FMU(model, dest=folder, **options)
    return folder / f"{model.stem}.fmu"


def altered(
    fmu: Path,
    to: Path,
    words: Mapping[str, str] | None = None,
    keep: Callable[[str], bool] = lambda name: True,
) -> Path:
    """Copy an FMU with other words in its description, and without some of its files."""
    with zipfile.ZipFile(fmu) as old, zipfile.ZipFile(to, "w") as new:
        for name in filter(keep, old.namelist()):
            data = old.read(name)
            if name == "modelDescription.xml":
                text = data.decode()
                for before, after in (words or {}).items():
                    assert before in text
                    text = text.replace(before, after)
                data = text.encode()
            new.writestr(name, data)
    return to


def save(path: Path, **columns: np.ndarray) -> Path:
    """Write columns as CSV."""
    table = np.column_stack(list(columns.values()))
    np.savetxt(path, table, delimiter=",", header=",".join(columns), comments="", fmt="%.12g")
    return path
