"""The memory layout of eight springs that are simulated together: one flat array, whose rows have one number per
spring.

The compiler makes vector instructions of a loop over the springs if all data are at constant distances in one array.
So the position of each row is a constant, and there is no second array.
"""

from enum import IntEnum, auto
from typing import Any, Final

from bench_sim.model.layout import EXTRA_BRANCHES

#: Number of springs that are integrated together: the numbers in the widest vector of present processors.
LANES: Final = 8
#: Number of benches whose two springs are integrated together.
PAIRS: Final = LANES // 2
#: Friction elements that a lane may have beyond its own.
LANE_FRICTIONS: Final = 3
#: Coefficients of the polynomial that represents a power.
POWERS: Final = 19


class _Rows(IntEnum):
    """Rows in the order of their definition. The value is the index of the first lane in the flat array."""

    @staticmethod
    def _generate_next_value_(name: str, start: int, count: int, last_values: list[Any]) -> int:
        return LANES * count


class LaneState(_Rows):
    """The continuous states of a spring within a block of states, in the order of `State`."""

    MASS = auto()  #: bellows
    ENERGY = auto()
    AUXILIARY_MASS = auto()
    AUXILIARY_ENERGY = auto()
    WALL = auto()
    AUXILIARY_WALL = auto()
    CREEP = auto()
    LEVER = auto()  #: of the leveling valve, where springs are fed
    DASHPOT_Z = auto()
    DASHPOT_Z_2 = auto()
    DASHPOT_Z_3 = auto()
    DASHPOT_Y = auto()
    DASHPOT_Y_2 = auto()
    DASHPOT_Y_3 = auto()
    EXTRA = auto()  #: vertical and lateral dash-pot of each extra branch


class Lane(_Rows):
    """All other values of a spring: its inputs, the values computed from them, and its parameters."""

    # position of the plates
    HEIGHT = auto()  #: and the next as in `Algebraic`
    HEIGHT_SPEED = auto()
    LATERAL = auto()
    LATERAL_SPEED = auto()
    # valves during a step (`GIVEN` rows, as in a course); only the first row is used if no air enters or leaves
    OPENING = auto()  #: of the reservoir valve, 0 … 1
    LEVELING = auto()  #: connection of the leveling valve, 0 … 1
    SERVICE = auto()  #: opening of the service valve, −1 exhausting … 1 filling
    SUPPLY = auto()  #: Pa absolute
    JOINED = auto()  #: connection of the differential pressure valve, 0 … 1
    # difference between this lane and its course
    SHIFT = auto()  #: m to the left
    SUPPLY_ERROR = auto()  #: Pa by which the supply pressure is below that of the course
    # Newton's method
    TRY_Z = auto()  #: m, deflection of the bellows in the present iteration
    TRY_Y = auto()
    STEP_Z = auto()  #: m, next step from TRY_Z
    STEP_Y = auto()
    MOVING = auto()  #: 1 while Newton's method iterates, then 0
    NOTED_Z = auto()  #: at the start of the step, as are the speeds; BEND is half the acceleration
    NOTED_Y = auto()
    NOTED_Z_SPEED = auto()
    NOTED_Y_SPEED = auto()
    BEND_Z = auto()
    BEND_Y = auto()
    # friction and rubber
    ORIGIN_Z = auto()  #: last reversal of the friction
    LEVEL_Z = auto()
    ORIGIN_Y = auto()
    LEVEL_Y = auto()
    MORE_Z = auto()  #: N and N/m of extra friction elements
    MORE_Y = auto()
    STIFFER_Z = auto()
    STIFFER_Y = auto()
    PULL_Z = auto()  #: Σ r w in m and Σ r dw/dt in m/s over all dash-pots
    PULL_Y = auto()
    RATE_Z = auto()
    RATE_Y = auto()
    # computed from state and plates
    VOLUME = auto()  #: and the next as in `Algebraic`
    AREA = auto()
    LATERAL_AREA = auto()
    PRESSURE = auto()
    CONTACT = auto()
    STACK_Z = auto()
    STACK_Y = auto()
    STIFFNESS_ZZ = auto()
    STIFFNESS_ZY = auto()
    STIFFNESS_YY = auto()
    Z_PER_PRESSURE = auto()
    Y_PER_PRESSURE = auto()
    BELLOWS_Z = auto()
    BELLOWS_Y = auto()
    BELLOWS_Z_SPEED = auto()
    BELLOWS_Y_SPEED = auto()
    TEMPERATURE = auto()
    AUXILIARY_PRESSURE = auto()
    AUXILIARY_TEMPERATURE = auto()
    PASSAGE = auto()  #: C_d A of the orifice, m², with the opening of its valve and the direction of the flow
    FLOW = auto()  #: kg/s from bellows to auxiliary chamber, and the flow without inertia
    STEADY_FLOW = auto()
    NOTED_STEADY_FLOW = (
        auto()
    )  #: flow without inertia at the start of the step; next: the part missing by inertia
    NOTED_MISSING_FLOW = auto()
    HEATING = auto()  #: W into the bellows, without the work
    DENSITY = (
        auto()
    )  #: density at which the series of the heat's density factor begins; next: the factor there
    DENSITY_FACTOR = auto()
    AUXILIARY_DENSITY = auto()
    AUXILIARY_DENSITY_FACTOR = auto()
    PRESENT_DENSITY = auto()  #: at the start of the step
    AUXILIARY_PRESENT_DENSITY = auto()
    KNOWN = auto()  #: slope of the bellows' energy at the last stage
    CHANGED = auto()  #: sums of the change of this slope since the previous stage, for each of three stages
    CHANGED_2 = auto()
    CHANGED_3 = auto()
    # properties of the spring
    V_0 = auto()
    A_0 = auto()  #: without pressure
    A_1 = auto()
    GROWTH = auto()  #: A_p of the area
    KAPPA_0 = auto()
    KAPPA_1 = auto()
    PER_TRAVEL = auto()  #: 1/y_s of the membrane
    SHELL_Z = auto()
    SHELL_Y = auto()
    RATIO = auto()
    RATIO_2 = auto()
    RATIO_3 = auto()
    RATIOS = auto()  #: sum over all branches, extra ones too
    SPEED = auto()  #: 1/τ
    SPEED_2 = auto()
    SPEED_3 = auto()
    FRICTION_Z = auto()
    FRICTION_Z_SLOPE = auto()
    FRICTION_Z_TRAVEL = auto()
    FRICTION_Y = auto()
    FRICTION_Y_SLOPE = auto()
    FRICTION_Y_TRAVEL = auto()
    SMALL_LOOP = auto()
    CONTACT_HEIGHT = auto()
    CONTACT_STIFFNESS = auto()
    PRELOAD = auto()
    GIVE_Z = auto()  #: compliance of the emergency spring, m/N
    GIVE_Y = auto()
    CREEP_GAIN = auto()
    CREEP_RATE = auto()
    STRETCH = auto()  #: ∂V/∂p of the bellows at design height
    STRETCH_AT_0 = auto()  #: change of the volume by stretch at zero pressure and design height
    ATMOSPHERE = auto()
    GAS_CONSTANT = auto()
    HEAT_RATIO = auto()
    HEAT_CAPACITY = auto()  #: c_p
    AMBIENT = auto()
    AUXILIARY_VOLUME = auto()
    HEAT = auto()
    AUXILIARY_HEAT = auto()
    HEAT_EXPONENT = auto()
    HEAT_DENSITY = auto()
    WALL_RATE = auto()  #: 1/C_w, or 0
    WALL_OUTER = auto()
    ORIFICE = auto()  #: C_d A
    ASYMMETRY = auto()
    REYNOLDS = auto()
    INERTANCE = auto()  #: of the air in the connection, 1/m
    REYNOLDS_PER_FLOW = auto()  #: Re/G
    LAMINAR = auto()
    PSI_LAMINAR = auto()  #: ψ/(1 − r) where the flow is linear
    PSI_FACTOR = auto()  #: 2κ/(κ−1)
    CRITICAL = auto()  #: pressure ratio of the choked nozzle
    LEAK = auto()
    LEAK_CRITICAL = auto()
    LEAK_LAMINAR = auto()
    POWER = auto()  #: coefficients of r^(1/κ) from the critical ratio to 1, the constant first


#: Number of values that a course has for the valves, from `Lane.OPENING` on.
GIVEN: Final = (Lane.JOINED - Lane.OPENING) // LANES + 1

EXTRA_RATIO: Final = Lane.POWER + LANES * POWERS
EXTRA_SPEED: Final = EXTRA_RATIO + LANES * EXTRA_BRANCHES
EXTRA_FRICTION: Final = EXTRA_SPEED + LANES * EXTRA_BRANCHES
EXTRA_TRAVEL: Final = EXTRA_FRICTION + LANES * LANE_FRICTIONS
EXTRA_LEVEL_Z: Final = EXTRA_TRAVEL + LANES * LANE_FRICTIONS
EXTRA_LEVEL_Y: Final = EXTRA_LEVEL_Z + LANES * LANE_FRICTIONS
_BLOCK: Final = LaneState.EXTRA + 2 * LANES * EXTRA_BRANCHES
#: Blocks of states: where the slope is taken, the slope, the start of the step, the sum of its slopes.
STAGE: Final = EXTRA_LEVEL_Y + LANES * LANE_FRICTIONS
SLOPE: Final = STAGE + _BLOCK
START: Final = SLOPE + _BLOCK
SUM: Final = START + _BLOCK
LENGTH: Final = SUM + _BLOCK
#: Numbers of one lane. The length of an array over this is the number of lanes, which the compiler does not know: short
#: loops over so many lanes become vector instructions, where those over `LANES` are written out eight times.
PER_LANE: Final = LENGTH // LANES
