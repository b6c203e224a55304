"""Orderly end of a command that moves or serves a bench, when a signal ends it."""

import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Final, NoReturn

from bench_protocol.runtime.own_process import available_signals

#: Signals that the sender may not be aware of: a closed terminal, Ctrl-\\.
UNAWARES: Final = ("SIGHUP", "SIGQUIT")


def end_in_order() -> None:
    """Treat all signals that end this process like Ctrl-C: tear-down runs, sockets are closed."""
    for number in available_signals("SIGTERM", "SIGQUIT"):
        signal.signal(number, signal.default_int_handler)
    for number in available_signals("SIGHUP"):
        if signal.getsignal(number) == signal.SIG_DFL:  # with nohup it continues
            signal.signal(number, _hung_up)


def _hung_up(number: int, _: object) -> NoReturn:
    """End like Ctrl-C, but only once, because the shell can send this signal again during the tear-down."""
    signal.signal(number, signal.SIG_IGN)
    raise KeyboardInterrupt


@contextmanager
def ended_by(end: Callable[[str], object]) -> Iterator[None]:
    """During the block, call ``end`` with the name of each signal that would end this process."""
    before = {}
    for number in available_signals("SIGINT", "SIGTERM", "SIGQUIT", "SIGHUP"):
        if signal.getsignal(number) != signal.SIG_IGN or number.name != "SIGHUP":  # with nohup it continues
            before[number] = signal.signal(number, lambda number, _: end(signal.Signals(number).name))
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
