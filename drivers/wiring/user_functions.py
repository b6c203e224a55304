"""The functions of a user's own that a wiring names: one small Python file beside the wiring file."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Sequence
from functools import cache
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from types import ModuleType
from typing import Any

from drivers.errors import WiringError
from drivers.wiring.expression import Combine
from drivers.wiring.keys import meant


def functions_file(where: str, name: str, directory: Path) -> Path | None:
    """Return the file ``name`` in ``directory``, None without a name; WiringError if it is not there."""
    if not name:
        return None
    path = directory / name
    if not path.is_file():
        raise WiringError(f"{where} = {name!r}: there is no such file in {directory}")
    return path


def user_function(where: str, path: Path, name: str, arguments: int) -> Combine:
    """Return the function ``name`` of ``path``, of so many numbers; WiringError, with ``where``, if it is none."""
    function = find_function(where, path, name)
    try:
        inspect.signature(function).bind(*[0.0] * arguments)
    except TypeError as error:
        raise WiringError(
            f"{where} = {name!r}: it is called with {arguments} numbers, one for each point: {error}"
        ) from None

    def combine(values: Sequence[float]) -> float:
        return float(function(*values))

    return combine


def find_function(where: str, path: Path, name: str) -> Callable[..., Any]:
    """Return the function ``name`` of the file ``path``; WiringError, which begins with ``where``."""
    try:
        module = _load(path)
    except Exception as error:  # whatever a user's file does wrong
        raise WiringError(f"{where} = {name!r}: {path.name} cannot be run: {error!r}") from error
    own = [key for key, value in vars(module).items() if inspect.isfunction(value)]
    function = vars(module).get(name)
    if not callable(function):
        raise WiringError(f"{where} = {name!r} is no function of {path.name}; {meant(name, own)}")
    return function


@cache
def _load(path: Path) -> ModuleType:
    spec = spec_from_file_location(f"wiring_functions_{path.stem}", path)
    assert spec is not None and spec.loader is not None, "a .py file"
    module = module_from_spec(spec)
    spec.loader.exec_module(module)
    return module
