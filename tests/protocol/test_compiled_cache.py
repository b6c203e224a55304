"""Several processes compile at once, and each finds its own functions again."""

import errno
import fcntl
import os
import pickle
import subprocess
import sys
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path

import numba
import pytest
from numba.core.caching import IndexDataCacheFile

from bench_protocol.runtime.binding import LOCK, cached, folder_of, lock_cache
from bench_protocol.runtime.sources import digest_of

WORKERS, FUNCTIONS = 4, 40


def _kept_at_once(folder: Path, turns: bool) -> int:
    """Return how many of many functions are found again that several saved at once, each through a separate cache."""

    def one() -> IndexDataCacheFile:
        made = IndexDataCacheFile(str(folder), "function", 0)
        if turns:
            lock_cache(made)
        return made

    def save(worker: int) -> None:
        cache = one()
        for k in range(FUNCTIONS):
            cache.save((worker, k), f"code {worker} {k}")

    with ThreadPoolExecutor(WORKERS) as threads:
        list(threads.map(save, range(WORKERS)))
    cache = one()
    return sum(cache.load((w, k)) == f"code {w} {k}" for w in range(WORKERS) for k in range(FUNCTIONS))


def test_what_is_saved_at_once_is_found_again(tmp_path: Path) -> None:
    assert _kept_at_once(tmp_path, turns=True) == WORKERS * FUNCTIONS


def test_without_serialisation_entries_are_lost(tmp_path: Path) -> None:
    """The hazard is numba's, and the test above would see it."""
    assert _kept_at_once(tmp_path, turns=False) < WORKERS * FUNCTIONS


def test_cached_functions_are_serialised(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(numba.config, "CACHE_DIR", str(tmp_path))

    def twice(x: float) -> float:
        return 2.0 * x

    assert cached(twice)(3.0) == 6.0
    assert len(list(tmp_path.rglob(LOCK))) == 1


def test_a_file_system_without_locks_is_no_hindrance(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def unlocked(_file: int, _operation: int) -> None:
        raise OSError(errno.ENOLCK, "No locks available")

    monkeypatch.setattr(fcntl, "flock", unlocked)
    cache = IndexDataCacheFile(str(tmp_path), "function", 0)
    lock_cache(cache)
    cache.save("key", "code")
    assert cache.load("key") == "code"


#: Possible contents of the index or its folder: a class of another release that was renamed, half a file.
KEPT: dict[str, bytes] = {
    "a class that is gone": b"cnumba.core.caching\nA_class_that_is_gone\n.",
    "a module that is gone": b"ca_module_that_is_gone\nAny\n.",
    "half a file": pickle.dumps(("stamp", {"key": "data"}))[:-9],
    "nothing": b"",
}


@pytest.mark.parametrize("place", ["function.nbi", "function.1.nbc"])
@pytest.mark.parametrize("what", KEPT)
def test_what_another_release_kept_is_compiled_anew(tmp_path: Path, what: str, place: str) -> None:
    """numba unpickles the whole index before it compares the sources: AttributeError after an update."""
    cache = IndexDataCacheFile(str(tmp_path), "function", 0)
    cache.save("key", "code")
    index = place.endswith(".nbi")
    (tmp_path / place).write_bytes((pickle.dumps(numba.__version__) if index else b"") + KEPT[what])
    lock_cache(cache)
    assert cache.load("key") is None
    cache.save("key", "code of today")
    assert cache.load("key") == "code of today"


#: A module in a read-only folder: not even root can make a folder of a file.
MODULE = "def twice(x):\n    return 2.0 * x\n"


@pytest.fixture
def strange(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[[float], float]:
    """A function in an installation that cannot be written to."""
    monkeypatch.setattr(numba.config, "CACHE_DIR", "")
    (tmp_path / "strange.py").write_text(MODULE)
    (tmp_path / "__pycache__").write_text("")
    spec = spec_from_file_location("strange", tmp_path / "strange.py")
    assert spec and spec.loader
    module = module_from_spec(spec)
    spec.loader.exec_module(module)
    return module.twice


def test_where_an_installation_cannot_be_written_to_the_users_own_folder_keeps(
    strange, tmp_path, monkeypatch
):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "mine"))
    twice = cached(strange)
    assert twice(3.0) == 6.0
    assert Path(folder_of(twice)).is_relative_to(tmp_path / "mine")
    assert list(Path(folder_of(twice)).glob("*.nbc"))


def test_a_read_only_folder_is_reported_once_and_tolerated(strange, tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "strange.py"))
    with pytest.warns(RuntimeWarning, match="compiled functions cannot be kept.* Set NUMBA_CACHE_DIR"):
        twice = cached(strange)
    assert (twice(3.0), folder_of(twice)) == (6.0, "")


#: A package with a kernel, a law that the kernel calls, and a module that nothing compiled imports.
SOURCES = {
    "__init__.py": "",
    "law.py": "LIMIT = 2.0\n\ndef law(x):\n    return LIMIT * x\n",
    "kernel.py": "from bench_fmu_like.law import law\n\ndef kernel(x):\n    return law(x)\n",
    "packaging.py": "EXTRAS = 1\n",
}
#: A change of one file, and whether the kernel must be compiled again.
CHANGES = {
    "nothing": ("law.py", "", "", False),
    "a value in the law": ("law.py", "2.0", "3.0", True),
    "an operation in the law": ("law.py", "LIMIT * x", "LIMIT / x", True),
    "a comment": ("law.py", "LIMIT =", "# reason\nLIMIT =", False),
    "another comment": ("law.py", "return", "# reason\n    return", False),
    "a module that is not imported": ("packaging.py", "1", "2", False),
    "a new import": ("kernel.py", "\n\ndef", "\nfrom bench_fmu_like import packaging\n\ndef", True),
}
DOCSTRINGS = {
    "a module": '"""{}"""\nLIMIT = 2.0\n',
    "a function": 'def law(x):\n    """{}"""\n    return x\n',
    "a class": 'class Law:\n    """{}"""\n\n    LIMIT = 2.0\n',
    "a method": 'class Law:\n    def law(self):\n        """{}"""\n        return 1\n',
}


def _digest(folder: Path, sources: dict[str, str]) -> str:
    """Return the digest of the kernel in a package with these ``sources``, seen by a new process."""
    package = folder / "bench_fmu_like"
    package.mkdir(exist_ok=True)
    for name, text in sources.items():
        (package / name).write_text(text)
    script = (
        "from bench_protocol.runtime import sources; sources.PACKAGES |= {'bench_fmu_like'}; "
        "print(sources.digest_of('bench_fmu_like.kernel'))"
    )
    environment = {**os.environ, "PYTHONPATH": str(folder), "PYTHONDONTWRITEBYTECODE": "1"}
    done = subprocess.run([sys.executable, "-c", script], env=environment, capture_output=True, check=True)
    return done.stdout.decode()


@pytest.mark.parametrize("change", CHANGES)
def test_only_a_change_of_reached_code_compiles_again(tmp_path: Path, change: str) -> None:
    file, old, new, again = CHANGES[change]
    before = _digest(tmp_path, SOURCES)
    assert (_digest(tmp_path, {file: SOURCES[file].replace(old, new)}) != before) == again


@pytest.mark.parametrize("place", DOCSTRINGS)
def test_a_docstring_does_not_compile_again(tmp_path: Path, place: str) -> None:
    one, other = (_digest(tmp_path, SOURCES | {"law.py": DOCSTRINGS[place].format(k)}) for k in "ab")
    assert one == other


def test_the_model_is_kept_by_the_code_that_it_reaches() -> None:
    """Whatever is compiled into the tick is imported where it is called."""
    from bench_sim.model.kernel import advance_plant

    if hasattr(advance_plant, "signatures"):
        assert advance_plant._cache._cache_file._source_stamp == digest_of("bench_sim.model.kernel")
