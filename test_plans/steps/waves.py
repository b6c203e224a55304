"""Sines at any frequency, and the complex stiffness per spring from them, corrected for the compliance of the bench."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from math import ceil, tau
from typing import TYPE_CHECKING, Final, Literal, NamedTuple

import numpy as np

from bench_protocol.dimensions import lag
from bench_protocol.units import Hz, s
from bench_protocol.words import PROGRAM_STATES, SIDES
from test_plans.analysis import (
    BELLOWS_TEMPERATURES,
    GENERATOR,
    HEIGHTS,
    PRESSURES,
    SHEAR_CELLS,
    VERTICAL_CELLS,
    Samples,
    Stiffness,
    dynamic_stiffness,
    harmonic,
    whole_cycles,
)
from test_plans.analysis.cells import (
    CELLS,
    CELLS_ACROSS,
    LOADED,
    cells_in,
    cells_under,
    sideways_force,
    upward_force,
)
from test_plans.analysis.geometry import LASERS, POSE_SIGNALS, SEEING, Rig, roll_of
from test_plans.analysis.uncertainty import Measured
from test_plans.description import lag_of, lags
from test_plans.steps.amplitude import controlled
from test_plans.steps.shaking import spring_motion

if TYPE_CHECKING:
    from test_plans.run import Run

SAMPLE_RATE: Final = 200 * Hz
#: Time at full amplitude before a measurement, and its duration, at least; both are whole cycles.
LEAD: Final = 0.5 * s
MEASURED: Final = 1.0 * s
#: The generator's count of cycles is sent at 50 Hz: a cycle may appear to begin later by this time.
COUNT_LATE: Final = 0.04 * s
#: Above this frequency the accelerometer measures the bolster better than the piston behind oil and frame does.
SEISMIC: Final = 3 * Hz

_ACCELEROMETER: Final = "lateral.acceleration"
_LATERAL: Final = (*POSE_SIGNALS, _ACCELEROMETER, *PRESSURES)
_VERTICAL: Final = (*HEIGHTS, *PRESSURES, *BELLOWS_TEMPERATURES)
#: Signals and dimensions for sines on one axis.
SLOW_LATERAL_WAVES: Final = (  #: below `SEISMIC`
    *(name for name in _LATERAL if name != _ACCELEROMETER),
    *SHEAR_CELLS,
    *GENERATOR,
    "lateral.control",
    "lateral.displacement_setpoint",
    *SEEING,
    *CELLS_ACROSS,
    *lags((*HEIGHTS, "lateral.displacement", "lateral.force", *SHEAR_CELLS)),
)
LATERAL_WAVES: Final = (
    *SLOW_LATERAL_WAVES,
    _ACCELEROMETER,
    lag(_ACCELEROMETER),
    "accelerometer_height",
    "gravity",
)
VERTICAL_WAVES: Final = (
    *_VERTICAL,
    *VERTICAL_CELLS,
    *GENERATOR,
    *CELLS,
    *LASERS,
    *lags((*HEIGHTS, *VERTICAL_CELLS)),
)

Values = dict[str, Samples]


class Sine(NamedTuple):
    """The readings during a sine: times (s), values by signal, and its frequency (Hz)."""

    times: Samples
    values: Values
    frequency: float


def shake(
    run: Run,
    axis: Literal["vertical", "lateral"],
    frequency: float,
    amplitude: float,
    *,
    lead: float = LEAD,
    measured: float = MEASURED,
) -> tuple[Samples, Values]:
    """Run a sine (m, Hz). Return times (s) and aligned samples of whole cycles, after ``lead`` s, for ``measured`` s.

    A rig with amplitude control repeats the sine until the motion of springs or bolster has the ``amplitude``.
    """
    moving = HEIGHTS if axis == "vertical" else ("lateral.displacement",)

    def harmonic_of(times: Samples, values: Values) -> complex:
        motion = sum((values[name] for name in moving), np.zeros_like(times)) / len(moving)
        return harmonic(run.rig, times, motion, frequency, *moving)

    def once(command: float) -> tuple[Samples, Values]:
        return _once(run, axis, frequency, command, lead, measured)

    return controlled(run, axis, "sine", frequency, amplitude, once, harmonic_of)


def _once(
    run: Run,
    axis: Literal["vertical", "lateral"],
    frequency: float,
    amplitude: float,
    lead: float,
    measured: float,
) -> tuple[Samples, Values]:
    before = max(1, ceil(lead * frequency))
    count = max(1 if frequency < 0.3 else 2, ceil(measured * frequency))
    cycles = before + count + ceil(COUNT_LATE * frequency)
    cycles += 1 if frequency > 1 / LEAD else 0  # the fade-out must not be included
    names = _VERTICAL if axis == "vertical" else _LATERAL
    names = (*names, *LOADED[axis](run.rig))
    with run.bench.capture(*(name for name in names if run.bench.has(name)), *GENERATOR) as capture:
        run.bench.generator.run(axis, amplitude=amplitude, frequency=frequency, cycles=cycles)
    times, values = capture.aligned(SAMPLE_RATE)
    running = values["rig.program"] == PROGRAM_STATES.index("RUN")
    steady = whole_cycles(
        times, values["rig.generator_cycle"], running, first=before, count=count, frequency=frequency
    )
    return times[steady], {name: series[steady] for name, series in values.items()}


def vertical_stiffness(times: Samples, rig: Rig, values: Values, frequency: float) -> Stiffness:
    """Return the complex vertical stiffness per spring (mean of both), from lasers and load cells."""
    heights = 0.5 * (values["left.height"] + values["right.height"])
    loads = 0.5 * upward_force(values, rig)
    X = -harmonic(rig, times, heights, frequency, *HEIGHTS)
    F = harmonic(rig, times, loads, frequency, *VERTICAL_CELLS)
    return Stiffness(F / X, frequency, abs(X))


def stiffness_of_side(times: Samples, rig: Rig, values: Values, frequency: float, side: str) -> Stiffness:
    """Return the complex vertical stiffness of one spring."""
    late = lag_of(rig, f"{side}.height"), lag_of(rig, *cells_under(rig, side))
    return dynamic_stiffness(times, *spring_motion(values, rig, side), frequency, lags=late)


def lateral_stiffness(times: Samples, rig: Rig, values: Values, frequency: float) -> Stiffness:
    """Return the complex lateral stiffness per spring (half of that of the pair).

    The motion is that of the springs' top plates. It includes the roll of the bolster, and is corrected for the
    compliance of the frame; from `SEISMIC` on, it comes from the accelerometer.
    """

    def of(name: str) -> complex:
        return harmonic(rig, times, values[name], frequency, name)

    roll = harmonic(rig, times, roll_of(values, rig), frequency, *HEIGHTS)
    if frequency < SEISMIC:
        pinned = of("lateral.displacement")
        pinned -= of("lateral.force") / rig["lateral_frame_stiffness"]
        X = pinned + (rig["centre_height"] + rig["lateral_actuator_height"]) * roll
    else:
        # It reads ÿ + gφ − hφ̈, because its axis rolls with the bolster, and it is mounted h above the centre.
        centre = (rig["gravity"] * roll - of(_ACCELEROMETER)) / (tau * frequency) ** 2
        centre += rig["accelerometer_height"] * roll
        X = centre + rig["centre_height"] * roll
    F = -0.5 * complex(sideways_force({cell: of(cell) for cell in cells_in(values)}, rig))
    return Stiffness(F / X, frequency, abs(X))


class Known(NamedTuple):
    """Results of a sine: magnitude, storage and damping of a stiffness, each with its uncertainty."""

    size: Measured
    storage: Measured
    damping: Measured


def know(
    run: Run,
    times: Samples,
    values: Values,
    frequency: float,
    stiffness: Callable[[Samples, Rig, Values, float], Stiffness],
) -> Known:
    """Return magnitude, K' and c of a stiffness with their uncertainties. ``stiffness`` computes it from the samples of
    a sine.
    """

    def evaluate(rig: Rig, read: Values) -> tuple[float, float, float]:
        K = stiffness(times, rig, read, frequency)
        return abs(K.value), K.storage, K.damping

    return Known(*run.measure(evaluate, run.rig, values))


def measure_sines(
    run: Run,
    sines: Sequence[Sine],
    stiffness: Callable[[Samples, Rig, Values, float], Stiffness],
    evaluate: Callable[[list[Stiffness]], float],
) -> Measured:
    """Return the result of ``evaluate``, with its uncertainty. It receives the ``stiffness`` computed from each of
    several sines.

    An instrument has the same error in all sines; this error cancels in a ratio.
    """

    def computed(rig: Rig, *read: Values) -> float:
        return evaluate(
            [
                stiffness(one.times, rig, values, one.frequency)
                for one, values in zip(sines, read, strict=True)
            ]
        )

    return run.measured(computed, run.rig, *(one.values for one in sines))


def pressure_of(values: Mapping[str, Samples]) -> float:
    """Return the mean gauge pressure of both bellows (Pa)."""
    return float(np.mean([values[f"{side}.bellows_pressure"].mean() for side in SIDES]))
