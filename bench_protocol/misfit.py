"""Error texts for content that violates its schema: the key, its value and a valid value."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from copy import deepcopy
from types import UnionType
from typing import Annotated, Any, Final, Literal, TypeVar, Union, get_args, get_origin

import msgspec

from bench_protocol.suggestion import did_you_mean

_KINDS: Final = {
    "int": "a whole number",
    "float": "a number",
    "str": "a text",
    "bool": "true or false",
    "array": "a list",
    "object": "a table of keys",
}
T = TypeVar("T")
#: Number of errors that are reported at once.
_MOST: Final = 50
_STEP: Final = re.compile(r"\.([^.\[\]]+)|\[(\d+)\]|\[(\.\.\.)\]")


class Misfits(ValueError):
    """All errors of a content, as ``texts``."""

    def __init__(self, texts: Sequence[str]) -> None:
        super().__init__("\n".join(texts))
        self.texts = tuple(texts)


def converted(content: Any, kind: type[T]) -> T:
    """Convert tables to a ``kind``, as `msgspec.convert` does. Raises `Misfits` with all errors at once.

    msgspec reports one error at a time. The wrong key is therefore removed, and the conversion repeated.
    """
    left, texts, reported = deepcopy(content), list[str](), set[str]()
    for _ in range(_MOST):
        try:
            found = msgspec.convert(left, kind)
        except msgspec.ValidationError as error:
            message, _, place = str(error).partition(" - at `$")
            field = re.fullmatch("Object (contains unknown|missing required) field `(.*)`", message)
            way = [key for key, _, _ in _steps(place, left, kind)] + ([field[2]] if field else [])
            if ".".join(way) not in reported:
                texts.append(misfit(error, left, kind))
            if field and field[1] == "missing required":
                way.pop()
            reported.add(".".join(way))
            if not _removed(left, way):
                break
        else:
            if texts:
                break
            return found
    raise Misfits(texts)


def _removed(content: Any, way: Sequence[str]) -> bool:
    """Remove a key and its value from nested tables; return whether that was possible.

    Items of lists are not removed, because the other items would get other numbers.
    """
    for key in way[:-1]:
        content = content.get(key) if isinstance(content, dict) else None
    if not way or not isinstance(content, dict) or way[-1] not in content:
        return False
    del content[way[-1]]
    return True


def misfit(error: Exception, content: object, kind: Any) -> str:
    """Return the error of msgspec for ``content``, which should be a ``kind``, as a plain text."""
    message, _, place = str(error).partition(" - at `$")
    steps, name = _steps(place, content, kind), ""
    for key, _, _ in steps:
        name += key if key.startswith("[") or not name else f".{key}"
    _, value, form = steps[-1] if steps else ("", content, kind)
    form = _bare(form, value)
    if found := re.fullmatch("Object (contains unknown|missing required) field `(.*)`", message):
        whole = f"{name}.{found[2]}" if name else found[2]
        if found[1] == "missing required":
            return f"the key {whole} is missing; add it"
        return f"{whole} is not a key here; {did_you_mean(found[2], _fields(form))}"
    if found := re.match(r"(?:Expected|Invalid) ", message):
        return f"{name} = {value!r}; use {_right(message, form)}" if name else f"use {_right(message, form)}"
    return f"{name}: {message}" if name and name not in message else message  # a sentence of our own schema


def _steps(place: str, content: Any, kind: Any) -> list[tuple[str, Any, Any]]:
    """Return the path to a place: at each step the key, its value, and the expected type."""
    steps: list[tuple[str, Any, Any]] = []
    value, form = content, kind
    for step in _STEP.finditer(place.removesuffix("`")):
        key, value, form = _within(step, value, _bare(form, value))
        steps.append((key, value, form))
    return steps


def _within(step: re.Match[str], value: Any, form: Any) -> tuple[str, Any, Any]:
    """Return one step of a path: the key, its value, and the expected type."""
    if step[1]:
        inner = value.get(step[1]) if isinstance(value, Mapping) else None
        return step[1], inner, _fields(form).get(step[1])
    of = next((one for one in reversed(get_args(form)) if one is not ...), None)
    if step[2]:
        return f"[{step[2]}]", value[int(step[2])], of
    for key, one in value.items():  # msgspec does not report which of several values is wrong
        try:
            msgspec.convert(one, of)
        except (msgspec.ValidationError, ValueError):
            return str(key), one, of
    return "…", None, of


def _bare(form: Any, value: Any) -> Any:
    """Return the expected type without annotations; for a union, the member of the same kind as ``value``."""
    while get_origin(form) is Annotated:
        form = get_args(form)[0]
    if get_origin(form) in (Union, UnionType):
        members = [one for one in (_bare(one, value) for one in get_args(form)) if one is not type(None)]
        tables = [one for one in members if bool(_fields(one)) == isinstance(value, Mapping)]
        return (tables or members)[0] if len(tables or members) == 1 else form
    return form


def _fields(form: Any) -> dict[str, Any]:
    struct = isinstance(form, type) and issubclass(form, msgspec.Struct)
    return {field.encode_name: field.type for field in msgspec.structs.fields(form)} if struct else {}


def _right(message: str, form: Any) -> str:
    words = _literals(form)
    if words:
        return " or ".join(words)
    found = re.match(r"Expected `(.*?)`([^,]*)", message)
    if found is None:
        return "a number" if "number" in message else "another value"
    kinds = [one for one in found[1].split(" | ") if one != "null"]
    if "float" in kinds:
        kinds = [one for one in kinds if one != "int"]
    return " or ".join(_KINDS.get(one, one) for one in kinds) + found[2].replace("`", "")


def _literals(form: Any) -> list[str]:
    if get_origin(form) is Literal:
        return [f'"{one}"' if isinstance(one, str) else str(one) for one in get_args(form)]
    return [
        word for one in get_args(form) if get_origin(form) in (Union, UnionType) for word in _literals(one)
    ]
