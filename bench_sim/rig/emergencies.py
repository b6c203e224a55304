"""Errors of the bench. Each new error, and the end of all errors, sends one emergency message (CiA 301)."""

from collections import deque
from collections.abc import Callable
from typing import Final

import numpy as np
import numpy.typing as npt

from bench_protocol.object_dictionary import ERRORS_KEPT
from bench_protocol.table import TABLE
from bench_protocol.words import Reason
from bench_sim.rig.states import EMERGENCY_CODES

# The bits of the error register.
_GENERIC: Final = 0x01
_COMMUNICATION: Final = 0x10
_MANUFACTURER: Final = 0x80
#: Codes from here to 81FFh are of the communication.
_COMMUNICATION_CODES: Final = range(0x8100, 0x8200)


class Emergencies:
    """The active errors and the history of errors.

    Reasons with the same code are one error. For example, a late, a lost and a disconnected commander have the same
    code. The object writes the signals of the emergency to ``values`` (SI, by table row), and calls ``on_message`` to
    send them.
    """

    def __init__(self, values: npt.NDArray[np.float64], on_message: Callable[[], None]) -> None:
        self._values, self._on_message = values, on_message
        self._active: list[tuple[int, int]] = []  # code and tripped
        #: The codes of the last errors, the latest first; above them the reason, and 24 bits up what tripped.
        self.history: deque[int] = deque(maxlen=ERRORS_KEPT)

    @property
    def register(self) -> int:
        """Return the CANopen error register."""
        register = 0
        for code, _ in self._active:
            register |= _GENERIC | (_COMMUNICATION if code in _COMMUNICATION_CODES else _MANUFACTURER)
        return register

    def report(self, reason: Reason, tripped: int = 0) -> None:
        """Send an error, unless it is already active. ``tripped`` is the number of the reading that exceeded its limit,
        as in ``rig.tripped``.
        """
        code = EMERGENCY_CODES[reason]
        if (code, tripped) in self._active:
            return
        self._active.append((code, tripped))
        self.history.appendleft(code | reason << 16 | tripped << 24)
        self._publish(reason)

    def settle(self, reason: Reason) -> None:
        """Mark the error of ``reason`` as ended. The end of the last active error is sent."""
        error = EMERGENCY_CODES[reason], 0
        if error in self._active:
            self._active.remove(error)
            if not self._active:
                self._publish(Reason.NONE)

    def clear(self) -> None:
        """Mark all errors as ended, and send their end."""
        if self._active:
            self._active.clear()
            self._publish(Reason.NONE)

    def _publish(self, reason: Reason) -> None:
        published = (EMERGENCY_CODES[reason], self.register, reason)
        for part, value in zip(("code", "register", "reason"), published, strict=True):
            self._values[TABLE.index[f"emergency.{part}"]] = value
        self._on_message()
