"""The indices of all arrays of the plant: inputs, sensors, continuous states, sides.

Each numbering is an ``IntEnum``. Its members index plain arrays in Python and are constants for numba. Quantities of
both sides are in pairs, and ``State.BELLOWS_MASS + side`` selects one.
"""

from enum import IntEnum
from typing import Final

#: Number of springs; side 0 is left (lateral position +b), side 1 is right (−b).
SIDES: Final = 2
LEFT: Final = 0
RIGHT: Final = 1

#: Branches of the generalised Maxwell model of the rubber.
BRANCHES: Final = 3

#: Largest numbers of extra rubber branches and extra friction elements.
#: All effects at once need 9 and 3; unused ones cost nothing.
EXTRA_BRANCHES: Final = 12
EXTRA_FRICTIONS: Final = 6

#: Number of coefficients of a fitted surface, along its first and its second coordinate.
SURFACE: Final = (8, 4)

#: Servo-hydraulic actuators: vertical left, vertical right, lateral.
ACTUATORS: Final = 3
VERTICAL_LEFT: Final = 0
VERTICAL_RIGHT: Final = 1
LATERAL: Final = 2

#: Length of the delay line of an actuator command, in steps: the longest possible delay.
DELAY_CAPACITY: Final = 64

#: Number of past outputs (steps) that are stored for each sensor if readings are delayed.
HISTORY: Final = 256

#: Points of the force-travel table of the lateral bump stop.
BUMP_POINTS: Final = 9


class Mode(IntEnum):
    """Control modes of an actuator."""

    OFF = 0  #: unloads softly and then follows without force
    FORCE = 1  #: command in N
    DISPLACEMENT = 2  #: command in m
    SHUT_IN = 3  #: valve closed, the oil holds the piston; command: release speed through the throttle, m/s


class Input(IntEnum):
    """External inputs, constant over one step (SI units)."""

    SUPPLY = 0  #: supply main valve: 1 open, 0 closed and vented
    LEFT_LEVELING = 1  #: leveling valve: 1 connected, 0 isolated
    RIGHT_LEVELING = 2
    LEFT_SERVICE_VALVE = 3  #: fills (up to +1) or exhausts (down to −1) the auxiliary chamber
    RIGHT_SERVICE_VALVE = 4
    LEFT_RESERVOIR_VALVE = 5  #: 1 = orifice path open, 0 = bellows cut off from its auxiliary chamber
    RIGHT_RESERVOIR_VALVE = 6
    DPV_CONNECTED = 7  #: differential pressure valve: 1 connected, 0 isolated
    VERTICAL_LEFT_MODE = 8  #: a `Mode`
    VERTICAL_RIGHT_MODE = 9
    LATERAL_MODE = 10
    VERTICAL_LEFT_COMMAND = 11  #: N pushing down (FORCE), m up (DISPLACEMENT) or m/s up (SHUT_IN)
    VERTICAL_RIGHT_COMMAND = 12
    LATERAL_COMMAND = 13  #: N pushing to the left (FORCE), m (DISPLACEMENT) or m/s to the left (SHUT_IN)
    PLATFORM_VERTICAL = 14  #: m up
    PLATFORM_LATERAL = 15  #: m to the left
    PLATFORM_ROLL = 16  #: rad, left side up


class Sensor(IntEnum):
    """Outputs of the measuring chain, in SI units; pressures are gauge."""

    LEFT_HEIGHT = 0  #: spring height above design height, laser
    RIGHT_HEIGHT = 1
    LEFT_BELLOWS_PRESSURE = 2
    RIGHT_BELLOWS_PRESSURE = 3
    LEFT_AUXILIARY_PRESSURE = 4
    RIGHT_AUXILIARY_PRESSURE = 5
    SUPPLY_PRESSURE = 6  #: behind the main valve
    LEFT_BELLOWS_TEMPERATURE = 7
    RIGHT_BELLOWS_TEMPERATURE = 8
    LEFT_AUXILIARY_TEMPERATURE = 9
    RIGHT_AUXILIARY_TEMPERATURE = 10
    VERTICAL_LEFT_FORCE = 11  #: actuator force, positive pushing down
    VERTICAL_RIGHT_FORCE = 12
    LATERAL_FORCE = 13  #: actuator force, positive pushing to the left
    VERTICAL_LEFT_DISPLACEMENT = 14  #: piston, positive up
    VERTICAL_RIGHT_DISPLACEMENT = 15
    LATERAL_DISPLACEMENT = 16  #: piston, positive left
    LOAD_CELL_1 = 17  #: vertical, at (+l_x, +l_y), compression positive
    LOAD_CELL_2 = 18  #: vertical, at (+l_x, −l_y)
    LOAD_CELL_3 = 19  #: vertical, at (−l_x, +l_y)
    LOAD_CELL_4 = 20  #: vertical, at (−l_x, −l_y)
    LOAD_CELL_5 = 21  #: lateral, at (+l_x, 0, z_c); positive when the springs push the bolster left
    LOAD_CELL_6 = 22  #: lateral, at (−l_x, 0, z_c)
    LATERAL_ACCELERATION = (
        23  #: on the bolster and across it, positive left; its lean's part of gravity included
    )
    PLATFORM_VERTICAL = 24
    PLATFORM_LATERAL = 25
    PLATFORM_ROLL = 26


class State(IntEnum):
    """The continuous states, in the order of the state vector.

    States of rarely used parts are at the end. A step integrates only up to the last state that can change
    (`bench_sim.model.runge_kutta.integrated_states`).
    """

    BELLOWS_MASS = 0  #: kg, per side
    BELLOWS_ENERGY = 2  #: J, internal energy m c_v T, per side
    AUXILIARY_MASS = 4
    AUXILIARY_ENERGY = 6
    BELLOWS_WALL = 8  #: K, wall temperature, per side
    AUXILIARY_WALL = 10
    LEVER = 12  #: m, lever of the leveling valve behind its dash-pot, per side
    VERTICAL_DASHPOT = 14  #: m, dash-pots of the Maxwell branches: side * BRANCHES + branch
    LATERAL_DASHPOT = 20
    BOLSTER_LATERAL = 26
    BOLSTER_VERTICAL = 27
    BOLSTER_ROLL = 28
    BOLSTER_LATERAL_SPEED = 29
    BOLSTER_VERTICAL_SPEED = 30
    BOLSTER_ROLL_SPEED = 31
    PLATFORM_LATERAL = 32
    PLATFORM_VERTICAL = 33
    PLATFORM_ROLL = 34
    PLATFORM_LATERAL_SPEED = 35
    PLATFORM_VERTICAL_SPEED = 36
    PLATFORM_ROLL_SPEED = 37
    ACTUATOR = 38  #: N (force) or m (piston, displacement control), per actuator
    ACTUATOR_RATE = 41  #: its rate, per actuator
    SUPPLY_LINE = 44  #: Pa absolute, behind the main valve
    CREEP = 45  #: m by which the emergency spring has crept together, per side
    PIPE_FLOW = 47  #: kg/s from bellows to auxiliary chamber, per side; 0 where no pipe is fitted
    EXTRA_VERTICAL_DASHPOT = 49  #: m, of the extra Maxwell branches: EXTRA_DASHPOTS * branch + side
    EXTRA_LATERAL_DASHPOT = 51


#: Dash-pots of one extra branch: vertical and lateral, left and right.
EXTRA_DASHPOTS: Final = 4

#: A state of a smaller magnitude becomes zero: a decayed rate would end as a denormal number, and with a few of those
#: the processor takes up to three times as long for a step.
TINY: Final = 1e-100

#: Number of ... each.
INPUTS: Final = len(Input)
SENSORS: Final = len(Sensor)
STATES: Final = State.EXTRA_VERTICAL_DASHPOT + EXTRA_DASHPOTS * EXTRA_BRANCHES
