"""Experiments in which the motion of the bolster is prescribed and the response of the springs is recorded.

Terms, step and memory are those of the kernel. Only the six states of the bolster are prescribed instead of
integrated.
"""

from dataclasses import dataclass
from enum import IntEnum
from math import cos, floor, pi, sin
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bench_sim.model.algebraic import ALGEBRAICS, Algebraic
from bench_sim.model.compiled import compiled, compiled_entry
from bench_sim.model.kernel import begin_step, evaluate
from bench_sim.model.layout import SENSORS, STATES, Input, State
from bench_sim.model.plant import Plant
from bench_sim.model.runge_kutta import integrate, step_scheme


class Shape(IntEnum):
    """The course of an imposed motion over time."""

    SINE = 0  #: offset + amplitude sin 2πft
    TRIANGLE = 1  #: offset + amplitude times a triangle of frequency f, rising first
    RAMP = 2  #: offset, then to offset + amplitude within 1/f seconds, then held


#: Directions of motion, in the order of the bolster's states.
LATERAL, VERTICAL, ROLL = 0, 1, 2


@compiled
def course(shape: int, amplitude: float, frequency: float, t: float) -> tuple[float, float]:
    """Return displacement and speed at ``t`` ≥ 0, without the offset."""
    if amplitude == 0.0:
        return 0.0, 0.0
    if shape == Shape.SINE:
        omega = 2.0 * pi * frequency
        return amplitude * sin(omega * t), amplitude * omega * cos(omega * t)
    if shape == Shape.TRIANGLE:
        phase = frequency * t + 0.25
        phase -= floor(phase)
        if phase < 0.5:
            return amplitude * (4.0 * phase - 1.0), 4.0 * amplitude * frequency
        return amplitude * (3.0 - 4.0 * phase), -4.0 * amplitude * frequency
    if t * frequency < 1.0:
        return amplitude * frequency * t, amplitude * frequency
    return amplitude, 0.0


@compiled
def place_bolster(t: float, motion: Any, x: Any) -> None:
    """Write the prescribed motion into the bolster's states. ``motion`` (3, 5) has one row for each direction: shape,
    offset, amplitude, frequency and start.
    """
    for k in range(3):
        displacement, speed = course(
            int(motion[k, 0]), motion[k, 2], motion[k, 3], max(t - motion[k, 4], 0.0)
        )
        x[State.BOLSTER_LATERAL + k] = motion[k, 1] + displacement
        x[State.BOLSTER_LATERAL_SPEED + k] = speed


@compiled
def moved_bench(ahead: float, x: Any, mem: Any, u: Any, par: Any, given: Any, dx: Any, out: Any) -> None:
    """Compute the right-hand side of the bench with a prescribed motion of the bolster. ``given`` holds the motion."""
    place_bolster(mem.time + ahead, given[0], x)
    evaluate(ahead, x, mem, u, par, (), dx, out)


@compiled_entry
def impose_motion(
    x: Any,
    memory: Any,
    u: Any,
    parameters: Any,
    dt: float,
    steps: int,
    motion: Any,
    every: int,
    states: Any,
    rows: Any,
) -> None:
    """Take ``steps`` steps of ``dt`` s in place with the bolster moved by ``motion``. With a pipe, steps are divided as
    in the kernel.

    Row k of ``rows`` (ALGEBRAICS) and of ``states`` (STATES) is written before step k·every, until the arrays are
    full.
    """
    mem = memory[0]
    par = parameters[0]
    work = np.empty((5, STATES))
    out = np.zeros(ALGEBRAICS)
    values = np.empty(SENSORS)
    scheme = step_scheme(par, dt)
    slope = work[0]
    given = (motion,)
    place_bolster(mem.time, motion, x)
    for n in range(steps):
        begin_step(moved_bench, x, mem, u, par, given, dt, slope, out, values)
        if n % every == 0 and n // every < rows.shape[0]:
            rows[n // every] = out
            states[n // every] = x
        integrate(moved_bench, dt, scheme, x, mem, u, par, given, work, out)
        mem.step += 1
    place_bolster(mem.time, motion, x)


@dataclass(frozen=True, slots=True)
class ImposedMotion:
    """The imposed motion in one direction, in SI units. The ``frequency`` (Hz) of a ramp is 1 / duration."""

    direction: int
    amplitude: float
    frequency: float
    shape: Shape = Shape.SINE
    offset: float = 0.0


@dataclass(frozen=True, slots=True)
class TimeHistory:
    """The record of an experiment: time in s, and one row of states and of algebraic variables per instant."""

    time: NDArray[np.floating]
    states: NDArray[np.float64]
    algebraic: NDArray[np.float64]

    def of(self, quantity: Algebraic, side: int = 0) -> NDArray[np.float64]:
        """Return one algebraic variable over time."""
        return self.algebraic[:, quantity + side]


def isolate(plant: Plant) -> None:
    """Close the plant's valves (leveling, service, differential pressure). The orifices to the auxiliary chambers
    stay open.
    """
    for valve in (
        Input.LEFT_LEVELING,
        Input.RIGHT_LEVELING,
        Input.LEFT_SERVICE_VALVE,
        Input.RIGHT_SERVICE_VALVE,
        Input.DPV_CONNECTED,
    ):
        plant.inputs[valve] = 0.0


def impose(
    plant: Plant,
    motions: list[ImposedMotion],
    duration: float,
    *,
    every: int = 1,
    dt: float | None = None,
    rows: int | None = None,
) -> TimeHistory:
    """Move the plant's bolster by ``motions`` for ``duration`` s from now on. In a direction without a motion the
    bolster stays at 0.

    Record the state every ``every`` steps of ``dt`` s (default: those of the plant), at most ``rows`` times.
    """
    step = plant.dt if dt is None else dt
    steps = round(duration / step)
    count = -(-steps // every) if rows is None else rows
    table = np.zeros((3, 5))
    table[:, 3] = 1.0
    for motion in motions:
        table[motion.direction] = motion.shape, motion.offset, motion.amplitude, motion.frequency, plant.time
    algebraic = np.zeros((count, ALGEBRAICS))
    states = np.zeros((count, STATES))
    time = plant.time + step * every * np.arange(count)
    impose_motion(
        plant.state,
        plant.memory_array,
        plant.inputs,
        plant.parameter_array,
        step,
        steps,
        table,
        every,
        states,
        algebraic,
    )
    return TimeHistory(time, states, algebraic)


def first_harmonic(signal: NDArray[np.float64], cycles: int = 1) -> complex:
    """Return the complex amplitude of the first harmonic: the real part is that of sin 2πft. The equidistant samples
    span whole ``cycles``.
    """
    phase = 2.0 * np.pi * cycles * np.arange(len(signal)) / len(signal)
    return complex(2.0 * np.mean(signal * np.sin(phase)), 2.0 * np.mean(signal * np.cos(phase)))


def dynamic_stiffness(
    plant: Plant,
    amplitude: float,
    frequency: float,
    cycles: int,
    *,
    direction: int = VERTICAL,
    longest_step: float = 1e-3,
    offsets: tuple[float, float, float] = (0.0, 0.0, 0.0),
) -> tuple[complex, TimeHistory]:
    """Return the complex stiffness K' + iK'' in N/m of the left spring, and the record of the last of ``cycles`` sine
    cycles.

    The stiffness is the first harmonic of the force on the bolster, divided by that of the displacement; a restoring
    force is positive. The sine has the ``amplitude`` (m; rad for a roll) and the ``frequency`` (Hz); its steps are at
    most ``longest_step`` s long. ``offsets`` is the mean position of the bolster (lateral, vertical, roll; m, m, rad).
    The valves of the plant are closed (`isolate`), and the plant keeps its last state.
    """
    isolate(plant)
    per_cycle = max(16, int(np.ceil(1.0 / (frequency * longest_step) - 1e-9)))
    dt = 1.0 / (frequency * per_cycle)
    table = np.zeros((3, 5))
    table[:, 1] = offsets
    table[:, 3] = 1.0
    table[direction, 2:] = amplitude, frequency, plant.time
    algebraic = np.zeros((per_cycle, ALGEBRAICS))
    states = np.zeros((per_cycle, STATES))
    nothing = np.zeros((0, ALGEBRAICS)), np.zeros((0, STATES))
    shared = plant.state, plant.memory_array, plant.inputs, plant.parameter_array, dt
    impose_motion(*shared, per_cycle * (cycles - 1), table, 1, nothing[1], nothing[0])
    time = plant.time + dt * np.arange(per_cycle)
    impose_motion(*shared, per_cycle, table, 1, states, algebraic)
    history = TimeHistory(time, states, algebraic)
    force = history.of(Algebraic.LATERAL_FORCE if direction == LATERAL else Algebraic.VERTICAL_FORCE)
    moved = history.of(Algebraic.LATERAL if direction == LATERAL else Algebraic.HEIGHT)
    return -first_harmonic(force) / first_harmonic(moved), history
