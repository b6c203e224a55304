"""The signals that stop a run: each stops one part of it, and none keeps it from writing down what it found."""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Any, Final, Self

#: What Ctrl-C, whoever ends the process, a terminal that is closed, and Ctrl-\ send.
STOPPING: Final = tuple(
    getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP", "SIGQUIT") if hasattr(signal, name)
)


class Interruptions:
    """Keeps the signals that stop a run until a part is carried out that may be stopped: a context manager.

    What nobody heard until the end is then said to whoever listened before. Only the main thread hears signals:
    elsewhere, and of a signal that nobody listens to, nothing changes.
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
                    signal.signal(number, self._hear)
        return self

    def __exit__(self, *_: object) -> None:
        for number, before in self._before.items():
            if signal.getsignal(number) == self._hear:  # whoever heard it may have changed that
                signal.signal(number, before)
        self._deliver()

    @contextmanager
    def heard(self) -> Iterator[None]:
        """Let one signal stop what is done while the block lasts, at once if it has come already."""
        self._deliver()
        self._open = True
        try:
            yield
        finally:
            self._open = False

    def _hear(self, number: int, frame: FrameType | None) -> None:
        if not self._open:
            self._waiting.append(number)
            return
        self._open = False
        self._before[number](number, frame)

    def _deliver(self) -> None:
        """Say what came meanwhile to whoever listened before: several of a kind are one."""
        waiting, self._waiting = dict.fromkeys(self._waiting), []
        for number in waiting:
            self._before[number](number, None)
