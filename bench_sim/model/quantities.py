"""Names, SI units and shapes of the plant's parameters, and the types of the records for compiled code."""

from dataclasses import dataclass
from enum import Flag, auto
from math import inf
from typing import Final

import numpy as np

from bench_sim.model.layout import (
    ACTUATORS,
    BRANCHES,
    BUMP_POINTS,
    DELAY_CAPACITY,
    EXTRA_BRANCHES,
    EXTRA_FRICTIONS,
    HISTORY,
    SENSORS,
    SIDES,
    SURFACE,
)


class Lanes(Flag):
    """How the lanes use a parameter. In the lanes the diagnosis integrates many springs at the same time."""

    #: Lanes cannot handle this parameter unless it has its default, or 0. Then the slower scalar replay is used.
    UNKNOWN = 0
    COLUMN = auto()  #: trajectories depend on it; it is in the column of a spring
    SURFACE = auto()  #: of a fitted surface; it is not in the column
    FEEDS = auto()  #: of the valves that fill and exhaust a spring
    JOINS = auto()  #: of the valve between both springs of a bench
    NOT_IN_LANES = auto()  #: trajectories under an imposed motion do not depend on it


@dataclass(frozen=True, slots=True)
class Quantity:
    """One parameter. Its ``shape`` is () for a scalar, (2,) for left and right, and (3,) for the actuators.

    A quantity with a ``default`` may be missing in a parameter file. Then ``low`` and ``high`` are its limits.
    """

    name: str
    unit: str
    shape: tuple[int, ...] = ()
    default: float | None = None
    low: float = -inf
    high: float = inf
    lanes: Lanes = Lanes.UNKNOWN


def _each(
    unit: str, *names: str, shape: tuple[int, ...] = (), lanes: Lanes = Lanes.UNKNOWN
) -> tuple[Quantity, ...]:
    return tuple(Quantity(name, unit, shape, lanes=lanes) for name in names)


def _off(
    unit: str,
    *names: str,
    low: float,
    high: float,
    default: float = 0.0,
    shape: tuple[int, ...] = (),
    lanes: Lanes = Lanes.UNKNOWN,
) -> tuple[Quantity, ...]:
    """Return parameters of effects. Their default switches the effect off, and parameter files do not contain them."""
    return tuple(Quantity(name, unit, shape, default, low, high, lanes) for name in names)


_SIDE = (SIDES,)
_ACTUATOR = (ACTUATORS,)
_SENSOR = (SENSORS,)
_SPAN = (2,)
_UPRIGHT_CELLS = (4,)

#: Every parameter that the equations read, except those of the sensors.
PLANT_QUANTITIES: Final[tuple[Quantity, ...]] = (
    # gas, surroundings, supply
    *_each("J/(kg*K)", "gas_constant", lanes=Lanes.COLUMN),
    *_each("1", "heat_capacity_ratio", lanes=Lanes.COLUMN),
    *_each("Pa", "atmospheric_pressure", lanes=Lanes.COLUMN),
    *_each("K", "ambient_temperature", "wall_temperature_offset", lanes=Lanes.COLUMN),
    *_each("K", "supply_temperature", lanes=Lanes.FEEDS),
    *_each("Pa", "supply_pressure", "sawtooth_low", "sawtooth_high", lanes=Lanes.NOT_IN_LANES),
    *_each("1", "supply_sawtooth", lanes=Lanes.NOT_IN_LANES),
    *_each("s", "sawtooth_decay_time", "sawtooth_recharge_time", "supply_lag", lanes=Lanes.NOT_IN_LANES),
    # volumes and areas
    *_each("m2", "effective_area", shape=_SIDE, lanes=Lanes.COLUMN),
    *_each("m", "effective_area_slope", shape=_SIDE, lanes=Lanes.COLUMN),
    *_each("m3", "bellows_volume", "auxiliary_volume", shape=_SIDE, lanes=Lanes.COLUMN),
    *_each("m", "membrane_length", shape=_SIDE, lanes=Lanes.COLUMN),
    *_each("1", "membrane_length_slope", shape=_SIDE, lanes=Lanes.COLUMN),
    *_each("m", "membrane_travel", shape=_SIDE, lanes=Lanes.COLUMN),
    # heat
    *_each("W/K", "bellows_heat_transfer", "auxiliary_heat_transfer", shape=_SIDE, lanes=Lanes.COLUMN),
    *_each("kg/m3", "heat_reference_density", lanes=Lanes.COLUMN),
    *_each("1", "heat_density_exponent", lanes=Lanes.COLUMN),
    *_each("J/K", "wall_heat_capacity", shape=_SIDE, lanes=Lanes.COLUMN),
    *_each("W/K", "wall_outer_heat_transfer", shape=_SIDE, lanes=Lanes.COLUMN),
    # orifice and leak
    *_each("m", "orifice_diameter", shape=_SIDE, lanes=Lanes.COLUMN),
    *_each("1", "discharge_coefficient", shape=_SIDE, lanes=Lanes.COLUMN),
    *_each("1", "laminar_limit", lanes=Lanes.COLUMN),
    *_each("m3/(s*Pa)", "leak_conductance", shape=_SIDE, lanes=Lanes.COLUMN),
    *_each("1", "leak_critical_ratio", lanes=Lanes.COLUMN),
    *_each("kg/(s*Pa2)", "leak_laminar", shape=_SIDE, lanes=Lanes.COLUMN),
    # connecting pipe
    *_each("m", "pipe_length", shape=_SIDE),
    *_each("m", "pipe_diameter", shape=_SIDE, lanes=Lanes.NOT_IN_LANES),
    *_each("1", "pipe_friction", shape=_SIDE, lanes=Lanes.NOT_IN_LANES),
    # valves
    *_each(
        "m",
        "leveling_deadband",
        "leveling_hysteresis",
        "leveling_range",
        "lever_offset",
        shape=_SIDE,
        lanes=Lanes.FEEDS,
    ),
    *_each("s", "leveling_lag", shape=_SIDE, lanes=Lanes.FEEDS),
    *_each(
        "m3/(s*Pa)",
        "fill_conductance",
        "exhaust_conductance",
        "service_conductance",
        shape=_SIDE,
        lanes=Lanes.FEEDS,
    ),
    *_each("1", "valve_critical_ratio", lanes=Lanes.FEEDS | Lanes.JOINS),
    *_each("Pa", "dpv_opening", "dpv_reclosing", lanes=Lanes.JOINS),
    *_each("m3/(s*Pa)", "dpv_conductance", lanes=Lanes.JOINS),
    # rubber
    *_each("N/m", "shell_stiffness_vertical", "shell_stiffness_lateral", shape=_SIDE, lanes=Lanes.COLUMN),
    *_each("1", "maxwell_ratio", shape=(BRANCHES,), lanes=Lanes.COLUMN),
    *_each("s", "maxwell_time", shape=(BRANCHES,), lanes=Lanes.COLUMN),
    *_each("N", "friction_vertical", "friction_lateral", shape=_SIDE, lanes=Lanes.COLUMN),
    *_each("N/Pa", "friction_vertical_slope", "friction_lateral_slope", shape=_SIDE, lanes=Lanes.COLUMN),
    *_each("m", "friction_vertical_travel", "friction_lateral_travel", shape=_SIDE, lanes=Lanes.COLUMN),
    *_each("1", "friction_small_loop", lanes=Lanes.COLUMN),
    # emergency spring and contact
    *_each("N", "nominal_preload", shape=_SIDE, lanes=Lanes.COLUMN),
    *_each("1", "emergency_spring", lanes=Lanes.COLUMN),
    *_each(
        "N/m", "emergency_stiffness_vertical", "emergency_stiffness_lateral", shape=_SIDE, lanes=Lanes.COLUMN
    ),
    *_each("m", "contact_height", lanes=Lanes.COLUMN),
    *_each("N/m", "contact_stiffness", lanes=Lanes.COLUMN),
    *_each("s/m", "contact_loss", lanes=Lanes.NOT_IN_LANES),
    # roll and coupling
    *_each("N*m/rad", "torsional_stiffness", shape=_SIDE, lanes=Lanes.NOT_IN_LANES),
    *_each("N*m/(rad*Pa)", "torsional_stiffness_slope", shape=_SIDE, lanes=Lanes.NOT_IN_LANES),
    *_each("m", "column_height", lanes=Lanes.NOT_IN_LANES),
    *_each("rad", "coupling_angle", lanes=Lanes.NOT_IN_LANES),
    *_each("1", "coupling_sign", lanes=Lanes.NOT_IN_LANES),
    # bolster and bump stop
    *_each("kg", "bolster_mass", lanes=Lanes.NOT_IN_LANES),
    *_each("kg*m2", "bolster_inertia", lanes=Lanes.NOT_IN_LANES),
    *_each("m/s2", "gravity", lanes=Lanes.NOT_IN_LANES),
    *_each(
        "m",
        "spring_half_spacing",
        "centre_height",
        "actuator_half_spacing",
        "lateral_actuator_height",
        lanes=Lanes.NOT_IN_LANES,
    ),
    *_each("m", "accelerometer_height", lanes=Lanes.NOT_IN_LANES),
    *_each("m", "bump_stop_travel", shape=(BUMP_POINTS,), lanes=Lanes.NOT_IN_LANES),
    *_each("N", "bump_stop_force", shape=(BUMP_POINTS,), lanes=Lanes.NOT_IN_LANES),
    # actuators and platform
    *_each("Hz", "actuator_frequency", shape=_ACTUATOR, lanes=Lanes.NOT_IN_LANES),
    *_each("1", "actuator_damping", shape=_ACTUATOR, lanes=Lanes.NOT_IN_LANES),
    *_each("s", "actuator_delay", shape=_ACTUATOR, lanes=Lanes.NOT_IN_LANES),
    *_each("m", "actuator_stroke", shape=_ACTUATOR, lanes=Lanes.NOT_IN_LANES),
    *_each("m/s", "actuator_speed_limit", shape=_ACTUATOR, lanes=Lanes.NOT_IN_LANES),
    *_each("N", "actuator_force_limit", shape=_ACTUATOR, lanes=Lanes.NOT_IN_LANES),
    *_each("N/s", "actuator_force_rate", "actuator_unload_rate", shape=_ACTUATOR, lanes=Lanes.NOT_IN_LANES),
    *_each("N", "actuator_relief_force", shape=_ACTUATOR, lanes=Lanes.NOT_IN_LANES),
    *_each("m/(N*s)", "actuator_relief_flow", shape=_ACTUATOR, lanes=Lanes.NOT_IN_LANES),
    *_each("N/m", "frame_stiffness", shape=_ACTUATOR, lanes=Lanes.NOT_IN_LANES),
    *_each("N*s/m", "frame_damping", shape=_ACTUATOR, lanes=Lanes.NOT_IN_LANES),
    *_each("Hz", "platform_frequency", lanes=Lanes.NOT_IN_LANES),
    *_each("1", "platform_damping", lanes=Lanes.NOT_IN_LANES),
    # load cells
    *_each("m", "load_cell_x", "load_cell_y", "load_cell_height", lanes=Lanes.NOT_IN_LANES),
    *_each("1", "load_cell_crosstalk", shape=(6, 6), lanes=Lanes.NOT_IN_LANES),
    *_off("kg", "platen_mass", low=0.0, high=1e4, lanes=Lanes.NOT_IN_LANES),
    *_off("m", "seat_ahead", low=-0.5, high=0.5, shape=_SIDE, lanes=Lanes.NOT_IN_LANES),
    *_off("m", "load_ahead", low=-0.5, high=0.5, lanes=Lanes.NOT_IN_LANES),
    *_off("1", "support_softness", low=0.0, high=100.0, shape=_UPRIGHT_CELLS, lanes=Lanes.NOT_IN_LANES),
    *_off("N", "platform_twist", low=-5e4, high=5e4, lanes=Lanes.NOT_IN_LANES),
    # acquisition: latency of the readings of a group of sensors
    *_off(
        "s",
        "force_latency",
        "pressure_latency",
        "displacement_latency",
        low=0.0,
        high=0.25,
        lanes=Lanes.NOT_IN_LANES,
    ),
    *_off("1", "pressure_clock_skew", low=0.0, high=0.01, lanes=Lanes.NOT_IN_LANES),
    *_off("1", "pressure_hold", low=0.0, high=1.0, lanes=Lanes.NOT_IN_LANES),
    *_off("s", "pressure_hold_period", low=1e-3, high=0.25, default=0.02, lanes=Lanes.NOT_IN_LANES),
    # additional rubber effects: each list ends at its first element of 0
    *_off("1", "extra_branch_ratio", low=0.0, high=1e4, shape=(EXTRA_BRANCHES,), lanes=Lanes.COLUMN),
    *_off(
        "s", "extra_branch_time", default=1.0, low=1e-3, high=1e4, shape=(EXTRA_BRANCHES,), lanes=Lanes.COLUMN
    ),
    *_off("N", "extra_friction", low=0.0, high=1e5, shape=(EXTRA_FRICTIONS,), lanes=Lanes.COLUMN),
    *_off(
        "m",
        "extra_friction_travel",
        default=3e-3,
        low=1e-5,
        high=0.1,
        shape=(EXTRA_FRICTIONS,),
        lanes=Lanes.COLUMN,
    ),
    *_off("1", "creep_ratio", low=0.0, high=10.0, shape=_SIDE, lanes=Lanes.COLUMN),
    *_off("s", "creep_time", default=300.0, low=1.0, high=1e6, shape=_SIDE, lanes=Lanes.COLUMN),
    *_off("N/m", "extra_stop_stiffness", low=0.0, high=1e8, lanes=Lanes.NOT_IN_LANES),
    *_off("m", "extra_stop_gap", low=0.0, high=0.5, lanes=Lanes.NOT_IN_LANES),
    # gas and flow beyond the above
    *_off("m3/Pa", "bellows_compliance", low=0.0, high=1e-7, shape=_SIDE, lanes=Lanes.COLUMN),
    *_off("m2/Pa", "effective_area_growth", low=0.0, high=1e-6, shape=_SIDE, lanes=Lanes.COLUMN),
    *_off("Pa", "area_reference_pressure", default=2.06e5, low=0.0, high=1e6, lanes=Lanes.COLUMN),
    *_off("1", "orifice_reynolds", low=0.0, high=1e3, shape=_SIDE, lanes=Lanes.COLUMN),
    *_off("1", "orifice_asymmetry", low=-0.9, high=0.9, shape=_SIDE, lanes=Lanes.COLUMN),
    *_off("1/m", "flow_inertance", low=0.0, high=1e6, shape=_SIDE, lanes=Lanes.COLUMN),
    *_off("m3/(s*Pa)", "dpv_leak", low=0.0, high=1e-6, lanes=Lanes.JOINS),
    # fitted surfaces, each over the range of its two coordinates; a surface without a range is off
    *_off("N", "force_surface", low=-1e6, high=1e6, shape=SURFACE, lanes=Lanes.NOT_IN_LANES),
    *_off("m", "force_surface_displacement", low=-1.0, high=1.0, shape=_SPAN, lanes=Lanes.NOT_IN_LANES),
    *_off("m/s", "force_surface_speed", low=-10.0, high=10.0, shape=_SPAN, lanes=Lanes.NOT_IN_LANES),
    *_off("m/s", "force_surface_unit_speed", default=0.01, low=1e-6, high=10.0, lanes=Lanes.NOT_IN_LANES),
    *_off("N", "shear_surface", low=-1e6, high=1e6, shape=SURFACE, lanes=Lanes.NOT_IN_LANES),
    *_off("m", "shear_surface_shear", low=-1.0, high=1.0, shape=_SPAN, lanes=Lanes.NOT_IN_LANES),
    *_off("m/s", "shear_surface_speed", low=-10.0, high=10.0, shape=_SPAN, lanes=Lanes.NOT_IN_LANES),
    *_off("N", "roll_surface", low=-1e6, high=1e6, shape=SURFACE, lanes=Lanes.NOT_IN_LANES),
    *_off("rad", "roll_surface_roll", low=-1.0, high=1.0, shape=_SPAN, lanes=Lanes.NOT_IN_LANES),
    *_off("m", "roll_surface_shear", low=-1.0, high=1.0, shape=_SPAN, lanes=Lanes.NOT_IN_LANES),
    *_off("N*m", "moment_surface", low=-1e6, high=1e6, shape=SURFACE, lanes=Lanes.NOT_IN_LANES),
    *_off("rad", "moment_surface_roll", low=-1.0, high=1.0, shape=_SPAN, lanes=Lanes.NOT_IN_LANES),
    *_off("m", "moment_surface_shear", low=-1.0, high=1.0, shape=_SPAN, lanes=Lanes.NOT_IN_LANES),
    *_off("kg/s", "flow_surface", low=-10.0, high=10.0, shape=SURFACE, lanes=Lanes.SURFACE),
    *_off("Pa", "flow_surface_difference", low=-2e6, high=2e6, shape=_SPAN, lanes=Lanes.SURFACE),
    *_off("Pa", "flow_surface_pressure", low=0.0, high=2e6, shape=_SPAN, lanes=Lanes.SURFACE),
    *_off("W", "heat_surface", low=-1e6, high=1e6, shape=SURFACE, lanes=Lanes.SURFACE),
    *_off("Pa", "heat_surface_pressure", low=0.0, high=2e6, shape=_SPAN, lanes=Lanes.SURFACE),
    *_off("K", "heat_surface_temperature", low=-500.0, high=500.0, shape=_SPAN, lanes=Lanes.SURFACE),
)

#: Properties of every sensor; the unit "signal" is that of the sensor itself.
SENSOR_QUANTITIES: Final[tuple[Quantity, ...]] = (
    *_each("1", "sensor_gain", shape=_SENSOR, lanes=Lanes.NOT_IN_LANES),
    *_each("signal", "sensor_bias", shape=_SENSOR, lanes=Lanes.NOT_IN_LANES),
    *_each("signal/s", "sensor_drift", shape=_SENSOR, lanes=Lanes.NOT_IN_LANES),
    *_each("s", "sensor_lag", shape=_SENSOR, lanes=Lanes.NOT_IN_LANES),
    *_each(
        "signal",
        "sensor_noise",
        "sensor_resolution",
        "sensor_low",
        "sensor_high",
        shape=_SENSOR,
        lanes=Lanes.NOT_IN_LANES,
    ),
    # The maker's bound on the bias; it is used only to draw the bias of a rig as built.
    *_each("signal", "sensor_accuracy", shape=_SENSOR, lanes=Lanes.NOT_IN_LANES),
)

QUANTITIES: Final = PLANT_QUANTITIES + SENSOR_QUANTITIES


def in_lanes(part: Lanes) -> tuple[str, ...]:
    """Return the names of the parameters that the lanes use in this way."""
    return tuple(one.name for one in QUANTITIES if part in one.lanes)


#: The record that compiled code reads as ``par.name``.
PARAMETERS: Final = np.dtype([(q.name, np.float64, q.shape) for q in QUANTITIES])

#: Memory of the plant in addition to its continuous states; changed once per step, never between.
MEMORY: Final = np.dtype(
    [
        ("step", np.int64),
        ("time", np.float64),
        ("seed", np.int64),
        # the algebraic solution at the start of the last step: where Newton's method begins
        ("solved_time", np.float64),
        ("bellows_vertical", np.float64, _SIDE),
        ("bellows_lateral", np.float64, _SIDE),
        ("bellows_vertical_speed", np.float64, _SIDE),
        ("bellows_lateral_speed", np.float64, _SIDE),
        # friction: the last reversal, (vertical, lateral) per side
        ("friction_origin", np.float64, (2, SIDES)),
        ("friction_level", np.float64, (2, SIDES)),
        ("friction_direction", np.float64, (2, SIDES)),
        ("friction_last", np.float64, (2, SIDES)),
        ("extra_friction_level", np.float64, (EXTRA_FRICTIONS, 2, SIDES)),
        # the curve outside a small loop: the way it went (0: no small loop), where it was left, its last reversal
        ("friction_outer_way", np.float64, (2, SIDES)),
        ("friction_outer_turn", np.float64, (2, SIDES)),
        ("friction_outer_origin", np.float64, (2, SIDES)),
        ("friction_outer_level", np.float64, (2, SIDES)),
        ("extra_friction_outer_level", np.float64, (EXTRA_FRICTIONS, 2, SIDES)),
        # gas: density and heat-transfer factor around which the factor is expanded, chambers b_L b_R a_L a_R
        ("heat_density", np.float64, (2 * SIDES,)),
        ("heat_factor", np.float64, (2 * SIDES,)),
        # air with inertia: the flow that the orifice would pass without it, and what is missing from that
        ("steady_flow", np.float64, _SIDE),
        ("missing_flow", np.float64, _SIDE),
        # latches: leveling −1 filling, 0 closed, +1 exhausting; differential pressure valve 0 or 1, the share of the
        # step for which it is open, and p_L − p_R where the step began (0: not known yet)
        ("leveling_latch", np.int64, _SIDE),
        ("dpv_latch", np.int64),
        ("dpv_share", np.float64),
        ("dpv_difference", np.float64),
        # actuators: the mode in force, its slewed set-point, the delay line, what leaves it
        ("mode", np.int64, _ACTUATOR),
        ("setpoint", np.float64, _ACTUATOR),
        ("delay_line", np.float64, (ACTUATORS, DELAY_CAPACITY)),
        ("delayed", np.float64, _ACTUATOR),
        # sensor lags: filter output and last three inputs, and their coefficients for (lag, step)
        ("sensor_output", np.float64, _SENSOR),
        ("sensor_input", np.float64, _SENSOR),
        ("sensor_input_before", np.float64, _SENSOR),
        ("sensor_input_earlier", np.float64, _SENSOR),
        # their last outputs, written only where readings arrive late
        ("sensor_history", np.float64, (SENSORS, HISTORY)),
        ("lag_time", np.float64, _SENSOR),
        ("lag_step", np.float64),
        ("lag_decay", np.float64, _SENSOR),
        ("lag_ramp", np.float64, _SENSOR),
        ("lag_bend", np.float64, _SENSOR),
        ("lag_twist", np.float64, _SENSOR),
    ]
)
