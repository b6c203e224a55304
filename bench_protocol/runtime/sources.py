"""The sources of a compiled function: its module, and all own modules that this one imports."""

import hashlib
from functools import cache
from importlib.machinery import SourceFileLoader
from importlib.util import find_spec
from types import CodeType
from typing import Any, Final

from bench_protocol.rates import TICK_RATE

#: Packages whose modules can be part of a compiled function.
PACKAGES: Final = frozenset({"astb", "bench_protocol", "bench_sim", "drivers"})
#: Flags of a code object (`inspect`): it is a function; it has a docstring (Python 3.13 and later).
_FUNCTION: Final = 0x2
_DOCSTRING: Final = 0x4000000


@cache
def digest_of(*modules: str) -> str | None:
    """Return a digest of the code in ``modules`` that can be compiled; None if one of them cannot be read.

    It changes with the code of these modules, with the code of the modules that they import, and with the rate of the
    tick. Comments, docstrings and line numbers have no effect, because compiling the model takes minutes.
    """
    found: set[str] = set()
    unread = list(modules)
    while unread:
        if (module := unread.pop()) not in found:
            found.add(module)
            unread.extend(_imported(module))
    if any(_code(module) is None for module in modules):
        return None
    digest = hashlib.sha256(str(TICK_RATE).encode())
    for module in sorted(found):
        digest.update(_meaning(module))
    return digest.hexdigest()


@cache
def _meaning(module: str) -> bytes:
    """Return the code of one module as bytes for a digest. Cached, because many functions use the same modules."""
    return repr((module, _without_documentation(_code(module)))).encode()


@cache
def _code(module: str) -> CodeType | None:
    """Return the code of a ``module``, which is not run; None if there is none."""
    try:
        spec = find_spec(module)
    except (ImportError, ValueError):
        return None
    if spec is None or not spec.has_location or spec.origin is None:
        return None
    # Not by the loader of the module: pytest has one that changes the code.
    return SourceFileLoader(module, spec.origin).get_code(module)


@cache
def _imported(module: str) -> frozenset[str]:
    """Return the modules of `PACKAGES` that ``module`` imports when it is imported itself."""
    code = _code(module)
    names = code.co_names if code else ()
    whole = {name for name in names if name.partition(".")[0] in PACKAGES}
    packages = [name for name in whole if (spec := find_spec(name)) and spec.submodule_search_locations]
    # ``from package import name``: the name can be a module.
    parts = {f"{package}.{name}" for package in packages for name in names if name.isidentifier()}
    return frozenset(name for name in whole | parts if _code(name) is not None)


def _without_documentation(code: Any) -> Any:
    """Return the content of a constant or a code object: its instructions, names and constants, without docstrings."""
    if not isinstance(code, CodeType):
        return sorted(map(repr, code)) if isinstance(code, frozenset) else code
    constants = [_without_documentation(constant) for constant in code.co_consts]
    if (place := _place_of_docstring(code)) is not None:
        constants[place] = None
    return (
        code.co_name, code.co_code, constants, code.co_names, code.co_varnames, code.co_freevars, code.co_cellvars,
        code.co_argcount, code.co_posonlyargcount, code.co_kwonlyargcount, code.co_flags & ~_DOCSTRING,
    )  # fmt: skip


def _place_of_docstring(code: CodeType) -> int | None:
    """Return the index of the docstring among the constants, if any. In a class, the class name comes before it."""
    if code.co_flags & _FUNCTION:
        return 0 if code.co_consts and isinstance(code.co_consts[0], str) else None
    if "__doc__" not in code.co_names:
        return None
    return 1 if "__qualname__" in code.co_names else 0
