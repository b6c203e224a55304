"""The catalogue of effects: every cause that the bench can be given on purpose and that a diagnosis can name."""

from collections.abc import Mapping
from types import MappingProxyType
from typing import Final

from bench_sim.model.effects import (
    actuator_tracking,
    area_slope,
    asymmetric_orifice,
    auxiliary_volume,
    bellows_volume,
    bump_stop,
    cell_loads,
    clock_skew,
    compliance,
    coupling,
    creep,
    crosstalk,
    discharge,
    discharge_reynolds,
    dpv_leak,
    emergency_compliance,
    fractional,
    frame_compliance,
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
    platen_inertia,
    pressure_drift,
    quantisation,
    sample_and_hold,
    sensor_gain,
    sensor_lag,
    sensor_latency,
    sensor_offset,
)
from bench_sim.model.effects.effect import Effect

#: Every effect by its name, in the order of the families.
CATALOGUE: Final[Mapping[str, Effect]] = MappingProxyType(
    {
        effect.name: effect
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
            # sensor
            sensor_lag,
            sensor_gain,
            sensor_offset,
            pressure_drift,
            crosstalk,
            # acquisition
            sensor_latency,
            clock_skew,
            sample_and_hold,
            quantisation,
            # rig
            actuator_tracking,
            frame_compliance,
            platen_inertia,
            cell_loads,
            coupling,
            emergency_compliance,
        )
        for effect in getattr(module, "EFFECTS", None) or (module.EFFECT,)
    }
)
