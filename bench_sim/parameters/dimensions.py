"""What a file of dimensions would say of a simulated rig: its parameters under the names of a rig's description."""

from typing import Final

from bench_protocol.dimensions import ACROSS, LAGS, across, lag
from bench_sim.model.layout import Sensor
from bench_sim.parameters import Parameters

#: By dimension: the parameter, and which element of it.
_PARAMETERS: Final = {
    "bolster_mass": ("bolster_mass", 0),
    "gravity": ("gravity", 0),
    "spring_half_spacing": ("spring_half_spacing", 0),
    "centre_height": ("centre_height", 0),
    "lateral_actuator_height": ("lateral_actuator_height", 0),
    "column_height": ("column_height", 0),
    "bump_stop_gap": ("bump_stop_travel", 0),
    "vertical_frame_stiffness": ("frame_stiffness", 0),
    "vertical_frame_damping": ("frame_damping", 0),
    "lateral_frame_stiffness": ("frame_stiffness", 2),
    "lateral_frame_damping": ("frame_damping", 2),
    "actuator_frequency": ("actuator_frequency", 0),
    "actuator_damping": ("actuator_damping", 0),
    "actuator_speed": ("actuator_speed_limit", 0),
}


def dimensions_of(parameters: Parameters) -> dict[str, float]:
    """Return the dimensions (SI) of a rig with these parameters, by name, without its effects, which nobody knows.

    The lasers stand at the springs, and load cells 1 and 3 on the left.
    """

    def of(parameter: str, element: int = 0) -> float:
        return float(parameters.entries[parameter].value.flat[element])

    spacings = {
        "height": of("spring_half_spacing"),
        "vertical": of("actuator_half_spacing"),
        "load_cell": of("load_cell_y"),
    }
    left = ("left.height", "vertical_left", "load_cell.1", "load_cell.3")
    places = {place: next(spacing for part, spacing in spacings.items() if part in place) for place in ACROSS}
    return {
        **{name: of(*where) for name, where in _PARAMETERS.items()},
        **{across(place): spacing if place in left else -spacing for place, spacing in places.items()},
        **{lag(name): of("sensor_lag", int(Sensor[name.replace(".", "_").upper()])) for name in LAGS},
    }
