"""A user's own simulator, named as ``package.module:factory``, as a system for mapped files."""

from __future__ import annotations

import importlib
import sys
from collections.abc import Mapping
from pathlib import Path
from traceback import extract_tb
from typing import Final, Protocol, runtime_checkable

from bench_protocol.suggestion import did_you_mean
from diagnosis.contracts import DiagnosisError, Simulator
from diagnosis.systems.system import System, SystemSignal


@runtime_checkable
class DrivenSimulator(Simulator, Protocol):
    """A simulator that declares its inputs, with their SI units."""

    @property
    def inputs(self) -> Mapping[str, str]: ...


#: Attributes of such a simulator.
_ATTRIBUTES: Final = ("name", "channels", "nuisances", "catalogue", "surfaces", "run", "inputs")
_RIGHT: Final = 'write it as "my_oscillator:Oscillator", for a class in the file my_oscillator.py'


def load_system(name: str, folder: Path) -> System:
    """Return the system that the factory ``name`` makes. Its module may be in ``folder``, which is added to the import
    path.

    The factory is a class or function without arguments. It returns a `System`, or a simulator with ``inputs``.
    Pressures of such a simulator are gauge pressures, and its settings are its own. Inputs in its optional ``held``
    keep their values between samples. Raises DiagnosisError that states what is missing.
    """
    module_name, _, attribute = name.partition(":")
    if not module_name or not attribute:
        raise DiagnosisError(f'simulator "{name}" does not name a class or function of a module; {_RIGHT}')
    place = str(folder.resolve())
    if place not in sys.path:
        sys.path.insert(0, place)
    try:
        module = importlib.import_module(module_name)
    except ModuleNotFoundError as error:
        if error.name is None or not f"{module_name}.".startswith(f"{error.name}."):
            raise DiagnosisError(
                f'simulator "{name}": {module_name} needs {error.name}: {error}; install {error.name}'
            ) from error
        raise DiagnosisError(
            f'simulator "{name}": there is no module {error.name} in {folder.resolve()} or among the installed '
            f"packages; {_RIGHT}"
        ) from None
    except Exception as error:  # it may be anybody's code
        raise _failed(name, error) from error
    factory = getattr(module, attribute, None)
    if not callable(factory):
        public = [one for one in vars(module) if not one.startswith("_")]
        raise DiagnosisError(
            f'simulator "{name}": {module_name} has no class or function {attribute}; '
            + did_you_mean(attribute, public)
        )
    try:
        made = factory()
    except DiagnosisError:
        raise
    except Exception as error:  # it may be anybody's code
        raise _failed(name, error) from error
    return made if isinstance(made, System) else _system(name, made)


def _failed(name: str, error: Exception) -> DiagnosisError:
    place = extract_tb(error.__traceback__)[-1]
    where = f"{Path(place.filename).name}, line {place.lineno}"
    return DiagnosisError(
        f'simulator "{name}" cannot be made: {type(error).__name__}: {error}; correct {where}'
    )


def _system(name: str, made: object) -> System:
    missing = [one for one in _ATTRIBUTES if not hasattr(made, one)]
    if missing or not isinstance(made, DrivenSimulator):
        raise DiagnosisError(
            f'simulator "{name}" returned a {type(made).__name__} without {", ".join(missing)}; return a System, or a '
            "simulator with inputs = {name: unit}"
        )
    if not made.channels:
        raise DiagnosisError(f'simulator "{name}" has no channels; give at least one')
    simulator: Simulator = made
    held = frozenset(getattr(made, "held", ()))
    if unknown := sorted(held - set(made.inputs)):
        raise DiagnosisError(
            f'simulator "{name}": held has {", ".join(unknown)}, but only inputs can be held: '
            + ", ".join(made.inputs)
        )
    return System(
        name=made.name,
        title=made.name,
        inputs=tuple(
            SystemSignal(one, unit, one, gauge=unit == "Pa", held=one in held)
            for one, unit in made.inputs.items()
        ),
        outputs=tuple(
            SystemSignal(one.name, one.unit, one.name, False, one.unit == "Pa", one.display, one.scale)
            for one in made.channels
        ),
        settings=(),
        simulator=lambda settings, channels: simulator,
    )
