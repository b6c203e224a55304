"""A wire: the socket behind a CAN port, for what writes frames without the interpreter."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from bench_protocol.runtime.mutex import Mutex


@dataclass(frozen=True, slots=True, eq=False)
class Wire:
    """A socket to which compiled code may write frames; whoever else writes there locks ``mutex`` first.

    ``descriptor`` (1,) is -1 once nothing may be written any more; ``lines``: frames travel as lines of the socketcand
    protocol, else as the kernel's struct can_frame, one a message.
    """

    descriptor: npt.NDArray[np.int64]
    mutex: Mutex
    lines: bool

    @classmethod
    def on(cls, descriptor: int, *, lines: bool) -> Wire:
        """Return the wire behind a socket's ``descriptor``."""
        return cls(np.array([descriptor], np.int64), Mutex(), lines)

    @property
    def usable(self) -> bool:
        """Whether it has not been cut."""
        return bool(self.descriptor[0] >= 0)

    def cut(self) -> None:
        """Let nothing be written any more: the socket is about to be closed, or half a line is out."""
        with self.mutex:
            self.descriptor[0] = -1
