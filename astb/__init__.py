"""The command line and composition root, where the rig and its drivers meet, and the public API: `import astb`."""

from importlib import import_module
from typing import TYPE_CHECKING, Any, Final

if TYPE_CHECKING:
    from astb.api import diagnose_record, open_bench, run_plan
    from bench_protocol import units
    from drivers import errors
    from test_plans import analysis

#: Modules of the public names: each is imported at its first use, so that `import astb` is fast.
_HOME: Final = {
    "analysis": "test_plans",
    "diagnose_record": "astb.api",
    "errors": "drivers",
    "open_bench": "astb.api",
    "run_plan": "astb.api",
    "units": "bench_protocol",
}

__all__ = ["analysis", "diagnose_record", "errors", "open_bench", "run_plan", "units"]


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(
            f"module 'astb' has no attribute {name!r}; the attributes are {', '.join(__all__)}"
        )
    home = _HOME[name]
    # The name is a module of a package, or a name inside a module.
    value = getattr(import_module(home), name) if "." in home else import_module(f"{home}.{name}")
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
