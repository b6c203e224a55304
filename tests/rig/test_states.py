"""The state machine: every transition that the table has works, and no other does."""

import itertools

import pytest

from bench_protocol.words import AIR_BY_STATE, BenchState, Reason
from bench_sim.rig.controls import AirSupply
from bench_sim.rig.states import (
    COMMAND_VALID,
    ESTOP_RELEASED,
    MAINS,
    TRANSITIONS,
    Event,
    StateMachine,
)

CONDITIONS = (COMMAND_VALID, ESTOP_RELEASED, MAINS)
YES = {condition: lambda: True for condition in CONDITIONS}
NO = {condition: lambda: False for condition in CONDITIONS}
ROWS = {(row.source, row.event): row for row in TRANSITIONS}


def machine(state: BenchState, conditions: dict = YES) -> StateMachine:
    made = StateMachine(conditions)
    made.state = state
    return made


def test_no_event_has_two_targets() -> None:
    assert len(ROWS) == len(TRANSITIONS)


@pytest.mark.parametrize(("state", "event"), list(itertools.product(BenchState, Event)))
def test_only_transitions_of_the_table_change_the_state(state: BenchState, event: Event) -> None:
    row = ROWS.get((state, event))
    made = machine(state)
    assert made.handle(event) == (row is not None)
    assert made.state is (row.target if row else state)
    refused = machine(state, NO)
    assert refused.handle(event) == (row is not None and not row.needs)


def test_every_state_can_be_reached_and_left() -> None:
    reached = {BenchState.OFF}
    while grown := {row.target for row in TRANSITIONS if row.source in reached} - reached:
        reached |= grown
    assert reached == set(BenchState)
    assert {row.source for row in TRANSITIONS} == set(BenchState)


def test_from_every_state_the_stop_button_stops() -> None:
    for state in set(BenchState) - {BenchState.OFF, BenchState.ESTOP}:
        made = machine(state)
        assert made.handle(Event.ESTOP)
        assert made.state is BenchState.ESTOP


def test_only_a_reset_leaves_a_latched_fault_upward() -> None:
    up = {BenchState.AIR_LOW, BenchState.AIR_HIGH, BenchState.HOLD, BenchState.ACTIVE, BenchState.DISABLED}
    for row in TRANSITIONS:
        if (
            row.source in (BenchState.FAULT_HOLD, BenchState.FAULT_DISABLED, BenchState.ESTOP)
            and row.target in up
        ):
            assert row.event is Event.RESET


def test_the_first_reason_stays() -> None:
    made = machine(BenchState.ACTIVE)
    made.handle(Event.COMMAND_LATE)
    made.handle(Event.REACTED_HOLD)
    made.handle(Event.COMMAND_LOST)
    assert made.reason is Reason.COMMAND_LATE
    made.handle(Event.RESET)
    assert made.reason is Reason.NONE


@pytest.mark.parametrize("row", TRANSITIONS, ids=lambda row: f"{row.source.name}, {row.event.name}")
def test_the_described_air_in_a_state_matches_the_rig(commander, row) -> None:
    """The drivers' table, against the rig's own order to its valves."""
    supervisor = commander.rig.supervisor
    supervisor.machine = machine(row.source)
    if row.source is BenchState.FAULT_REACTION and row.event is Event.REACTED_HOLD:
        commander.rig._controls["engaged"] = 1
    assert supervisor.handle(row.event)
    does = {
        AirSupply.VENTED: "let off",
        AirSupply.SHUT: "shut in",
        AirSupply.RESTRICTED: "as ordered",
        AirSupply.FULL: "as ordered",
    }
    assert does[AirSupply(commander.rig._controls["air"])] == AIR_BY_STATE[row.target.name]
