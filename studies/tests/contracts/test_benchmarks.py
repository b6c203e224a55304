"""Benchmarks are measured by hand: here is seen that they still fit the code they measure, and need no tests."""

import ast
import importlib

import pytest

from astb_studies.benchmarks.__main__ import NAMES
from astb_studies.places import ROOT

SOURCES = sorted(
    path for folder in ("studies/astb_studies", "tools") for path in (ROOT / folder).rglob("*.py")
)


@pytest.mark.parametrize("name", NAMES)
def test_every_benchmark_can_be_started(name):
    assert callable(importlib.import_module(f"astb_studies.benchmarks.{name}").run)


def imports_tests(source: str) -> bool:
    """Whether a module imports from the tests, wherever in it and if only for types."""
    names = []
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            names += [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            names.append(node.module or "")
    return any(name.partition(".")[0] in {"tests", "conftest"} for name in names)


@pytest.mark.parametrize("path", SOURCES, ids=lambda path: str(path.relative_to(ROOT)))
def test_tests_may_use_the_benchmarks_and_not_the_other_way_round(path):
    assert not imports_tests(path.read_text())


@pytest.mark.parametrize(
    "line",
    [
        "import tests.diagnosis.conftest",
        "from tests.diagnosis import conftest as lab",
        "def hidden():\n    import tests",
        "if TYPE_CHECKING:\n    from tests.plans import conftest",
    ],
)
def test_an_import_of_the_tests_is_seen(line):
    assert imports_tests(line)
