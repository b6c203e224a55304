"""Decoding of the frames of a message that a DBC describes, and reasons for missing values."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

from cantools import Error
from cantools.database.can import Message

from bench_protocol import j1939
from bench_protocol.account import Account
from bench_protocol.dbc import Described
from bench_protocol.no_value import no_value_codes

if TYPE_CHECKING:
    from cantools.database.can import Message as Coding
    from cantools.database.can import Signal


class Decoding:
    """Decodes the frames of one message. Missing parts of a frame are counted in the given account."""

    def __init__(self, message: Described) -> None:
        self.message = message
        self.signals = {signal.name: signal for signal in message.coding.signals}
        # cantools decodes signals that share bits wrongly, so each of them is decoded alone.
        self._parts = list(_single_signal_codings(message.coding)) if message.unsound else [message.coding]
        #: The raw values of each signal that the DBC names as no value, with their names; may be changed.
        self.no_value = {name: codes for name, one in self.signals.items() if (codes := no_value_codes(one))}
        found = {signal.name for part in self._parts for signal in part.signals}
        #: Signals that the DBC places outside of their message: no frame has them.
        self.outside = [name for name in self.signals if name not in found]
        self._errors = (Error, ValueError, OverflowError)

    def values(self, data: bytes, account: Account) -> Iterator[tuple[str, float]]:
        """Yield the signals in a frame by name, in the unit of the DBC; NaN for codes without a value."""
        name = self.message.name
        raw = self.message.j1939 or bool(self.no_value)
        if len(data) < self.message.coding.length:
            account.leave_out(
                f"frame(s) of {name} shorter than its {self.message.coding.length} bytes in part"
            )
        reported = set()
        for part in self._parts:
            try:
                found: Any = part.decode(data, decode_choices=False, scaling=not raw, allow_truncated=True)
            except self._errors:  # a page that the DBC does not know
                account.leave_out(f"frame(s) of {name} with a page that the DBC does not have")
                continue
            for signal, value in found.items():
                if signal in reported:
                    continue  # the selector of several pages
                reported.add(signal)
                yield signal, self._checked(signal, value, account) if raw else float(value)

    def _checked(self, name: str, raw: float, account: Account) -> float:
        signal = self.signals[name]
        text = self.no_value.get(name, {}).get(raw)  # type: ignore[call-overload]
        if text is not None:
            account.leave_out(f"value(s) of {self.message.name}.{name} that the DBC names {text!r}")
            return math.nan
        if self.message.j1939 and not signal.conversion.is_float:
            code = j1939.missing(int(raw) & (1 << signal.length) - 1, signal.length)
            if code:
                account.leave_out("J1939 value(s) " + ("in error" if code == "error" else f"that are {code}"))
                return math.nan
        return float(signal.conversion.raw_to_scaled(raw, decode_choices=False))  # type: ignore[arg-type]


def _single_signal_codings(coding: Coding) -> Iterator[Coding]:
    """Yield, for each signal that fits into a message, a message with nothing else."""
    for signal in coding.signals:
        selectors: list[Signal] = []
        name = signal.multiplexer_signal
        while name is not None and len(selectors) < len(coding.signals):
            selectors.append(next(one for one in coding.signals if one.name == name))
            name = selectors[-1].multiplexer_signal
        try:
            yield Message(
                coding.frame_id,
                coding.name,
                coding.length,
                [signal, *selectors],
                is_extended_frame=coding.is_extended_frame,
                strict=True,
            )
        except Error:  # it does not fit, and no frame has it
            continue
