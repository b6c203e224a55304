"""FMUs that are not ours, made by pythonfmu and pythonfmu3, and what a map says of them."""

import re
import zipfile
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np

HERE = Path(__file__).parent
HOW_TO = HERE.parents[1] / "docs" / "how-to"
PAGE = HOW_TO / "use-fmus.md"


def page_files(folder: Path) -> None:
    """Save the files that the page shows, and the file `measure.py` of the page that it links."""
    pattern = r"`(\w+\.(?:py|toml))`[^`\n]*:\n\n```\w+\n(.*?)```"
    linked = dict(re.findall(pattern, (HOW_TO / "diagnose-other-data.md").read_text(), flags=re.DOTALL))
    shown = dict(re.findall(pattern, PAGE.read_text(), flags=re.DOTALL))
    for name, text in (shown | {"measure.py": linked["measure.py"]}).items():
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
