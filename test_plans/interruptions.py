"""Handling of signals that stop a run. A signal stops one part of the run, but never prevents the run from writing its
results.
"""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Any, Final, Self

#: Signals of Ctrl-C, of a request to end the process, of a closed terminal, and of Ctrl-\.
STOPPING: Final = tuple(
    getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP", "SIGQUIT") if hasattr(signal, name)
)


class Interruptions:
    """Context manager that defers stop signals until an interruptible part of the run.

    Signals that are still pending at the exit go to the handlers that were installed before. Only the main thread
    receives signals. In other threads, and for signals without a Python handler, the context manager has no effect.
    """

    def __init__(self) -> None:
        self._before: dict[int, Callable[[int, FrameType | None], Any]] = {}
        self._waiting: list[int] = []
        self._open = False

    def __enter__(self) -> Self:
        if threading.current_thread() is threading.main_thread():
            for number in STOPPING:
                if callable(before := signal.getsignal(number)):
                    self._before[number] = before
                    signal.signal(number, self._on_signal)
        return self

    def __exit__(self, *_: object) -> None:
        for number, before in self._before.items():
            if signal.getsignal(number) == self._on_signal:  # a handler may have replaced it
                signal.signal(number, before)
        self._deliver()

    @contextmanager
    def interruptible(self) -> Iterator[None]:
        """Let a signal stop the block. A signal that is already pending stops it at once."""
        self._deliver()
        self._open = True
        try:
            yield
        finally:
            self._open = False

    def _on_signal(self, number: int, frame: FrameType | None) -> None:
        if not self._open:
            self._waiting.append(number)
            return
        self._open = False
        self._before[number](number, frame)

    def _deliver(self) -> None:
        """Call the former handlers for the pending signals, once for each signal number."""
        waiting, self._waiting = dict.fromkeys(self._waiting), []
        for number in waiting:
            self._before[number](number, None)
