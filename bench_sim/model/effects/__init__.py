"""The catalogue of effects: every cause that the bench can be given on purpose and that a diagnosis can name."""

from collections.abc import Mapping
from types import MappingProxyType
from typing import Final

from bench_sim.model.effects import (
    area_slope,
    asymmetric_orifice,
    auxiliary_volume,
    bellows_volume,
    bump_stop,
    compliance,
    creep,
    discharge,
    discharge_reynolds,
    dpv_leak,
    fractional,
    friction,
    friction_distributed,
    heat,
    leak,
    leak_laminar,
    leveling_deadband,
    leveling_delay,
    maxwell,
    maxwell_two,
    pipe_inertia,
)
from bench_sim.model.effects.effect import Effect

#: Every effect by its name, in the order of the families.
CATALOGUE: Final[Mapping[str, Effect]] = MappingProxyType(
    {
        module.EFFECT.name: module.EFFECT
        for module in (
            # rubber
            maxwell,
            maxwell_two,
            fractional,
            friction,
            friction_distributed,
            creep,
            bump_stop,
            # gas
            leak,
            leak_laminar,
            heat,
            bellows_volume,
            auxiliary_volume,
            compliance,
            area_slope,
            # flow
            discharge,
            discharge_reynolds,
            asymmetric_orifice,
            pipe_inertia,
            leveling_deadband,
            leveling_delay,
            dpv_leak,
        )
    }
)
