"""The right-hand side of eight springs at the same time (`bench_sim.model.lanes.layout`), without branches.

Theory of operation
-------------------
The laws are functions of numbers in `bench_sim.model.bellows`, `rubber`, `gas`, `orifice`, `valves` and `surface`, the
same as in `bench_sim.model.air_spring`; this module provides their arguments. Every loop over the lanes becomes vector
instructions. For this, missing parts of a spring add 0, and r^(1/κ) of the nozzle is a polynomial, accurate to 3e-15
if the nozzle is not choked. The compiler would write out a loop over `LANES` with a short body eight times, without
vector instructions. A loop over ``w.shape[0] // PER_LANE`` becomes vector instructions.
"""

from typing import Any, NamedTuple

from bench_sim.model.bellows import bellows_speeds
from bench_sim.model.compiled import compiled, compiled_once
from bench_sim.model.gas import density_series, heat_inward, upstream_enthalpy, wall_speed
from bench_sim.model.inertance import missing_flow
from bench_sim.model.lanes.algebra import lane_algebra, tangent_of
from bench_sim.model.lanes.layout import (
    EXTRA_RATIO,
    EXTRA_SPEED,
    LANES,
    PER_LANE,
    SLOPE,
    STAGE,
    Lane,
    LaneState,
)
from bench_sim.model.lanes.valves import feed, join
from bench_sim.model.orifice import mass_flow, nozzle_root, one_way, reynolds_factor, upstream
from bench_sim.model.rubber import creep_speed, dashpot_speed
from bench_sim.model.surface import surface_flow, surface_heat
from bench_sim.model.valves import leak_flow


class ActiveTerms(NamedTuple):
    """The terms that are active in at least one lane. Other terms are skipped."""

    extra: int  #: largest number of extra rubber branches in a lane
    frictions: int  #: largest number of extra friction elements in a lane
    inert: bool  #: the air in a connection has inertia
    leaking: bool  #: a bellows leaks
    surfaces: bool  #: an unknown flow or heat is fitted as a surface
    fed: bool  #: a spring is connected with the supply or the atmosphere
    joined: (
        bool  #: air may flow between left springs (first half of the lanes) and right springs (second half)
    )


@compiled
def _power(w: Any, i: int, t: float) -> float:
    """Return r^(1/κ) of one lane. ``t`` is −1 at the critical pressure ratio and 1 at ratio 1.

    The even and the odd powers of the polynomial are computed separately.
    """
    square = t * t
    even = w[Lane.POWER + 18 * LANES + i]
    odd = w[Lane.POWER + 17 * LANES + i]
    even = even * square + w[Lane.POWER + 16 * LANES + i]
    odd = odd * square + w[Lane.POWER + 15 * LANES + i]
    even = even * square + w[Lane.POWER + 14 * LANES + i]
    odd = odd * square + w[Lane.POWER + 13 * LANES + i]
    even = even * square + w[Lane.POWER + 12 * LANES + i]
    odd = odd * square + w[Lane.POWER + 11 * LANES + i]
    even = even * square + w[Lane.POWER + 10 * LANES + i]
    odd = odd * square + w[Lane.POWER + 9 * LANES + i]
    even = even * square + w[Lane.POWER + 8 * LANES + i]
    odd = odd * square + w[Lane.POWER + 7 * LANES + i]
    even = even * square + w[Lane.POWER + 6 * LANES + i]
    odd = odd * square + w[Lane.POWER + 5 * LANES + i]
    even = even * square + w[Lane.POWER + 4 * LANES + i]
    odd = odd * square + w[Lane.POWER + 3 * LANES + i]
    even = even * square + w[Lane.POWER + 2 * LANES + i]
    odd = odd * square + w[Lane.POWER + 1 * LANES + i]
    return even * square + w[Lane.POWER + i] + odd * t


@compiled
def orifice(w: Any) -> None:
    """Compute the flow between bellows and auxiliary chamber from the pressures."""
    for i in range(LANES):
        R = w[Lane.GAS_CONSTANT + i]
        p_b = w[Lane.PRESSURE + i]
        p_a = w[Lane.AUXILIARY_PRESSURE + i]
        T_b = w[Lane.TEMPERATURE + i]
        T_a = w[Lane.AUXILIARY_TEMPERATURE + i]
        sense, p_up, T_up, p_down = upstream(p_b, T_b, p_a, T_a)
        r = p_down / p_up
        low = w[Lane.CRITICAL + i]
        inside = max(r, low)
        q = _power(w, i, (inside - 0.5 * (1.0 + low)) / (0.5 * (1.0 - low)))
        psi = nozzle_root(q, inside, w[Lane.PSI_FACTOR + i])
        psi = w[Lane.PSI_LAMINAR + i] * (1.0 - r) if r > w[Lane.LAMINAR + i] else psi
        area = w[Lane.OPENING + i] * w[Lane.ORIFICE + i] * one_way(w[Lane.ASYMMETRY + i], p_b - p_a)
        w[Lane.PASSAGE + i] = area
        G = mass_flow(area, p_up, T_up, R, psi)
        w[Lane.FLOW + i] = (
            sense * G * reynolds_factor(w[Lane.REYNOLDS_PER_FLOW + i] * G, w[Lane.REYNOLDS + i])
        )


@compiled
def hold_back(w: Any, ahead: float, parameters: Any) -> None:
    """Delay the flow by the inertia of the air, lane by lane (`bench_sim.model.inertance`)."""
    for i in range(LANES):
        steady = w[Lane.FLOW + i]
        w[Lane.STEADY_FLOW + i] = steady
        if w[Lane.INERTANCE + i] > 0.0 and w[Lane.OPENING + i] > 0.0:
            w[Lane.FLOW + i] -= missing_flow(
                ahead,
                w[Lane.NOTED_STEADY_FLOW + i],
                w[Lane.NOTED_MISSING_FLOW + i],
                steady,
                w[Lane.PRESSURE + i],
                w[Lane.TEMPERATURE + i],
                w[Lane.AUXILIARY_PRESSURE + i],
                w[Lane.AUXILIARY_TEMPERATURE + i],
                w[Lane.PASSAGE + i],
                w[Lane.INERTANCE + i],
                parameters[i],
            )


@compiled
def carry(w: Any) -> None:
    """Set the derivatives of masses and energies to the flow through the orifice and its enthalpy. Other terms add to
    them.
    """
    for i in range(LANES):
        c_p = w[Lane.HEAT_CAPACITY + i]
        G = w[Lane.FLOW + i]
        h = G * upstream_enthalpy(G, w[Lane.TEMPERATURE + i], w[Lane.AUXILIARY_TEMPERATURE + i], c_p)
        w[SLOPE + LaneState.MASS + i] = -G
        w[SLOPE + LaneState.AUXILIARY_MASS + i] = G
        w[Lane.HEATING + i] = -h
        w[SLOPE + LaneState.AUXILIARY_ENERGY + i] = h


@compiled
def leak(w: Any) -> None:
    """Subtract the leaks of the bellows to the atmosphere."""
    lanes = w.shape[0] // PER_LANE
    for i in range(lanes):
        G, power = leak_flow(
            w[Lane.PRESSURE + i],
            w[Lane.TEMPERATURE + i],
            w[Lane.ATMOSPHERE + i],
            w[Lane.AMBIENT + i],
            w[Lane.LEAK + i],
            w[Lane.LEAK_CRITICAL + i],
            w[Lane.LEAK_LAMINAR + i],
            w[Lane.LAMINAR + i],
            w[Lane.HEAT_CAPACITY + i],
        )
        w[SLOPE + LaneState.MASS + i] -= G
        w[Lane.HEATING + i] -= power


@compiled
def heat(w: Any) -> None:
    """Add the heat exchange of both chambers with their walls."""
    for i in range(LANES):
        exponent = w[Lane.HEAT_EXPONENT + i]
        known = w[Lane.DENSITY + i] * w[Lane.VOLUME + i]
        ratio = w[STAGE + LaneState.MASS + i] / known
        factor = density_series(ratio, w[Lane.DENSITY_FACTOR + i], exponent)
        wall, outer, per_C = w[STAGE + LaneState.WALL + i], w[Lane.WALL_OUTER + i], w[Lane.WALL_RATE + i]
        inward = heat_inward(w[Lane.HEAT + i] * factor, wall, w[Lane.TEMPERATURE + i])
        w[Lane.HEATING + i] += inward
        w[SLOPE + LaneState.WALL + i] = wall_speed(inward, wall, outer, w[Lane.AMBIENT + i], per_C)
        known = w[Lane.AUXILIARY_DENSITY + i] * w[Lane.AUXILIARY_VOLUME + i]
        ratio = w[STAGE + LaneState.AUXILIARY_MASS + i] / known
        factor = density_series(ratio, w[Lane.AUXILIARY_DENSITY_FACTOR + i], exponent)
        wall = w[STAGE + LaneState.AUXILIARY_WALL + i]
        inward = heat_inward(w[Lane.AUXILIARY_HEAT + i] * factor, wall, w[Lane.AUXILIARY_TEMPERATURE + i])
        w[SLOPE + LaneState.AUXILIARY_ENERGY + i] += inward
        w[SLOPE + LaneState.AUXILIARY_WALL + i] = wall_speed(inward, wall, outer, w[Lane.AMBIENT + i], per_C)


@compiled
def gas_surfaces(w: Any, parameters: Any) -> None:
    """Add the flow and heat of fitted surfaces (unknown flow or heat as a function of two states), lane by lane."""
    for i in range(LANES):
        par = parameters[i]
        p, T = w[Lane.PRESSURE + i], w[Lane.TEMPERATURE + i]
        flow = surface_flow(par, w[Lane.OPENING + i], p, w[Lane.AUXILIARY_PRESSURE + i])
        h = flow * upstream_enthalpy(flow, T, w[Lane.AUXILIARY_TEMPERATURE + i], w[Lane.HEAT_CAPACITY + i])
        w[SLOPE + LaneState.MASS + i] -= flow
        w[SLOPE + LaneState.AUXILIARY_MASS + i] += flow
        w[SLOPE + LaneState.AUXILIARY_ENERGY + i] += h
        w[Lane.HEATING + i] += surface_heat(par, p, T) - h


@compiled
def relax(w: Any, extra: int) -> None:
    """Write the rates of the rubber's dash-pots, of the forces by relaxation, and of the creep of the emergency
    spring.
    """
    lanes = w.shape[0] // PER_LANE
    for i in range(lanes):
        z, y = w[Lane.BELLOWS_Z + i], w[Lane.BELLOWS_Y + i]
        r_1, r_2, r_3 = w[Lane.RATIO + i], w[Lane.RATIO_2 + i], w[Lane.RATIO_3 + i]
        rate_1, rate_2, rate_3 = w[Lane.SPEED + i], w[Lane.SPEED_2 + i], w[Lane.SPEED_3 + i]
        a = dashpot_speed(z, w[STAGE + LaneState.DASHPOT_Z + i], rate_1)
        b = dashpot_speed(z, w[STAGE + LaneState.DASHPOT_Z_2 + i], rate_2)
        c = dashpot_speed(z, w[STAGE + LaneState.DASHPOT_Z_3 + i], rate_3)
        w[SLOPE + LaneState.DASHPOT_Z + i] = a
        w[SLOPE + LaneState.DASHPOT_Z_2 + i] = b
        w[SLOPE + LaneState.DASHPOT_Z_3 + i] = c
        w[Lane.RATE_Z + i] = r_1 * a + r_2 * b + r_3 * c
        a = dashpot_speed(y, w[STAGE + LaneState.DASHPOT_Y + i], rate_1)
        b = dashpot_speed(y, w[STAGE + LaneState.DASHPOT_Y_2 + i], rate_2)
        c = dashpot_speed(y, w[STAGE + LaneState.DASHPOT_Y_3 + i], rate_3)
        w[SLOPE + LaneState.DASHPOT_Y + i] = a
        w[SLOPE + LaneState.DASHPOT_Y_2 + i] = b
        w[SLOPE + LaneState.DASHPOT_Y_3 + i] = c
        w[Lane.RATE_Y + i] = r_1 * a + r_2 * b + r_3 * c
        w[SLOPE + LaneState.CREEP + i] = creep_speed(
            w[Lane.STACK_Z + i],
            w[STAGE + LaneState.CREEP + i],
            w[Lane.CREEP_GAIN + i],
            w[Lane.CREEP_RATE + i],
        )
    for e in range(extra):
        first = LaneState.EXTRA + 2 * LANES * e
        for i in range(lanes):
            r, rate = w[EXTRA_RATIO + LANES * e + i], w[EXTRA_SPEED + LANES * e + i]
            a = dashpot_speed(w[Lane.BELLOWS_Z + i], w[STAGE + first + i], rate)
            b = dashpot_speed(w[Lane.BELLOWS_Y + i], w[STAGE + first + LANES + i], rate)
            w[SLOPE + first + i] = a
            w[SLOPE + first + LANES + i] = b
            w[Lane.RATE_Z + i] += r * a
            w[Lane.RATE_Y + i] += r * b


@compiled
def work(w: Any) -> None:
    """Subtract the work p dV/dt of the bellows. This is last because the speed of the bellows depends on all other
    terms.
    """
    for i in range(LANES):
        A, B, per_z, per_y, K_zz, K_zy, K_yy = tangent_of(w, i)
        kappa = w[Lane.HEAT_RATIO + i]
        p = w[Lane.PRESSURE + i]
        z_speed, y_speed, V_rate = bellows_speeds(
            w[Lane.HEIGHT_SPEED + i] + w[SLOPE + LaneState.CREEP + i],
            w[Lane.LATERAL_SPEED + i],
            w[Lane.SHELL_Z + i] * w[Lane.RATE_Z + i],
            w[Lane.SHELL_Y + i] * w[Lane.RATE_Y + i],
            (kappa - 1.0) * w[Lane.HEATING + i],
            p,
            w[Lane.VOLUME + i],
            w[Lane.STRETCH + i] + 2.0 * w[Lane.GROWTH + i] * w[Lane.BELLOWS_Z + i],
            kappa,
            A,
            B,
            per_z,
            per_y,
            K_zz,
            K_zy,
            K_yy,
            w[Lane.GIVE_Z + i],
            w[Lane.GIVE_Y + i],
        )
        w[Lane.BELLOWS_Z_SPEED + i] = z_speed
        w[Lane.BELLOWS_Y_SPEED + i] = y_speed
        w[SLOPE + LaneState.ENERGY + i] = w[Lane.HEATING + i] - p * V_rate


@compiled_once
def lane_slope(w: Any, ahead: float, active: Any, sides: Any, memory: Any, parameters: Any) -> None:
    """Write dx/dt of all lanes, ``ahead`` s after the start of the step, and all values that follow from the states.

    Rarely used values have no rows in ``w``. They are read from ``memory`` and ``parameters``, for the ``sides`` of
    the springs (LANES each).
    """
    lane_algebra(w, ahead, active.extra, active.frictions)
    orifice(w)
    if active.inert:
        hold_back(w, ahead, parameters)
    carry(w)
    if active.fed:
        feed(w, sides, memory, parameters)
    if active.joined:
        join(w, memory, parameters)
    if active.leaking:
        leak(w)
    heat(w)
    if active.surfaces:
        gas_surfaces(w, parameters)
    relax(w, active.extra)
    work(w)
