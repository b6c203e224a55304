"""Run the notebooks of the tutorials and store their outputs: python -m tools.notebook [--into FOLDER].

Each notebook runs in a new folder, with the present interpreter. The stored notebook contains only outputs that are
equal in all runs of the same code. ``--into`` leaves the notebooks of the repository as they are.
"""

import argparse
import os
import sys
import tempfile
from pathlib import Path
from typing import Final

TUTORIALS: Final = Path(__file__).parents[1] / "docs" / "tutorials"
#: Time limit of one cell, in s: a diagnosis on a busy machine, with its model already compiled.
PATIENCE: Final = 240
#: Warnings of libraries and bars of progress are not what a reader comes for.
NOISE: Final = "stderr"


def run(source: Path, target: Path) -> None:
    """Run the notebook ``source`` and write it with outputs to ``target``. Raises nbclient's error if a cell fails."""
    with tempfile.TemporaryDirectory() as folder:
        # What this user has installed for Jupyter, other kernels of the same name among it, is left out.
        for name in (
            "JUPYTER_PATH",
            "JUPYTER_DATA_DIR",
            "JUPYTER_CONFIG_DIR",
            "JUPYTER_RUNTIME_DIR",
            "IPYTHONDIR",
        ):
            os.environ[name] = str(Path(folder, name.lower()))
        import nbformat
        from ipykernel.kernelspec import install
        from nbclient import NotebookClient

        install(prefix=folder)
        os.environ["JUPYTER_PATH"] = str(Path(folder, "share", "jupyter"))
        work = Path(folder, "work")
        work.mkdir()
        notebook = nbformat.read(source, as_version=4)
        client = NotebookClient(
            notebook,
            timeout=PATIENCE,
            kernel_name="python3",
            record_timing=False,
            resources={"metadata": {"path": str(work)}},
        )
        client.execute()
    notebook.metadata = {
        "kernelspec": {"display_name": "Python 3", "language": "python", "name": "python3"},
        "language_info": {"name": "python"},
    }
    for cell in notebook.cells:
        if cell.cell_type == "code":
            cell.outputs = [one for one in cell.outputs if one.get("name") != NOISE]
    nbformat.write(notebook, target)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--into", type=Path, default=TUTORIALS, help="where to write (default: in place)")
    into = parser.parse_args().into
    for source in sorted(TUTORIALS.glob("*.ipynb")):
        run(source, into / source.name)
        print(into / source.name, file=sys.stderr)


if __name__ == "__main__":
    main()
