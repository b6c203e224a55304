"""The right-hand side of eight springs in lock-step (`bench_sim.model.lane_layout`), without branches.

Theory of operation
-------------------
The equations are those of `bench_sim.model.air_spring` for one side each: `bench_sim.model.spring`, `rubber`, `gas`,
`valves` and `surface`, whose scalar form is the oracle. Every loop over the lanes becomes vector instructions: what
is decided by a branch there is selected by a condition here, what a spring does not have adds nothing, and r^(1/κ) of
the nozzle is a polynomial, 3e-15 close over the ratios at which it is not choked.
"""

from math import sqrt
from typing import Any, NamedTuple

from bench_sim.model.compiled import compiled, compiled_once
from bench_sim.model.gas import enthalpy_per_kelvin
from bench_sim.model.inertance import missing_flow
from bench_sim.model.iso6358 import ISO_DENSITY, ISO_TEMPERATURE
from bench_sim.model.lane_algebra import lane_algebra
from bench_sim.model.lane_layout import EXTRA_SPEED, LANES, PER_LANE, SLOPE, STAGE, Lane, LaneState
from bench_sim.model.lane_valves import feed, join
from bench_sim.model.surface import surface


class Having(NamedTuple):
    """What any of the lanes has; what none of them has is left out."""

    extra: int  #: branches of rubber, as many as the lane with most of them has
    frictions: int  #: elements of friction, likewise
    inert: bool  #: the air in a connection has inertia
    leaking: bool  #: a bellows leaks
    surfaces: bool  #: a surface without a name takes part
    fed: bool  #: a spring is connected with the supply or the atmosphere
    joined: bool  #: the first half of the lanes are left springs, the other their right ones, and air may pass between


@compiled
def _power(w: Any, i: int, t: float) -> float:
    """r^(1/κ) of one lane; ``t`` is −1 at the critical pressure ratio and 1 at 1. Odd and even powers apart."""
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
    """Flow between bellows and auxiliary chamber that follows from the pressures."""
    for i in range(LANES):
        R = w[Lane.GAS_CONSTANT + i]
        p_b = w[Lane.PRESSURE + i]
        p_a = w[Lane.AUXILIARY_PRESSURE + i]
        T_b = w[Lane.TEMPERATURE + i]
        T_a = w[Lane.AUXILIARY_TEMPERATURE + i]
        sense = 1.0 if p_b > p_a else -1.0
        p_up = max(p_b, p_a)
        T_up = T_b if p_b >= p_a else T_a
        r = min(p_b, p_a) / p_up
        low = w[Lane.CRITICAL + i]
        inside = max(r, low)
        q = _power(w, i, (inside - 0.5 * (1.0 + low)) / (0.5 * (1.0 - low)))
        psi = sqrt(w[Lane.PSI_FACTOR + i] * max(q * (q - inside), 0.0))
        psi = w[Lane.PSI_LAMINAR + i] * (1.0 - r) if r > w[Lane.LAMINAR + i] else psi
        area = w[Lane.OPENING + i] * w[Lane.ORIFICE + i] * (1.0 + sense * w[Lane.ASYMMETRY + i])
        w[Lane.PASSAGE + i] = area
        G = area * p_up / sqrt(R * T_up) * psi
        root = sqrt(max(w[Lane.REYNOLDS_PER_FLOW + i] * G, 1.0))
        w[Lane.FLOW + i] = G * (sense * root / (root + w[Lane.REYNOLDS + i]))


@compiled
def hold_back(w: Any, ahead: float, parameters: Any) -> None:
    """Let inertia hold back the flow, lane by lane (`bench_sim.model.inertance`)."""
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
    """The flow carries the enthalpy of its upstream side: it begins the slopes."""
    for i in range(LANES):
        c_p = w[Lane.HEAT_CAPACITY + i]
        G = w[Lane.FLOW + i]
        h = G * c_p * (w[Lane.TEMPERATURE + i] if G > 0.0 else w[Lane.AUXILIARY_TEMPERATURE + i])
        w[SLOPE + LaneState.MASS + i] = -G
        w[SLOPE + LaneState.AUXILIARY_MASS + i] = G
        w[Lane.HEATING + i] = -h
        w[SLOPE + LaneState.AUXILIARY_ENERGY + i] = h


@compiled
def leak(w: Any) -> None:
    """Leaks of the bellows to the atmosphere, as an orifice (ISO 6358) and as a laminar crack."""
    for i in range(LANES):
        c_p = w[Lane.HEAT_CAPACITY + i]
        p = w[Lane.PRESSURE + i]
        T = w[Lane.TEMPERATURE + i]
        outside = w[Lane.ATMOSPHERE + i]
        p_up = max(p, outside)
        T_up = T if p >= outside else w[Lane.AMBIENT + i]
        r = min(p, outside) / p_up
        b = w[Lane.LEAK_CRITICAL + i]
        laminar = w[Lane.LAMINAR + i]
        s = (min(max(r, b), laminar) - b) / (1.0 - b)
        iso = sqrt(1.0 - s * s)
        iso = iso * (1.0 - r) / (1.0 - laminar) if r > laminar else iso
        G = w[Lane.LEAK + i] * ISO_DENSITY * p_up * sqrt(ISO_TEMPERATURE / T_up) * iso
        G = G if p >= outside else -G
        G += w[Lane.LEAK_LAMINAR + i] * (p * p - outside * outside)
        w[SLOPE + LaneState.MASS + i] -= G
        w[Lane.HEATING + i] -= G * c_p * (T if G > 0.0 else w[Lane.AMBIENT + i])


@compiled
def _density_factor(mass: float, known_mass: float, known_factor: float, exponent: float) -> float:
    """(ρ/ρ_ref)^n by its series (`bench_sim.model.gas.density_factor`), masses being those in the present volume."""
    e = mass / known_mass - 1.0
    return known_factor * (
        1.0 + exponent * e * (1.0 + 0.5 * (exponent - 1.0) * e * (1.0 + (exponent - 2.0) / 3.0 * e))
    )


@compiled
def heat(w: Any) -> None:
    """Heat exchange of both chambers with their walls."""
    for i in range(LANES):
        exponent = w[Lane.HEAT_EXPONENT + i]
        known = w[Lane.DENSITY + i] * w[Lane.VOLUME + i]
        factor = _density_factor(w[STAGE + LaneState.MASS + i], known, w[Lane.DENSITY_FACTOR + i], exponent)
        wall = w[STAGE + LaneState.WALL + i]
        inward = w[Lane.HEAT + i] * factor * (wall - w[Lane.TEMPERATURE + i])
        w[Lane.HEATING + i] += inward
        outer = w[Lane.WALL_OUTER + i] * (w[Lane.AMBIENT + i] - wall)
        w[SLOPE + LaneState.WALL + i] = w[Lane.WALL_RATE + i] * (outer - inward)
        known = w[Lane.AUXILIARY_DENSITY + i] * w[Lane.AUXILIARY_VOLUME + i]
        factor = _density_factor(
            w[STAGE + LaneState.AUXILIARY_MASS + i], known, w[Lane.AUXILIARY_DENSITY_FACTOR + i], exponent
        )
        wall = w[STAGE + LaneState.AUXILIARY_WALL + i]
        inward = w[Lane.AUXILIARY_HEAT + i] * factor * (wall - w[Lane.AUXILIARY_TEMPERATURE + i])
        w[SLOPE + LaneState.AUXILIARY_ENERGY + i] += inward
        outer = w[Lane.WALL_OUTER + i] * (w[Lane.AMBIENT + i] - wall)
        w[SLOPE + LaneState.AUXILIARY_WALL + i] = w[Lane.WALL_RATE + i] * (outer - inward)


@compiled
def gas_surfaces(w: Any, parameters: Any) -> None:
    """Flow and heat by the surfaces that have no name, lane by lane (`bench_sim.model.surface.gas_surface_term`)."""
    for i in range(LANES):
        par = parameters[i]
        p = w[Lane.PRESSURE + i]
        T = w[Lane.TEMPERATURE + i]
        if par.flow_surface_difference[1] > par.flow_surface_difference[0]:
            flow = w[Lane.OPENING + i] * surface(
                par.flow_surface,
                p - w[Lane.AUXILIARY_PRESSURE + i],
                par.flow_surface_difference,
                p,
                par.flow_surface_pressure[0],
                par.flow_surface_pressure[1],
            )
            enthalpy = (
                flow * enthalpy_per_kelvin(par) * (T if flow > 0.0 else w[Lane.AUXILIARY_TEMPERATURE + i])
            )
            w[SLOPE + LaneState.MASS + i] -= flow
            w[SLOPE + LaneState.AUXILIARY_MASS + i] += flow
            w[SLOPE + LaneState.AUXILIARY_ENERGY + i] += enthalpy
            w[Lane.HEATING + i] -= enthalpy
        if par.heat_surface_pressure[1] > par.heat_surface_pressure[0]:
            w[Lane.HEATING + i] += surface(
                par.heat_surface,
                p,
                par.heat_surface_pressure,
                T - par.ambient_temperature,
                par.heat_surface_temperature[0],
                par.heat_surface_temperature[1],
            )


@compiled
def relax(w: Any, extra: int) -> None:
    """Dash-pots of the rubber and creep of the emergency spring: dw/dt = (x_b − w)/τ."""
    lanes = w.shape[0] // PER_LANE
    for i in range(lanes):
        z = w[Lane.BELLOWS_Z + i]
        y = w[Lane.BELLOWS_Y + i]
        w[SLOPE + LaneState.DASHPOT_Z + i] = (z - w[STAGE + LaneState.DASHPOT_Z + i]) * w[Lane.SPEED + i]
        w[SLOPE + LaneState.DASHPOT_Z_2 + i] = (z - w[STAGE + LaneState.DASHPOT_Z_2 + i]) * w[
            Lane.SPEED_2 + i
        ]
        w[SLOPE + LaneState.DASHPOT_Z_3 + i] = (z - w[STAGE + LaneState.DASHPOT_Z_3 + i]) * w[
            Lane.SPEED_3 + i
        ]
        w[SLOPE + LaneState.DASHPOT_Y + i] = (y - w[STAGE + LaneState.DASHPOT_Y + i]) * w[Lane.SPEED + i]
        w[SLOPE + LaneState.DASHPOT_Y_2 + i] = (y - w[STAGE + LaneState.DASHPOT_Y_2 + i]) * w[
            Lane.SPEED_2 + i
        ]
        w[SLOPE + LaneState.DASHPOT_Y_3 + i] = (y - w[STAGE + LaneState.DASHPOT_Y_3 + i]) * w[
            Lane.SPEED_3 + i
        ]
        w[SLOPE + LaneState.CREEP + i] = w[Lane.CREEP_RATE + i] * (
            w[Lane.CREEP_GAIN + i] * w[Lane.STACK_Z + i] - w[STAGE + LaneState.CREEP + i]
        )
    for e in range(extra):
        first = LaneState.EXTRA + 2 * LANES * e
        for i in range(lanes):
            rate = w[EXTRA_SPEED + LANES * e + i]
            w[SLOPE + first + i] = (w[Lane.BELLOWS_Z + i] - w[STAGE + first + i]) * rate
            w[SLOPE + first + LANES + i] = (w[Lane.BELLOWS_Y + i] - w[STAGE + first + LANES + i]) * rate


@compiled
def work(w: Any) -> None:
    """−p dV/dt of the bellows, whose speed follows as in `bench_sim.model.spring.work_term`; it comes last."""
    for i in range(LANES):
        z = w[Lane.BELLOWS_Z + i]
        y = w[Lane.BELLOWS_Y + i]
        speeds = w[Lane.SPEEDS + i]
        relax_z = w[Lane.SHELL_Z + i] * (speeds * z - w[Lane.RATE_Z + i])
        relax_y = w[Lane.SHELL_Y + i] * (speeds * y - w[Lane.RATE_Y + i])
        kappa = w[Lane.HEAT_RATIO + i]
        p = w[Lane.PRESSURE + i]
        C = w[Lane.STRETCH + i]
        per_V = 1.0 / (w[Lane.VOLUME + i] + kappa * C * p)
        heating = (kappa - 1.0) * w[Lane.HEATING + i]
        A = w[Lane.AREA + i]
        B = w[Lane.LATERAL_AREA + i]
        per_z = w[Lane.Z_PER_PRESSURE + i]
        per_y = w[Lane.Y_PER_PRESSURE + i]
        cross = w[Lane.STIFFNESS_ZY + i]
        c_z = w[Lane.GIVE_Z + i]
        c_y = w[Lane.GIVE_Y + i]
        p_V = kappa * p * per_V
        a = 1.0 - c_z * (w[Lane.STIFFNESS_ZZ + i] - per_z * p_V * A)
        b = -c_z * (cross - per_z * p_V * B)
        c = -c_y * (cross - per_y * p_V * A)
        d = 1.0 - c_y * (w[Lane.STIFFNESS_YY + i] - per_y * p_V * B)
        p_rate = heating * per_V
        dz = w[Lane.HEIGHT_SPEED + i] + w[SLOPE + LaneState.CREEP + i] + c_z * (per_z * p_rate + relax_z)
        dy = w[Lane.LATERAL_SPEED + i] + c_y * (per_y * p_rate + relax_y)
        inverse = 1.0 / (a * d - b * c)
        z_speed = (d * dz - b * dy) * inverse
        y_speed = (a * dy - c * dz) * inverse
        w[Lane.BELLOWS_Z_SPEED + i] = z_speed
        w[Lane.BELLOWS_Y_SPEED + i] = y_speed
        V_rate = A * z_speed + B * y_speed
        V_rate += C * (heating - kappa * p * V_rate) * per_V
        w[SLOPE + LaneState.ENERGY + i] = w[Lane.HEATING + i] - p * V_rate


@compiled_once
def lane_slope(w: Any, ahead: float, having: Any, sides: Any, memory: Any, parameters: Any) -> None:
    """Write dx/dt of all lanes, ``ahead`` s after the start of the step, and everything that follows from the states.

    What is rare, and has no rows in ``w``, is in ``memory`` and ``parameters`` (LANES), at the ``sides`` (LANES).
    """
    lane_algebra(w, ahead, having.extra, having.frictions)
    orifice(w)
    if having.inert:
        hold_back(w, ahead, parameters)
    carry(w)
    if having.fed:
        feed(w, sides, memory, parameters)
    if having.joined:
        join(w, memory, parameters)
    if having.leaking:
        leak(w)
    heat(w)
    if having.surfaces:
        gas_surfaces(w, parameters)
    relax(w, having.extra)
    work(w)
