"""The test plans by name, found where they are declared: in `plans`, in packages, and in a folder of one's own."""

import os
import sys
from collections.abc import Iterable, Iterator
from functools import cache
from importlib import import_module
from importlib.metadata import entry_points
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from pkgutil import iter_modules
from traceback import extract_tb
from types import ModuleType
from typing import Final

import test_plans.plans as inside
from test_plans.plan import Plan
from test_plans.run import PlanError

#: Entry points of this group name a module with plans outside this package: ``ours = "our_plans.creep"``.
GROUP: Final = "astb.plans"
#: What names a folder with plans of one's own, every file in it.
FOLDER: Final = "ASTB_PLANS"


@cache
def plans() -> dict[str, Plan]:
    """Return all plans by name, in the order of their names.

    PlanError if a file cannot be imported, or if two plans have one name.
    """
    return by_name(_modules())


def by_name(modules: Iterable[ModuleType]) -> dict[str, Plan]:
    """Return the plans that ``modules`` declare. PlanError if two have one name; it says where both stand."""
    found: dict[str, tuple[Plan, str]] = {}
    for module in modules:
        for plan in declared(module):
            other, where = found.setdefault(plan.name, (plan, module.__name__))
            if other is not plan:
                raise PlanError(
                    f"two plans are named {plan.name}, in {where} and in {module.__name__}: rename one"
                )
    return {name: found[name][0] for name in sorted(found)}


def in_file(path: Path) -> dict[str, Plan]:
    """Return the plans that the Python file ``path`` declares, by name.

    PlanError, with file and line, if it cannot be read or run, or declares none.
    """
    module = _module_of(path)
    found = {one.name: one for one in declared(module) if one.main.__module__ == module.__name__}
    if not found:
        raise PlanError(f"{path} declares no plan: a function with @plan above it would be one")
    return found


def declared(module: ModuleType) -> Iterator[Plan]:
    """Yield the plans that stand at the top of ``module``, on their own or in a tuple."""
    for value in vars(module).values():
        for one in value if isinstance(value, tuple) else (value,):
            if isinstance(one, Plan):
                yield one


def _modules() -> Iterator[ModuleType]:
    names = [f"{inside.__name__}.{module.name}" for module in iter_modules(inside.__path__)]
    for name in (*names, *(entry.module for entry in entry_points(group=GROUP))):
        try:
            yield import_module(name)
        except Exception as error:
            raise PlanError(f"{name} cannot be imported: {type(error).__name__}: {error}") from error
    if folder := os.environ.get(FOLDER):
        if not Path(folder).is_dir():
            raise PlanError(f"{FOLDER} = {folder} is no folder; one with plans of your own would be right")
        yield from map(_module_of, sorted(Path(folder).glob("*.py")))


def _module_of(path: Path) -> ModuleType:
    """Return what a Python file that belongs to no package declares; it is run once."""
    name = f"own_plans.{path.resolve()}"
    if name in sys.modules:
        return sys.modules[name]
    if not path.is_file():
        raise PlanError(f"{path} is no file; `astb plans new {path.stem}` writes one to begin with")
    spec = spec_from_file_location(name, path)
    assert spec and spec.loader, path
    module = sys.modules[name] = module_from_spec(spec)
    try:
        spec.loader.exec_module(module)
    except Exception as error:
        del sys.modules[name]
        line = next((at for file, at in _places(error) if file == str(path)), None)
        where = f"{path}, line {line}" if line else path
        raise PlanError(f"{where}: {type(error).__name__}: {getattr(error, 'msg', error)}") from error
    return module


def _places(error: BaseException) -> Iterator[tuple[str, int | None]]:
    """Yield the files and lines that an error came through, the last first."""
    if isinstance(error, SyntaxError) and error.filename:
        yield error.filename, error.lineno
    for frame in reversed(extract_tb(error.__traceback__)):
        yield frame.filename, frame.lineno
