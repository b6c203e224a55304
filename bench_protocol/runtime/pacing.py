"""The pace of the compiled tick: absolute deadlines in real time and what a missed one means; or none at all."""

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
#: After a stall this long the readers get this much time first.
_STALL: Final = round(20 * ms * NS)
_PAUSE: Final = round(3 * ms * NS)


class Late(IntEnum):
    """What happens to ticks whose time has passed."""

    CATCH_UP = 0  #: run them all, at once
    SKIP = 1  #: let the rig's time stand still for as long
    FAULT = 2  #: catch up, but more than 100 ms is a fault of the bench


PACING: Final = np.dtype(
    [
        ("paced", "<i8"),  # 1: in real time
        ("stop", "<i8"),  # 1: come back before the next tick
        ("policy", "<i8"),  # `Late`
        ("start", "<i8"),  # monotonic, ns
        ("ticks", "<i8"),  # since start
        ("epoch", "<i8"),  # ns from the rig's time to the time of day
        ("behind", "<i8"),  # 1: the last tick was a stall late
        ("stall", "<i8"),  # ns that the next tick takes longer, as if the machine stood still
        ("mutex", "<i8"),  # address of the mutex
        ("eventfd", "<i8"),  # eventfd that tells of frames
        ("logged", "<i8"),  # latenesses in the log
    ]
)


class Pacing(NamedTuple):
    """How the compiled tick keeps time."""

    record: npt.NDArray[np.void]  #: one `PACING`
    spec: npt.NDArray[np.int64]  #: work space of the clock
    one: npt.NDArray[np.uint64]  #: what is written to the eventfd
    log: npt.NDArray[np.int64]  #: the lateness (ns) of the first ticks, if somebody wants to know them all

    @classmethod
    def virtual(cls, log: int = 0) -> "Pacing":
        """Return a pace without waiting; ``log``: of how many ticks the lateness is kept, once it is real."""
        return cls(
            np.zeros(1, PACING),
            np.zeros(SPEC_WORDS, np.int64),
            np.ones(1, np.uint64),
            np.zeros(log, np.int64),
        )

    @property
    def real(self) -> bool:
        """Whether the tick keeps real time now."""
        return bool(self.record[0]["paced"])

    @property
    def log_is_full(self) -> bool:
        """Whether the lateness of as many ticks is known as were asked for."""
        return int(self.record[0]["logged"]) == self.log.size

    @property
    def stopped(self) -> bool:
        """Whether the tick was told to come back."""
        return bool(self.record[0]["stop"])

    def start(self, epoch: int, mutex: int, eventfd: int, policy: Late) -> None:
        """Begin to keep real time: the next tick is due one period from now.

        ``epoch``: ns from the rig's time to the time of day; ``mutex``: its address; ``eventfd``: written to when
        frames have left.
        """
        record = self.record[0]
        record["start"], record["ticks"] = now(self.spec), 0
        record["epoch"] = epoch
        record["policy"], record["mutex"], record["eventfd"] = policy, mutex, eventfd
        record["paced"] = 1

    def stop(self) -> None:
        """Let the tick come back before it runs again."""
        self.record[0]["stop"] = 1

    def end(self) -> None:
        """Go back to time without waiting; the tick must have come back before."""
        self.record[0]["paced"] = self.record[0]["stop"] = 0

    def wake(self) -> None:
        """Wake who waits for the eventfd, from Python."""
        wake(int(self.record[0]["eventfd"]))

    def dated(self, block: Block) -> Block:
        """Return ``block``, stamped with the rig's time, with the time of day instead."""
        dated = copied(block)
        dated["time"] += self.record[0]["epoch"]
        return dated

    def stall(self, duration: int) -> None:
        """Let the next tick begin ``duration`` ns late, as if the machine stood still."""
        self.record[0]["stall"] = duration


@inlined
def await_tick(pacing: Any) -> int:
    """Sleep until the next tick is due and lock the mutex; return how late that is (ns)."""
    p = pacing.record[0]
    p.ticks += 1
    deadline = p.start + p.ticks * _PERIOD
    stall = p.stall
    p.stall = 0
    sleep_until(deadline + stall, pacing.spec)
    instant = now(pacing.spec)
    late = instant - deadline
    if late > _STALL and p.behind == 0:
        # The machine stood still, and with it the threads that read: commands that came in time lie in the sockets.
        # Without this pause the catching up would count them as missing and trip the watchdog.
        sleep_until(instant + _PAUSE, pacing.spec)
    p.behind = late > _STALL
    lock_mutex(p.mutex)
    return late


@inlined
def put_off(pacing: Any) -> None:
    """Unlock the mutex before the tick has run: the next one that is awaited is this one."""
    p = pacing.record[0]
    p.ticks -= 1
    unlock_mutex(p.mutex)
