"""The safe position: actuators with closed valves hold the bolster until its springs are empty, then lower it, and
are released.

If the actuators were released under pressure, the springs would throw the bolster up: 172 mm at 1.56 bar. So engaged
actuators stay engaged when commander, communication or power fail. Return springs close the valves of the actuators
and open the exhausts of the air springs. The orifice of a lowering valve limits the speed.
"""

import math
from enum import IntEnum
from typing import Any, Final

from bench_protocol.rates import FAST_RATE
from bench_protocol.signals import Group
from bench_protocol.units import bar, kN, mm, s
from bench_sim.model.compiled import compiled
from bench_sim.model.layout import Sensor
from bench_sim.model.wiring import sensors_of
from bench_sim.rig.controls import AirSupply

#: Slightly less than the pressure that carries the bolster (0.23 bar). The release of nearly unloaded actuators causes
#: no motion.
EMPTY: Final = 0.22 * bar
#: Upward force of an actuator below which the bolster counts as set down.
SET_DOWN: Final = 0.5 * kN
LOWERING_SPEED: Final = 40 * mm / s
#: Samples for which empty springs stay open: expanded gas is cold, and would lift the bolster again in a closed spring.
AIRING: Final = round(20 * s * FAST_RATE)

_CHAMBERS: Final = tuple(int(sensor) for sensor in sensors_of(Group.PRESSURE))


class Grip(IntEnum):
    """The state of actuators that are not engaged."""

    OPEN = 0  #: unloaded: they follow without force
    SHUT = 1  #: shut in: they hold against the force of the springs
    LOWERING = 2  #: the springs are empty: the actuators set down their loads


@compiled
def keep_grip(c: Any, values: Any) -> None:
    """Decide from the readings whether the actuators are held, lower the bolster, or are released.

    ``values`` are signals by table row, sensors first. A pressure without a valid reading counts as present.
    """
    empty = True
    for chamber in _CHAMBERS:
        if not values[chamber] < EMPTY:
            empty = False
    if c.air == AirSupply.VENTED and (not empty or c.grip == Grip.LOWERING):
        c.airing = AIRING
    elif empty and c.airing > 0:
        c.airing -= 1
    if c.engaged != 0 or c.shut_in != 0:
        c.grip = Grip.SHUT.value
    elif c.grip != Grip.OPEN:
        if not empty:
            c.grip = Grip.SHUT.value
        else:
            # Each actuator is lowered separately. Otherwise it could press a spring that already carries it.
            left, right = values[Sensor.VERTICAL_LEFT_FORCE], values[Sensor.VERTICAL_RIGHT_FORCE]
            lead = values[Sensor.VERTICAL_LEFT_DISPLACEMENT] - values[Sensor.VERTICAL_RIGHT_DISPLACEMENT]
            # An actuator without a force reading follows the other one, but not below it.
            c.lowering[0] = left < -SET_DOWN or (math.isnan(left) and right < -SET_DOWN and lead > 0.0)
            c.lowering[1] = right < -SET_DOWN or (math.isnan(right) and left < -SET_DOWN and lead < 0.0)
            c.grip = Grip.LOWERING.value if c.lowering[0] or c.lowering[1] else Grip.OPEN.value
