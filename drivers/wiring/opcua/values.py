"""Conversion of an OPC UA variable to a point: a number, an element of an array, a text, or no possible value."""

from __future__ import annotations

import asyncio
import math
import struct
from concurrent.futures import CancelledError
from typing import Annotated, Any, Final

import msgspec
from msgspec import Meta

#: Status codes of nodes that never have a value, with the reason as text.
NEVER: Final = {
    "BadNodeIdUnknown": "the server has no such node",
    "BadNodeIdInvalid": "the server has no such node",
    "BadAttributeIdInvalid": "the node is not a variable",
}
#: Python's format of each number type of the server's variables.
LETTERS: Final = {
    "SByte": "b",
    "Byte": "B",
    "Int16": "h",
    "UInt16": "H",
    "Int32": "i",
    "UInt32": "I",
    "Int64": "q",
    "UInt64": "Q",
    "Float": "f",
    "Double": "d",
}


class NodeKeys(msgspec.Struct, forbid_unknown_fields=True, frozen=True):
    """A point that is a variable of the server, or an element of one: number = scale · value + offset."""

    node: str
    index: Annotated[int, Meta(ge=0)] | None = None  #: of the element, from 0, where it is an array
    scale: float = 1.0
    offset: float = 0.0
    subscribe: bool = True

    @property
    def shown(self) -> str:
        """The node and the index as text."""
        return self.node if self.index is None else f"{self.node}, element {self.index}"

    def number(self, raw: Any) -> float:
        """Return the number of the server's value; NaN for a value that is not a number."""
        if self.index is not None:
            raw = raw[self.index] if isinstance(raw, list) and self.index < len(raw) else None
        return self.scale * raw + self.offset if isinstance(raw, int | float) else math.nan

    def raw(self, name: str, value: float, kind: str) -> float | bool:
        """Return the server's number for ``value`` of the point ``name``, whose variable has the type ``kind``. Raises
        ValueError if it does not fit.
        """
        raw = (value - self.offset) / self.scale
        if kind == "Boolean":
            if value not in (0.0, 1.0):
                raise ValueError(f"{name} = {value:g} is not a Boolean; use 0 or 1")
            return bool(value)
        if not math.isfinite(raw):
            raise ValueError(f"{name} = {value:g} is not a number to write; use a finite one")
        letter = LETTERS.get(kind)
        if letter is None:
            raise ValueError(
                f"{name} = {value:g} cannot be written: the node has the type {kind}, which is not a "
                "number; use another node"
            )
        try:
            struct.pack(f"<{letter}", raw if letter in "fd" else round(raw))
        except (struct.error, OverflowError):
            raise ValueError(
                f"{name} = {value:g} does not fit in the server's {kind}; use a number in its range"
            ) from None
        return raw if letter in "fd" else round(raw)

    def never(self, raw: Any) -> str:
        """Return why a server value like ``raw`` can never give a number for this point; "" if it can."""
        if raw is None:  # nothing has come yet
            return ""
        if isinstance(raw, list):
            if self.index is None:
                return (
                    f"the node is an array of {len(raw)}; choose one element with index = 0 to "
                    f"{max(len(raw) - 1, 0)}"
                )
            if self.index >= len(raw):
                return f"the node has {len(raw)} elements; use an index from 0 to {len(raw) - 1}"
            raw = raw[self.index]
        elif self.index is not None:
            return "the node is not an array; remove index"
        if isinstance(raw, int | float) or (isinstance(raw, str) and not self.subscribe):
            return ""
        kind = "a text" if isinstance(raw, str) else f"a {type(raw).__name__}"
        return f"the node is {kind} instead of a number" + (
            "; set subscribe = false to read a text" if isinstance(raw, str) else ""
        )


def error_text(error: BaseException, within: float) -> str:
    """Return an error as text: a status of the server, or why it was not reached ``within`` s."""
    if isinstance(error, TimeoutError | CancelledError | asyncio.CancelledError):
        return f"no answer in {within:g} s"
    if isinstance(error, OSError):
        return error.strerror or "no connection"
    if isinstance(getattr(error, "code", None), int):  # each status is an exception of its name
        return f"the server reports {type(error).__name__}"
    return "the answer is not that of an OPC UA server; check url"
