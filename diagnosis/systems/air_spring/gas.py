"""The gas in the springs at the start of a run, from sensor readings. Effects may begin at this start."""

from collections.abc import Mapping
from typing import Any, Final

import numpy as np

from bench_protocol.signals import Group
from bench_protocol.table_signals import BY_GROUP
from bench_sim.model.bellows import envelope, lateral_shape, pressure_that_carries, pressure_that_stretches
from bench_sim.model.effects import effect as bench
from bench_sim.model.layout import SIDES
from bench_sim.model.replay import Gas
from bench_sim.model.rest import settled_temperature
from bench_sim.model.spring import compliance, stretch, unpressed_area
from bench_sim.model.wiring import sensor_of
from diagnosis.contracts import DiagnosisError, Experiment
from diagnosis.systems.air_spring.parameters import CHAMBERS
from diagnosis.systems.air_spring.runs import given

_SIDE_NAMES: Final = bench.PLACES
#: The name of the setting of a run whose effects begin at its start. The sensors that read the gas did not yet have
#: these effects, and the gas is that in the springs without them.
BEFORE: Final = "before"
MOVING: Final = "moving"  #: the setting of a run that begins in a motion: air flows between its chambers
GAS: Final = (*BY_GROUP[Group.PRESSURE], *BY_GROUP[Group.TEMPERATURE])  #: readings of its state


def gas_that_was_read(experiment: Experiment, parameters: Mapping[str, float], par: Any) -> Gas:
    """Return the gas at the start of a run, from sensor readings minus the sensor errors of the model.

    At rest a bellows and its open chamber have one pressure; a closed chamber has its own.
    """
    settings = experiment.settings

    def unbiased(name: str) -> float:
        sensor = sensor_of(name)
        off = par.sensor_bias[sensor] + par.sensor_drift[sensor] * settings.get("start", 0.0)
        read = settings[name] - off - parameters.get(f"{name}.offset", 0.0)
        return float(read / (1.0 + par.sensor_gain[sensor]))

    pressure = np.empty(2 * SIDES)
    temperature = np.empty(2 * SIDES)
    for i, side in enumerate(_SIDE_NAMES):
        bellows, auxiliary = (f"{side}.{chamber}_pressure" for chamber in ("bellows", "auxiliary"))
        if bellows not in settings:
            raise DiagnosisError(
                f"run {experiment.name}: the setting {bellows} is missing; give the gauge pressure at the start in Pa"
            )
        pressure[[i, SIDES + i]] = unbiased(bellows) + parameters.get(f"{side}.initial_pressure", 0.0)
        joined = MOVING not in settings and given(experiment, f"{side}.reservoir", 1.0)[0]
        if auxiliary in settings and not joined:
            own = parameters.get(f"{side}.auxiliary.initial_pressure", 0.0)
            pressure[SIDES + i] = unbiased(auxiliary) + own
    pressure += par.atmospheric_pressure
    for k, chamber in enumerate(CHAMBERS):
        name = f"{chamber}_temperature"
        start = unbiased(name) if name in settings else float(settled_temperature(par))
        temperature[k] = start + parameters.get(f"{chamber}.initial_temperature", 0.0)
    return Gas(pressure, temperature)


def kept(gas: Gas, experiment: Experiment, before: Any, par: Any) -> Gas:
    """Return the gas after the springs change from the parameters ``before`` to ``par``: mass and temperature stay
    equal.
    """
    pressure = gas.pressure.copy()
    for i, side in enumerate(_SIDE_NAMES):
        at = float(experiment.inputs[f"{side}.height"][0]), float(given(experiment, "shear", 0.0)[0])
        V, compliance = _room(before, i, *at)
        content = pressure[i] * (V + compliance * pressure[i])
        pressure[i] = pressure_that_stretches(content, *_room(par, i, *at))
        pressure[SIDES + i] *= before.auxiliary_volume[i] / par.auxiliary_volume[i]
    return Gas(pressure, gas.temperature)


def _room(par: Any, side: int, zeta: float, y: float) -> tuple[float, float]:
    """Return the volume (m³) of a bellows at absolute pressure 0, and its growth per Pa. The spring has the height
    ``zeta`` ζ and the shear ``y`` (m).

    The pressure stretches the bellows, and compresses the emergency spring of stiffness k, so the bellows has the
    height ζ_b = ζ + (p_g A − P)/k. P is the preload.
    """
    Y, Y1, _ = lateral_shape(y, 1.0 / par.membrane_travel[side])
    names = ("effective_area_slope", "membrane_length", "membrane_length_slope")
    V_0, rest = float(par.bellows_volume[side]), (float(par[name][side]) for name in names)
    V, area, *_ = envelope(zeta, Y, Y1, V_0, unpressed_area(par, side), *rest)
    growth = float(par.effective_area_growth[side])
    resting = pressure_that_carries(float(par.nominal_preload[side]), area, growth)
    area += 2.0 * growth * resting
    gives = area**2 / float(par.emergency_stiffness_vertical[side]) if par.emergency_spring else 0.0
    unloaded = V + stretch(par, side, zeta, 0.0) - gives * (par.atmospheric_pressure + resting)
    return float(unloaded), compliance(par, side, zeta) + gives
