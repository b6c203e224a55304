"""Air flow of lanes from the supply, and between the two sides.

Theory of operation
-------------------
Valves are usually shut. Their equations are computed lane by lane with the functions of `bench_sim.model.valves`. If
the differential pressure valve connects both sides of a bench, the left spring is a lane of the first half, and the
right one is the same lane of the second half.
"""

from typing import Any

from bench_sim.model.compiled import compiled
from bench_sim.model.gas import pressure
from bench_sim.model.lanes.layout import GIVEN, LANES, PAIRS, SLOPE, STAGE, START, Lane, LaneState
from bench_sim.model.valves import (
    chamber_flow,
    dpv_flow,
    leveling_conductances,
    service_conductances,
    switch_dpv,
    switch_leveling,
    valve_opening,
)


@compiled
def gather_valves(w: Any, n: int, valves: Any, rows: Any, everything: bool) -> None:
    """Set the valves of all lanes for step n of their courses. Without ``everything`` only the reservoir valves are
    set.
    """
    given = GIVEN if everything else 1
    for i in range(LANES):
        row = min(n, rows[i] - 1)
        for k in range(given):
            w[Lane.OPENING + LANES * k + i] = valves[i][row, k]
        if everything:
            w[Lane.SUPPLY + i] -= w[Lane.SUPPLY_ERROR + i]


@compiled
def settle_levers(w: Any, sides: Any, parameters: Any) -> None:
    """Set every lever to its steady position for the present height."""
    for i in range(LANES):
        w[STAGE + LaneState.LEVER + i] = w[Lane.HEIGHT + i] + parameters[i].lever_offset[sides[i]]
        w[START + LaneState.LEVER + i] = w[STAGE + LaneState.LEVER + i]


@compiled
def switch_leveling_valves(w: Any, sides: Any, memory: Any, parameters: Any) -> None:
    """Switch the leveling valves according to the states at the start of a step."""
    for i in range(LANES):
        switch_leveling(w[START + LaneState.LEVER + i], memory[i], parameters[i], sides[i])


@compiled
def switch_between(w: Any, memory: Any, parameters: Any) -> None:
    """Switch the differential pressure valves according to the states at the start of a step. The memory of the left
    lane holds the result.
    """
    for i in range(PAIRS):
        j = PAIRS + i
        kappa = w[Lane.HEAT_RATIO + i]
        left = pressure(w[START + LaneState.AUXILIARY_ENERGY + i], w[Lane.AUXILIARY_VOLUME + i], kappa)
        right = pressure(w[START + LaneState.AUXILIARY_ENERGY + j], w[Lane.AUXILIARY_VOLUME + j], kappa)
        switch_dpv(left - right, memory[i], parameters[i])


@compiled
def feed(w: Any, sides: Any, memory: Any, parameters: Any) -> None:
    """Add the air flow of leveling and service valves to the auxiliary chambers, and the motion of the levers."""
    for i in range(LANES):
        side = sides[i]
        par = parameters[i]
        p, T = w[Lane.AUXILIARY_PRESSURE + i], w[Lane.AUXILIARY_TEMPERATURE + i]
        lever = w[STAGE + LaneState.LEVER + i]
        target = w[Lane.HEIGHT + i] + par.lever_offset[side]
        w[SLOPE + LaneState.LEVER + i] = (target - lever) / par.leveling_lag[side]
        opening = w[Lane.LEVELING + i] * valve_opening(lever, memory[i], par, side)
        fill, exhaust = leveling_conductances(opening, par, side)
        flow, power = chamber_flow(w[Lane.SUPPLY + i], p, T, fill, exhaust, par)
        fill, exhaust = service_conductances(w[Lane.SERVICE + i], par, side)
        more_flow, more_power = chamber_flow(w[Lane.SUPPLY + i], p, T, fill, exhaust, par)
        w[SLOPE + LaneState.AUXILIARY_MASS + i] += flow + more_flow
        w[SLOPE + LaneState.AUXILIARY_ENERGY + i] += power + more_power


@compiled
def join(w: Any, memory: Any, parameters: Any) -> None:
    """Add the flow through the differential pressure valves between left and right springs."""
    for i in range(PAIRS):
        j = PAIRS + i
        T_left, T_right = w[Lane.AUXILIARY_TEMPERATURE + i], w[Lane.AUXILIARY_TEMPERATURE + j]
        p_left, p_right = w[Lane.AUXILIARY_PRESSURE + i], w[Lane.AUXILIARY_PRESSURE + j]
        connected = w[Lane.JOINED + i]
        flow, enthalpy = dpv_flow(memory[i], connected, p_left, T_left, p_right, T_right, parameters[i])
        w[SLOPE + LaneState.AUXILIARY_MASS + i] -= flow
        w[SLOPE + LaneState.AUXILIARY_MASS + j] += flow
        w[SLOPE + LaneState.AUXILIARY_ENERGY + i] -= flow * enthalpy
        w[SLOPE + LaneState.AUXILIARY_ENERGY + j] += flow * enthalpy
