"""The bench at rest: forces of its actuators, its heights without air, and its complete state.

These functions are not compiled here, because an FMU of the bench compiles them itself.
"""

from typing import Any

from bench_sim.model.actuator import hold_setpoint
from bench_sim.model.layout import ACTUATORS, SIDES, State
from bench_sim.model.rest import fill_chamber, relax_rubber, settled_temperature
from bench_sim.model.spring import stretch, volume


def rest_forces(par: Any) -> tuple[float, float, float]:
    """Return the three actuator forces (N) with which springs at design height carry their preload."""
    left, right = par.nominal_preload[0], par.nominal_preload[1]
    total = left + right - par.bolster_mass * par.gravity
    difference = (left - right) * par.spring_half_spacing / par.actuator_half_spacing
    return 0.5 * (total + difference), 0.5 * (total - difference), 0.0


def seated_height(par: Any, side: int) -> tuple[float, float]:
    """Return the height of one bellows and the height of its complete spring (m), without air, under the weight of
    the bolster alone.
    """
    weight = 0.5 * par.bolster_mass * par.gravity
    shell = par.shell_stiffness_vertical[side]
    bellows = (par.contact_stiffness * par.contact_height - weight) / (shell + par.contact_stiffness)
    if shell > 0.0:
        bellows = max(bellows, -weight / shell)
    height = bellows
    if par.emergency_spring != 0.0:
        height -= (weight - par.nominal_preload[side]) / par.emergency_stiffness_vertical[side]
    return bellows, height


def settle_bench(x: Any, mem: Any, par: Any, bellows: Any, height: Any, pressure: Any, supply: float) -> None:
    """Write the state of a bench at rest to ``x`` and ``mem``. Rubber is relaxed, and the gas is at wall temperature.

    ``bellows`` and ``height`` (m) and ``pressure`` (Pa absolute) have one value for each side. ``supply`` is the
    pressure of the supply line (Pa absolute). The actuator commands are assumed to have been constant for a long time.
    """
    T = settled_temperature(par)
    x[State.BOLSTER_VERTICAL] = 0.5 * (height[0] + height[1])
    x[State.BOLSTER_ROLL] = 0.5 * (height[0] - height[1]) / par.spring_half_spacing
    x[State.SUPPLY_LINE] = supply
    for side in range(SIDES):
        held = volume(par, side, bellows[side], 0.0) + stretch(par, side, bellows[side], pressure[side])
        fill_chamber(x, par, State.BELLOWS_MASS + side, pressure[side], held, T)
        fill_chamber(x, par, State.AUXILIARY_MASS + side, pressure[side], par.auxiliary_volume[side], T)
        x[State.BELLOWS_WALL + side] = x[State.AUXILIARY_WALL + side] = T
        x[State.LEVER + side] = height[side] + par.lever_offset[side]
        relax_rubber(x, mem, side, bellows[side], 0.0)
    for j in range(ACTUATORS):
        hold_setpoint(mem, j, x[State.ACTUATOR + j])
