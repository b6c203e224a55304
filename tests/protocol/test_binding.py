"""Compiled code is bound without scipy's linear algebra, which other threads may import meanwhile."""

import sys
import threading

import pytest

from bench_protocol.runtime.binding import _without_linear_algebra

NAME = "scipy.linalg.cython_blas"


@pytest.mark.parametrize("others", [0, 1])
def test_all_threads_share_the_data(others: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """One that imported scipy while another one compiled met a module that is said not to be there."""
    monkeypatch.delitem(sys.modules, NAME, raising=False)
    monkeypatch.setattr(threading, "active_count", lambda: 1 + others)
    with _without_linear_algebra():
        assert (NAME in sys.modules) == (others == 0)
    assert NAME not in sys.modules
