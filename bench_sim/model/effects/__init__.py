"""The catalogue of effects: causes that can be added to the bench and that a diagnosis can name.

Each family has a file with its effects in order. An effect that changes one quantity is a row; its change is made by
`adds` or `scales` of `effect`.
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
