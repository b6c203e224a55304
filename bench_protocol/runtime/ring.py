"""A ring of CAN frames between the compiled tick and the servers: written by one side, emptied by the other."""

from collections.abc import Callable
from typing import Any, Final, NamedTuple

import numpy as np
import numpy.typing as npt

from bench_protocol.frames import FRAME, Block
from bench_protocol.runtime.binding import cached, inlined
from bench_protocol.runtime.calls import lock_yielding, unlock_yielding

_WRITTEN: Final = 0
_READ: Final = 1
_LOST: Final = 2


class Ring(NamedTuple):
    """A ring buffer of frames and their senders. Both sides lock the mutex, which is almost always free, and also
    orders memory accesses.
    """

    frames: Block
    senders: npt.NDArray[np.int64]
    counts: npt.NDArray[np.int64]  #: frames written, read, and lost: a full ring overwrites the oldest

    @classmethod
    def of(cls, size: int) -> "Ring":
        """Return an empty ring for ``size`` frames."""
        return cls(np.zeros(size, FRAME), np.zeros(size, np.int64), np.zeros(3, np.int64))

    @property
    def lost(self) -> int:
        """Number of frames that were overwritten before they were fetched."""
        return int(self.counts[_LOST])


def _entry(function: Callable[..., Any]) -> Any:
    """Compile ``function`` to be called from Python. It releases the interpreter only while it waits for the mutex."""
    return cached(function)


@inlined
def push(ring: Any, source: Any, first: int, last: int, sender: int) -> None:
    """Write ``source[first:last]`` to the ring; the caller holds the mutex. If the ring is full, the oldest frames are
    lost.
    """
    size = ring.frames.size
    for k in range(first, last):
        if ring.counts[_WRITTEN] - ring.counts[_READ] == size:
            ring.counts[_READ] += 1
            ring.counts[_LOST] += 1
        place = ring.counts[_WRITTEN] % size
        ring.frames[place] = source[k]
        ring.senders[place] = sender
        ring.counts[_WRITTEN] += 1


@_entry
def fill(ring: Any, mutex: int, block: Any, sender: int) -> None:
    """Write all frames of ``block`` to the ring; ``mutex``: address of the mutex."""
    thread = lock_yielding(mutex)
    push(ring, block, 0, block.size, sender)
    unlock_yielding(mutex, thread)


@inlined
def take(ring: Any, out: Any, senders: Any) -> int:
    """Move the oldest frames to ``out``, their senders to ``senders``; return the number. The caller holds the
    mutex.
    """
    size = ring.frames.size
    count = min(ring.counts[_WRITTEN] - ring.counts[_READ], out.size)
    for k in range(count):
        place = (ring.counts[_READ] + k) % size
        out[k] = ring.frames[place]
        senders[k] = ring.senders[place]
    ring.counts[_READ] += count
    return count


@_entry
def drain(ring: Any, mutex: int, out: Any, senders: Any) -> int:
    """Move the oldest frames to ``out``, their senders to ``senders``; return the number. ``mutex``: address of the
    mutex.
    """
    thread = lock_yielding(mutex)
    count = take(ring, out, senders)
    unlock_yielding(mutex, thread)
    return count
