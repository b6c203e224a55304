"""The supervisor: it manages the state of the bench, and what this state means for actuators, air, program and
watchdog.
"""

from typing import Any, Final

import numpy as np
import numpy.typing as npt

from bench_protocol.rates import DISABLE_AFTER, TICK
from bench_protocol.table import TABLE
from bench_protocol.units import ms, s
from bench_protocol.words import FAULTS, LIVE, SAFE, BenchState, LimitKind
from bench_sim.rig.black_box import BlackBox
from bench_sim.rig.controls import TICK_MODULUS, AirSupply, ControlBit, Happened
from bench_sim.rig.emergencies import Emergencies
from bench_sim.rig.in_force import InForce
from bench_sim.rig.limits import Limit, LimitAction, reset_detectors
from bench_sim.rig.safe_position import Grip
from bench_sim.rig.states import (
    COMMAND_VALID,
    ENGAGED,
    ESTOP_RELEASED,
    MAINS,
    REASON_OF,
    SHUT_IN,
    STATUS_CODES,
    WAKING,
    Event,
    StateMachine,
)

ASTRAY: Final = (
    "the car in the loop wanted more than the actuators can do, or felt no force: its ride has ended"
)
_BOOT_TICKS: Final = round(0.2 * s / TICK)
#: Event for the state machine when a limit trips, by action; milder actions have no event.
_ON_TRIP: Final = {
    LimitAction.PROGRAM_HOLD: Event.TRIP_PROGRAM_HOLD,
    LimitAction.PROGRAM_STOP: Event.TRIP_PROGRAM_STOP,
    LimitAction.INTERLOCK: Event.TRIP_INTERLOCK,
    LimitAction.POWER_OFF: Event.TRIP_POWER_OFF,
}


class Supervisor:
    """Handles the events of the tick and the requests from CAN and Modbus, between two ticks.

    It writes the ``controls`` of the tick and the signals in ``values`` (SI, by table row). ``watched`` contains the
    limits and their detectors. The supervisor resets the settings ``in_force``, logs events to ``black_box``, and
    reports errors to ``emergencies``.
    """

    def __init__(
        self,
        controls: Any,
        values: npt.NDArray[np.float64],
        watched: tuple[tuple[Limit, ...], npt.NDArray[np.void]],
        in_force: InForce,
        black_box: BlackBox,
        emergencies: Emergencies,
    ) -> None:
        self.estop = False
        #: Whether mains power is available.
        self.mains = True
        self._controls = controls
        self._values = values
        self._limits, self._detectors = watched
        self._in_force = in_force
        self._black_box = black_box
        self._emergencies = emergencies
        self._bits = ControlBit.NONE  # of the last valid command
        self._held = False  # whether actuators were engaged before the fault reaction
        self.machine = StateMachine(
            {
                COMMAND_VALID: self.command_valid,
                ESTOP_RELEASED: lambda: not self.estop,
                MAINS: lambda: self.mains,
            },
        )

    @property
    def state(self) -> BenchState:
        """The present state of the bench."""
        return self.machine.state

    @property
    def silence(self) -> int:
        """Return the number of ticks since the last valid command."""
        return int(self._controls["tick"] - self._controls["command_tick"])

    @property
    def limits_broken(self) -> bool:
        """Whether a limit has tripped or is still exceeded after a reset."""
        return bool((self._detectors["tripped"] | self._detectors["standing"]).any())

    def command_valid(self) -> bool:
        """Return whether a commander sends valid commands with the enable bit set."""
        return (
            self._controls["commander"] >= 0
            and self.silence * TICK < DISABLE_AFTER
            and bool(self._bits & ControlBit.ENABLE)
        )

    def command(self, bits: ControlBit) -> None:
        """Handle a valid Control message in which a bit has changed: D (enable), H (hold), M (active) or R (reset)."""
        rising, self._bits = bits & ~self._bits, bits
        if not bits & ControlBit.ENABLE:
            self.handle(Event.DISABLE)
        if rising & ControlBit.RESET:
            self.reset()
        if rising & ControlBit.HOLD:
            self.handle(Event.HOLD)
        if rising & ControlBit.ACTIVE:
            self.handle(Event.ACTIVATE)
        self._step_down()

    def _step_down(self) -> None:
        """Leave the states whose bits are cleared. A rising edge of a bit enters a state, and a low level leaves it."""
        if not self._bits & ControlBit.HOLD:
            self.handle(Event.RELEASE)
        if not self._bits & ControlBit.ACTIVE:
            self.handle(Event.PAUSE)

    def run_program(self) -> bool:
        """Start or resume the program of the generator, if possible. Return whether this happened."""
        if self.state is not BenchState.ACTIVE or not self._in_force.generator.run():
            return False
        if self._in_force.generator.moves_actuators:
            self.engage()
        return True

    def run_car(self) -> bool:
        """Start the ride of the car that the settings describe, if possible. Return whether it was started."""
        if self.state is not BenchState.ACTIVE or not self._in_force.generator.ride():
            return False
        self.engage()
        return True

    def add_to_program(self) -> bool:
        """Add the wave that the settings describe to the next program, if possible. Return whether it was added."""
        return self.state is BenchState.ACTIVE and self._in_force.generator.add()

    def applied(self, *, steered: bool) -> None:
        """Handle new settings of a commander. ``steered`` is True if a control mode has changed; then the actuators
        are engaged.
        """
        if self.state not in LIVE:
            return
        c = self._controls
        c["airing"] = 0
        if self.state not in ENGAGED:
            c["shut_in"] = 0
        elif steered:
            self.engage()

    def engage(self) -> None:
        """Engage the actuators at their present positions, if their valves are still closed."""
        if self.state in ENGAGED and not self._controls["engaged"]:
            self._in_force.engage()
        self._controls["ordered"] = 0

    def forget(self) -> None:
        """Discard the program and settings of the last holder. Called when the holder of the bench changes or
        leaves.
        """
        c = self._controls
        self._in_force.generator.drop()
        self._bits = ControlBit.NONE
        c["bits"] = ControlBit.NONE
        c["wind"] = c["wind_goal"] = 0.0
        c["wind_slew"] = 0
        if c["token"]:
            self.handle(Event.NEW_HOLDER)
        if self.state in (*SAFE, *SHUT_IN):  # from all others a fault leads there
            self._in_force.rest(vented=self.state in SAFE)
            self._in_force.generator.forget()

    def handle(self, event: Event, tripped: int = 0) -> bool:
        """Pass an event to the state machine and apply the new state. Return whether the state has changed.

        In a fault state, an error is reported even if it does not change the state. ``tripped`` is the number of the
        reading that exceeded its limit.
        """
        before = self.state
        changed = self.machine.handle(event)
        if event in REASON_OF and (changed or before in FAULTS):
            self._emergencies.report(REASON_OF[event], tripped)
        if not changed:
            return False
        state, c = self.state, self._controls
        self._black_box.note(int(c["tick"]), f"{event.value}: {before.name} → {state.name}")
        if state in FAULTS and before not in FAULTS:
            self._black_box.trigger(int(c["tick"]), event.value)
        self._set("rig.state", state)
        self._set("rig.reason", self.machine.reason)
        self._set("rig.status_code", STATUS_CODES[state])
        if state is not BenchState.ACTIVE:
            self._in_force.generator.drop()
        if before is BenchState.ACTIVE or (state not in ENGAGED and self._in_force.generator.busy):
            self._freeze(keep_program=state is BenchState.HOLD)
        if state is BenchState.FAULT_REACTION:  # the hold does not change during the reaction
            self._held = before in ENGAGED
        else:
            self._hold_on(before, event)
        if state in (*SAFE, *SHUT_IN) and event not in WAKING:
            self._in_force.rest(vented=state in SAFE)
        c["active"] = state is BenchState.ACTIVE
        c["armed"] = state in (*LIVE, BenchState.FAULT_HOLD)
        if state in (BenchState.AIR_HIGH, BenchState.HOLD, BenchState.ACTIVE):
            c["air"] = AirSupply.FULL
        elif state is BenchState.AIR_LOW:
            c["air"] = AirSupply.RESTRICTED
        else:
            c["air"] = AirSupply.VENTED if state in SAFE else AirSupply.SHUT
        if state in (BenchState.BOOT, BenchState.INIT):
            c["alarm"] = c["tick"] + _BOOT_TICKS
        elif state is BenchState.FAULT_REACTION:
            c["alarm"] = c["tick"] + 1
        if event is Event.POWER_LOST:
            self._emergencies.clear()
        return True

    def _hold_on(self, before: BenchState, event: Event) -> None:
        """Decide whether the actuators keep their valves closed in the new state. They do so until a client commands
        a position.

        Therefore arming causes no motion, even while the springs are being vented or before the bolster is set down.
        Resuming causes no motion either. Otherwise an actuator that could not follow would jump to its set-point.
        """
        state, c = self.state, self._controls
        if state in ENGAGED:
            if c["engaged"] and self._in_force.astray:
                c["engaged"] = c["ordered"] = 0
            if c["grip"] == Grip.OPEN:
                self.engage()
            elif not c["engaged"]:
                c["shut_in"] = 1
        else:
            c["engaged"] = c["ordered"] = 0
            kept = c["grip"] != Grip.OPEN if before is BenchState.DISABLED else c["shut_in"]
            rising = state in LIVE and event is not Event.RELEASE
            c["shut_in"] = state in SHUT_IN or (rising and kept)
        if state in (*ENGAGED, *SHUT_IN) or (state in SAFE and before not in SAFE):
            c["grip"] = Grip.SHUT  # also for a bolster that floated on its springs: it must not move

    def _freeze(self, *, keep_program: bool) -> None:
        """Stop all motion. Set-points keep their values. The generator pauses, or ends and keeps its offset."""
        c = self._controls
        if keep_program:
            self._in_force.generator.hold()
        else:
            self._in_force.generator.freeze()
        c["goal"] = c["setpoint"]
        c["slew"] = 0

    def decide(self, happened: Happened) -> None:
        """Handle the events that the tick has reported."""
        if Happened.SPRING_LOST in happened:
            self.handle(Event.SPRING_LOST)
        if Happened.ALARM in happened:
            self._alarm()
        if Happened.RECORDED in happened:
            self._black_box.keep()
        if Happened.ASTRAY in happened:
            self._black_box.note(int(self._controls["tick"]), ASTRAY)
        if Happened.LIMIT in happened:
            self._trip()
        if Happened.COMMAND_LATE in happened:
            self.handle(Event.COMMAND_LATE)
        if Happened.COMMAND_LOST in happened:
            self.handle(Event.COMMAND_LOST)
        if Happened.TICK_LOST in happened:
            self.handle(Event.TICK_LOST)

    def _alarm(self) -> None:
        match self.state:
            case BenchState.BOOT:
                self.handle(Event.BOOTED)
            case BenchState.INIT:
                self.handle(Event.CHECKED)
            case BenchState.FAULT_REACTION:
                c = self._controls
                lost = c["lost"] or c["springless"]
                mild = self._held and not lost and not self._tripped(LimitAction.INTERLOCK)
                self.handle(Event.REACTED_HOLD if mild else Event.REACTED_DISABLE)

    def _set(self, name: str, value: float) -> None:
        self._values[TABLE.index[name]] = value

    def _tripped(self, action: LimitAction) -> bool:
        """Return whether a limit has tripped with this ``action`` or a stronger one."""
        return any(
            tripped and limit.action >= action
            for limit, tripped in zip(self._limits, self._detectors["tripped"], strict=True)
        )

    def _trip(self) -> None:
        """Apply the actions of the limits that have just tripped, the strongest first. Publish the first trip."""
        just_now = np.flatnonzero(self._detectors["tripped"] > self._detectors["reported"])
        self._detectors["reported"] = self._detectors["tripped"]
        if self._values[TABLE.index["rig.tripped"]] == 0:
            self._publish_first_trip(int(just_now[0]))
        for limit in sorted((self._limits[row] for row in just_now), key=lambda one: -one.action):
            if limit.action in _ON_TRIP:
                self.handle(_ON_TRIP[limit.action], TABLE.trip_number(limit.signal))

    def _publish_first_trip(self, row: int) -> None:
        limit, tick = self._limits[row], int(self._controls["tick"])
        judged = float(self._detectors[row]["sense"] * self._detectors[row]["judged"])
        step = {LimitKind.TIMEOUT: ms, LimitKind.COUNT: 1.0}.get(limit.kind, TABLE[limit.signal].step)
        self._set("rig.tripped", float(TABLE.trip_number(limit.signal)))
        self._set("rig.tripped_kind", limit.kind)
        self._set("rig.tripped_value", float(np.rint(judged / step)))
        self._set("rig.tripped_tick", float(tick % TICK_MODULUS))
        self._black_box.trigger(tick, limit.trip_message(judged), limit.signal)

    def reset(self) -> bool:
        """Clear the latched trips if the state machine accepts the reset. Return whether they were cleared.

        Limits that only indicate, or only hold the program, do not change the state. Their reset does not change it
        either.
        """
        if not self.handle(Event.RESET) and not (self.state in LIVE and self._detectors["tripped"].any()):
            return False
        reset_detectors(self._detectors)
        self._black_box.rearm()
        for name in ("tripped", "tripped_kind", "tripped_value", "tripped_tick"):
            self._set(f"rig.{name}", 0.0)
        self._controls["late"] = self._controls["lost"] = 0
        self._emergencies.clear()
        self._step_down()
        return True
