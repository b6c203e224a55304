"""Several processes compile at once, and each finds its own functions again."""

import errno
import fcntl
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numba
import pytest
from numba.core.caching import IndexDataCacheFile

from bench_protocol.binding import LOCK, cached, take_turns

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
