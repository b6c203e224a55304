"""Servo-hydraulic actuators: force or displacement control of second order behind a delay, on a compliant frame.

In each mode one state q follows the delayed set-point, d²q/dt² = ω²(q_set − q) − 2ζω dq/dt. Under force control (and
OFF, which is force control to zero with a slow ramp) q is the force. Under displacement control q is the piston, and
frame and oil act as a spring between piston and bolster: F = k (q − d) + c (dq/dt − dd/dt), limited by the supply
pressure.
"""

from math import pi
from typing import Any

from bench_sim.model.algebraic import Algebraic
from bench_sim.model.compiled import compiled
from bench_sim.model.layout import ACTUATORS, DELAY_CAPACITY, LATERAL, Input, Mode, State


@compiled
def actuator_sense(actuator: int) -> float:
    """Return the sign of the bolster motion under a positive force: +1 for the lateral actuator. It is −1 for the
    vertical actuators, because they push down.
    """
    return 1.0 if actuator == LATERAL else -1.0


@compiled
def bolster_point(x: Any, par: Any, actuator: int) -> tuple[float, float]:
    """Return displacement (m) and speed (m/s) of the bolster where the actuator is attached; up and left are
    positive.
    """
    if actuator == LATERAL:
        arm = -par.lateral_actuator_height
        place = State.BOLSTER_LATERAL
    else:
        arm = (1.0 - 2.0 * actuator) * par.actuator_half_spacing
        place = State.BOLSTER_VERTICAL
    # The index of a speed is that of its displacement plus 3.
    return (
        x[place] + arm * x[State.BOLSTER_ROLL],
        x[place + 3] + arm * x[State.BOLSTER_ROLL_SPEED],
    )


@compiled
def actuator_force(x: Any, mem: Any, par: Any, j: int, d: float, d_speed: float) -> float:
    """Return the force of one actuator on the bolster in N, including the cushion at the end of the stroke. A positive
    force pushes down (vertical actuators) or to the left (lateral). ``d`` (m) and ``d_speed`` (m/s) are from
    `bolster_point`.
    """
    sense = actuator_sense(j)
    q = x[State.ACTUATOR + j]
    if mem.mode[j] == Mode.DISPLACEMENT:
        q = sense * (
            par.frame_stiffness[j] * (q - d) + par.frame_damping[j] * (x[State.ACTUATOR_RATE + j] - d_speed)
        )
    force = min(max(q, -par.actuator_force_limit[j]), par.actuator_force_limit[j])
    stroke = par.actuator_stroke[j]
    beyond = d - min(max(d, -stroke), stroke)
    if beyond != 0.0:
        # The cushion brakes only while the piston moves into it.
        braking = par.frame_damping[j] * d_speed if beyond * d_speed > 0.0 else 0.0
        force -= sense * (par.frame_stiffness[j] * beyond + braking)
    return force


@compiled
def actuator_term(x: Any, mem: Any, par: Any, out: Any, dx: Any) -> None:
    """Add the dynamics of the three actuators to ``dx``. Add their forces (N) to the sums for the bolster in ``dx``,
    which `bolster_term` divides by the mass.

    Write force (N), displacement (m) and speed (m/s) of each actuator to ``out``.
    """
    for j in range(ACTUATORS):
        omega = 2.0 * pi * par.actuator_frequency[j]
        rate = x[State.ACTUATOR_RATE + j]
        dx[State.ACTUATOR + j] += rate
        dx[State.ACTUATOR_RATE + j] += omega * (
            omega * (mem.delayed[j] - x[State.ACTUATOR + j]) - 2.0 * par.actuator_damping[j] * rate
        )
        d, d_speed = bolster_point(x, par, j)
        force = actuator_force(x, mem, par, j, d, d_speed)
        out[Algebraic.ACTUATOR_FORCE + j] = force
        out[Algebraic.ACTUATOR_DISPLACEMENT + j] = d
        out[Algebraic.ACTUATOR_SPEED + j] = d_speed
        if j == LATERAL:
            dx[State.BOLSTER_LATERAL_SPEED] += force
            dx[State.BOLSTER_ROLL_SPEED] -= par.lateral_actuator_height * force
        else:
            dx[State.BOLSTER_VERTICAL_SPEED] -= force
            dx[State.BOLSTER_ROLL_SPEED] -= (1.0 - 2.0 * j) * par.actuator_half_spacing * force


@compiled
def piston_displacement(x: Any, mem: Any, par: Any, j: int, force: float, d: float) -> float:
    """Return the reading of the displacement transducer in the actuator, in m. It contains the deflection of the frame.
    ``force`` is from `actuator_force` (N), ``d`` from `bolster_point` (m).
    """
    if mem.mode[j] == Mode.DISPLACEMENT:
        return x[State.ACTUATOR + j]
    return d + actuator_sense(j) * force / par.frame_stiffness[j]


@compiled
def relief_speed(x: Any, mem: Any, par: Any, j: int) -> float:
    """Return the speed (m/s) of a piston whose valve is closed. It is 0 up to the force at which the relief valves
    open.
    """
    d, d_speed = bolster_point(x, par, j)
    force = actuator_force(x, mem, par, j, d, d_speed)
    beyond = force - min(max(force, -par.actuator_relief_force[j]), par.actuator_relief_force[j])
    return -actuator_sense(j) * par.actuator_relief_flow[j] * beyond


@compiled
def hold_setpoint(mem: Any, j: int, value: float) -> None:
    """Set the set-point (m or N) and fill its delay line with it, as if the set-point had always been constant."""
    mem.setpoint[j] = value
    mem.delayed[j] = value
    for k in range(DELAY_CAPACITY):
        mem.delay_line[j, k] = value


@compiled
def change_mode(x: Any, mem: Any, par: Any, j: int, mode: int) -> None:
    """Change the control mode without a jump: the force stays the same. The set-point starts at the present position
    or force.
    """
    d, d_speed = bolster_point(x, par, j)
    force = actuator_force(x, mem, par, j, d, d_speed)
    was = mem.mode[j]
    mem.mode[j] = mode
    if mode == Mode.DISPLACEMENT and was != Mode.DISPLACEMENT:
        q = d + actuator_sense(j) * force / par.frame_stiffness[j]
        x[State.ACTUATOR + j] = q
        x[State.ACTUATOR_RATE + j] = d_speed
        hold_setpoint(mem, j, q)
    elif mode != Mode.DISPLACEMENT and was == Mode.DISPLACEMENT:
        x[State.ACTUATOR + j] = force
        x[State.ACTUATOR_RATE + j] = 0.0
        hold_setpoint(mem, j, force)


@compiled
def command_actuators(x: Any, mem: Any, u: Any, par: Any, dt: float) -> None:
    """Update control modes and set-points of all actuators, once per step of ``dt`` s. Set-points are limited in size
    and rate, and delayed.
    """
    head = mem.step % DELAY_CAPACITY
    for j in range(ACTUATORS):
        mode = int(u[Input.VERTICAL_LEFT_MODE + j])
        target = u[Input.VERTICAL_LEFT_COMMAND + j]
        shut_in = mode == Mode.SHUT_IN
        if shut_in:
            mode = Mode.DISPLACEMENT.value  # the oil column is as stiff with its valve closed
        if mode != mem.mode[j]:
            change_mode(x, mem, par, j, mode)
        if shut_in:
            target = mem.setpoint[j] + (target + relief_speed(x, mem, par, j)) * dt
        if mode == Mode.DISPLACEMENT:
            limit = par.actuator_stroke[j]
            slew = par.actuator_speed_limit[j]
        elif mode == Mode.FORCE:
            limit = par.actuator_force_limit[j]
            slew = par.actuator_force_rate[j]
        else:
            limit = 0.0
            slew = par.actuator_unload_rate[j]
        target = min(max(target, -limit), limit)
        mem.setpoint[j] += min(max(target - mem.setpoint[j], -slew * dt), slew * dt)
        mem.delay_line[j, head] = mem.setpoint[j]
        behind = min(int(par.actuator_delay[j] / dt + 0.5), DELAY_CAPACITY - 1)
        mem.delayed[j] = mem.delay_line[j, (mem.step - behind) % DELAY_CAPACITY]
