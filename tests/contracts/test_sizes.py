"""Files of at most 800 lines, functions of at most 60; longer ones are listed with their length and may only shrink."""

import ast
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
FILE, FUNCTION = 800, 60

#: Path, or path and function, with the number of lines. Remove shortened entries; a new line here needs a reason.
EXCEPTIONS: dict[str, int] = {
    "tests/records/conftest.py: write_run": 65,
}


def python_files(root: Path) -> list[Path]:
    """All files of the packages, studies, tests and tools."""
    packages = tomllib.loads((root / "pyproject.toml").read_text())["tool"]["mypy"]["packages"]
    folders = [*packages, "studies", "tests", "tools"]
    return sorted(path for folder in folders for path in (root / folder).rglob("*.py"))


def functions(tree: ast.AST, inside: str = "") -> dict[str, int]:
    """Lines of each function, from its ``def`` to its last line, by its dotted name; inner ones too."""
    found: dict[str, int] = {}
    for node in ast.iter_child_nodes(tree):
        if isinstance(node, ast.expr):
            continue  # no function is defined within one
        named = isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef)
        name = f"{inside}.{node.name}".lstrip(".") if named else inside
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            assert node.end_lineno is not None
            found[name] = max(found.get(name, 0), node.end_lineno - node.lineno + 1)
        for inner, lines in functions(node, name).items():
            found[inner] = max(found.get(inner, 0), lines)
    return found


def too_long(root: Path) -> dict[str, int]:
    found = {}
    for path in python_files(root):
        name, text = path.relative_to(root).as_posix(), path.read_text()
        if (lines := text.count("\n")) > FILE:
            found[name] = lines
        found |= {f"{name}: {f}": n for f, n in functions(ast.parse(text)).items() if n > FUNCTION}
    return found


def complaints(found: dict[str, int], listed: dict[str, int]) -> list[str]:
    """Grown entries, new entries, and entries that are no longer needed."""
    said = []
    for name in sorted(found.keys() | listed.keys()):
        lines, allowed = found.get(name), listed.get(name)
        most = FUNCTION if ": " in name else FILE
        if lines is None:
            said.append(f"{name} has at most {most} lines now, or is gone: take it off the list")
        elif allowed is None:
            said.append(f"{name} has {lines} lines, and {most} are the most: divide it along its concepts")
        elif lines > allowed:
            said.append(f"{name} has grown from {allowed} to {lines} lines; {most} are the most")
        elif lines < allowed:
            said.append(f"{name} has {lines} lines now: the list should say so, not {allowed}")
    return said


def test_no_entry_exceeds_the_readable_length() -> None:
    assert complaints(too_long(ROOT), EXCEPTIONS) == []


@pytest.fixture
def small(tmp_path: Path) -> Path:
    """A tree with one file of the most lines that a file may have, and one function of the most that one may."""
    (tmp_path / "pyproject.toml").write_text('[tool.mypy]\npackages = ["one"]\n')
    (tmp_path / "one").mkdir()
    (tmp_path / "one" / "long.py").write_text("x = 1\n" * FILE)
    lines = ["class A:", "    @property", "    def f(self):", *["        x = 1"] * (FUNCTION - 1)]
    (tmp_path / "one" / "function.py").write_text("\n".join(lines) + "\n")
    return tmp_path


def test_what_just_fits_is_no_exception(small: Path) -> None:
    assert complaints(too_long(small), {}) == []


@pytest.mark.parametrize(
    ("file", "line", "name", "lines"),
    [
        ("long.py", "x = 1\n", "one/long.py", FILE + 1),
        ("function.py", "        x = 1\n", "one/function.py: A.f", FUNCTION + 1),
    ],
)
def test_a_line_too_many_is_seen_whatever_the_list_says(
    small: Path, file: str, line: str, name: str, lines: int
) -> None:
    with (small / "one" / file).open("a") as end:
        end.write(line)
    found = too_long(small)
    assert complaints(found, {name: lines}) == []
    assert "are the most: divide it" in complaints(found, {})[0]
    assert f"has grown from {lines - 1} to {lines}" in complaints(found, {name: lines - 1})[0]
    assert "the list should say so" in complaints(found, {name: lines + 1})[0]


def test_the_list_holds_no_more_than_it_needs(small: Path) -> None:
    assert "take it off the list" in complaints(too_long(small), {"one/long.py": FILE})[0]


def test_a_function_in_a_function_counts_by_itself() -> None:
    inner = "def outer():\n    def inner():\n        pass\n        pass\n"
    assert functions(ast.parse(inner)) == {"outer": 4, "outer.inner": 3}
