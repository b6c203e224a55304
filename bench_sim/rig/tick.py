"""The compiled tick: set-points, function generator, air control, plant step, sampling, frames, watchdog, limits.

One call runs the requested number of ticks. It stops earlier after a tick with an event for the state machine. So real
time (one tick per call) and virtual time (many ticks per call) behave the same.
"""

import math
from typing import Any, Final, NamedTuple

import numpy as np
import numpy.typing as npt

from bench_protocol.can_codec import encode_into
from bench_protocol.rates import TICK
from bench_protocol.runtime.calls import (
    enter_interpreter,
    leave_interpreter,
    lock_yielding,
    unlock_mutex,
    unlock_yielding,
    wake,
)
from bench_protocol.runtime.pacing import Pacing, await_tick, put_off
from bench_protocol.runtime.ring import Ring, push
from bench_protocol.table import TABLE
from bench_protocol.units import bar, mbar
from bench_protocol.words import (
    ACTUATORS,
    AIR_MODES,
    AXES,
    CONTROL_MODES,
    PLATFORM_AXES,
    SIDES,
    WAVES,
    Program,
)
from bench_sim.model.algebraic import ALGEBRAICS
from bench_sim.model.compiled import compiled, compiled_entry
from bench_sim.model.external_springs import ExternalSprings, Slot
from bench_sim.model.kernel import observe, step
from bench_sim.model.layout import SENSORS, STATES, Input, Mode, Sensor
from bench_sim.model.runge_kutta import step_scheme
from bench_sim.model.sensors import read_sensors
from bench_sim.rig.black_box import Tape, write_sample
from bench_sim.rig.car import publish_car, ride
from bench_sim.rig.commands import Incoming, take_waiting
from bench_sim.rig.controls import (
    FAST,
    GONE_TICKS,
    LATE_TICKS,
    LOST_TICKS,
    MEDIUM,
    SLOW,
    TARGETS,
    TICK_MODULUS,
    TICK_NS,
    AirSupply,
    Happened,
    Target,
)
from bench_sim.rig.external_springs import observe_around, step_around
from bench_sim.rig.faults.in_tick import FaultArrays, disturb, hold_inputs
from bench_sim.rig.heartbeat import node_due, send_heartbeat
from bench_sim.rig.lateness import count_lateness
from bench_sim.rig.limits import detect
from bench_sim.rig.safe_position import LOWERING_SPEED, Grip, keep_grip
from bench_sim.rig.setpoints import travel

#: All messages at once, and a heartbeat.
FRAMES_PER_TICK_MAX: Final = 1 + sum(message.from_rig and message.rate > 0 for message in TABLE.messages)


#: The pressure controller opens a service valve fully at this error, and not at all within the dead zone.
_FULL_OPENING: Final = 0.15 * bar
_DEAD_ZONE: Final = 5 * mbar
#: AIR_LOW lets through a fifth of the flow.
_RESTRICTED: Final = 0.2


#: Rows of the table that the tick itself fills.
_TICK_ROW: Final = TABLE.index["rig.tick"]
_PROGRAM_ROW: Final = TABLE.index["rig.program"]
_CYCLE_ROW: Final = TABLE.index["rig.generator_cycle"]
_REFUSED_ROW: Final = TABLE.index["rig.refused_setpoints"]

_DISPLACEMENT: Final = CONTROL_MODES.index("displacement")
_LEVEL: Final = AIR_MODES.index("level")
_FILL: Final = AIR_MODES.index("fill")
_VENT: Final = AIR_MODES.index("vent")
#: The plant has one more mode: shut in, which cannot be commanded; the valve enters it by itself.
assert tuple(mode.name.lower() for mode in Mode if mode is not Mode.SHUT_IN) == CONTROL_MODES
#: The actuators come first, then the axes of the platform. From the lateral actuator on, the order is that of the
#: axes of the generator.
_NAMES: Final = tuple(target.name.lower() for target in Target)
assert (*ACTUATORS, *(f"platform_{axis}" for axis in PLATFORM_AXES)) == _NAMES
assert AXES[Target.LATERAL :] == _NAMES[Target.LATERAL :]
_COSINE: Final = WAVES.index("unilateral_cosine")
_TRIANGLE: Final = WAVES.index("triangle")
_PLATEAU: Final = WAVES.index("plateau")


@compiled
def waveform(wave: int, phase: float, cycles: float) -> float:
    """Return the value (−1 to 1) of a wave at ``phase``, the cycles since its start. ``cycles`` is its whole number
    of cycles.

    Sine, triangle and plateau fade in over the first cycle and out over the last one. The unilateral cosine ``(1 -
    cos(2 pi phase)) / 2`` starts and ends at rest without this. Before its start (``phase`` < 0) a wave is 0.
    """
    if phase < 0.0:
        return 0.0
    if wave == _COSINE:
        return 0.5 * (1.0 - math.cos(2.0 * math.pi * phase))
    envelope = 1.0
    edge = min(phase, cycles - phase)
    if edge < 1.0:
        envelope = 0.5 * (1.0 - math.cos(math.pi * max(edge, 0.0)))
    if wave == _PLATEAU:
        return envelope
    turn = phase - math.floor(phase)
    if wave == _TRIANGLE:
        if turn < 0.25:
            unit = 4.0 * turn
        elif turn < 0.75:
            unit = 2.0 - 4.0 * turn
        else:
            unit = 4.0 * turn - 4.0
    else:
        unit = math.sin(2.0 * math.pi * turn)
    return envelope * unit


@compiled
def _generate(c: Any) -> int:
    """Advance all waves of the function generator by one tick, and set the offsets. Return the `Happened` events."""
    happened = Happened.NOTHING.value
    if c.program == Program.RUN:
        going = False
        for k in range(c.waves):
            c.phase[k] = min(c.phase[k] + c.frequency[k] * TICK, c.cycles[k])
            going = going or c.phase[k] < c.cycles[k]
        if not going:
            c.program = Program.IDLE.value
            happened = Happened.PROGRAM_DONE.value
    for row in range(TARGETS):
        c.offset[row] = 0.0
    if c.program == Program.RUN or c.program == Program.HOLD:
        for k in range(c.waves):
            unit = waveform(c.wave[k], c.phase[k], c.cycles[k])
            for row in range(TARGETS):
                c.offset[row] += c.amplitude[k, row] * unit
    return happened


@compiled
def _advance_program(c: Any, mem: Any, par: Any, sampling: Any) -> int:
    """Advance the program by one tick: its waves, or the ride of the car. Return the `Happened` events."""
    if c.riding != 0:
        return int(ride(c, mem, par, sampling.faults, sampling.readings))
    return int(_generate(c))


@compiled
def _opening(mode: int, target: float, pressure: float) -> float:
    """Return the opening of a service valve, from -1 (exhaust) to 1 (fill): the output of a proportional pressure
    controller with a dead zone. ``target`` and ``pressure`` are in Pa.
    """
    error = target - pressure
    if math.isnan(error) or abs(error) < _DEAD_ZONE:
        return 0.0
    if mode == _FILL:
        return min(max(error / _FULL_OPENING, 0.0), 1.0)
    if mode == _VENT:
        return max(min(error / _FULL_OPENING, 0.0), -1.0)
    return 0.0


@compiled
def _set_inputs(c: Any, u: Any, pressure_left: float, pressure_right: float) -> None:
    """Move the set-points by one tick, and convert the controls to the inputs of the plant.

    An actuator in displacement control follows its own transducer, so it has the zero error of this transducer.
    """
    travel(c)
    for actuator in range(len(ACTUATORS)):
        command = Input.VERTICAL_LEFT_COMMAND + actuator
        mode = Input.VERTICAL_LEFT_MODE + actuator
        if c.engaged != 0 or c.grip == Grip.OPEN:
            # The wire's numbers of the control modes are the plant's.
            u[mode] = float(c.control[actuator]) if c.engaged != 0 else 0.0
            u[command] = c.setpoint[actuator] + c.offset[actuator]
            if u[mode] == _DISPLACEMENT:
                u[command] -= c.zero[actuator]
        else:
            lowering = c.grip == Grip.LOWERING and actuator != Target.LATERAL and c.lowering[actuator] != 0
            u[mode] = float(Mode.SHUT_IN.value)
            u[command] = -LOWERING_SPEED if lowering else 0.0
    for axis in range(len(PLATFORM_AXES)):
        target = Target.PLATFORM_VERTICAL + axis
        u[Input.PLATFORM_VERTICAL + axis] = c.setpoint[target] + c.offset[target] - c.zero[target]

    flowing = c.air == AirSupply.RESTRICTED or c.air == AirSupply.FULL
    vented = c.air == AirSupply.VENTED or c.airing > 0  # arming does not interrupt it
    u[Input.SUPPLY] = 1.0 if flowing else 0.0
    u[Input.DPV_CONNECTED] = c.dpv
    for side in range(len(SIDES)):
        pressure = pressure_left if side == 0 else pressure_right
        opening = 0.0
        if vented:
            opening = -1.0
        elif flowing:
            opening = _opening(c.air_mode[side], c.air_target[side], pressure)
            if c.air == AirSupply.RESTRICTED:
                opening *= _RESTRICTED
        leveling = not vented and c.air == AirSupply.FULL and c.air_mode[side] == _LEVEL
        u[Input.LEFT_SERVICE_VALVE + side] = opening
        u[Input.LEFT_LEVELING + side] = 1.0 if leveling else 0.0
        # The bellows are vented too: the way through their auxiliary chambers is open.
        u[Input.LEFT_RESERVOIR_VALVE + side] = 1.0 if vented else c.reservoir[side]


@compiled
def _expired_watchdogs(c: Any) -> int:
    """Return the events of watchdogs that expire in this tick: commands late or lost, writes of the holder, or the
    lease.
    """
    happened = Happened.NOTHING.value
    silence = c.tick - c.command_tick
    if c.tick == c.write_deadline:
        happened |= Happened.WRITES_LOST.value
    if c.expiring != 0:
        gone = silence >= LOST_TICKS and c.tick - c.granted >= LOST_TICKS
    else:
        # A client that has never commanded on CAN, or still writes, counts as present. One that has commanded does not,
        # even if its connection on CAN has closed.
        commanded = c.token != 0 and c.command_tick >= c.granted
        gone = commanded and silence >= GONE_TICKS and c.tick - c.write_tick >= GONE_TICKS
    if gone:
        happened |= Happened.LEASE_LOST.value
    if c.armed == 0:
        return happened
    if silence >= LATE_TICKS and c.late == 0:
        c.late = 1
        happened |= Happened.COMMAND_LATE.value
    if silence >= LOST_TICKS and c.lost == 0:
        c.lost = 1
        happened |= Happened.COMMAND_LOST.value
    return happened


@compiled
def _due_parts(c: Any) -> int:
    """Return the events for the state machine and for the fault panel that are due in this tick."""
    happened = Happened.NOTHING.value
    if c.tick == c.alarm:
        happened |= Happened.ALARM.value
    if c.tick == c.fault_tick:
        happened |= Happened.FAULT.value
    return happened


class PlantArrays(NamedTuple):
    """The arrays of the plant for its compiled step. ``memory`` and ``parameters`` contain one record each.

    ``external_springs`` are the springs of an external library, if there are any.
    """

    state: npt.NDArray[np.float64]
    memory: npt.NDArray[np.void]
    inputs: npt.NDArray[np.float64]
    parameters: npt.NDArray[np.void]
    external_springs: ExternalSprings


class Sampling(NamedTuple):
    """The data of a sampling instant (200 Hz): readings of the sensors, all signals by table row, limits and faults."""

    readings: npt.NDArray[np.float64]
    values: npt.NDArray[np.float64]  #: SI; the measurements are first, in the order of the sensors
    detectors: npt.NDArray[np.void]
    tape: Tape  #: of the black box
    faults: FaultArrays


class Sending(NamedTuple):
    """The layout of the frames, their counters, and the rows of the messages that are sent at each rate."""

    messages: npt.NDArray[np.void]
    fields: npt.NDArray[np.void]
    counters: npt.NDArray[np.int64]
    fast: npt.NDArray[np.int64]
    medium: npt.NDArray[np.int64]
    slow: npt.NDArray[np.int64]
    every: npt.NDArray[np.int64]  #: in every tick


@compiled
def _send(values: Any, sending: Sending, rows: Any, time: int, out: Any, position: int) -> int:
    """Write one frame for each message in ``rows`` to ``out``, with the time stamp ``time`` (ns). Return the position
    after the last frame.
    """
    return encode_into(values, rows, time, sending.messages, sending.fields, sending.counters, out, position)


@compiled
def _step(c: Any, plant: PlantArrays, scheme: tuple[int, int], work: Any, algebraic: Any, ideal: Any) -> int:
    """Take a step of the plant. Return `Happened.SPRING_LOST` if external springs have failed: once, and again while
    the bench is armed.
    """
    x, u, mem, par = plant.state, plant.inputs, plant.memory[0], plant.parameters[0]
    if plant.external_springs.numbers[Slot.ON] == 0:
        step(x, mem, u, par, TICK, scheme, work, algebraic, ideal)
        return Happened.NOTHING.value
    if step_around(plant.external_springs, x, mem, u, par, TICK, work, algebraic, ideal):
        return Happened.NOTHING.value
    if c.springless == 0 or c.armed != 0:
        c.springless = 1
        return Happened.SPRING_LOST.value
    return Happened.NOTHING.value


@compiled
def _read_sensors(
    c: Any, plant: PlantArrays, sampling: Sampling, work: Any, algebraic: Any, ideal: Any
) -> None:
    """Read the sensors. The readings are NaN after external springs have failed."""
    x, u, mem, par = plant.state, plant.inputs, plant.memory[0], plant.parameters[0]
    if plant.external_springs.numbers[Slot.ON] == 0:
        observe(x, mem, u, par, work[0], algebraic, ideal)
    else:
        observe_around(plant.external_springs, x, mem, u, par, work[0], algebraic, ideal)
    read_sensors(mem, par, ideal, c.tick // FAST, sampling.readings)
    disturb(sampling.faults, c.tick, par, sampling.readings)
    if c.springless != 0:
        for k in range(SENSORS):
            sampling.readings[k] = np.nan


@compiled
def _store_and_check(c: Any, sampling: Sampling) -> int:
    """Store the new readings of the sensors as signals, and decide from them whether the actuators are held. Return the
    events of limits and black box.
    """
    for k in range(SENSORS):
        sampling.values[k] = sampling.readings[k]
    keep_grip(c, sampling.values)
    happened = detect(c, sampling.values, sampling.detectors)
    return int(happened | write_sample(sampling.tape, sampling.values))


@compiled
def _write_frames(c: Any, values: Any, sending: Sending, out: Any, position: int) -> int:
    """Write the frames of a sampling instant to ``out``, and update the signals of tick, program and car. Return the
    position after the last one.
    """
    time = c.tick * TICK_NS
    position = _send(values, sending, sending.fast, time, out, position)
    values[_TICK_ROW] = c.tick % TICK_MODULUS
    values[_PROGRAM_ROW] = c.program
    values[_CYCLE_ROW] = math.floor(max(c.phase[max(c.waves - 1, 0)], 0.0))
    values[_REFUSED_ROW] = c.refused
    publish_car(c, values)
    if c.tick % MEDIUM == 0:
        position = _send(values, sending, sending.medium, time, out, position)
    if c.tick % SLOW == 0:
        position = _send(values, sending, sending.slow, time, out, position)
    return position


@compiled
def _end(pacing: Pacing, outgoing: Ring, out: Any, frames: int) -> None:
    """Send the frames of a tick in real time, with the time of day as their time stamps, and unlock the mutex."""
    pace = pacing.record[0]
    for k in range(frames):
        out[k].time += pace.epoch
    push(outgoing, out, 0, frames, 0)
    unlock_mutex(pace.mutex)
    if frames > 0:
        wake(pace.eventfd, pacing.one)


@compiled_entry
def copy_values(values: Any, seen: Any, controls: Any, mutex: int) -> int:
    """Copy all signals to ``seen`` between two ticks. Return the number of the tick. ``mutex`` is the address of the
    mutex.
    """
    thread = lock_yielding(mutex)
    for row in range(values.size):
        seen[row] = values[row]
    tick = controls[0].tick
    unlock_yielding(mutex, thread)
    return int(tick)


@compiled_entry
def run_ticks(
    ticks: int,
    controls: Any,
    plant: PlantArrays,
    sampling: Sampling,
    sending: Sending,
    incoming: Incoming,
    outgoing: Ring,
    pacing: Pacing,
    out: Any,
) -> tuple[int, int, int]:
    """Run up to ``ticks`` ticks. Return the number of ticks, the number of frames written to ``out``, and the events
    of the last tick.

    Records are passed as arrays of one element: numba checks an array in 0.2 µs and a record in 13 µs. ``out`` must
    have room for `FRAMES_PER_TICK_MAX` frames per tick. In real time the call releases the interpreter lock. Each tick
    waits for its time, locks the mutex while it runs, and sends its frames through the ring buffer ``outgoing``.
    """
    pace = pacing.record[0]
    real = pace.paced != 0
    thread = leave_interpreter() if real else 0
    c, mem, par = controls[0], plant.memory[0], plant.parameters[0]
    u, values = plant.inputs, sampling.values
    work, algebraic, ideal = np.empty((5, STATES)), np.empty(ALGEBRAICS), np.empty(SENSORS)
    scheme = step_scheme(par, TICK)
    position = 0
    happened = Happened.NOTHING.value
    done = 0
    while done < ticks and happened == 0 and pace.stop == 0:
        late = await_tick(pacing) if real else 0
        happened |= take_waiting(c, incoming, values)
        if happened != 0:  # commands count from this tick on: they wait for the decision
            if real:
                put_off(pacing)
            break
        if real:
            happened |= count_lateness(values, late, pacing)
        done += 1
        c.tick += 1
        happened |= _advance_program(c, mem, par, sampling)
        _set_inputs(c, u, values[Sensor.LEFT_AUXILIARY_PRESSURE], values[Sensor.RIGHT_AUXILIARY_PRESSURE])
        hold_inputs(sampling.faults, u)
        if c.refitted != 0:
            scheme = step_scheme(par, TICK)
            c.refitted = 0
        happened |= _step(c, plant, scheme, work, algebraic, ideal)
        if c.tick % FAST == 0:
            _read_sensors(c, plant, sampling, work, algebraic, ideal)
            happened |= _store_and_check(c, sampling)
            position = _write_frames(c, values, sending, out, position)
        position = _send(values, sending, sending.every, c.tick * TICK_NS, out, position)
        position = send_heartbeat(c, out, position)
        happened |= _expired_watchdogs(c) | node_due(c) | _due_parts(c)
        if real:
            _end(pacing, outgoing, out, position)
            position = 0
    if real:
        enter_interpreter(thread)
    return done, position, happened
