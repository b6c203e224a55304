"""Search for the test plans by name: in `test_plans.plans`, in installed packages, and in a folder of the user.

A file that cannot be used affects only its own plans; `unusable` lists such files with the reasons.
"""

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
from typing import Final, NamedTuple

import test_plans.plans as inside
from bench_protocol.suggestion import did_you_mean
from test_plans.plan import Plan
from test_plans.run import PlanError

#: Entry points of this group name a module with plans outside this package: ``ours = "our_plans.creep"``.
GROUP: Final = "astb.plans"
#: The environment variable that names a folder with custom plans; every file in it is a plan.
FOLDER: Final = "ASTB_PLANS"
_OWN: Final = "own_plans."


class Found(NamedTuple):
    """The result of a search for plans."""

    plans: dict[str, Plan]  #: by name, in the order of their names
    unusable: list[str]  #: files, modules and plans that cannot be used, each with place and reason


def plans() -> dict[str, Plan]:
    """Return all plans by name, in the order of their names."""
    return find_all().plans


def unusable() -> list[str]:
    """Return a text for each file, module or plan that cannot be used, with place and reason."""
    return find_all().unusable


def unknown(name: str, otherwise: str = "") -> str:
    """Return a message that there is no plan ``name``. It lists similar names (`did_you_mean`) and unusable plans."""
    return "; ".join([f"there is no plan {name!r}", did_you_mean(name, plans(), otherwise), *unusable()])


@cache
def find_all() -> Found:
    """Search all places for plans, and return the result. It is cached."""
    wrong: list[str] = []
    found = by_name(_modules(wrong))
    return Found(found.plans, wrong + found.unusable)


def by_name(modules: Iterable[ModuleType]) -> Found:
    """Return the plans that ``modules`` declare. If two plans have the same name, the first is used and the other is
    reported.
    """
    found: dict[str, tuple[Plan, str]] = {}
    wrong = []
    for module in modules:
        for plan in declared(module):
            other, where = found.setdefault(plan.name, (plan, _short_name(module)))
            if other is not plan:
                wrong.append(
                    f"{_short_name(module)}: there is a plan {plan.name} already, in {where}; rename one of them"
                )
    return Found({name: found[name][0] for name in sorted(found)}, wrong)


def _short_name(module: ModuleType) -> str:
    return module.__name__.removeprefix(_OWN)


def in_file(path: Path) -> dict[str, Plan]:
    """Return the plans that the Python file ``path`` declares, by name.

    Raises PlanError, with file and line, if the file cannot be read or run, or declares no plan.
    """
    module = _module_of(path)
    found = {one.name: one for one in declared(module) if one.main.__module__ == module.__name__}
    if not found:
        raise PlanError(f"{path} declares no plan; add a function with @plan above it")
    return found


def declared(module: ModuleType) -> Iterator[Plan]:
    """Yield the plans at the top level of ``module``. A variable there may hold a plan or a tuple of plans."""
    for value in vars(module).values():
        for one in value if isinstance(value, tuple) else (value,):
            if isinstance(one, Plan):
                yield one


def _modules(wrong: list[str]) -> Iterator[ModuleType]:
    """Yield all modules with plans. For each module that cannot be imported, append the reason to ``wrong``."""
    names = [f"{inside.__name__}.{module.name}" for module in iter_modules(inside.__path__)]
    for name in (*names, *(entry.module for entry in entry_points(group=GROUP))):
        try:
            yield import_module(name)
        except (Exception, SystemExit) as error:
            wrong.append(f"{name} cannot be imported: {type(error).__name__}: {error}; repair or remove it")
    if folder := os.environ.get(FOLDER):
        if not Path(folder).is_dir():
            wrong.append(f"{FOLDER} = {folder} is no folder; name the folder of your plans")
        for path in sorted(Path(folder).glob("*.py")):
            try:
                yield _module_of(path)
            except PlanError as error:
                wrong.append(str(error))


def _module_of(path: Path) -> ModuleType:
    """Return the module of a Python file that belongs to no package. The file is run only once. Raises PlanError if
    there is no such file, or if it cannot be run.
    """
    name = f"{_OWN}{path.resolve()}"
    if name in sys.modules:
        return sys.modules[name]
    if not path.is_file():
        raise PlanError(f"{path} is not a file; `astb plans new {path.stem}` writes a new one")
    spec = spec_from_file_location(name, path)
    assert spec and spec.loader, path
    module = sys.modules[name] = module_from_spec(spec)
    try:
        spec.loader.exec_module(module)
    except (Exception, SystemExit) as error:
        del sys.modules[name]
        line = next((at for file, at in _places(error) if file == str(path)), None)
        where = f"{path}, line {line}" if line else path
        raise PlanError(
            f"{where}: {type(error).__name__}: {getattr(error, 'msg', error)}; correct the file"
        ) from error
    return module


def _places(error: BaseException) -> Iterator[tuple[str, int | None]]:
    """Yield the files and lines of an error's traceback, innermost first."""
    if isinstance(error, SyntaxError) and error.filename:
        yield error.filename, error.lineno
    for frame in reversed(extract_tb(error.__traceback__)):
        yield frame.filename, frame.lineno
