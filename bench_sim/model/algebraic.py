"""Algebraic variables, which are computed from the states: pressures, forces, and the deflection of the bellows."""

from enum import IntEnum
from typing import Final


class Algebraic(IntEnum):
    """Indices of the array of algebraic variables. A pair holds left and right: ``Algebraic.X + side``."""

    HEIGHT = 0  #: ζ, spring height above design height, m
    LATERAL = 2  #: y, lateral displacement of the top plate against its foot, m
    HEIGHT_SPEED = 4
    LATERAL_SPEED = 6
    ROLL = 8  #: θ, roll of the bolster against the platform, rad (one value)
    PRESSURE = 10  #: bellows, Pa absolute
    TEMPERATURE = 12
    AUXILIARY_PRESSURE = 14
    AUXILIARY_TEMPERATURE = 16
    VOLUME = 18  #: bellows, m³
    AREA = 20  #: ∂V/∂ζ, m²
    LATERAL_AREA = 22  #: ∂V/∂y, m²
    BELLOWS_VERTICAL = 24  #: ζ_b, the bellows' share of ζ, m
    BELLOWS_LATERAL = 26
    BELLOWS_VERTICAL_SPEED = 28
    BELLOWS_LATERAL_SPEED = 30
    STACK_VERTICAL = 32  #: force through bellows and emergency spring on the top plate, N
    STACK_LATERAL = 34
    STIFFNESS_ZZ = 36  #: ∂F_z/∂ζ_b at constant pressure, N/m
    STIFFNESS_ZY = 38  #: ∂F_z/∂y_b = ∂F_y/∂ζ_b at constant pressure
    STIFFNESS_YY = 40
    VERTICAL_PER_PRESSURE = 42  #: ∂F_z/∂p, m²
    LATERAL_PER_PRESSURE = 44
    DASHPOT_VERTICAL = 46  #: rate of F_z by relaxation of the rubber, N/s
    DASHPOT_LATERAL = 48
    VERTICAL_FORCE = 50  #: total force of the spring on the bolster, N; next: lateral (N), roll moment (N·m)
    LATERAL_FORCE = 52
    ROLL_MOMENT = 54
    ACTUATOR_FORCE = 56  #: three
    ACTUATOR_DISPLACEMENT = 59  #: of the bolster at the actuator, three
    ACTUATOR_SPEED = 62  #: three
    BUMP_STOP = 65
    LATERAL_ACCELERATION = 66  #: of the bolster's centre, m/s²
    ACCELEROMETER = 67  #: reading of an ideal accelerometer on the bolster, m/s²
    LEVELING_FLOW = 68  #: kg/s through the leveling valve into the auxiliary chamber, per side
    ORIFICE_FLOW = 70  #: kg/s from bellows to auxiliary chamber, per side
    DPV_FLOW = 72  #: kg/s from left to right
    CONTACT = 74  #: compression of the contact on the emergency spring, m, per side
    HEAT = 76  #: W into the bellows, per side
    AUXILIARY_HEAT = 78
    STEADY_FLOW = 80  #: kg/s that the orifice would pass if its air had no inertia, per side
    PLATFORM_ACCELERATION = 82  #: lateral, vertical, m/s²
    SERVICE_FLOW = 84  #: kg/s through the rig's service valve into the auxiliary chamber, per side


#: Length of the array.
ALGEBRAICS: Final = 86
