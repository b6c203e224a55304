"""Threads for independent tasks. Long loops over samples release the interpreter lock, so they run in parallel.

Results do not depend on the number of workers: they keep the order of the requests, and no worker may change the input
of another one.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from functools import wraps
from typing import ParamSpec, TypeVar

from threadpoolctl import threadpool_limits

Given = TypeVar("Given")
Found = TypeVar("Found")
Arguments = ParamSpec("Arguments")


def algebra_on_one_core(function: Callable[Arguments, Found]) -> Callable[Arguments, Found]:
    """Return the function, wrapped so that numpy uses one core for linear algebra while it runs.

    Otherwise the threads of the linear algebra and the threads of this module would wait for each other, and a
    diagnosis would take several times as long.
    """

    @wraps(function)
    def calm(*args: Arguments.args, **kwargs: Arguments.kwargs) -> Found:
        with threadpool_limits(limits=1, user_api="blas"):
            return function(*args, **kwargs)

    return calm


def in_threads(workers: int, function: Callable[[Given], Found], given: Iterable[Given]) -> list[Found]:
    """Call a function for each item in ``workers`` threads, and return the results in the order of the items."""
    items = list(given)
    if workers <= 1 or len(items) < 2:
        return [function(item) for item in items]
    with ThreadPoolExecutor(min(workers, len(items))) as pool:
        return list(pool.map(function, items))


def aside(workers: int, function: Callable[[], Found]) -> Callable[[], Found]:
    """Start a calculation in another thread; return a function that waits for its result.

    With one worker the calculation starts only when the returned function is called.
    """
    if workers <= 1:
        return function
    pool = ThreadPoolExecutor(1)
    future = pool.submit(function)
    pool.shutdown(wait=False)
    return future.result
