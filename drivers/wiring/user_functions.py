"""Functions of the user that a wiring names: one Python file next to the wiring file."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Sequence
from functools import cache
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from types import ModuleType
from typing import Any

from bench_protocol.suggestion import did_you_mean
from drivers.errors import WiringError
from drivers.wiring.expression import Combine


def functions_file(where: str, name: str, directory: Path) -> Path | None:
    """Return the file ``name`` in ``directory``, None without a name. Raises WiringError if it is missing."""
    if not name:
        return None
    path = directory / name
    if not path.is_file():
        raise WiringError(f"{where} = {name!r}: there is no such file in {directory}; correct the name")
    return path


def user_function(where: str, path: Path, name: str, arguments: int) -> Combine:
    """Return the function ``name`` of ``path`` with ``arguments`` arguments. Raises WiringError if there is none."""
    function = find_function(where, path, name)
    try:
        inspect.signature(function).bind(*[0.0] * arguments)
    except TypeError as error:
        raise WiringError(
            f"{where} = {name!r}: it must accept {arguments} numbers, one for each point ({error}); correct it"
        ) from None

    def combine(values: Sequence[float]) -> float:
        return float(function(*values))

    return combine


def find_function(where: str, path: Path, name: str) -> Callable[..., Any]:
    """Return the function ``name`` of the file ``path``. Raises WiringError, which begins with ``where``, if it is
    missing.
    """
    own = _functions_in(_load(f"{where} = {name!r}", path))
    if name not in own:
        raise WiringError(f"{where} = {name!r} is not a function of {path.name}; {did_you_mean(name, own)}")
    return own[name]


def _functions_in(module: ModuleType) -> dict[str, Callable[..., Any]]:
    return {name: one for name, one in vars(module).items() if inspect.isfunction(one)}


def _load(where: str, path: Path) -> ModuleType:
    try:
        return _module(path, path.stat().st_mtime_ns)
    except Exception as error:  # a user's file may raise any error
        raise WiringError(f"{where}: {path.name} cannot be run: {error!r}; correct the file") from error


@cache
def _module(path: Path, changed: int) -> ModuleType:
    """Return the module of ``path``; ``changed`` (ns) distinguishes versions of the file."""
    del changed
    spec = spec_from_file_location(f"wiring_functions_{path.stem}", path)
    assert spec is not None and spec.loader is not None, "a .py file"
    module = module_from_spec(spec)
    spec.loader.exec_module(module)
    return module
