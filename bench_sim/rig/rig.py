"""The whole rig without a socket or clock: frames and requests in, frames and answers out, tick by tick."""

import threading
from collections.abc import Mapping
from typing import Any, Final

import numpy as np

from bench_protocol import modbus
from bench_protocol.binding import bind
from bench_protocol.can_codec import Decoder, Encoder, Tally
from bench_protocol.frames import FRAME, Block, join
from bench_protocol.rates import COMMAND_RATE, DISABLE_AFTER, FAST_RATE, LATENESS_BINS, SLOW_RATE, TICK
from bench_protocol.signals import Group
from bench_protocol.table import TABLE
from bench_protocol.units import bar
from bench_protocol.words import (
    ACTUATORS,
    AXES,
    CONTROL_MODES,
    FAULTS,
    LIVE,
    PIPE_LENGTH,
    PLATFORM_AXES,
    BenchState,
    Program,
    Reason,
)
from bench_sim.model.layout import Sensor
from bench_sim.model.layout import State as PlantState
from bench_sim.model.plant import Plant
from bench_sim.model.wiring import sensors_of
from bench_sim.parameters import Parameters
from bench_sim.rig.limits import LIMITS, Limit, LimitAction, detectors
from bench_sim.rig.registers import RegisterBank
from bench_sim.rig.states import (
    COMMAND_VALID,
    ENGAGED,
    ESTOP_RELEASED,
    STATUS_CODES,
    Event,
    StateMachine,
)
from bench_sim.rig.tick import (
    CONTROLS,
    FRAMES_PER_TICK_MAX,
    TARGETS,
    TICK_NS,
    Air,
    Happened,
    Target,
    run_ticks,
    take_commands,
)

_SCRATCH_TICKS: Final = 100  # as many frames need no new memory
_BOOT_TICKS: Final = 200
_RETURN_TICKS: Final = 1000  # a stopped generator's axis takes one second to come back
#: By table row: which target a set-point aims for, and in which control mode; -1 for none and any.
_TARGETS: Final = np.full(len(TABLE.signals), -1, np.int64)
_MODES: Final = np.full(len(TABLE.signals), -1, np.int64)
for _target, _name in enumerate(ACTUATORS):
    for _mode in ("force", "displacement"):
        _TARGETS[TABLE.index[f"{_name}.{_mode}_setpoint"]] = _target
        _MODES[TABLE.index[f"{_name}.{_mode}_setpoint"]] = CONTROL_MODES.index(_mode)
for _axis in PLATFORM_AXES:
    _TARGETS[TABLE.index[f"platform.{_axis}_setpoint"]] = Target[f"PLATFORM_{_axis.upper()}"]
#: More command frames than this in one block are a flood; what comes after is not heard.
_CHANGES_MAX: Final = 4096
_ENABLE, _HOLD, _ACTIVE, _RESET = 1, 2, 4, 8
_REJECTED: Final = TABLE.index["rig.rejected_commands"]
_CONTROL: Final = TABLE.index["control.enable"]
#: Up to which gauge pressure somebody may open a flange.
_FLANGE_PRESSURE: Final = 0.3 * bar
#: CANopen emergency codes (CiA 301): 0x8130 is its heartbeat error, 0xFF00 and up are the device's own.
_EMERGENCY: Final = {
    Reason.NONE: 0x0000,
    Reason.COMMAND_LATE: 0x8130,
    Reason.COMMAND_LOST: 0x8130,
    Reason.DISCONNECTED: 0x8130,
    Reason.LIMIT: 0xFF01,
    Reason.ESTOP: 0xFF02,
    Reason.TICK_LOST: 0xFF03,
    Reason.BY_COMMANDER: 0x0000,
}


class Rig:
    """A virtual rig: plant, tick, states, interlocks and both doors.

    One thread at a time: the methods take a lock, so that a server's thread may answer between two ticks.
    All times are the rig's own: tick ``k`` happens at ``k`` ms.
    """

    def __init__(self, parameters: Parameters, seed: int = 0, limits: tuple[Limit, ...] = LIMITS) -> None:
        #: The set as this rig was built: the same seed draws the same sensors.
        self.parameters = parameters.as_built(seed)
        self.plant = Plant.depressurised(self.parameters.record, seed=seed, dt=TICK)
        self.values = np.full(len(TABLE.signals), np.nan)
        self.lock = threading.RLock()
        self.estop = False
        self._limits = limits
        self._detectors = detectors(TABLE, limits, FAST_RATE)
        controls = np.zeros(1, CONTROLS)
        self._controls: Any = controls[0]
        self._encoder = Encoder(TABLE)
        self._decoder = Decoder(TABLE, from_rig=False)
        self._commander: str | None = None
        self._bits = 0  # D, H, M, R of the last valid command
        self._changes = np.zeros(_CHANGES_MAX, np.int64)
        self._modbus_deadline = -1
        self._pending: list[Block] = []
        self._scratch = np.empty(_SCRATCH_TICKS * FRAMES_PER_TICK_MAX, FRAME)
        self._readings = np.zeros(len(Sensor))
        self._status_rows = np.array(
            [TABLE.index[name] for name in ("rig.tick", "rig.program", "rig.generator_cycle")], np.int64
        )
        self._rows = {
            rate: self._encoder.rows([m.name for m in TABLE.messages if m.from_rig and m.rate == rate])
            for rate in (FAST_RATE, COMMAND_RATE, SLOW_RATE)
        }
        self._emergency_row = self._encoder.rows(["Emergency"])
        self._tick_state = (
            controls,
            self.plant.state,
            self.plant.memory_array,
            self.plant.inputs,
            self.plant.parameter_array,
            self._readings,
            self.values,
            self._status_rows,
            self._detectors,
            self._encoder.plan.messages,
            self._encoder.plan.fields,
            self._encoder.counters,
            self._rows[FAST_RATE],
            self._rows[COMMAND_RATE],
            self._rows[SLOW_RATE],
        )
        self._run_ticks: Any = bind(run_ticks, 1, *self._tick_state, np.zeros(FRAMES_PER_TICK_MAX, FRAME))
        none = np.zeros(0, np.int64), np.zeros(0)
        self._take_commands: Any = bind(
            take_commands, controls, *none, _TARGETS, _MODES, _CONTROL, self._changes
        )
        self.machine = StateMachine(
            {COMMAND_VALID: self._command_valid, ESTOP_RELEASED: lambda: not self.estop},
        )
        self.registers = RegisterBank(TABLE, self)
        #: What the bench was last told to have fitted. The parameter set may say otherwise: a plate that was
        #: bored wrong stays in until somebody changes it.
        self._fitted = _fittings(self.registers.staged)
        self._start_values()
        self.apply(self.registers.staged)
        self._handle(Event.POWER_ON)

    # -- the doors -----------------------------------------------------------------------------------------------

    def receive(self, block: Block, peer: str = "") -> None:
        """Take CAN frames from ``peer``; only the first commander's count while it is alive."""
        with self.lock:
            if self._commander not in (None, peer) and self._silence() < DISABLE_AFTER / TICK:
                return
            stamped = block[:_CHANGES_MAX].copy()
            stamped["time"] = int(self._controls["tick"]) * TICK_NS
            samples = self._decoder.decode(stamped)
            tally = self._decoder.tally
            self.values[_REJECTED] = (
                tally[Tally.CORRUPT] + tally[Tally.REPEATED] + tally[Tally.OUT_OF_SEQUENCE]
            )
            if samples.signals.size:
                self._commander = peer
                count = self._take_commands(
                    self._tick_state[0],
                    samples.signals,
                    samples.values,
                    _TARGETS,
                    _MODES,
                    _CONTROL,
                    self._changes,
                )
                for bits in self._changes[:count].tolist():
                    self._command(bits)

    def answer(self, request: bytes, peer: str = "") -> bytes:
        """Return the response to one Modbus/TCP request (ADU) from ``peer``."""
        with self.lock:
            return modbus.answer(request, self.registers.seen_by(peer))

    def peer_lost(self, peer: str) -> None:
        """Hear that a connection is gone; if it was the commander's the bench holds at once."""
        with self.lock:
            if self.registers.release(peer) or peer == self._commander:
                self._handle(Event.DISCONNECTED)
            if peer == self._commander:
                self._commander = None
                self._decoder.forget()

    def tick(self) -> Block:
        """Run one tick and return the frames that it sends."""
        return self.run(1)

    def run(self, ticks: int) -> Block:
        """Run ``ticks`` ticks and return all frames in order, stamped with the rig's time (ns)."""
        with self.lock:
            blocks, self._pending = self._pending, []
            room = ticks * FRAMES_PER_TICK_MAX
            out = self._scratch if room <= self._scratch.size else np.empty(room, FRAME)
            start = 0
            while ticks > 0:
                done, count, happened = self._run(ticks, out[start:])
                blocks.append(out[start : start + count].copy())
                start += count
                ticks -= done
                if happened or self._modbus_deadline >= 0:
                    self._decide(Happened(happened))
                    blocks += self._pending
                    self._pending = []
            return blocks[0] if len(blocks) == 1 else join(blocks)

    # -- the hard wires ------------------------------------------------------------------------------------------

    def press_estop(self) -> None:
        """Press the emergency stop: hard-wired, no software between the button and the valves."""
        with self.lock:
            self.estop = True
            self._handle(Event.ESTOP)

    def release_estop(self) -> None:
        """Release the button; the bench stays stopped until somebody resets it."""
        with self.lock:
            self.estop = False

    # -- what the loop around it reports -------------------------------------------------------------------------

    def report_lateness(self, lateness: float, *, lost: bool = False) -> None:
        """Count a tick that began ``lateness`` s after its deadline; ``lost`` makes it a fault (policy ``fault``)."""
        counter = next(one for one in LATENESS_BINS if lateness < one.edge)
        self.values[TABLE.index[counter.signal]] += 1
        worst = TABLE.index["rig.lateness_max"]
        self.values[worst] = max(self.values[worst], lateness)
        if lateness >= TICK:
            self.values[TABLE.index["rig.late_ticks"]] += 1
        if lost:
            with self.lock:
                self._handle(Event.TICK_LOST)

    # -- what the registers ask for ------------------------------------------------------------------------------

    @property
    def sequence(self) -> int:
        """The sampling instant, modulo 65536."""
        return int(self._controls["tick"]) // 5 & 0xFFFF

    @property
    def state(self) -> BenchState:
        """The present state of the bench."""
        return self.machine.state

    def contact(self, name: str) -> bool:
        """Return the state of an interlock."""
        match name:
            case "estop":
                return self.estop
            case "pneumatic":
                return self.state not in (*LIVE, BenchState.FAULT_HOLD)
            case "program":
                return self.state is not BenchState.ACTIVE
            case "command":
                return self._command_valid()
            case "limits":
                return bool(self._detectors["tripped"].any())
            case "fault":
                return self.state in FAULTS
            case "staged":
                return self.registers.unapplied
        raise ValueError(f"there is no interlock {name!r}")

    def watch(self, milliseconds: int) -> None:
        """Expect the next write of the lease holder within ``milliseconds``; 0 stops watching."""
        self._modbus_deadline = int(self._controls["tick"]) + milliseconds if milliseconds else -1

    def act(self, name: str) -> bool:
        """Carry out a coil's action; return whether the present state allows it."""
        match name:
            case "reset":
                return self._reset()
            case "program_run":
                return self._program_run()
            case "program_hold":
                return self._program_hold()
            case "program_stop":
                return self._program_stop()
        return self._handle(Event(name.replace("_", " ")) if name != "disable" else Event.DISABLE)

    def apply(self, settings: Mapping[str, float]) -> bool:
        """Take over all settings at once; an engaged actuator changes its control mode without a bump."""
        c = self._controls
        if c["program"] in (Program.RUN, Program.HOLD):
            moved = [
                c["control"][0] != settings["vertical.control"],
                c["control"][2] != settings["lateral.control"],
            ]
            if any(moved):
                return False  # a mode must not change under a running program
        fittings = _fittings(settings)
        if fittings != self._fitted and not self._may_be_opened():
            return False
        if not self._shim(settings["rig.nominal_preload"]):
            return False
        self._fit(*fittings)
        for k, side in enumerate(("left", "right")):
            c["air_mode"][k] = settings[f"air.{side}_mode"]
            c["air_target"][k] = settings[f"air.{side}_target"]
            c["reservoir"][k] = settings[f"air.{side}_reservoir"]
        c["dpv"] = settings["air.dpv"]
        modes = (settings["vertical.control"], settings["vertical.control"], settings["lateral.control"])
        for actuator, mode in enumerate(modes):
            if c["control"][actuator] != mode:
                c["control"][actuator] = mode
                self._take_present(Target(actuator))
        return True

    # -- inside --------------------------------------------------------------------------------------------------

    def _run(self, ticks: int, out: Block) -> tuple[int, int, int]:
        if self._modbus_deadline >= 0:
            ticks = max(1, min(ticks, self._modbus_deadline - int(self._controls["tick"])))
        ran: tuple[int, int, int] = self._run_ticks(ticks, *self._tick_state, out)
        return ran

    def _start_values(self) -> None:
        for signal in TABLE.signals:
            if signal.name.startswith(("rig.", "emergency.")):
                self._set(signal.name, 0.0)
        self._set("rig.map_hash", float(TABLE.map_hash))

    def _set(self, name: str, value: float) -> None:
        self.values[TABLE.index[name]] = value

    def _silence(self) -> int:
        """Ticks since the last valid command."""
        return int(self._controls["tick"] - self._controls["command_tick"])

    def _command_valid(self) -> bool:
        return (
            self._commander is not None
            and self._silence() * TICK < DISABLE_AFTER
            and bool(self._bits & _ENABLE)
        )

    def _command(self, bits: int) -> None:
        """Act on the D, H, M and R bits of a valid Control message in which one of them has changed."""
        rising, self._bits = bits & ~self._bits, bits
        if not bits & _ENABLE:
            self._handle(Event.DISABLE)
        if rising & _RESET:
            self._reset()
        if rising & _HOLD:
            self._handle(Event.HOLD)
        if rising & _ACTIVE:
            self._handle(Event.ACTIVATE)
        self._step_down()

    def _step_down(self) -> None:
        """Leave the states that the present bits do not ask for: going up takes an edge, going down a level."""
        if not self._bits & _HOLD:
            self._handle(Event.RELEASE)
        if not self._bits & _ACTIVE:
            self._handle(Event.PAUSE)

    def _shim(self, preload: float) -> bool:
        """Set the height to zero for ``preload`` (N per spring), as shims under the emergency springs do.

        The bolster is lifted or lowered by what the emergency springs differ between the two loads, so that the
        bellows do not feel it. Refused while the actuators hold or move.
        """
        par, x = self.plant.parameters, self.plant.state
        change = preload - par.nominal_preload
        if not change.any():
            return True
        if self._controls["engaged"]:
            return False
        lift = change / par.emergency_stiffness_vertical if par.emergency_spring else np.zeros(2)
        x[PlantState.BOLSTER_VERTICAL] += lift.mean()
        x[PlantState.BOLSTER_ROLL] += 0.5 * (lift[0] - lift[1]) / par.spring_half_spacing
        x[PlantState.LEVER : PlantState.LEVER + 2] += lift
        par.nominal_preload[:] = preload
        return True

    def _may_be_opened(self) -> bool:
        """Tell whether hands may open the flanges: nothing engaged, and no pressure (the air asks no sensor)."""
        gauge = self.plant.ideal()[sensors_of(Group.PRESSURE)]
        return not self._controls["engaged"] and bool((np.abs(gauge) < _FLANGE_PRESSURE).all())

    def _fit(self, plate: int, pipe: bool) -> None:
        """Change the orifice plates (bore in steps of the setting) and the pipes of both sides, where they differ."""
        par, (old_plate, old_pipe) = self.plant.parameters, self._fitted
        if plate != old_plate:
            par.orifice_diameter[:] = plate * TABLE["rig.orifice_diameter"].step
        if pipe != old_pipe:
            par.pipe_length[:] = PIPE_LENGTH if pipe else 0.0
            self.plant.state[PlantState.PIPE_FLOW : PlantState.PIPE_FLOW + 2] = 0.0
        self._fitted = plate, pipe

    def _take_present(self, target: Target) -> None:
        """Let an actuator's set-point be what it measures now, so that taking over changes nothing."""
        c = self._controls
        mode = CONTROL_MODES[int(c["control"][target])]
        present = 0.0 if mode == "off" else self.values[TABLE.index[f"{ACTUATORS[target]}.{mode}"]]
        c["setpoint"][target] = c["goal"][target] = 0.0 if np.isnan(present) else present
        c["slew"][target] = 0

    def _handle(self, event: Event) -> bool:
        """Let the state machine decide and bring everything in line with the new state."""
        before = self.machine.state
        if not self.machine.handle(event):
            return False
        state, c = self.machine.state, self._controls
        self._set("rig.state", state)
        self._set("rig.reason", self.machine.reason)
        self._set("rig.status_code", STATUS_CODES[state])
        if state in ENGAGED and not c["engaged"]:
            for actuator in (Target.VERTICAL_LEFT, Target.VERTICAL_RIGHT, Target.LATERAL):
                self._take_present(actuator)
        if before is BenchState.ACTIVE:
            self._freeze(keep_program=state is BenchState.HOLD)
        if state is not BenchState.FAULT_REACTION:  # while it reacts, the bench keeps what it has
            c["engaged"] = state in ENGAGED
        c["active"] = state is BenchState.ACTIVE
        c["armed"] = state in (*LIVE, BenchState.FAULT_HOLD)
        if state in (BenchState.AIR_HIGH, BenchState.HOLD, BenchState.ACTIVE):
            c["air"] = Air.FULL
        elif state is BenchState.AIR_LOW:
            c["air"] = Air.RESTRICTED
        else:
            c["air"] = Air.VENTED if state is BenchState.ESTOP else Air.SHUT
        if state in (BenchState.BOOT, BenchState.INIT):
            c["alarm"] = c["tick"] + _BOOT_TICKS
        elif state is BenchState.FAULT_REACTION:
            c["alarm"] = c["tick"] + 1
        if (state in FAULTS) != (before in FAULTS):
            self._emergency()
        return True

    def _freeze(self, *, keep_program: bool) -> None:
        """Stop where everything is: set-points stay, the generator pauses, or ends with its offset kept."""
        c = self._controls
        if c["program"] == Program.RUN and keep_program:
            c["program"] = Program.HOLD
        elif not keep_program:
            self._absorb_offset()
            c["program"] = Program.STOPPED if c["program"] != Program.IDLE else Program.IDLE
        c["goal"] = c["setpoint"]
        c["slew"] = 0

    def _absorb_offset(self) -> None:
        c = self._controls
        c["setpoint"] += c["offset"]
        c["offset"] = 0.0
        c["phase"] = 0.0

    def _emergency(self) -> None:
        reason = self.machine.reason
        self._set("emergency.code", _EMERGENCY[reason])
        self._set("emergency.register", 1.0 if _EMERGENCY[reason] else 0.0)
        self._set("emergency.reason", reason)
        time = int(self._controls["tick"]) * TICK_NS
        self._pending.append(self._encoder.encode(self.values, self._emergency_row, time))

    def _decide(self, happened: Happened) -> None:
        """Act on what the tick could not decide by itself."""
        if Happened.ALARM in happened:
            self._alarm()
        if Happened.LIMIT in happened:
            self._trip()
        if Happened.COMMAND_LATE in happened:
            self._handle(Event.COMMAND_LATE)
        if Happened.COMMAND_LOST in happened:
            self._commander = None
            self._handle(Event.COMMAND_LOST)
        if 0 <= self._modbus_deadline <= int(self._controls["tick"]):
            self._modbus_deadline = -1
            self._handle(Event.DISCONNECTED)

    def _alarm(self) -> None:
        match self.machine.state:
            case BenchState.BOOT:
                self._handle(Event.BOOTED)
            case BenchState.INIT:
                self._handle(Event.CHECKED)
            case BenchState.FAULT_REACTION:
                c = self._controls
                mild = c["engaged"] and not c["lost"] and not self._tripped(LimitAction.POWER_OFF)
                self._handle(Event.REACTED_HOLD if mild else Event.REACTED_DISABLE)

    def _tripped(self, action: LimitAction) -> bool:
        return any(
            tripped and limit.action is action
            for limit, tripped in zip(self._limits, self._detectors["tripped"], strict=True)
        )

    def _trip(self) -> None:
        if self.values[TABLE.index["rig.tripped"]] == 0:
            first = int(np.argmax(self._detectors["tripped"]))
            self._set("rig.tripped", float(TABLE.trip_number(self._limits[first].signal)))
        if self._tripped(LimitAction.POWER_OFF):
            self._handle(Event.TRIP_OFF)
        elif self._tripped(LimitAction.HOLD):
            self._handle(Event.TRIP_HOLD)

    def _reset(self) -> bool:
        """Clear what is latched, if the state machine lets the reset through."""
        if not self._handle(Event.RESET):
            return False
        self._detectors["tripped"] = 0
        self._detectors["outside"] = 0
        self._set("rig.tripped", 0.0)
        self._controls["late"] = self._controls["lost"] = 0
        self._step_down()
        return True

    def _program_run(self) -> bool:
        c, staged = self._controls, self.registers.staged
        if self.state is not BenchState.ACTIVE or c["program"] == Program.RUN:
            return False
        if c["program"] == Program.HOLD:
            c["program"] = Program.RUN
            return True
        amplitude = self._amplitude(int(staged["generator.axis"]))
        if amplitude is None:
            return False
        c["axis"], c["wave"] = staged["generator.axis"], staged["generator.wave"]
        c["amplitude"] = amplitude
        c["lever"] = self.plant.parameters.actuator_half_spacing
        c["frequency"], c["cycles"] = staged["generator.frequency"], staged["generator.cycles"]
        c["phase"] = 0.0
        c["program"] = Program.RUN
        return True

    def _amplitude(self, axis: int) -> float | None:
        """Return the amplitude for ``axis`` in its present control mode; None if it cannot move so."""
        staged, name = self.registers.staged, AXES[axis]
        if name == "platform_roll":
            return staged["generator.roll_amplitude"]
        if name.startswith("platform"):
            return staged["generator.amplitude"]
        mode = CONTROL_MODES[int(self._controls["control"][2 if name == "lateral" else 0])]
        if mode == "displacement":
            return staged["generator.roll_amplitude" if name == "roll" else "generator.amplitude"]
        if mode == "force" and name != "roll":
            return staged["generator.force_amplitude"]
        return None

    def _program_hold(self) -> bool:
        if self._controls["program"] != Program.RUN:
            return False
        self._controls["program"] = Program.HOLD
        return True

    def _program_stop(self) -> bool:
        c = self._controls
        if c["program"] not in (Program.RUN, Program.HOLD):
            return False
        self._absorb_offset()
        c["program"] = Program.STOPPED
        for target in range(TARGETS):
            c["slew"][target] = _RETURN_TICKS
        return True


def _fittings(settings: Mapping[str, float]) -> tuple[int, bool]:
    """Return the bore of the plates, in steps of the setting (no single says exactly 13 mm), and if pipes are in."""
    signal = TABLE["rig.orifice_diameter"]
    return round(settings[signal.name] / signal.step), bool(settings["rig.pipe"])
