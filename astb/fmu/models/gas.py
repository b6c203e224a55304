"""Common parts of FMUs with air springs: their parameters as numbers, and the indices that the C code uses."""

from collections.abc import Mapping
from typing import Final

import numpy as np
from numpy.typing import NDArray

from astb.fmu.unit import offset
from bench_sim.model.algebraic import Algebraic
from bench_sim.model.layout import State
from bench_sim.model.quantities import PARAMETERS
from bench_sim.parameters import Parameters

#: Pairs of parameters that only make sense in one order.
ORDERS: Final = (
    ("dpv_reclosing", "dpv_opening"),
    ("sawtooth_low", "sawtooth_high"),
    ("left.leveling_hysteresis", "left.leveling_deadband"),
    ("right.leveling_hysteresis", "right.leveling_deadband"),
)


def defaults_of(parameters: Parameters) -> NDArray[np.float64]:
    """Return all parameters as one array of numbers, in the order of the parameter record."""
    return np.frombuffer(np.asarray(parameters.record).tobytes(), dtype=np.float64)


def places_of(*, shims: bool) -> Mapping[str, int]:
    """Return the indices that ``gas.c`` uses, by their names in C.

    ``shims`` states whether the preload can change in a simulation.
    """
    return {
        "ATMOSPHERE": offset(PARAMETERS, "atmospheric_pressure") // 8,
        "MEMBRANE": offset(PARAMETERS, "membrane_length") // 8,
        "MEMBRANE_SLOPE": offset(PARAMETERS, "membrane_length_slope") // 8,
        "SHIMS": int(shims),
        "PRELOAD": offset(PARAMETERS, "nominal_preload") // 8,
        "EMERGENCY": offset(PARAMETERS, "emergency_spring") // 8,
        "EMERGENCY_STIFFNESS": offset(PARAMETERS, "emergency_stiffness_vertical") // 8,
        "LEVER": int(State.LEVER),
        "PIPE_LENGTH": offset(PARAMETERS, "pipe_length") // 8,
        "PIPE_DIAMETER": offset(PARAMETERS, "pipe_diameter") // 8,
        "BELLOWS_VERTICAL": int(Algebraic.BELLOWS_VERTICAL),
        "PRESSURE": int(Algebraic.PRESSURE),
        "AUXILIARY_PRESSURE": int(Algebraic.AUXILIARY_PRESSURE),
    }
