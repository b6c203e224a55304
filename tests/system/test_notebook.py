"""The notebook of the tutorials: it runs as printed, finds the hidden effect, and contains no traces of its user."""

import base64
import math
import re
import subprocess
import sys
from pathlib import Path

import nbformat
import pytest

ROOT = Path(__file__).parents[2]
KEPT = ROOT / "docs" / "tutorials" / "bench.ipynb"


def read(path: Path) -> nbformat.NotebookNode:
    notebook = nbformat.read(path, as_version=4)
    nbformat.validate(notebook)
    return notebook


def code_cells(notebook: nbformat.NotebookNode) -> list[nbformat.NotebookNode]:
    return [cell for cell in notebook.cells if cell.cell_type == "code"]


def output_of(cell: nbformat.NotebookNode) -> str:
    """What a cell printed and what its last line is, without pictures."""
    texts = [one.get("text") or one.get("data", {}).get("text/plain", "") for one in cell.outputs]
    return "\n".join(texts)


def judge(cells: list[nbformat.NotebookNode]) -> None:
    """The statements to a reader are correct: the loop's energy, the verdicts, and the hidden hole."""
    text = "\n".join(output_of(cell) for cell in cells)

    def number(pattern: str) -> float:
        return float(re.search(pattern, text)[1])

    # The loop is an ellipse as far as its area goes: π K'' X², with K'' as printed in kN/mm.
    area = math.pi * number(r"K'' +(\S+)") * 1e6 * 0.005**2
    assert number(r"lost +(\S+) J") == pytest.approx(area, rel=0.02)
    assert 0 < number(r"loss angle +(\S+)°") < 45
    assert re.search(r"checks: pass\n.*conforms with", text)
    assert number(r"left bellows leaks .*\(area: (\S+) ± ") == pytest.approx(0.2, abs=0.01)
    assert number(r"leak\.left +(\S+)") > 10 * number(r"leak\.right +(\S+)")
    pictures = [
        one.data["image/png"] for cell in cells for one in cell.outputs if "image/png" in one.get("data", {})
    ]
    assert [base64.b64decode(one)[:4] for one in pictures] == [b"\x89PNG"]


def test_the_notebook_is_kept_as_its_tool_writes_it():
    notebook = read(KEPT)
    assert set(notebook.metadata) == {"kernelspec", "language_info"}
    assert set(notebook.metadata.language_info) == {"name"}, "no version of its last user"
    cells = code_cells(notebook)
    assert [cell.execution_count for cell in cells] == list(range(1, len(cells) + 1))
    assert not any(cell.metadata for cell in notebook.cells)
    for cell in cells:
        assert {one.output_type for one in cell.outputs} <= {"stream", "display_data", "execute_result"}
        assert not re.search(r"/(home|root|tmp)/", output_of(cell))
    assert KEPT.stat().st_size < 100_000
    judge(cells)


@pytest.mark.slow
def test_the_notebook_runs_and_finds_what_was_hidden(tmp_path):
    done = subprocess.run(
        [sys.executable, "-m", "tools.notebook", "--into", tmp_path],
        cwd=ROOT,
        capture_output=True,
        text=True,
        timeout=280,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    judge(code_cells(read(tmp_path / KEPT.name)))
