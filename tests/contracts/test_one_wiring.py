"""No code depends on the kind of a wiring: every wiring implements the contract, and states its rig's capabilities."""

import ast
from pathlib import Path

from drivers.wiring import contract
from tests.contracts.test_imports import PACKAGES

ROOT = Path(__file__).resolve().parents[2]
ASKING = "from x import OwnWiring as W\nif isinstance(bench.wiring, (W, Other)): pass\n"


def questions(source: str) -> list[int]:
    """Return the lines that test the kind of a wiring."""
    tree = ast.parse(source)
    renamed = {
        one.asname or one.name
        for node in ast.walk(tree)
        if isinstance(node, ast.ImportFrom)
        for one in node.names
        if one.name.endswith("Wiring")
    }
    found = []
    for node in ast.walk(tree):
        if isinstance(node, ast.Call) and ast.unparse(node.func) in ("isinstance", "issubclass", "hasattr"):
            what, kind = map(ast.unparse, node.args)
            if kind == "str":  # the key of a rig file, a path or the keys themselves
                continue
            names = {name.id for name in ast.walk(node.args[1]) if isinstance(name, ast.Name)}
            if kind.endswith("Wiring") or names & renamed or what.split(".")[-1] in ("wiring", "_wiring"):
                found.append(node.lineno)
    return found


def test_no_part_of_the_product_asks_which_wiring_it_has():
    assert questions(ASKING) == [2]
    asked = [
        f"{path.relative_to(ROOT)}:{line}"
        for folder in PACKAGES.values()
        for path in (ROOT / folder).rglob("*.py")
        if "iring" in (text := path.read_text())
        for line in questions(text)
    ]
    assert asked == []


def test_only_the_port_of_a_simulated_bus_has_optional_members():
    """Callers would have to check each wiring and transport for optional members."""
    partial = [
        name
        for name, one in vars(contract).items()
        if getattr(one, "_is_runtime_protocol", False) and one.__module__ == contract.__name__
    ]
    assert partial == ["CyclicPort"]
