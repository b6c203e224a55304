"""Several threads for what does not depend on each other: long loops over samples release the interpreter meanwhile.

Results are the same for any number of workers: they keep the order of the requests, and no worker may change the input
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
    """Return a function during which numpy multiplies on one core.

    Threads of the linear algebra wait for each other together with those here: a diagnosis takes several times as long.
    """

    @wraps(function)
    def calm(*args: Arguments.args, **kwargs: Arguments.kwargs) -> Found:
        with threadpool_limits(limits=1, user_api="blas"):
            return function(*args, **kwargs)

    return calm


def in_threads(workers: int, function: Callable[[Given], Found], given: Iterable[Given]) -> list[Found]:
    """Return what a function makes of each item, by so many workers."""
    items = list(given)
    if workers <= 1 or len(items) < 2:
        return [function(item) for item in items]
    with ThreadPoolExecutor(min(workers, len(items))) as pool:
        return list(pool.map(function, items))


def aside(workers: int, function: Callable[[], Found]) -> Callable[[], Found]:
    """Begin a calculation in parallel, and return a function that waits for its result; one worker begins it then."""
    if workers <= 1:
        return function
    pool = ThreadPoolExecutor(1)
    future = pool.submit(function)
    pool.shutdown(wait=False)
    return future.result
