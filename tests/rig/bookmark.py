"""A snapshot of anything that the project builds: every array and every attribute below it, put back in place."""

from collections import deque
from collections.abc import Callable
from enum import Enum
from random import Random
from typing import Any

import numpy as np

#: Arrays that are larger than this (bytes) are rings of frames and room for them: empty between two ticks.
_RINGS = 300_000
_OURS = ("bench_protocol.", "bench_sim.", "astb.rig_in_memory", "tests.", "conftest")


class Bookmark:
    """What ``root`` and all that it holds are now; :meth:`restore` makes them so again, the same objects."""

    def __init__(self, root: Any) -> None:
        self._undo: list[Callable[[], None]] = []
        self._seen: dict[int, Any] = {}
        waiting = [root]
        while waiting:
            one = waiting.pop()
            if id(one) in self._seen:
                continue
            self._seen[id(one)] = one
            waiting += self._keep(one)

    def restore(self) -> None:
        """Put everything back."""
        for undo in self._undo:
            undo()

    def _keep(self, one: Any) -> list[Any]:
        """Remember ``one``; return what it holds."""
        if one is None or isinstance(one, (str, bytes, int, float)):
            return []
        if isinstance(one, np.ndarray):
            if one.nbytes > _RINGS:
                return []
            kept = one.copy()
            self._undo.append(lambda: np.copyto(one, kept))
            return []
        if isinstance(one, Random):
            state = one.getstate()
            self._undo.append(lambda: one.setstate(state))
            return []
        if isinstance(one, dict):
            content = dict(one)
            self._undo.append(lambda: (one.clear(), one.update(content)))
            return list(content.values())
        if isinstance(one, (list, deque)):
            items = list(one)
            self._undo.append(lambda: (one.clear(), one.extend(items)))
            return items
        if isinstance(one, (tuple, set, frozenset)):
            return list(one)
        if getattr(getattr(one, "__dataclass_params__", None), "frozen", False):
            return []
        if type(one).__module__.startswith(_OURS) and not isinstance(one, (Enum, type)):
            attributes = dict(getattr(one, "__dict__", {}))
            if attributes:
                self._undo.append(lambda: _put_back(one, attributes))
            return list(attributes.values())
        return []


def _put_back(one: Any, attributes: dict[str, Any]) -> None:
    for name, value in attributes.items():
        if getattr(one, name) is not value:
            setattr(one, name, value)
