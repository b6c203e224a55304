"""What we use of numba without its promise: every such name, and numba still has it."""

import ast
from collections.abc import Iterator
from pathlib import Path

import numba
import numpy as np
import pytest

from tests.contracts.test_imports import CONFIG, PACKAGES

ROOT = Path(__file__).resolve().parents[2]

#: By file. A new release of numba may change any of them: it is allowed in pyproject.toml when the tests have passed.
PRIVATE = {
    "bench_protocol/runtime/binding.py": {
        "_nrt",  # an option: a function without numba's runtime, which counts references
        "_cache",  # of a compiled function
        "_cache_file",  # of its cache: reads and writes the files
        "_cache_path",  # where they lie
        "_source_stamp",  # what decides whether they are of today
        "_index_name",  # the names of these files
        "_index_path",
        "_data_name_pattern",
        "get_overload",  # the compiled function for some types, called without a look at its arguments
    },
    "bench_protocol/runtime/addresses.py": {"numba.extending"},  # a call of an address
    "bench_sim/model/compiled.py": {"_nrt"},
    "drivers/cycle.py": {"get_overload"},
    "tests/protocol/test_compiled_cache.py": {"numba.core.caching", "_cache", "_cache_file", "_source_stamp"},
}
#: Public by their name, and mentioned nowhere in numba's documentation.
UNDOCUMENTED = {"get_overload"}
#: The underscore of namedtuples is public.
NAMEDTUPLE = {"_replace", "_fields", "_asdict", "_make"}


def ours(tree: ast.Module) -> set[str]:
    """Names with an underscore that a file gives to something itself: functions, attributes, fields."""
    given = set()
    for node in ast.walk(tree):
        match node:
            case ast.FunctionDef(name=name) | ast.ClassDef(name=name):
                given.add(name)
            case (
                ast.Attribute(value=ast.Name(id="self" | "cls"), attr=name)
                | ast.Name(id=name, ctx=ast.Store())
            ):
                given.add(name)
    return given


def used(tree: ast.Module) -> Iterator[str]:
    """Names that a file uses without a promise: of attributes, options, texts given to getattr, and parts of numba."""
    own = ours(tree)
    for node in ast.walk(tree):
        match node:
            case ast.Attribute(attr=name) | ast.keyword(arg=str(name)):
                if name not in own:
                    yield name
            case ast.Call(
                func=ast.Name(id="getattr" | "hasattr" | "setattr"), args=[_, ast.Constant(value=name), *_]
            ):
                yield str(name)
            case ast.ImportFrom(module=str(module)) if module.startswith("numba."):
                yield module
            case ast.Import(names=names):
                yield from (one.name for one in names if one.name.startswith("numba."))


def private(tree: ast.Module) -> set[str]:
    return {
        name
        for name in used(tree)
        if name.startswith("numba.")
        or name in UNDOCUMENTED
        or (name.startswith("_") and not name.startswith("__") and name not in NAMEDTUPLE)
    }


def knows_numba(tree: ast.Module) -> bool:
    """Whether a file imports numba, or something from where its functions are compiled."""
    homes = ("numba", "bench_protocol.runtime.binding", "bench_sim.model.compiled")
    return any(
        (isinstance(node, ast.Import) and any(one.name.split(".")[0] == "numba" for one in node.names))
        or (isinstance(node, ast.ImportFrom) and (node.module or "").startswith(homes))
        for node in ast.walk(tree)
    )


def test_every_private_name_of_numba_is_listed() -> None:
    found = {}
    for top in (*PACKAGES.values(), "studies/tests", "tools", "tests"):
        for path in sorted((ROOT / top).rglob("*.py")):
            text, where = path.read_text(encoding="utf-8"), path.relative_to(ROOT).as_posix()
            if path == Path(__file__) or not any(home in text for home in ("numba", "binding", "compiled")):
                continue
            tree = ast.parse(text)
            if (knows_numba(tree) or where in PRIVATE) and (names := private(tree)):
                found[where] = names
    assert found == PRIVATE


@pytest.mark.parametrize("line", ["f._dispatcher", "g(_dbg=1)", "getattr(f, '_code')", "import numba.core.x"])
def test_a_new_one_would_be_seen(line: str) -> None:
    assert private(ast.parse(f"import numba\n{line}\n"))


def test_numba_has_them_all(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    if numba.config.DISABLE_JIT:
        pytest.skip("plain Python has none of them")
    monkeypatch.setattr(numba.config, "CACHE_DIR", str(tmp_path))

    @numba.njit(cache=True, _nrt=False)
    def twice(x: float) -> float:
        return 2.0 * x

    twice.compile((numba.float64,))
    assert twice.get_overload((numba.float64,))(3.0) == 6.0
    file = twice._cache._cache_file
    assert Path(file._cache_path).is_relative_to(tmp_path)
    assert file._source_stamp
    assert np.all([callable(file.save), callable(file.load)])


def test_numba_is_pinned_to_a_minor_release() -> None:
    (numbas,) = (text for text in CONFIG["project"]["dependencies"] if text.startswith("numba"))
    low, high = (part.strip("numba<>=").split(".") for part in numbas.split(","))
    assert (int(low[0]), int(low[1]) + 1) == tuple(map(int, high[:2]))
