"""Every air flow: orifice, leveling and service valves, differential pressure valve, leaks, supply line."""

from typing import Any, Final

from bench_sim.model.algebraic import Algebraic
from bench_sim.model.compiled import compiled
from bench_sim.model.gas import enthalpy_per_kelvin, pressure, transfer, upstream_enthalpy
from bench_sim.model.inertance import missing_flow
from bench_sim.model.layout import Input, State
from bench_sim.model.orifice import (
    effective_flow_area,
    iso_flow,
    laminar_between,
    one_way,
    orifice_between,
    reynolds_factor,
    reynolds_per_flow,
    valve_between,
)
from bench_sim.model.pipe import PIPE_RATE, pipe_acceleration

#: With a pipe, a reservoir valve counts as closed below this opening.
_SHUT: Final = 1e-3


@compiled
def orifice_term(t: float, x: Any, mem: Any, u: Any, par: Any, out: Any, dx: Any) -> None:
    """Add the flow between each bellows and its auxiliary chamber, with the enthalpy of the chamber that the air
    leaves.

    Without a pipe the flow follows from the pressures. With a pipe the flow is a state, and a closing valve stops it
    within half a millisecond.
    """
    kappa = par.heat_capacity_ratio
    c_p = enthalpy_per_kelvin(par)
    for i in range(2):
        opening = min(max(u[Input.LEFT_RESERVOIR_VALVE + i], 0.0), 1.0)
        piped = par.pipe_length[i] > 0.0
        flow = 0.0
        steady = 0.0
        if piped and opening < _SHUT:
            dx[State.PIPE_FLOW + i] -= 0.25 * PIPE_RATE * x[State.PIPE_FLOW + i]
        elif opening > 0.0:
            p_b = out[Algebraic.PRESSURE + i]
            p_a = out[Algebraic.AUXILIARY_PRESSURE + i]
            T_b = out[Algebraic.TEMPERATURE + i]
            T_a = out[Algebraic.AUXILIARY_TEMPERATURE + i]
            area = opening * effective_flow_area(par.orifice_diameter[i], par.discharge_coefficient[i])
            if par.orifice_asymmetry[i] != 0.0:
                outward = x[State.PIPE_FLOW + i] if piped else p_b - p_a
                area *= one_way(par.orifice_asymmetry[i], outward)
            if piped:
                flow = x[State.PIPE_FLOW + i]
                Re = reynolds_per_flow(par.orifice_diameter[i]) * abs(flow)
                area *= reynolds_factor(Re, par.orifice_reynolds[i])
                dx[State.PIPE_FLOW + i] += pipe_acceleration(flow, p_b, T_b, p_a, T_a, area, i, par)
            else:
                flow = orifice_between(p_b, T_b, p_a, T_a, area, par.gas_constant, kappa, par.laminar_limit)
                if par.orifice_reynolds[i] != 0.0:
                    Re = reynolds_per_flow(par.orifice_diameter[i]) * abs(flow)
                    flow *= reynolds_factor(Re, par.orifice_reynolds[i])
                steady = flow
                if par.flow_inertance[i] > 0.0:
                    ahead, noted, held = t - mem.solved_time, mem.steady_flow[i], mem.missing_flow[i]
                    inertance = par.flow_inertance[i]
                    flow -= missing_flow(ahead, noted, held, steady, p_b, T_b, p_a, T_a, area, inertance, par)
            enthalpy = upstream_enthalpy(flow, T_b, T_a, c_p)
            transfer(dx, State.BELLOWS_MASS + i, State.AUXILIARY_MASS + i, flow, enthalpy)
        out[Algebraic.ORIFICE_FLOW + i] = flow
        out[Algebraic.STEADY_FLOW + i] = steady


@compiled
def note_flows(mem: Any, par: Any, out: Any) -> None:
    """Store the steady and the missing flow at the start of a step, for sides whose air has inertia."""
    for i in range(2):
        if par.flow_inertance[i] > 0.0:
            mem.steady_flow[i] = out[Algebraic.STEADY_FLOW + i]
            mem.missing_flow[i] = out[Algebraic.STEADY_FLOW + i] - out[Algebraic.ORIFICE_FLOW + i]


@compiled
def leveling_latch(lever: float, latch: int, deadband: float, hysteresis: float) -> int:
    """Return the state of a leveling valve: −1 filling, 0 closed, +1 exhausting. The valve opens at a ``lever`` beyond
    ±``deadband``, and closes at ``deadband`` − ``hysteresis`` (all in m). ``latch`` is its last state.
    """
    if lever > deadband:
        return 1
    if lever < -deadband:
        return -1
    if latch * lever <= deadband - hysteresis:
        return 0
    return latch


@compiled
def leveling_opening(lever: float, latch: int, deadband: float, hysteresis: float, span: float) -> float:
    """Return the opening u = sat((|x| − δ + δ_h)/Δ) with the sign of the latch (−1 to 1). A positive opening exhausts.
    x is ``lever``, δ ``deadband``, δ_h ``hysteresis`` and Δ ``span`` (all in m).
    """
    if latch == 0:
        return 0.0
    return latch * min(max((latch * lever - deadband + hysteresis) / span, 0.0), 1.0)


@compiled
def lever_term(x: Any, par: Any, out: Any, dx: Any) -> None:
    """Add dx_l/dt = (ζ + offset − x_l)/τ: the lever follows the height with a lag, by its dash-pot."""
    for i in range(2):
        target = out[Algebraic.HEIGHT + i] + par.lever_offset[i]
        dx[State.LEVER + i] += (target - x[State.LEVER + i]) / par.leveling_lag[i]


@compiled
def chamber_flow(
    supply: float, p: float, T: float, fill: float, exhaust: float, par: Any
) -> tuple[float, float]:
    """Return the net flow (kg/s) into a chamber, from the supply and to the atmosphere, and the enthalpy that it
    carries (W).

    Pressures are absolute (Pa). ``fill`` and ``exhaust`` are sonic conductances in m³/(s·Pa) (ISO 6358), 0 if the valve
    is closed. A check valve prevents flow back into the supply. Through an open exhaust air flows into a chamber below
    atmospheric pressure.
    """
    c_p = enthalpy_per_kelvin(par)
    b = par.valve_critical_ratio
    flow = 0.0
    power = 0.0
    if fill > 0.0 and supply > p:
        flow = iso_flow(supply, par.supply_temperature, p, fill, b, par.laminar_limit)
        power = flow * c_p * par.supply_temperature
    if exhaust > 0.0:
        G = valve_between(
            p, T, par.atmospheric_pressure, par.ambient_temperature, exhaust, b, par.laminar_limit
        )
        flow -= G
        power -= G * upstream_enthalpy(G, T, par.ambient_temperature, c_p)
    return flow, power


@compiled
def chamber_term(x: Any, par: Any, side: int, fill: float, exhaust: float, out: Any, dx: Any) -> float:
    """Add the net flow from the supply and to the atmosphere (`chamber_flow`) to one auxiliary chamber. Return it in
    kg/s.
    """
    p = out[Algebraic.AUXILIARY_PRESSURE + side]
    T = out[Algebraic.AUXILIARY_TEMPERATURE + side]
    flow, power = chamber_flow(x[State.SUPPLY_LINE], p, T, fill, exhaust, par)
    dx[State.AUXILIARY_MASS + side] += flow
    dx[State.AUXILIARY_ENERGY + side] += power
    return flow


@compiled
def valve_opening(lever: float, mem: Any, par: Any, side: int) -> float:
    """Return the opening of the leveling valve of one side, from −1 (fills) to +1 (exhausts)."""
    deadband, hysteresis = par.leveling_deadband[side], par.leveling_hysteresis[side]
    return leveling_opening(lever, mem.leveling_latch[side], deadband, hysteresis, par.leveling_range[side])


@compiled
def leveling_conductances(opening: float, par: Any, side: int) -> tuple[float, float]:
    """Return the conductances in m³/(s·Pa) for filling and exhausting one auxiliary chamber by its leveling valve."""
    return max(-opening, 0.0) * par.fill_conductance[side], max(opening, 0.0) * par.exhaust_conductance[side]


@compiled
def service_conductances(opening: float, par: Any, side: int) -> tuple[float, float]:
    """Return the conductances in m³/(s·Pa) for filling and exhausting one auxiliary chamber by the rig's service
    valve.
    """
    conductance = par.service_conductance[side]
    return max(opening, 0.0) * conductance, max(-opening, 0.0) * conductance


@compiled
def leveling_term(x: Any, mem: Any, u: Any, par: Any, out: Any, dx: Any) -> None:
    """Add the flow through the leveling valve of each auxiliary chamber."""
    for i in range(2):
        connected = min(max(u[Input.LEFT_LEVELING + i], 0.0), 1.0)
        opening = connected * valve_opening(x[State.LEVER + i], mem, par, i)
        fill, exhaust = leveling_conductances(opening, par, i)
        out[Algebraic.LEVELING_FLOW + i] = chamber_term(x, par, i, fill, exhaust, out, dx)


@compiled
def service_term(x: Any, u: Any, par: Any, out: Any, dx: Any) -> None:
    """Add the flow through the service valve of each auxiliary chamber."""
    for i in range(2):
        opening = min(max(u[Input.LEFT_SERVICE_VALVE + i], -1.0), 1.0)
        fill, exhaust = service_conductances(opening, par, i)
        out[Algebraic.SERVICE_FLOW + i] = chamber_term(x, par, i, fill, exhaust, out, dx)


@compiled
def ahead(now: float, before: float) -> float:
    """Return the pressure difference (Pa, at least 0) one step later, extrapolated from ``now`` and ``before``, the
    value one step earlier.
    """
    return max(2.0 * now - before, 0.0) if before > 0.0 else now


@compiled
def switch_dpv(difference: float, mem: Any, par: Any) -> None:
    """Open the differential pressure valve if |p_L − p_R| exceeds its opening pressure. Close it below its reclosing
    pressure.

    Except in the first step, the valve switches at an instant within the step. This instant is extrapolated linearly
    from ``difference`` at the start of the step (Pa) and its value one step before. The valve is open for the fraction
    ``dpv_share`` of the step. So the flow depends smoothly on all parameters, and not on the start times of steps. A
    line overestimates a peak, so the valve also opens at a peak of at least 99.9 % of its opening pressure.
    """
    now = abs(difference)
    then = ahead(now, abs(mem.dpv_difference))
    share = float(mem.dpv_latch)
    if mem.dpv_latch == 0 and max(now, then) > par.dpv_opening:
        mem.dpv_latch = 1
        share = 1.0 if now >= par.dpv_opening else (then - par.dpv_opening) / (then - now)
    elif mem.dpv_latch == 1 and min(now, then) < par.dpv_reclosing:
        mem.dpv_latch = 0
        share = 0.0 if now <= par.dpv_reclosing else (now - par.dpv_reclosing) / (now - then)
    mem.dpv_share = share
    mem.dpv_difference = difference


@compiled
def switch_leveling(lever: float, mem: Any, par: Any, side: int) -> None:
    """Store the new state of one leveling valve (`leveling_latch`)."""
    deadband, hysteresis = par.leveling_deadband[side], par.leveling_hysteresis[side]
    mem.leveling_latch[side] = leveling_latch(lever, mem.leveling_latch[side], deadband, hysteresis)


@compiled
def switch_valves(x: Any, mem: Any, par: Any) -> None:
    """Switch the leveling valves and the differential pressure valve according to the state at the start of a step."""
    kappa = par.heat_capacity_ratio
    for i in range(2):
        switch_leveling(x[State.LEVER + i], mem, par, i)
    left = pressure(x[State.AUXILIARY_ENERGY], par.auxiliary_volume[0], kappa)
    right = pressure(x[State.AUXILIARY_ENERGY + 1], par.auxiliary_volume[1], kappa)
    switch_dpv(left - right, mem, par)


@compiled
def dpv_flow(
    mem: Any, connected: float, p_left: float, T_left: float, p_right: float, T_right: float, par: Any
) -> tuple[float, float]:
    """Return the flow from the left to the right auxiliary chamber in kg/s, and its enthalpy in J/kg. Both are 0 unless
    the valve is connected (``connected`` is 1, otherwise 0), and open or leaking.
    """
    conductance = (mem.dpv_share * par.dpv_conductance + par.dpv_leak) * min(max(connected, 0.0), 1.0)
    if conductance == 0.0:
        return 0.0, 0.0
    b = par.valve_critical_ratio
    flow = valve_between(p_left, T_left, p_right, T_right, conductance, b, par.laminar_limit)
    return flow, enthalpy_per_kelvin(par) * (T_left if p_left > p_right else T_right)


@compiled
def dpv_term(mem: Any, u: Any, par: Any, out: Any, dx: Any) -> None:
    """Add the flow from the left to the right auxiliary chamber through the differential pressure valve."""
    p, T = Algebraic.AUXILIARY_PRESSURE, Algebraic.AUXILIARY_TEMPERATURE
    flow, enthalpy = dpv_flow(mem, u[Input.DPV_CONNECTED], out[p], out[T], out[p + 1], out[T + 1], par)
    if flow != 0.0:
        transfer(dx, State.AUXILIARY_MASS, State.AUXILIARY_MASS + 1, flow, enthalpy)
    out[Algebraic.DPV_FLOW] = flow


@compiled
def leak_flow(
    p: float,
    T: float,
    outside: float,
    ambient: float,
    conductance: float,
    b: float,
    crack: float,
    laminar: float,
    c_p: float,
) -> tuple[float, float]:
    """Return the flow to the atmosphere in kg/s, and the enthalpy that it carries in W. An orifice (ISO 6358) and a
    laminar crack leak in parallel. ``conductance`` is in m³/(s·Pa), ``crack`` in kg/(s·Pa²) (`laminar_between`).
    ``outside`` (Pa) and ``ambient`` (K) are the state of the atmosphere.
    """
    flow = valve_between(p, T, outside, ambient, conductance, b, laminar)
    flow += laminar_between(p, outside, crack)
    return flow, flow * upstream_enthalpy(flow, T, ambient, c_p)


@compiled
def leak_term(par: Any, out: Any, dx: Any) -> None:
    """Subtract the leaks of the bellows to the atmosphere (`leak_flow`)."""
    c_p = enthalpy_per_kelvin(par)
    for i in range(2):
        if par.leak_conductance[i] == 0.0 and par.leak_laminar[i] == 0.0:
            continue
        p = out[Algebraic.PRESSURE + i]
        T = out[Algebraic.TEMPERATURE + i]
        flow, power = leak_flow(
            p,
            T,
            par.atmospheric_pressure,
            par.ambient_temperature,
            par.leak_conductance[i],
            par.leak_critical_ratio,
            par.leak_laminar[i],
            par.laminar_limit,
            c_p,
        )
        dx[State.BELLOWS_MASS + i] -= flow
        dx[State.BELLOWS_ENERGY + i] -= power


@compiled
def source_pressure(t: float, par: Any) -> float:
    """Return the gauge pressure before the main valve in Pa. It is constant, or falls and is recharged periodically."""
    if par.supply_sawtooth == 0.0:
        return par.supply_pressure
    phase = t % (par.sawtooth_decay_time + par.sawtooth_recharge_time)
    swing = par.sawtooth_high - par.sawtooth_low
    if phase < par.sawtooth_decay_time:
        return par.sawtooth_high - swing * phase / par.sawtooth_decay_time
    return par.sawtooth_low + swing * (phase - par.sawtooth_decay_time) / par.sawtooth_recharge_time


@compiled
def supply_term(t: float, x: Any, u: Any, par: Any, dx: Any) -> None:
    """Add dp_s/dt = (p_source − p_s)/τ of the supply line behind the main valve. A closed main valve vents the line."""
    gauge = source_pressure(t, par) if u[Input.SUPPLY] > 0.5 else 0.0
    dx[State.SUPPLY_LINE] += (gauge + par.atmospheric_pressure - x[State.SUPPLY_LINE]) / par.supply_lag
