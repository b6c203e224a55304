"""Actions at the start of each step: valves switch, friction reverses, and the memory is updated.

Their results are constant within a step, so the right-hand side is smooth during the integration.
"""

from typing import Any

from bench_sim.model.algebraic import Algebraic
from bench_sim.model.compiled import compiled, compiled_within
from bench_sim.model.gas import note_densities
from bench_sim.model.rubber import turn_friction
from bench_sim.model.valves import note_flows, switch_valves


@compiled
def note_solution(mem: Any, par: Any, out: Any) -> bool:
    """Store the motion of the bellows and the flows for the next step, and update the friction. Return whether any
    friction curve has changed.
    """
    note_flows(mem, par, out)
    turned = False
    dt = mem.time - mem.solved_time
    for i in range(2):
        z = out[Algebraic.BELLOWS_VERTICAL + i]
        y = out[Algebraic.BELLOWS_LATERAL + i]
        z_speed = out[Algebraic.BELLOWS_VERTICAL_SPEED + i]
        y_speed = out[Algebraic.BELLOWS_LATERAL_SPEED + i]
        if turn_friction(
            mem, par, 0, i, z, z_speed, mem.bellows_vertical_speed[i], par.friction_vertical_travel[i], dt
        ):
            turned = True
        if turn_friction(
            mem, par, 1, i, y, y_speed, mem.bellows_lateral_speed[i], par.friction_lateral_travel[i], dt
        ):
            turned = True
        mem.bellows_vertical[i] = z
        mem.bellows_lateral[i] = y
        mem.bellows_vertical_speed[i] = z_speed
        mem.bellows_lateral_speed[i] = y_speed
    mem.solved_time = mem.time
    return turned


@compiled_within
def begin(slope: Any, x: Any, mem: Any, u: Any, par: Any, given: Any, dx: Any, out: Any) -> None:
    """Switch valves and friction at ``mem.time``, and write the slope after this to ``dx``.

    ``slope`` and ``given`` are those of `bench_sim.model.runge_kutta`.
    """
    switch_valves(x, mem, par)
    slope(0.0, x, mem, u, par, given, dx, out)
    if note_solution(mem, par, out):
        slope(0.0, x, mem, u, par, given, dx, out)
    note_densities(x, mem, par, out)
