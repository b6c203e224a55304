"""A wire: the socket of a CAN port, for writing frames without the interpreter."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from bench_protocol.runtime.mutex import Mutex


@dataclass(frozen=True, slots=True, eq=False)
class Wire:
    """A socket to which compiled code may write frames; other writers lock ``mutex`` first.

    ``descriptor`` (1,) is -1 once writing is forbidden. ``lines``: frames are sent as lines of the socketcand protocol,
    else as the kernel's struct can_frame, one frame per write.
    """

    descriptor: npt.NDArray[np.int64]
    mutex: Mutex
    lines: bool

    @classmethod
    def on(cls, descriptor: int, *, lines: bool) -> Wire:
        """Return the wire that writes to the socket with this file ``descriptor``: ``lines`` of socketcand, else struct
        can_frame.
        """
        return cls(np.array([descriptor], np.int64), Mutex(), lines)

    @property
    def usable(self) -> bool:
        """Whether writing is permitted."""
        return bool(self.descriptor[0] >= 0)

    def cut(self) -> None:
        """Forbid writing, because the socket is about to be closed or an incomplete line was sent."""
        with self.mutex:
            self.descriptor[0] = -1
