"""Several processes compile at once, and each finds its own functions again."""

import errno
import fcntl
import pickle
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path

import numba
import pytest
from numba.core.caching import IndexDataCacheFile

from bench_protocol.realtime.binding import LOCK, cached, folder_of, kept, take_turns

WORKERS, FUNCTIONS = 4, 40


def _kept_at_once(folder: Path, turns: bool) -> int:
    """Return how many of many functions are found again that several saved at once, each through a cache of its own."""

    def one() -> IndexDataCacheFile:
        made = IndexDataCacheFile(str(folder), "function", 0)
        if turns:
            take_turns(made)
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


def test_without_turns_something_is_lost(tmp_path: Path) -> None:
    """The hazard is numba's, and the test above would see it."""
    assert _kept_at_once(tmp_path, turns=False) < WORKERS * FUNCTIONS


def test_cached_functions_take_turns(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(numba.config, "CACHE_DIR", str(tmp_path))

    def twice(x: float) -> float:
        return 2.0 * x

    assert cached(twice, "digest")(3.0) == 6.0
    assert len(list(tmp_path.rglob(LOCK))) == 1


def test_a_file_system_without_locks_is_no_hindrance(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def unlocked(_file: int, _operation: int) -> None:
        raise OSError(errno.ENOLCK, "No locks available")

    monkeypatch.setattr(fcntl, "flock", unlocked)
    cache = IndexDataCacheFile(str(tmp_path), "function", 0)
    take_turns(cache)
    cache.save("key", "code")
    assert cache.load("key") == "code"


#: What may lie in the index or beside it: a class of another release that has another name today, half a file.
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
    take_turns(cache)
    assert cache.load("key") is None
    cache.save("key", "code of today")
    assert cache.load("key") == "code of today"


#: A module in a folder of its own, where nothing can be written: not even root can make a folder of a file.
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
    twice = kept(strange)
    assert twice(3.0) == 6.0
    assert Path(folder_of(twice)).is_relative_to(tmp_path / "mine")
    assert list(Path(folder_of(twice)).glob("*.nbc"))


def test_where_nothing_can_be_written_one_sentence_says_so_and_it_works_all_the_same(
    strange, tmp_path, monkeypatch
):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "strange.py"))
    with pytest.warns(RuntimeWarning, match="compiled functions cannot be kept.* NUMBA_CACHE_DIR may name"):
        twice = cached(strange, "digest")
    assert (twice(3.0), folder_of(twice)) == (6.0, "")
