"""The catalogue of effects: every cause that the bench can be given on purpose and that a diagnosis can name."""

from collections.abc import Iterator, Mapping
from importlib import import_module
from pkgutil import iter_modules
from types import MappingProxyType
from typing import Final

from bench_sim.model.effects.effect import FAMILIES, Effect

#: The files that come first in their family, in this order; all others follow them by name.
_FIRST: Final = (
    *("maxwell", "maxwell_two", "fractional", "friction", "friction_distributed", "creep"),
    *("leak", "leak_laminar", "heat", "bellows_volume", "auxiliary_volume", "compliance"),
    *("discharge", "discharge_reynolds", "blocked_orifice", "asymmetric_orifice", "pipe_inertia"),
    *("leveling_deadband", "leveling_delay"),
    *("sensor_lag", "sensor_gain", "sensor_offset", "pressure_drift"),
    *("sensor_latency", "clock_skew", "sample_and_hold"),
    *("actuator_tracking", "frame_compliance", "platen_inertia", "cell_loads", "coupling"),
)


def _found() -> Iterator[Effect]:
    """Yield what the files of this folder name, each one `EFFECT` or several `EFFECTS`."""
    for name in sorted(
        (module.name for module in iter_modules(__path__)),
        key=lambda name: (_FIRST.index(name) if name in _FIRST else len(_FIRST), name),
    ):
        module = import_module(f"{__name__}.{name}")
        yield from getattr(module, "EFFECTS", None) or filter(None, (getattr(module, "EFFECT", None),))


#: Every effect by its name, in the order of the families.
CATALOGUE: Final[Mapping[str, Effect]] = MappingProxyType(
    {effect.name: effect for effect in sorted(_found(), key=lambda effect: FAMILIES.index(effect.family))}
)
