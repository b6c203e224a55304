"""The compiled tick: set-points, function generator, air control, plant step, sampling, frames, watchdog, limits.

One call runs as many ticks as asked, or fewer: it stops after the tick in which something happened that the state
machine must decide on, so that real time (one tick a call) and virtual time (many) behave alike to the tick.
"""

import math
from enum import IntEnum, IntFlag
from typing import Any, Final

import numpy as np

from bench_protocol.can_codec import encode_into
from bench_protocol.rates import DISABLE_AFTER, HOLD_AFTER, TICK
from bench_protocol.units import NS, bar, mbar
from bench_protocol.words import AIR_MODES, AXES, CONTROL_MODES, WAVES
from bench_sim.model.algebraic import ALGEBRAICS
from bench_sim.model.compiled import compiled, compiled_entry
from bench_sim.model.kernel import observe, step
from bench_sim.model.layout import SENSORS, STATES, Input, Mode, Sensor
from bench_sim.model.pipe import pipe_steps
from bench_sim.model.sensors import read_sensors

TICK_NS: Final = round(TICK * NS)
#: Set-points arrive at 50 Hz; the rig draws a straight line to each within one such period.
SLEW_TICKS: Final = 20
#: Ticks between samples at 200, 50 and 10 Hz.
FAST, MEDIUM, SLOW = 5, 20, 100
FRAMES_PER_TICK_MAX: Final = 12

_LATE_TICKS: Final = round(HOLD_AFTER / TICK)
_LOST_TICKS: Final = round(DISABLE_AFTER / TICK)

#: The pressure controller opens a service valve fully at this error, and not at all within the dead zone.
_FULL_OPENING: Final = 0.15 * bar
_DEAD_ZONE: Final = 5 * mbar
#: AIR_LOW lets through a fifth of the flow.
_RESTRICTED: Final = 0.2


class Target(IntEnum):
    """Rows of the set-points."""

    VERTICAL_LEFT = 0
    VERTICAL_RIGHT = 1
    LATERAL = 2
    PLATFORM_VERTICAL = 3
    PLATFORM_LATERAL = 4
    PLATFORM_ROLL = 5


TARGETS: Final = len(Target)


class Air(IntEnum):
    """What the state of the bench lets the air do."""

    SHUT = 0
    RESTRICTED = 1
    FULL = 2
    VENTED = 3  #: emergency stop: supply shut, springs vented


class Happened(IntFlag):
    """What the state machine must decide on."""

    NOTHING = 0
    COMMAND_LATE = 1
    COMMAND_LOST = 2
    LIMIT = 4
    PROGRAM_DONE = 8
    ALARM = 16


#: Everything that the tick keeps of its own, in one record: a snapshot of the rig is a copy of it.
CONTROLS: Final = np.dtype(
    [
        ("tick", "<i8"),
        ("alarm", "<i8"),  # tick at which the state machine wants to be asked, -1 for never
        ("command_tick", "<i8"),  # when the last valid command came
        ("bits", "<i8"),  # D, H, M, R of the last valid command: 1, 2, 4, 8
        ("armed", "<i8"),  # 1: the watchdog is watching
        ("late", "<i8"),  # 1: already reported
        ("lost", "<i8"),
        ("active", "<i8"),  # 1: follow the commander's set-points
        ("engaged", "<i8"),  # 1: the actuators hold or move
        ("air", "<i8"),
        ("control", "<i8", (3,)),  # control mode by actuator
        ("goal", "<f8", (TARGETS,)),
        ("setpoint", "<f8", (TARGETS,)),
        ("slew", "<i8", (TARGETS,)),
        ("air_mode", "<i8", (2,)),
        ("air_target", "<f8", (2,)),
        ("reservoir", "<i8", (2,)),
        ("dpv", "<i8"),
        ("program", "<i8"),
        ("axis", "<i8"),
        ("wave", "<i8"),
        ("amplitude", "<f8"),
        ("lever", "<f8"),  # m per rad, of a roll at the vertical actuators
        ("frequency", "<f8"),
        ("cycles", "<f8"),
        ("phase", "<f8"),  # cycles since the start of the program
        ("offset", "<f8", (TARGETS,)),  # what the generator adds to the set-points
    ]
)

_LEVEL: Final = AIR_MODES.index("level")
_FILL: Final = AIR_MODES.index("fill")
_VENT: Final = AIR_MODES.index("vent")
assert tuple(mode.name.lower() for mode in Mode) == CONTROL_MODES
_AXIS_VERTICAL: Final = AXES.index("vertical")
_AXIS_ROLL: Final = AXES.index("roll")
_AXIS_LATERAL: Final = AXES.index("lateral")
_COSINE: Final = WAVES.index("unilateral_cosine")
_TRIANGLE: Final = WAVES.index("triangle")


@compiled
def waveform(wave: int, phase: float, cycles: float) -> float:
    """Return the unit wave at ``phase`` (cycles since start) of a program of ``cycles`` whole cycles.

    Sine and triangle fade in over the first cycle and out over the last; the unilateral cosine
    ``(1 - cos(2 pi phase)) / 2`` starts and ends at rest by itself.
    """
    if wave == _COSINE:
        return 0.5 * (1.0 - math.cos(2.0 * math.pi * phase))
    envelope = 1.0
    edge = min(phase, cycles - phase)
    if edge < 1.0:
        envelope = 0.5 * (1.0 - math.cos(math.pi * max(edge, 0.0)))
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
    """Advance the function generator by one tick and set its offsets."""
    happened = 0
    if c.program == 1:
        c.phase += c.frequency * TICK
        if c.phase >= c.cycles:
            c.phase = c.cycles
            c.program = 0
            happened = 8
    for row in range(TARGETS):
        c.offset[row] = 0.0
    value = c.amplitude * waveform(c.wave, c.phase, c.cycles) if c.program != 0 else 0.0
    if c.axis == _AXIS_VERTICAL:
        c.offset[0] = value
        c.offset[1] = value
    elif c.axis == _AXIS_ROLL:
        c.offset[0] = value * c.lever
        c.offset[1] = -value * c.lever
    else:
        c.offset[c.axis] = value  # from the lateral axis on, axes and targets are numbered alike
    return happened


@compiled
def _opening(mode: int, target: float, pressure: float) -> float:
    """Return the opening of a service valve, -1 (exhaust) to 1 (fill), of the pressure controller."""
    error = target - pressure
    if math.isnan(error) or abs(error) < _DEAD_ZONE:
        return 0.0
    if mode == _FILL:
        return min(max(error / _FULL_OPENING, 0.0), 1.0)
    if mode == _VENT:
        return max(min(error / _FULL_OPENING, 0.0), -1.0)
    return 0.0


@compiled
def _drive(c: Any, u: Any, pressure_left: float, pressure_right: float) -> None:
    """Turn the controls into the inputs of the plant."""
    for row in range(TARGETS):
        if c.slew[row] > 0:
            c.setpoint[row] += (c.goal[row] - c.setpoint[row]) / c.slew[row]
            c.slew[row] -= 1
    for actuator in range(3):
        command = Input.VERTICAL_LEFT_COMMAND + actuator
        mode = Input.VERTICAL_LEFT_MODE + actuator
        # The wire's numbers of the control modes are the plant's.
        u[mode] = float(c.control[actuator]) if c.engaged != 0 else 0.0
        u[command] = c.setpoint[actuator] + c.offset[actuator]
    for axis in range(3):
        u[Input.PLATFORM_VERTICAL + axis] = c.setpoint[3 + axis] + c.offset[3 + axis]

    flowing = c.air == 1 or c.air == 2
    u[Input.SUPPLY] = 1.0 if flowing else 0.0
    u[Input.DPV_CONNECTED] = c.dpv
    for side in range(2):
        pressure = pressure_left if side == 0 else pressure_right
        opening = 0.0
        if flowing:
            opening = _opening(c.air_mode[side], c.air_target[side], pressure)
            if c.air == 1:
                opening *= _RESTRICTED
        elif c.air == 3:
            opening = -1.0
        u[Input.LEFT_SERVICE_VALVE + side] = opening
        u[Input.LEFT_LEVELING + side] = 1.0 if c.air == 2 and c.air_mode[side] == _LEVEL else 0.0
        # An emergency stop empties the bellows too: the way through their auxiliary chambers stands open.
        u[Input.LEFT_RESERVOIR_VALVE + side] = 1.0 if c.air == Air.VENTED else c.reservoir[side]


@compiled
def _detect(values: Any, detectors: Any) -> int:
    """Advance the limit detectors by one sample; return 4 if one of them tripped just now."""
    happened = 0
    for row in range(detectors.size):
        detector = detectors[row]
        value = values[detector.signal]
        if value < detector.low or value > detector.high:
            detector.outside += 1
            if detector.outside >= detector.samples and detector.tripped == 0:
                detector.tripped = 1
                happened = 4
        else:
            detector.outside = 0
    return happened


@compiled
def _watch(c: Any) -> int:
    """Return what the watchdog has to say in this tick."""
    if c.armed == 0:
        return 0
    silence = c.tick - c.command_tick
    happened = 0
    if silence >= _LATE_TICKS and c.late == 0:
        c.late = 1
        happened |= 1
    if silence >= _LOST_TICKS and c.lost == 0:
        c.lost = 1
        happened |= 2
    return happened


@compiled_entry
def take_commands(
    controls: Any, signals: Any, values: Any, targets: Any, modes: Any, control_row: int, changes: Any
) -> int:
    """Let the decoded samples of commands act; return how many changes of the control bits were written to ``changes``.

    ``targets`` and ``modes`` say by table row which target a set-point aims for (-1: none) and in which control mode
    (-1: any). A set-point acts while the bench is ACTIVE and the axis is in its mode; NaN means "as before".
    """
    c = controls[0]
    count = 0
    for k in range(signals.size):
        row = signals[k]
        target = targets[row]
        if row == control_row:
            bits = 0
            for bit in range(4):
                bits |= (values[k + bit] != 0.0) << bit
            c.command_tick = c.tick
            c.late = 0
            c.lost = 0
            if bits != c.bits:
                changes[count] = bits
                count += 1
                c.bits = bits
        elif (
            target >= 0
            and c.active != 0
            and (modes[row] < 0 or modes[row] == c.control[target])
            and not np.isnan(values[k])
            and c.goal[target] != values[k]
        ):
            c.goal[target] = values[k]
            c.slew[target] = SLEW_TICKS
    return count


@compiled_entry
def run_ticks(
    ticks: int,
    controls: Any,
    x: Any,
    memory: Any,
    u: Any,
    parameters: Any,
    readings: Any,
    values: Any,
    status_rows: Any,
    detectors: Any,
    messages: Any,
    fields: Any,
    counters: Any,
    fast_rows: Any,
    medium_rows: Any,
    slow_rows: Any,
    out: Any,
) -> tuple[int, int, int]:
    """Run up to ``ticks`` ticks; return (ticks run, frames written to ``out``, what happened in the last one).

    ``controls``, ``memory`` and ``parameters`` hold one record each: numba looks at an array in 0.2 µs and at a
    record in 13. ``values`` are the signals by table row (SI), the measurements first and in the order of the sensors;
    ``status_rows`` says where tick, program and cycle stand. ``out`` must have room for 12 frames a tick.
    """
    c, mem, par = controls[0], memory[0], parameters[0]
    work, algebraic, ideal = np.empty((5, STATES)), np.empty(ALGEBRAICS), np.empty(SENSORS)
    pieces = pipe_steps(par, TICK)
    position = 0
    happened = 0
    done = 0
    while done < ticks and happened == 0:
        done += 1
        c.tick += 1
        happened |= _generate(c)
        left = values[Sensor.LEFT_AUXILIARY_PRESSURE]
        right = values[Sensor.RIGHT_AUXILIARY_PRESSURE]
        _drive(c, u, left, right)
        step(x, mem, u, par, TICK, pieces, work, algebraic, ideal)
        if c.tick % FAST == 0:
            observe(x, mem, u, par, work[0], algebraic, ideal)
            read_sensors(mem, par, ideal, c.tick // FAST, readings)
            for k in range(readings.size):
                values[k] = readings[k]  # measurements stand first in the table, in the order of the sensors
            happened |= _detect(values, detectors)
            time = c.tick * TICK_NS
            position = encode_into(values, fast_rows, time, messages, fields, counters, out, position)
            values[status_rows[0]] = c.tick % 16777215
            values[status_rows[1]] = c.program
            values[status_rows[2]] = math.floor(c.phase)
            if c.tick % MEDIUM == 0:
                position = encode_into(values, medium_rows, time, messages, fields, counters, out, position)
            if c.tick % SLOW == 0:
                position = encode_into(values, slow_rows, time, messages, fields, counters, out, position)
        happened |= _watch(c)
        if c.tick == c.alarm:
            happened |= 16
    return done, position, happened
