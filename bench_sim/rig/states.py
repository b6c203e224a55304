"""The states of the bench. Every possible transition is a row of a table; all other events are refused."""

from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum
from typing import Final

from bench_protocol.words import LIVE, BenchState, Reason


class Event(StrEnum):
    """Events of the bench's state machine."""

    POWER_ON = "power on"
    POWER_OFF = "power off"
    BOOTED = "boot finished"
    CHECKED = "self-test passed"
    RESET = "reset, rising edge"
    AIR_LOW = "air low"
    AIR_HIGH = "air high"
    HOLD = "H, rising edge"
    RELEASE = "H cleared"
    ACTIVATE = "M, rising edge"
    PAUSE = "M cleared"
    DISABLE = "disable, or D cleared"
    COMMAND_LATE = "no valid command for 100 ms"
    COMMAND_LOST = "no valid command for 500 ms"
    DISCONNECTED = "the commander's connection closed"
    HEARTBEAT_LOST = "the commander's heartbeat stopped"
    NEW_HOLDER = "another client took the lease"
    TRIP_PROGRAM_HOLD = "a limit with the action program hold tripped"
    TRIP_PROGRAM_STOP = "a limit with the action program stop tripped"
    TRIP_INTERLOCK = "a limit with the action interlock tripped"
    TRIP_POWER_OFF = "a limit with the action power off tripped"
    TICK_LOST = "a tick was lost under the policy fault"
    SPRING_LOST = "the computation of the springs failed"
    REACTED_HOLD = "reaction finished, holding"
    REACTED_DISABLE = "reaction finished, to the safe position"
    ESTOP = "emergency stop pressed"
    POWER_LOST = "power lost"


@dataclass(frozen=True, slots=True)
class Transition:
    """One row of the table: in the state ``source``, ``event`` leads to ``target``. ``needs`` is the text of a
    condition, or "".
    """

    source: BenchState
    event: Event
    target: BenchState
    needs: str = ""


_S, _E = BenchState, Event
COMMAND_VALID: Final = "valid commands arrive"
ESTOP_RELEASED: Final = "emergency stop released"
MAINS: Final = "the mains power is on"

#: States in which the actuators hold or follow their commands.
ENGAGED: Final = (_S.HOLD, _S.ACTIVE)
#: States in which they are shut in, whatever their command: a held force would not stop a moving bolster.
SHUT_IN: Final = (_S.FAULT_HOLD,)
#: What leads from a state of `SAFE` towards the next command; all else that leads there ends one.
WAKING: Final = (_E.POWER_ON, _E.BOOTED, _E.CHECKED, _E.RESET)

TRANSITIONS: Final[tuple[Transition, ...]] = (
    Transition(_S.OFF, _E.POWER_ON, _S.BOOT, MAINS),
    Transition(_S.BOOT, _E.BOOTED, _S.INIT),
    Transition(_S.INIT, _E.CHECKED, _S.DISABLED),
    Transition(_S.DISABLED, _E.RESET, _S.AIR_LOW, COMMAND_VALID),
    Transition(_S.AIR_LOW, _E.AIR_HIGH, _S.AIR_HIGH, COMMAND_VALID),
    Transition(_S.AIR_HIGH, _E.AIR_LOW, _S.AIR_LOW),
    Transition(_S.AIR_HIGH, _E.HOLD, _S.HOLD, COMMAND_VALID),
    Transition(_S.HOLD, _E.RELEASE, _S.AIR_HIGH),
    Transition(_S.HOLD, _E.ACTIVATE, _S.ACTIVE, COMMAND_VALID),
    Transition(_S.ACTIVE, _E.PAUSE, _S.HOLD),
    Transition(_S.ACTIVE, _E.RELEASE, _S.AIR_HIGH),
    *(Transition(state, _E.DISABLE, _S.DISABLED) for state in LIVE),
    *(Transition(state, _E.POWER_OFF, _S.OFF) for state in (_S.BOOT, _S.INIT, _S.DISABLED, *LIVE)),
    *(Transition(state, _E.COMMAND_LATE, _S.FAULT_REACTION) for state in (_S.HOLD, _S.ACTIVE)),
    *(Transition(state, _E.DISCONNECTED, _S.FAULT_REACTION) for state in LIVE),
    *(Transition(state, _E.HEARTBEAT_LOST, _S.FAULT_REACTION) for state in LIVE),
    *(Transition(state, _E.COMMAND_LOST, _S.FAULT_REACTION) for state in LIVE),
    Transition(_S.ACTIVE, _E.TRIP_PROGRAM_HOLD, _S.HOLD),
    *(Transition(state, _E.TRIP_PROGRAM_STOP, _S.FAULT_REACTION) for state in LIVE),
    *(Transition(state, _E.TRIP_INTERLOCK, _S.FAULT_REACTION) for state in LIVE),
    *(
        Transition(state, _E.TRIP_POWER_OFF, _S.OFF)
        for state in (*LIVE, _S.FAULT_REACTION, _S.FAULT_HOLD, _S.FAULT_DISABLED)
    ),
    *(Transition(state, _E.TICK_LOST, _S.FAULT_REACTION) for state in LIVE),
    *(Transition(state, _E.SPRING_LOST, _S.FAULT_REACTION) for state in LIVE),
    Transition(_S.FAULT_REACTION, _E.REACTED_HOLD, _S.FAULT_HOLD),
    Transition(_S.FAULT_REACTION, _E.REACTED_DISABLE, _S.FAULT_DISABLED),
    Transition(_S.FAULT_HOLD, _E.COMMAND_LOST, _S.FAULT_DISABLED),
    Transition(_S.FAULT_HOLD, _E.TRIP_INTERLOCK, _S.FAULT_DISABLED),
    Transition(_S.FAULT_HOLD, _E.SPRING_LOST, _S.FAULT_DISABLED),
    Transition(_S.FAULT_HOLD, _E.DISABLE, _S.FAULT_DISABLED),
    *(Transition(state, _E.NEW_HOLDER, _S.FAULT_DISABLED) for state in (_S.FAULT_REACTION, _S.FAULT_HOLD)),
    Transition(_S.FAULT_HOLD, _E.RESET, _S.HOLD, COMMAND_VALID),
    Transition(_S.FAULT_DISABLED, _E.RESET, _S.DISABLED),
    *(Transition(state, _E.ESTOP, _S.ESTOP) for state in BenchState if state not in (_S.OFF, _S.ESTOP)),
    Transition(_S.ESTOP, _E.RESET, _S.DISABLED, ESTOP_RELEASED),
    *(Transition(state, _E.POWER_LOST, _S.OFF) for state in BenchState if state is not _S.OFF),
)

#: The first cause that leads into a fault, by the event.
REASON_OF: Final[dict[Event, Reason]] = {
    _E.COMMAND_LATE: Reason.COMMAND_LATE,
    _E.COMMAND_LOST: Reason.COMMAND_LOST,
    _E.DISCONNECTED: Reason.DISCONNECTED,
    _E.HEARTBEAT_LOST: Reason.HEARTBEAT_LOST,
    _E.TRIP_PROGRAM_HOLD: Reason.LIMIT,
    _E.TRIP_PROGRAM_STOP: Reason.LIMIT,
    _E.TRIP_INTERLOCK: Reason.LIMIT,
    _E.TRIP_POWER_OFF: Reason.LIMIT,
    _E.TICK_LOST: Reason.TICK_LOST,
    _E.ESTOP: Reason.ESTOP,
    _E.SPRING_LOST: Reason.SPRING_LOST,
}

#: SECoP-style status codes, by state: 0 disabled, 1xx idle, 2xx warning, 3xx busy, 4xx error.
STATUS_CODES: Final[dict[BenchState, int]] = {
    _S.OFF: 0,
    _S.BOOT: 300,
    _S.INIT: 300,
    _S.DISABLED: 0,
    _S.AIR_LOW: 100,
    _S.AIR_HIGH: 100,
    _S.HOLD: 100,
    _S.ACTIVE: 100,
    _S.FAULT_REACTION: 400,
    _S.FAULT_HOLD: 400,
    _S.FAULT_DISABLED: 400,
    _S.ESTOP: 430,
}


#: CANopen emergency codes (CiA 301): 0x8130 is its heartbeat error, 0xFF00 and up are the device's own.
EMERGENCY_CODES: Final[dict[Reason, int]] = {
    Reason.NONE: 0x0000,
    Reason.COMMAND_LATE: 0x8130,
    Reason.COMMAND_LOST: 0x8130,
    Reason.DISCONNECTED: 0x8130,
    Reason.LIMIT: 0xFF01,
    Reason.ESTOP: 0xFF02,
    Reason.TICK_LOST: 0xFF03,
    Reason.BY_COMMANDER: 0x0000,
    Reason.HEARTBEAT_LOST: 0x8130,
    Reason.SPRING_LOST: 0xFF04,
}


class StateMachine:
    """The present state of the bench, which only events can change."""

    def __init__(self, conditions: dict[str, Callable[[], bool]]) -> None:
        self._conditions = conditions
        self._rows = {(row.source, row.event): row for row in TRANSITIONS}
        self.state = BenchState.OFF
        self.reason = Reason.NONE

    def allows(self, event: Event) -> bool:
        """Return whether ``event`` has a transition in the present state whose condition is met."""
        row = self._rows.get((self.state, event))
        return row is not None and (not row.needs or self._conditions[row.needs]())

    def handle(self, event: Event) -> bool:
        """Take the transition for ``event``. Return False if there is none.

        The first reason for a fault stays until a reset. Only an emergency stop replaces it.
        """
        if not self.allows(event):
            return False
        target = self._rows[self.state, event].target
        first = self.reason in (Reason.NONE, Reason.BY_COMMANDER)
        if event in REASON_OF and (first or event is Event.ESTOP):
            self.reason = REASON_OF[event]
        elif event is Event.DISABLE and target is BenchState.DISABLED:
            self.reason = Reason.BY_COMMANDER
        elif event in (Event.RESET, Event.POWER_LOST):
            self.reason = Reason.NONE
        self.state = target
        return True
