"""The steps that test instructions consist of: fill, level, shake, roll, vent."""

from test_plans.steps.air import AIR, TIGHT, WEIGHED_BY, Weighing, check_air, check_tightness, weigh_the_air
from test_plans.steps.carrying import (
    AVERAGE_OVER,
    CARRYING,
    carry,
    carry_load,
    depressurise,
    free_the_bolster,
    hold_the_height,
    lock_the_air,
    make_safe,
    once_let_go,
    power_up,
    raise_the_air,
    restore_state,
    shim,
)
from test_plans.steps.stiffness import (
    STIFFNESS,
    VERTICAL_SECANT,
    lateral_loop,
    lateral_sweep,
    vertical_loop,
    vertical_sweep,
)
from test_plans.steps.track_and_roll import TRACK_AND_ROLL, roll_by_unequal_preload, track_excitation

#: The checks of springs under a load, as in `aw0` and `aw3`.
UNDER_LOAD = (*AIR, *STIFFNESS, *TRACK_AND_ROLL, TIGHT)

__all__ = [
    "AIR",
    "AVERAGE_OVER",
    "CARRYING",
    "STIFFNESS",
    "TIGHT",
    "TRACK_AND_ROLL",
    "UNDER_LOAD",
    "VERTICAL_SECANT",
    "WEIGHED_BY",
    "Weighing",
    "carry",
    "carry_load",
    "check_air",
    "check_tightness",
    "depressurise",
    "free_the_bolster",
    "hold_the_height",
    "lateral_loop",
    "lateral_sweep",
    "lock_the_air",
    "make_safe",
    "once_let_go",
    "power_up",
    "raise_the_air",
    "restore_state",
    "roll_by_unequal_preload",
    "shim",
    "stand_again",
    "track_excitation",
    "vertical_loop",
    "vertical_sweep",
    "weigh_the_air",
]

stand_again = restore_state  # the old name, for one release
