"""Extras: optional libraries, the messages if they are missing, and what their use needs."""

from __future__ import annotations

import gc
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from importlib.util import find_spec
from typing import Final, NamedTuple


class Extra(NamedTuple):
    """The purpose of an extra, and its libraries."""

    purpose: str
    libraries: tuple[str, ...]


EXTRAS: Final = {
    "campaign": Extra("campaigns: many runs on all cores or on a cluster", ("dask", "distributed")),
    "excel": Extra("tables for Excel", ("xlsxwriter",)),
    "fmu": Extra("imported FMUs", ("fmpy",)),
    "mcp": Extra("recorded runs for assistants, by the Model Context Protocol", ("mcp",)),
    "mdf": Extra("measured data in MDF 4", ("asammdf",)),
    "mqtt": Extra("readings by MQTT", ("aiomqtt",)),
    "opcua": Extra("rigs behind an OPC UA server, and readings by OPC UA", ("asyncua",)),
}


def installed(extra: str) -> bool:
    """Return whether all libraries of an extra are installed, without importing them."""
    return all(map(_is_installed, EXTRAS[extra].libraries))


def lacking(extra: str, who: str) -> str:
    """Return a sentence with the missing extra of ``who`` (a plural) and the command to install it."""
    libraries = EXTRAS[extra].libraries
    verb = "is" if len(libraries) == 1 else "are"
    return f"{who} need {' and '.join(libraries)}, which {verb} not installed: {install_command(extra)}"


def install_command(extra: str) -> str:
    """Return the command that installs an extra: its libraries by name, as it works for any installation."""
    return " ".join(("pip install", *(f"'{one}'" for one in requirements(extra))))


def requirements(extra: str) -> list[str]:
    """Return the requirements of an extra for pip, without versions if the bench is not an installed package."""
    from importlib import metadata

    from packaging.requirements import Requirement

    try:
        declared = [Requirement(text) for text in metadata.requires("astb") or ()]
    except metadata.PackageNotFoundError:
        declared = []
    versions = {
        one.name: ",".join(sorted(map(str, one.specifier), reverse=True))
        for one in declared
        if one.marker and one.marker.evaluate({"extra": extra})
    }
    return [name + versions.get(name, "") for name in EXTRAS[extra].libraries]


def _is_installed(library: str) -> bool:
    try:
        return find_spec(library) is not None
    except ValueError:  # None marks a module as missing
        return False


@contextmanager
def no_destructor_errors() -> Iterator[None]:
    """Suppress the output of errors that destructors raise inside the block."""
    hook = sys.unraisablehook
    sys.unraisablehook = lambda _: None
    try:
        yield
    finally:
        gc.collect()
        sys.unraisablehook = hook
