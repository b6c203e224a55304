"""Timing of the compiled tick: absolute deadlines and a policy for late ticks in real time, or no waiting."""

from enum import IntEnum
from typing import Any, Final, NamedTuple

import numpy as np
import numpy.typing as npt

from bench_protocol.frames import Block, copied
from bench_protocol.rates import TICK
from bench_protocol.runtime.binding import inlined
from bench_protocol.runtime.calls import SPEC_WORDS, lock_mutex, now, sleep_until, unlock_mutex
from bench_protocol.runtime.eventfd import wake
from bench_protocol.units import NS, ms

_PERIOD: Final = round(TICK * NS)
#: Pause after a stall, in which the readers run first.
_STALL: Final = round(20 * ms * NS)
_PAUSE: Final = round(3 * ms * NS)


class Late(IntEnum):
    """Policy for ticks whose deadline has passed."""

    CATCH_UP = 0  #: run all of them at once
    SKIP = 1  #: shift the rig's time by the delay
    FAULT = 2  #: catch up, but more than 100 ms is a fault of the bench


PACING: Final = np.dtype(
    [
        ("paced", "<i8"),  # 1: in real time
        ("stop", "<i8"),  # 1: return before the next tick
        ("policy", "<i8"),  # `Late`
        ("start", "<i8"),  # monotonic, ns
        ("ticks", "<i8"),  # number of ticks since start
        ("epoch", "<i8"),  # ns from the rig's time to the time of day
        ("behind", "<i8"),  # 1: the last tick was late by a stall
        ("stall", "<i8"),  # ns by which the next tick is delayed, to simulate a stall
        ("mutex", "<i8"),  # address of the mutex
        ("eventfd", "<i8"),  # eventfd that signals new frames
        ("logged", "<i8"),  # number of latenesses in the log
    ]
)


class Pacing(NamedTuple):
    """State of the timing of the compiled tick."""

    record: npt.NDArray[np.void]  #: one `PACING`
    spec: npt.NDArray[np.int64]  #: work space of the clock
    one: npt.NDArray[np.uint64]  #: content for writing to the eventfd
    log: npt.NDArray[np.int64]  #: lateness (ns) of the first ticks, if requested

    @classmethod
    def virtual(cls, log: int = 0) -> "Pacing":
        """Return a timing without waiting; ``log``: number of ticks whose lateness is recorded in real time."""
        return cls(
            np.zeros(1, PACING),
            np.zeros(SPEC_WORDS, np.int64),
            np.ones(1, np.uint64),
            np.zeros(log, np.int64),
        )

    @property
    def real(self) -> bool:
        """Whether the tick runs in real time now."""
        return bool(self.record[0]["paced"])

    @property
    def log_is_full(self) -> bool:
        """Whether the requested number of latenesses is recorded."""
        return int(self.record[0]["logged"]) == self.log.size

    @property
    def stopped(self) -> bool:
        """Whether the tick was requested to return."""
        return bool(self.record[0]["stop"])

    def start(self, epoch: int, mutex: int, eventfd: int, policy: Late) -> None:
        """Switch to real time: the next tick is due one period from now.

        ``epoch``: ns from the rig's time to the time of day; ``mutex``: address of the mutex that the tick locks;
        ``eventfd``: signals sent frames.
        """
        record = self.record[0]
        record["start"], record["ticks"] = now(self.spec), 0
        record["epoch"] = epoch
        record["policy"], record["mutex"], record["eventfd"] = policy, mutex, eventfd
        record["paced"] = 1

    def stop(self) -> None:
        """Request the tick to return before it runs again."""
        self.record[0]["stop"] = 1

    def end(self) -> None:
        """Switch to time without waiting; the tick must have returned before."""
        self.record[0]["paced"] = self.record[0]["stop"] = 0

    def wake(self) -> None:
        """Wake the reader of the eventfd, from Python."""
        wake(int(self.record[0]["eventfd"]))

    def dated(self, block: Block) -> Block:
        """Return a copy of ``block`` with the time of day in place of the rig's time."""
        dated = copied(block)
        dated["time"] += self.record[0]["epoch"]
        return dated

    def stall(self, duration: int) -> None:
        """Delay the next tick by ``duration`` ns, to simulate a stall of the machine."""
        self.record[0]["stall"] = duration


@inlined
def await_tick(pacing: Any) -> int:
    """Sleep until the next tick is due, and lock the mutex; return the lateness (ns) of the tick."""
    p = pacing.record[0]
    p.ticks += 1
    deadline = p.start + p.ticks * _PERIOD
    stall = p.stall
    p.stall = 0
    sleep_until(deadline + stall, pacing.spec)
    instant = now(pacing.spec)
    late = instant - deadline
    if late > _STALL and p.behind == 0:
        # The machine stalled, and the reading threads with it: commands that arrived in time are still in the sockets.
        # Without this pause the late ticks would count them as missing and trip the watchdog.
        sleep_until(instant + _PAUSE, pacing.spec)
    p.behind = late > _STALL
    lock_mutex(p.mutex)
    return late


@inlined
def put_off(pacing: Any) -> None:
    """Unlock the mutex without running the tick: the next call of `await_tick` waits for the same tick again."""
    p = pacing.record[0]
    p.ticks -= 1
    unlock_mutex(p.mutex)
