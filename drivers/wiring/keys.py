"""Keys of a wiring's description, with errors that name the wrong key and a valid value."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any, Final, Self, TypeVar, get_args

import msgspec

from bench_protocol.misfit import misfit
from bench_protocol.suggestion import did_you_mean
from bench_protocol.units import UNITS
from drivers.errors import WiringError

T = TypeVar("T", bound=msgspec.Struct)
#: Separator of the errors of several lines.
LINE_BREAK: Final = "\n  "
_DURATION: Final = re.compile(r"([0-9.eE+-]+) *(min|[num]?s|h)")


class AliveKeys(msgspec.Struct, forbid_unknown_fields=True, frozen=True):
    """A heartbeat point: the rig expects it to count up, or a bit of it to toggle."""

    point: str
    every: str


class SeveralWrong(WiringError):
    """Errors of several lines, in one exception."""

    def __init__(self, lines: Sequence[str]) -> None:
        super().__init__(f"{LINE_BREAK.join(lines)}{LINE_BREAK}({len(lines)} lines are wrong)")
        self.lines = list(lines)


class AllAtOnce:
    """Collects the errors of many lines, so that all are reported in one run::

    with AllAtOnce() as wrong:
        for line in lines:
            with wrong.next():
                read(line)
    """

    def __init__(self) -> None:
        self._errors: list[str] = []

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        if kind is None and self._errors:
            raise (
                SeveralWrong(self._errors) if len(self._errors) > 1 else WiringError(self._errors[0])
            ) from None

    @contextmanager
    def next(self, where: str = "") -> Iterator[None]:
        """Collect a WiringError that is raised inside the block, with ``where`` before its text."""
        try:
            yield
        except WiringError as error:
            lines = error.lines if isinstance(error, SeveralWrong) else [str(error)]
            self._errors += [f"{where}{line}" for line in lines]


def duration(where: str, text: object) -> float:
    """Return a time like ``"100 ms"`` in s (positive). Raises WiringError, which begins with ``where``, if invalid."""
    found = _DURATION.fullmatch(text.strip()) if isinstance(text, str) else None
    try:
        value = float(found[1]) * UNITS[found[2]].factor if found else 0.0
    except ValueError:
        value = 0.0
    if not 0.0 < value < float("inf"):
        raise WiringError(
            f'{where} = {text!r} is not a time above 0 with its unit; write it like "100 ms" or "2 s"'
        )
    return value


def convert(where: str, table: object, kind: type[T]) -> T:
    """Return ``table`` as a struct ``kind``. Raises WiringError, which begins with ``where``, if it does not fit."""
    if not isinstance(table, Mapping):
        raise WiringError(f"{where} = {table!r} is not a table; write its keys and values in {{ }}")
    fields = {field.encode_name: field.type for field in msgspec.structs.fields(kind)}
    for key in table:
        if key not in fields:
            raise WiringError(f"{where}: there is no key {key!r} here; {did_you_mean(str(key), fields)}")
    try:
        return msgspec.convert(table, kind)
    except msgspec.ValidationError as error:
        _, _, place = str(error).partition(" - at `$.")
        keys = re.findall(r"\w+", place)
        value: Any = table
        for key in keys:
            value = value[key] if isinstance(value, Mapping) and key in value else value
        name = ".".join(keys)
        words = _words(fields.get(name))
        if words and isinstance(value, str):
            raise WiringError(
                f"{where}: {name} = {value!r} is unknown; {did_you_mean(value, words)}"
            ) from None
        raise WiringError(f"{where}: {misfit(error, table, kind)}") from None


def _words(hint: Any) -> list[str]:
    """Return the permitted words of a key, from a ``Literal`` anywhere in its type."""
    return [word for part in get_args(hint) for word in ([part] if isinstance(part, str) else _words(part))]
