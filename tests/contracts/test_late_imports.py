"""Imports stand at the top of a file; what must start quickly stays light all the same."""

import ast
import subprocess
import sys
from collections import Counter
from collections.abc import Iterator

import pytest

from tests.contracts.test_imports import PACKAGES, ROOT

#: Imports inside functions, because the module is an extra, or heavy and seldom used. Grows only with an extra.
INSIDE_FUNCTIONS = {
    "astb": 135,
    "astb_studies": 42,
    "bench_protocol": 3,
    "bench_records": 86,
    "bench_sim": 4,
    "diagnosis": 8,
    "drivers": 21,
    "test_plans": 1,
}

HEAVY = {
    "asyncio",
    "can",
    "cantools",
    "jinja2",
    "matplotlib",
    "numba",
    "pandas",
    "pyarrow",
    "pymodbus",
    "scipy",
}
COMMANDS = sorted(
    ".".join(path.relative_to(ROOT).with_suffix("").parts)
    for pattern in ("**/commands/[a-z]*.py", "**/cli.py")
    for path in (ROOT / "astb").glob(pattern)
)
#: What a process imports first, and what must not come with it: a key pressed for completion waits for all of it.
LIGHT = {
    "the commands": (COMMANDS, HEAVY | {"numpy"}),
    "the plans, for completion": (["test_plans.discovery"], HEAVY),
    "a session with a rig elsewhere": (["astb.session"], HEAVY),
    "the rig's process": (
        ["astb.commands.rig", "bench_sim.rig.process"],
        HEAVY - {"asyncio", "numba", "scipy"},
    ),
    "the public API": (
        ["astb.api"],
        {"can", "cantools", "diagnosis.engine", "jinja2", "matplotlib", "pandas"},
    ),
}


def late(tree: ast.AST, inside: bool = False) -> Iterator[ast.AST]:
    """Yield the imports inside functions."""
    for node in ast.iter_child_nodes(tree):
        if inside and isinstance(node, ast.Import | ast.ImportFrom):
            yield node
        yield from late(node, inside or isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef))


def test_imports_are_at_the_top() -> None:
    """Where it became more, move them up; where it became fewer, say so here."""
    counted = Counter(
        package
        for package in PACKAGES
        for path in (ROOT / PACKAGES[package]).rglob("*.py")
        for _ in late(ast.parse(path.read_text()))
    )
    assert dict(counted) == INSIDE_FUNCTIONS


def test_imports_inside_functions_are_detected() -> None:
    source = "import a\nclass A:\n    import b\n    def f():\n        import c\n        if c:\n            import d\n"
    assert [node.lineno for node in late(ast.parse(source))] == [5, 7]


@pytest.mark.parametrize("what", LIGHT)
def test_quick_commands_import_no_heavy_modules(what: str) -> None:
    modules, heavy = LIGHT[what]
    asked = f"import sys, {', '.join(modules)}; print(*sys.modules)"
    done = subprocess.run([sys.executable, "-c", asked], cwd=ROOT, capture_output=True, text=True, check=True)
    assert heavy.isdisjoint(done.stdout.split())
