"""The catalogue of effects: physical causes that can be added to the bench, and that a diagnosis can find.

Each family of effects has one file. If an effect changes one parameter, `adds` or `scales` of `effect` define its
change.
"""

from collections.abc import Mapping
from types import MappingProxyType
from typing import Final

from bench_sim.model.effects import acquisition, flow, gas, rig, rubber, sensor
from bench_sim.model.effects.effect import Effect

#: Every effect by its name, in the order of the families.
CATALOGUE: Final[Mapping[str, Effect]] = MappingProxyType(
    {
        effect.name: effect
        for family in (rubber, gas, flow, sensor, acquisition, rig)
        for effect in family.EFFECTS
    }
)
