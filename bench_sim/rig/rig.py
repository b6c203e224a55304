"""The complete rig without network connections and clock. It receives frames and requests, and returns frames and
answers, tick by tick.
"""

from collections.abc import Callable, Mapping, Sequence
from contextlib import nullcontext
from functools import cached_property
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from bench_protocol import modbus
from bench_protocol.can_codec import Decoder, Encoder
from bench_protocol.clock import wall_time_ns
from bench_protocol.frames import FRAME, Block, copied, join
from bench_protocol.rates import COMMAND_RATE, FAST_RATE, SLOW_RATE, TICK
from bench_protocol.runtime.binding import bind
from bench_protocol.runtime.mutex import Mutex
from bench_protocol.runtime.pacing import Late, Pacing
from bench_protocol.runtime.ring import Ring, drain, fill
from bench_protocol.table import TABLE
from bench_protocol.words import FAULTS, BenchState, Reason
from bench_sim.model.external_springs import ExternalSprings
from bench_sim.model.layout import SENSORS
from bench_sim.model.plant import Plant
from bench_sim.parameters import Parameters
from bench_sim.parameters.dimensions import dimensions_of
from bench_sim.rig.black_box import BlackBox
from bench_sim.rig.canopen import CanopenNode
from bench_sim.rig.car import Couplings
from bench_sim.rig.coils import coil_actions, contacts
from bench_sim.rig.commands import Incoming
from bench_sim.rig.controls import CONTROLS, FAST, HOLDING, TICK_NS, ControlBit, Happened
from bench_sim.rig.emergencies import Emergencies
from bench_sim.rig.faults.insertion import InsertionPoints
from bench_sim.rig.faults.orders import execute_order
from bench_sim.rig.faults.panel import FaultPanel
from bench_sim.rig.generator import FunctionGenerator
from bench_sim.rig.in_force import InForce
from bench_sim.rig.lease import Lease
from bench_sim.rig.limits import LIMITS, Limit, detectors
from bench_sim.rig.node_objects import DEFAULTS
from bench_sim.rig.peers import sender_of
from bench_sim.rig.registers import BUS_NOTE, NOTE_MAX, SPRING_NOTE, RegisterBank
from bench_sim.rig.springs import ReplacementSprings
from bench_sim.rig.states import Event
from bench_sim.rig.supervisor import Supervisor
from bench_sim.rig.tick import (
    FRAMES_PER_TICK_MAX,
    PlantArrays,
    Sampling,
    Sending,
    copy_values,
    run_ticks,
)

#: Capacity of the queue of frames for the servers; enough for some seconds.
_RING_FRAMES: Final = 16_384
_FOREVER: Final = 2**62
_SCRATCH_TICKS: Final = 1000  # up to this number no memory is allocated


#: Runs compiled ticks: (number, their arrays, room for frames) -> (ticks run, frames written, what happened).
Streamed = Callable[[int, tuple[Any, ...], Block], tuple[int, int, int]]


class Rig:
    """A virtual rig: plant, tick, states, interlocks, and its CAN and Modbus interfaces.

    In virtual time call :meth:`run`. In real time :meth:`keep_time` runs the ticks in a separate thread, without the
    Python interpreter lock, and :meth:`collect` returns the sent frames. The methods for frames, requests, faults and
    power take ``lock`` themselves. Hold it to use the parts of a running rig, such as ``faults`` or ``supervisor``.
    ``lock`` is recursive, and free between two ticks. Times are on the clock of the rig: tick ``k`` is at ``k`` ms.

    ``log`` is the number of ticks in real time whose lateness is stored. ``every_tick`` names messages to send in
    every tick; then no other messages are sent (for a load test of the interfaces). ``springs`` of an FMU replace
    those of the plant.
    """

    #: Text with the reason why the springs of an FMU are lost.
    spring_lost = ""

    def __init__(
        self,
        parameters: Parameters,
        seed: int = 0,
        limits: tuple[Limit, ...] = LIMITS,
        *,
        log: int = 0,
        every_tick: Sequence[str] = (),
        springs: ReplacementSprings | None = None,
    ) -> None:
        #: The parameters of this rig, with its tolerances: the same seed gives the same sensors.
        self.parameters = parameters.as_built(seed)
        self.springs = springs
        self.plant = Plant.depressurised(self.parameters.record, seed=seed, dt=TICK)
        self.values = np.full(len(TABLE.signals), np.nan)
        self.lock = Mutex()
        self.pacing = Pacing.virtual(log)
        self._outgoing = Ring.of(_RING_FRAMES)
        self._basket = np.empty(_RING_FRAMES, FRAME), np.empty(_RING_FRAMES, np.int64)
        self._seen = self.values.copy()
        self._seen_tick = 0
        self._detectors = detectors(TABLE, limits)
        self.black_box = BlackBox()
        self._control_array = np.zeros(1, CONTROLS)
        self._controls: Any = self._control_array[0]
        self._hold_position()
        self.faults = FaultPanel(InsertionPoints(self, self.plant, self._controls, springs))
        self._prepare_frames()
        self.lease = Lease(
            self._controls,
            self.values,
            seed,
            on_change=self._holder_changed,
            on_end=lambda: self.supervisor.handle(Event.DISCONNECTED),
        )
        self.registers = RegisterBank(TABLE, self, self.lease)
        self._incoming = Incoming.of(self._decoder)
        self._tick_state = self._arrays(every_tick)
        self._bind_kernels()
        lever, couplings = self.plant.parameters.actuator_half_spacing, Couplings(dimensions_of(parameters))
        self.generator = FunctionGenerator(self._controls, self.registers.active, lever, couplings)
        self._in_force = InForce(
            self._controls, self.values, self.registers, self.generator, self.plant, springs
        )
        self.emergencies = Emergencies(self.values, lambda: self._send_event_messages(self._emergency_row))
        watched = limits, self._detectors
        self.supervisor = Supervisor(
            self._controls, self.values, watched, self._in_force, self.black_box, self.emergencies
        )
        self._actions = coil_actions(
            self.supervisor, self.generator, lambda: self.apply(self.registers.staged)
        )
        sending = next(part for part in self._tick_state if isinstance(part, Sending))
        timed = sending.fast, sending.medium, sending.slow
        self.node = CanopenNode(self, self._controls, self._encoder, self._decoder, timed)
        self._contacts = contacts(self.supervisor, lambda: self.registers.unapplied)
        self._start_values()
        self.supervisor.handle(Event.POWER_ON)

    def _hold_position(self) -> None:
        """Set zeros and set-points of the actuators to the bias of their transducers, so that nothing moves at the
        start.
        """
        zero = self.plant.parameters.sensor_bias[list(HOLDING)]
        for what in ("zero", "setpoint", "goal"):
            self._controls[what] = zero

    def _prepare_frames(self) -> None:
        """Create the encoder and decoder of frames."""
        self._encoder = Encoder(TABLE)
        self._decoder = Decoder(TABLE, from_rig=False)
        self._pending: list[Block] = []
        self._scratch = np.empty(_SCRATCH_TICKS * FRAMES_PER_TICK_MAX, FRAME)
        self._emergency_row = self._encoder.rows(["Emergency"])
        self._lease_row = self._encoder.rows(["Lease"])

    @cached_property
    def _run_ticks(self) -> Any:
        """Return the compiled ticks. They are loaded on first use (0.2 s), because a caller in virtual time may use its
        own compiled ticks (``streamed``).
        """
        return bind(run_ticks, 1, *self._tick_state, self._scratch)

    def _bind_kernels(self) -> None:
        """Bind the compiled functions, so that calls do not check the types of their arguments."""
        self._fill: Any = bind(fill, self._outgoing, 0, self._scratch, 0)
        self._drain: Any = bind(drain, self._outgoing, 0, *self._basket)
        self._look: Any = bind(copy_values, self.values, self._seen, self._control_array, 0)

    def _arrays(
        self, every_tick: Sequence[str]
    ) -> tuple[npt.NDArray[np.void], PlantArrays, Sampling, Sending, Incoming, Ring, Pacing]:
        """Return the arguments of the compiled tick."""
        plant, layout = self.plant, self._encoder.layout
        external_springs = self.springs.arrays if self.springs else ExternalSprings.none()
        fast, medium, slow = (self._rows(rate) for rate in (FAST_RATE, COMMAND_RATE, SLOW_RATE))
        every = self._encoder.rows(every_tick)
        if every.size:
            fast = medium = slow = self._encoder.rows([])
        return (
            self._control_array,
            PlantArrays(
                plant.state, plant.memory_array, plant.inputs, plant.parameter_array, external_springs
            ),
            Sampling(
                np.zeros(SENSORS),
                self.values,
                self._detectors,
                self.black_box.tape,
                self.faults.points.arrays,
            ),
            Sending(layout.messages, layout.fields, self._encoder.counters, fast, medium, slow, every),
            self._incoming,
            self._outgoing,
            self.pacing,
        )

    def _rows(self, rate: float) -> npt.NDArray[np.int64]:
        """Return the rows of the messages that are sent at ``rate`` (Hz)."""
        return self._encoder.rows([m.name for m in TABLE.messages if m.from_rig and m.rate == rate])

    # -- CAN and Modbus ------------------------------------------------------------------------------------------

    def receive(self, block: Block, peer: str = "") -> None:
        """Queue CAN frames from ``peer`` for the next tick, which accepts only commands of the holder of the lease."""
        if self.node.concerns(block):
            with self.lock:
                block = self.node.receive(block, peer)
        self._fill(self._incoming.ring, self.lock.address, copied(block), sender_of(peer))

    def answer(self, request: bytes, peer: str = "") -> bytes:
        """Return the response to one Modbus/TCP request (ADU) from ``peer``. Only one thread at a time may call this.

        All values in a response are from one sampling instant. The call blocks the tick only for a write that may have
        an effect.
        """
        self._seen_tick = self._look(self.values, self._seen, self._control_array, self.lock.address)
        may_act = modbus.is_write(request) and self.lease.owner in (None, peer)
        with self.lock if may_act else nullcontext():
            return modbus.answer(request, self.registers.seen_by(peer))

    def peer_lost(self, peer: str) -> None:
        """Handle a closed connection, and discard its staged settings. If it was that of the commander, the bench holds
        at once.
        """
        with self.lock:
            self.registers.drop_staged(peer)
            self.lease.peer_lost(peer)

    def send(self, block: Block) -> None:
        """Send frames at once, outside of the tick. Their time stamps are the time of the rig (ns)."""
        if self.pacing.real:
            self._fill(self._outgoing, self.lock.address, self.pacing.dated(block), 0)
            self.pacing.wake()
        else:
            self._pending.append(block)

    def tick(self) -> Block:
        """Run one tick and return the frames that it sends."""
        return self.run(1)

    def run(self, ticks: int, streamed: Streamed | None = None) -> Block:
        """Run ``ticks`` ticks. Return all frames in order, with the rig's time (ns) as their time stamps. ``streamed``
        is that of `run_until_event`.
        """
        blocks: list[Block] = []
        while ticks > 0:
            before = int(self._controls["tick"])
            block, _ = self.run_until_event(ticks, streamed)
            blocks.append(block)
            ticks -= int(self._controls["tick"]) - before
        return blocks[0] if len(blocks) == 1 else join(blocks)

    def run_until_event(self, ticks: int, streamed: Streamed | None = None) -> tuple[Block, bool]:
        """Run ``ticks`` ticks, or fewer if an event occurs. Return the frames, and whether there was an event.

        ``streamed`` runs the compiled ticks, and gives the rig its commands at their times.
        """
        with self.lock:
            room = ticks * FRAMES_PER_TICK_MAX
            out = self._scratch if room <= self._scratch.size else np.empty(room, FRAME)
            if streamed:
                _, count, happened = streamed(ticks, self._tick_state, out)
            else:
                _, count, happened = self._run_ticks(ticks, *self._tick_state, out)
            blocks = [*self._pending, copied(out[:count])]
            self._pending = []
            if happened:
                self._decide(Happened(happened))
                blocks += self._pending
                self._pending = []
            return blocks[0] if len(blocks) == 1 else join(blocks), happened != 0

    @property
    def tick_arguments(self) -> tuple[Any, ...]:
        """Return the arguments of the compiled ticks, without their number."""
        return (*self._tick_state, self._scratch)

    @property
    def steady(self) -> bool:
        """Whether the CANopen node sends all messages as after booting, so that clients receive every change."""
        return self.node.operational and self.node.objects.parameters == DEFAULTS

    @property
    def status(self) -> tuple[BenchState, int]:
        """Return the present state, and the program state of the function generator."""
        return self.state, int(self._controls["program"])

    @property
    def ticks(self) -> int:
        """Return the number of the present tick."""
        return int(self._controls["tick"])

    @property
    def next_fault(self) -> int:
        """Return the tick at which the next fault begins or ends, or -1 if none is planned."""
        return int(self._controls["fault_tick"])

    # -- real time -----------------------------------------------------------------------------------------------

    def keep_time(self, eventfd: int, policy: Late = Late.CATCH_UP) -> None:
        """Run ticks in real time until ``pacing.stop()`` is called. Sent frames signal ``eventfd``; ``policy`` decides
        what a late tick causes.

        The time stamp of a frame is the nominal time of its tick (Unix epoch, ns). So sampling instants are
        equidistant even if a tick is late.
        """
        run_ticks = self._run_ticks  # loaded before the first tick is due
        epoch = wall_time_ns() - int(self._controls["tick"]) * TICK_NS
        self.pacing.start(epoch, self.lock.address, eventfd, policy)
        try:
            while not self.pacing.stopped:
                _, _, happened = run_ticks(_FOREVER, *self._tick_state, self._scratch)
                if happened:
                    with self.lock:
                        self._decide(Happened(happened))
        finally:
            self.pacing.end()

    def collect(self) -> Block:
        """Return the frames sent since the last call, in real time. Only one thread at a time may call this."""
        count = self._drain(self._outgoing, self.lock.address, *self._basket)
        return copied(self._basket[0][:count])

    # -- faults, the emergency stop, power -----------------------------------------------------------------------

    def order(self, line: bytes) -> bytes:
        """Execute a command for the fault panel, given as a line of JSON. Return the answer as a line of JSON."""
        return execute_order(self.faults, line, self.lock)

    def press_estop(self) -> None:
        """Press the emergency stop. It is hard-wired: there is no software between the button and the valves."""
        with self.lock:
            self.supervisor.estop = True
            self.supervisor.handle(Event.ESTOP)

    def release_estop(self) -> None:
        """Release the emergency stop. The bench stays stopped until a reset."""
        with self.lock:
            self.supervisor.estop = False

    def cut_power(self) -> None:
        """Cut the power of valves and actuators, which go to their safe position. The servers keep their power."""
        with self.lock:
            self.supervisor.handle(Event.POWER_LOST)

    def set_mains(self, *, there: bool) -> None:
        """Switch the mains on (``there``) or off. Without mains the power is cut; it returns only by a command."""
        with self.lock:
            self.supervisor.mains = there
            if not there:
                self.cut_power()

    def power_on(self) -> None:
        """Switch on the power of valves and actuators, if the mains are on."""
        with self.lock:
            self.supervisor.handle(Event.POWER_ON)

    def hold_program(self) -> None:
        """Pause the function generator."""
        with self.lock:
            self.generator.hold()

    def stall(self, duration: int) -> None:
        """Delay the next tick by ``duration`` ns. This has an effect only in real time."""
        self.pacing.stall(duration)

    # -- reports of the interfaces -------------------------------------------------------------------------------

    def report_bus(self, load: float, errors: int) -> None:
        """Publish the bus load (0 to 1) and the transmit error counter of the rig, as a text of the Modbus
        identification.
        """
        self.registers.notes[BUS_NOTE] = f"CAN bus load {load:.1%}, {errors} transmit errors".encode()

    # -- interface for the CANopen node --------------------------------------------------------------------------

    @property
    def held(self) -> bool:
        """Whether the lease has a holder."""
        return self.lease.token != 0

    def is_token(self, token: int, peer: str) -> bool:
        """Return whether ``peer`` is the CAN connection of the holder, and ``token`` is the token of the lease."""
        return self.held and self.lease.holds(peer) and token == self.lease.token

    def setting(self, name: str) -> float:
        """Return the value of an active setting (SI)."""
        return self.registers.active[name]

    def refuse(self, peer: str, identifier: int) -> None:
        """Count a refused frame of ``peer``, which does not hold the lease."""
        self.lease.refuse(peer, identifier)

    def heartbeat_lost(self) -> None:
        """Handle the missing heartbeat of the commander."""
        self.supervisor.handle(Event.HEARTBEAT_LOST)
        self.emergencies.report(Reason.HEARTBEAT_LOST)

    def heartbeat_back(self) -> None:
        """Handle a heartbeat that has returned, or that is no longer expected. A fault stays until it is reset."""
        if self.state not in FAULTS:
            self.emergencies.settle(Reason.HEARTBEAT_LOST)

    # -- interface for the registers -----------------------------------------------------------------------------

    @property
    def seen(self) -> npt.NDArray[np.float64]:
        """Return all signals by table row (SI), at the sampling instant of the Modbus request that is being
        answered.
        """
        return self._seen

    @property
    def sequence(self) -> int:
        """Return the number of the sampling instant of ``seen``, modulo 65536."""
        return self._seen_tick // FAST & 0xFFFF

    @property
    def state(self) -> BenchState:
        """Return the present state of the bench."""
        return self.supervisor.state

    @property
    def detectors(self) -> npt.NDArray[np.void]:
        """Return the limit detectors with their state, one for each limit. Read them only between two ticks."""
        return self._detectors

    def contact(self, name: str) -> bool:
        """Return the state of an interlock. True means what its description in the table of signals states, such as
        "The hard-wired emergency stop is pressed".
        """
        return self._contacts[name]()

    def read_file(self, number: int) -> Sequence[int]:
        """Return the registers of a file of the black box. The result is empty if there is no such file."""
        return self.black_box.read_file(number)

    def act(self, name: str) -> bool:
        """Execute the action of a coil. Return whether the present state allows it."""
        with self.lock:
            return self._actions[name]()

    def apply(self, settings: Mapping[str, float]) -> bool:
        """Apply all settings at once, and return whether this is allowed. An engaged actuator changes its control
        mode without a jump.
        """
        with self.lock:
            before = self._controls["control"].copy()
            taken = self._in_force.apply(settings)
            if taken:
                self.supervisor.applied(steered=bool((self._controls["control"] != before).any()))
            return taken

    # -- inside --------------------------------------------------------------------------------------------------

    def _decide(self, happened: Happened) -> None:
        """Handle the events that the tick has reported."""
        c = self._controls
        if Happened.COMMANDED in happened:
            changes = self._incoming.changes[: c["changed"]].tolist()
            c["changed"] = 0
            for bits in changes:
                self.supervisor.command(ControlBit(bits))
            if c["ordered"]:
                self.supervisor.engage()
            if c["asked"]:
                self.lease.ask()
        if Happened.SPRING_LOST in happened and self.springs and not self.spring_lost:
            self.spring_lost = self.springs.failure()
            self.registers.notes[SPRING_NOTE] = self.spring_lost.encode()[:NOTE_MAX]
            self.black_box.note(int(c["tick"]), self.spring_lost)
        self.supervisor.decide(happened)
        self.lease.decide(happened)
        self.node.decide(happened)
        self.faults.decide(happened)

    def _start_values(self) -> None:
        for signal in TABLE.signals:
            if signal.name.startswith(("rig.", "emergency.")):
                self._set(signal.name, 0.0)
        self._set("rig.map_hash", float(TABLE.map_hash))

    def _set(self, name: str, value: float) -> None:
        self.values[TABLE.index[name]] = value

    def _holder_changed(self) -> None:
        """Reset the state of the last commander, and publish the new holder on the bus."""
        self._decoder.forget()
        self._decoder.latest.fill(np.nan)
        self.registers.drop_staged()
        self.supervisor.forget()
        self.node.start()
        self._send_event_messages(self._lease_row)

    def _send_event_messages(self, rows: npt.NDArray[np.int64]) -> None:
        """Send the messages in ``rows``, which are sent on events only."""
        time = int(self._controls["tick"]) * TICK_NS
        self.send(self._encoder.encode(self.values, rows, time))
