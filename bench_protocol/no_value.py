"""Raw values of a signal that are not measurements according to their names in a DBC: "SNA", "Fehler", end of a
scale.
"""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from cantools.database.can import Signal

#: Names that mean "no value" for any signal, also for a state.
_NO_VALUE: Final = re.compile(
    r"\b(sna|not avail\w*|n a|na|nv|unavailable|no (value|data|signal)|not (valid|defined)|invalid|undefined|"
    r"(nicht|un) ?(verf(ü|ue)gbar|g(ü|ue)ltig|definiert|vorhanden)|ung(ü|ue)ltig|kein(e)? (wert|daten|signal))\b"
)
#: Names that mean "no value" for a number. For a state, such a name is one of its states.
_ERROR: Final = re.compile(
    r"\b(err|errors?|faults?|failures?|failed|defect\w*|fehler\w*|defekt\w*|implausib\w*|unplausib\w*|neutralwert|"
    r"neutral value|init\w*|out of range|overrange|underrange|(short|open) circuit|kurzschluss|unterbrechung)\b"
)
_NONE: Final = re.compile(r"\b(no|not|kein(e|er)?|ohne|without|free)\b|fehlerfrei")
#: The end of a scale is this part of its codes: one sixteenth.
_END: Final = 16
#: A signal without a unit counts as a number only with at least this many bits.
_NUMBER_BITS: Final = 8


def no_value_codes(signal: Signal) -> dict[int, str]:
    """Return the raw values of ``signal`` that mean "no value", each with its name in the DBC.

    The names decide, such as "SNA". For a number, a named value also means "no value" if its name is that of an error,
    if it is beyond the range of the signal, or if it is near an end of the raw range (such as 0xFF).

    A signal is a number if it has a unit, scale or offset, and more than 2 bits; or if it has at least 8 bits, and all
    its named values are of these kinds.
    """
    if signal.conversion.is_float or not signal.choices:
        return {}
    named = {int(code): str(text) for code, text in signal.choices.items()}
    found = {code: text for code, text in named.items() if _NO_VALUE.search(_plain(text))}
    special = {code for code, text in named.items() if code in found or _is_special(signal, code, text)}
    scaled = bool(signal.unit) or signal.scale != 1 or signal.offset != 0
    number = signal.length > 2 if scaled else signal.length >= _NUMBER_BITS and len(special) == len(named)
    return {code: text for code, text in named.items() if code in (special if number else found)}


def _is_special(signal: Signal, code: int, text: str) -> bool:
    plain = _plain(text)
    if _ERROR.search(plain) and not _NONE.search(plain):
        return True
    value = signal.scale * code + signal.offset
    low, high = signal.minimum, signal.maximum
    if (low is not None and value < low) or (high is not None and value > high):
        return True
    span = 1 << signal.length
    first = -(span >> 1) if signal.is_signed else 0
    above, below = first + span - 1 - code, code - first
    return _END * above < span or (signal.is_signed and _END * below < span)


def _plain(text: str) -> str:
    """Return a name as lower-case words: signal not available, for SignalNotAvailable or SIGNAL_NOT_AVAILABLE."""
    words = re.sub(r"(?<=[a-zäöü])(?=[A-ZÄÖÜ])", " ", text)
    return " ".join(re.sub(r"[\W_]+", " ", words.lower()).split())
