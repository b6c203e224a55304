"""Rubber: Berg's friction, and the generalised Maxwell model whose states are the positions of its dash-pots.

A Maxwell branch with spring k_j and time constant τ_j carries k_j q_j, dq_j/dt = dx/dt − q_j/τ_j. With the dash-pot
position w_j = x − q_j as the state, dw_j/dt = (x − w_j)/τ_j needs no speed.
"""

from typing import Any

from bench_sim.model.algebraic import Algebraic
from bench_sim.model.compiled import compiled
from bench_sim.model.layout import BRANCHES, EXTRA_BRANCHES, EXTRA_DASHPOTS, EXTRA_FRICTIONS, State


@compiled
def friction_curve(x: float, origin: float, level: float, travel: float) -> tuple[float, float]:
    """Return the normalised friction force F/F_max and its slope in 1/m, by Berg (1998).

    The curve starts at the last reversal x_s = ``origin`` with α = ``level`` = F_s/F_max; x₂ is ``travel``. For x >
    x_s it is α + (x−x_s)/(x₂(1−α) + x−x_s) · (1−α). For x < x_s the signs are reversed.
    """
    s = x - origin
    sense = 1.0 if s >= 0.0 else -1.0
    rest = 1.0 - sense * level
    d = max(travel * rest, 1e-12)
    per_n = 1.0 / (d + abs(s))
    return level + s * per_n * rest, rest * d * per_n * per_n


@compiled
def friction_limit(constant: float, slope: float, gauge: float) -> float:
    """Return F_max = F_0 + F_1 p_g in N, with F_0 = ``constant`` (N) and F_1 = ``slope`` (N/Pa). A negative gauge
    pressure counts as 0.
    """
    return constant + slope * max(gauge, 0.0)


@compiled
def relaxing(stiffness: float, ratios: float, held: float, displacement: float) -> float:
    """Return the force Σ k_j (x − w_j) in N, with k_j = r_j k. ``ratios`` is Σ r_j, ``held`` is Σ r_j w_j in m."""
    return stiffness * (ratios * displacement - held)


@compiled
def dashpot_speed(displacement: float, dashpot: float, per_time: float) -> float:
    """Return dw/dt = (x − w)/τ in m/s. ``per_time`` is 1/τ."""
    return (displacement - dashpot) * per_time


@compiled
def creep_speed(force: float, creep: float, gain: float, per_time: float) -> float:
    """Return dq/dt = (r F_z/k_es − q)/τ in m/s. ``gain`` is r/k_es, ``per_time`` is 1/τ."""
    return per_time * (gain * force - creep)


@compiled
def maxwell_pull(x: Any, par: Any, first: int, stiffness: float, displacement: float) -> tuple[float, float]:
    """Return the force of all Maxwell branches in N and their total stiffness in N/m. ``first`` is the index of the
    first dash-pot.
    """
    ratios = 0.0
    held = 0.0
    for j in range(BRANCHES):
        ratios += par.maxwell_ratio[j]
        held += par.maxwell_ratio[j] * x[first + j]
    return relaxing(stiffness, ratios, held, displacement), stiffness * ratios


@compiled
def extra_pull(
    x: Any, mem: Any, par: Any, direction: int, side: int, stiffness: float, displacement: float
) -> tuple[float, float]:
    """Return force in N and tangent stiffness in N/m of the extra branches and friction elements of one bellows.

    ``direction`` is 0 for vertical, 1 for lateral. All friction elements reverse together with the friction of the
    spring.
    """
    ratios = 0.0
    held = 0.0
    first = State.EXTRA_VERTICAL_DASHPOT + 2 * direction + side
    for j in range(EXTRA_BRANCHES):
        if par.extra_branch_ratio[j] == 0.0:
            break
        ratios += par.extra_branch_ratio[j]
        held += par.extra_branch_ratio[j] * x[first + EXTRA_DASHPOTS * j]
    force = relaxing(stiffness, ratios, held, displacement)
    total = stiffness * ratios
    for e in range(EXTRA_FRICTIONS):
        if par.extra_friction[e] == 0.0:
            break
        f, slope = friction_curve(
            displacement,
            mem.friction_origin[direction, side],
            mem.extra_friction_level[e, direction, side],
            par.extra_friction_travel[e],
        )
        force += par.extra_friction[e] * f
        total += par.extra_friction[e] * slope
    return force, total


@compiled
def maxwell_term(x: Any, par: Any, out: Any, dx: Any) -> None:
    """Add dw_j/dt = (x_b − w_j)/τ_j for every branch, spring and direction. Write the resulting rates of the forces
    (N/s).
    """
    for i in range(2):
        vertical_rate = 0.0
        lateral_rate = 0.0
        for j in range(BRANCHES):
            vertical = State.VERTICAL_DASHPOT + i * BRANCHES + j
            lateral = State.LATERAL_DASHPOT + i * BRANCHES + j
            speed = 1.0 / par.maxwell_time[j]
            z_speed = dashpot_speed(out[Algebraic.BELLOWS_VERTICAL + i], x[vertical], speed)
            y_speed = dashpot_speed(out[Algebraic.BELLOWS_LATERAL + i], x[lateral], speed)
            vertical_rate += par.maxwell_ratio[j] * z_speed
            lateral_rate += par.maxwell_ratio[j] * y_speed
            dx[vertical] += z_speed
            dx[lateral] += y_speed
        if par.extra_branch_ratio[0] != 0.0:
            for j in range(EXTRA_BRANCHES):
                if par.extra_branch_ratio[j] == 0.0:
                    break
                vertical = State.EXTRA_VERTICAL_DASHPOT + EXTRA_DASHPOTS * j + i
                lateral = State.EXTRA_LATERAL_DASHPOT + EXTRA_DASHPOTS * j + i
                speed = 1.0 / par.extra_branch_time[j]
                z_speed = dashpot_speed(out[Algebraic.BELLOWS_VERTICAL + i], x[vertical], speed)
                y_speed = dashpot_speed(out[Algebraic.BELLOWS_LATERAL + i], x[lateral], speed)
                vertical_rate += par.extra_branch_ratio[j] * z_speed
                lateral_rate += par.extra_branch_ratio[j] * y_speed
                dx[vertical] = z_speed
                dx[lateral] = y_speed
        out[Algebraic.DASHPOT_VERTICAL + i] = par.shell_stiffness_vertical[i] * vertical_rate
        out[Algebraic.DASHPOT_LATERAL + i] = par.shell_stiffness_lateral[i] * lateral_rate


@compiled
def creep_term(x: Any, par: Any, out: Any, dx: Any) -> None:
    """Add the creep rate of the emergency spring (`creep_speed`) to the derivatives."""
    for i in range(2):
        if par.creep_ratio[i] != 0.0:
            gain = par.creep_ratio[i] / par.emergency_stiffness_vertical[i]
            F_z = out[Algebraic.STACK_VERTICAL + i]
            dx[State.CREEP + i] += creep_speed(F_z, x[State.CREEP + i], gain, 1.0 / par.creep_time[i])


@compiled
def reversal(
    position: float, last: float, speed: float, last_speed: float, dt: float, direction: float
) -> tuple[float, bool]:
    """Return the position of a friction reversal between two samples, and whether there was one.

    Positions are in m, speeds in m/s; ``direction`` (1 or −1) is that of the motion before. The position of the
    reversal is the vertex of the parabola through the last position with both speeds.
    """
    if (position - last) * direction >= 0.0:
        return last, False
    if last_speed * direction > 0.0 and speed * direction < 0.0:
        return last + 0.5 * dt * last_speed * last_speed / (last_speed - speed), True
    return last, True


@compiled
def turn_friction(
    mem: Any,
    par: Any,
    direction: int,
    side: int,
    position: float,
    speed: float,
    last_speed: float,
    travel: float,
    dt: float,
) -> bool:
    """Update the friction memory of one spring in one ``direction`` (0 vertical, 1 lateral) after a step of ``dt`` s.
    Return whether the friction curve changed. ``travel`` is x₂ of `friction_curve` in m.

    The stored level is F/F_max. A stored force could later exceed its limit, which changes with pressure. In Berg's
    law every reversal begins a new curve and deletes the old one. A vibration of a nanometre could then change the
    later force by a third of its limit. In real rubber the previous curve continues after a small loop (Madelung
    1905). A loop is small if its travel is less than the share ``friction_small_loop`` of x₂. With a share of 1/25 and
    a force of half the limit, the return to the previous curve changes the force by 1/580 of its limit. With a share
    of 0 every reversal begins a new curve.
    """
    last = mem.friction_last[direction, side]
    if abs(position - last) < 1e-12:  # a rounding error is not a motion
        return False
    way = mem.friction_outer_way[direction, side]
    if way != 0.0:
        beyond = way * (position - mem.friction_outer_turn[direction, side])
        if beyond >= 0.0:
            _resume(mem, direction, side)
            mem.friction_direction[direction, side] = way
            mem.friction_last[direction, side] = position
            return True
        if -beyond > par.friction_small_loop * travel:
            mem.friction_outer_way[direction, side] = 0.0
    turn, turned = reversal(position, last, speed, last_speed, dt, mem.friction_direction[direction, side])
    if turned:
        if par.friction_small_loop > 0.0 and mem.friction_outer_way[direction, side] == 0.0:
            _remember(mem, direction, side, turn)
        level, _ = friction_curve(
            turn, mem.friction_origin[direction, side], mem.friction_level[direction, side], travel
        )
        for e in range(EXTRA_FRICTIONS):
            if par.extra_friction[e] == 0.0:
                break
            mem.extra_friction_level[e, direction, side], _ = friction_curve(
                turn,
                mem.friction_origin[direction, side],
                mem.extra_friction_level[e, direction, side],
                par.extra_friction_travel[e],
            )
        mem.friction_origin[direction, side] = turn
        mem.friction_level[direction, side] = level
    mem.friction_direction[direction, side] = 1.0 if position > last else -1.0
    mem.friction_last[direction, side] = position
    return turned


@compiled
def _remember(mem: Any, direction: int, side: int, turn: float) -> None:
    """Store the present friction curve, which a reversal at ``turn`` interrupts."""
    mem.friction_outer_way[direction, side] = mem.friction_direction[direction, side]
    mem.friction_outer_turn[direction, side] = turn
    mem.friction_outer_origin[direction, side] = mem.friction_origin[direction, side]
    mem.friction_outer_level[direction, side] = mem.friction_level[direction, side]
    for e in range(EXTRA_FRICTIONS):
        mem.extra_friction_outer_level[e, direction, side] = mem.extra_friction_level[e, direction, side]


@compiled
def _resume(mem: Any, direction: int, side: int) -> None:
    """Continue the stored friction curve, which a small loop has interrupted."""
    mem.friction_outer_way[direction, side] = 0.0
    mem.friction_origin[direction, side] = mem.friction_outer_origin[direction, side]
    mem.friction_level[direction, side] = mem.friction_outer_level[direction, side]
    for e in range(EXTRA_FRICTIONS):
        mem.extra_friction_level[e, direction, side] = mem.extra_friction_outer_level[e, direction, side]
