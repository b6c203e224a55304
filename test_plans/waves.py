"""Sines at any frequency, and what springs answer: complex stiffness per spring, without the bench's own give."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from math import ceil, tau
from typing import TYPE_CHECKING, Final, Literal, NamedTuple

import numpy as np

from bench_protocol.units import Hz, s
from bench_protocol.words import PROGRAM_STATES, SIDES
from test_plans.analysis import (
    Samples,
    Stiffness,
    dynamic_stiffness,
    first_harmonic,
    whole_cycles,
    without_lag,
)
from test_plans.geometry import CENTRE_HEIGHT, LATERAL_ACTUATOR_HEIGHT, LATERAL_FRAME, POSE_SIGNALS, roll_of
from test_plans.readings import (
    ACCELEROMETER_LAG,
    BELLOWS_TEMPERATURES,
    GENERATOR,
    HEIGHTS,
    LASER_LAG,
    LOAD_CELL_LAG,
    PRESSURES,
    SHEAR_CELLS,
    TRANSDUCER_LAG,
    VERTICAL_CELLS,
)
from test_plans.steps.shaking import spring_motion
from test_plans.uncertainty import Measured

if TYPE_CHECKING:
    from test_plans.run import Run

SAMPLE_RATE: Final = 200 * Hz
#: A wave is measured after so long at full amplitude, and for so long, but never less than whole cycles.
LEAD: Final = 0.5 * s
MEASURED: Final = 1.0 * s
#: The generator's count of cycles comes at 50 Hz: so much later a cycle may seem to begin.
COUNT_LATE: Final = 0.04 * s
#: From here on the accelerometer tells more of the bolster than the piston behind oil and frame.
SEISMIC: Final = 3 * Hz

_LATERAL: Final = (*POSE_SIGNALS, *SHEAR_CELLS, "lateral.acceleration", *PRESSURES)
_VERTICAL: Final = (*HEIGHTS, *VERTICAL_CELLS, *PRESSURES, *BELLOWS_TEMPERATURES)
#: What sines on one axis need.
LATERAL_WAVES: Final = (*_LATERAL, *GENERATOR, "lateral.control", "lateral.displacement_setpoint")
VERTICAL_WAVES: Final = (*_VERTICAL, *GENERATOR)

Values = dict[str, Samples]


class Sine(NamedTuple):
    """What was read during a sine: times (s), values by signal, and its frequency (Hz)."""

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
    """Run a sine (m, Hz); return times and aligned samples of whole cycles, after ``lead`` s, for ``measured`` s."""
    before = max(1, ceil(lead * frequency))
    count = max(1 if frequency < 0.3 else 2, ceil(measured * frequency))
    cycles = before + count + ceil(COUNT_LATE * frequency)
    cycles += 1 if frequency > 1 / LEAD else 0  # what fades out must not come near
    names = _VERTICAL if axis == "vertical" else _LATERAL
    with run.bench.capture(*names, *GENERATOR) as capture:
        run.bench.generator.run(axis, amplitude=amplitude, frequency=frequency, cycles=cycles)
    times, values = capture.aligned(SAMPLE_RATE)
    running = values["rig.program"] == PROGRAM_STATES.index("RUN")
    steady = whole_cycles(
        times, values["rig.generator_cycle"], running, first=before, count=count, frequency=frequency
    )
    return times[steady], {name: series[steady] for name, series in values.items()}


def vertical_stiffness(times: Samples, values: Values, frequency: float) -> Stiffness:
    """Complex vertical stiffness per spring, the mean of both, from lasers and load cells."""
    heights = 0.5 * (values["left.height"] + values["right.height"])
    loads = 0.5 * np.sum([values[cell] for cell in VERTICAL_CELLS], axis=0)
    X = -without_lag(first_harmonic(times, heights, frequency), LASER_LAG, frequency)
    F = without_lag(first_harmonic(times, loads, frequency), LOAD_CELL_LAG, frequency)
    return Stiffness(F / X, frequency, abs(X))


def stiffness_of_side(times: Samples, values: Values, frequency: float, side: str) -> Stiffness:
    """Complex vertical stiffness of one spring."""
    lag = LASER_LAG - LOAD_CELL_LAG
    return dynamic_stiffness(times, *spring_motion(values, side), frequency, motion_lag=lag)


def lateral_stiffness(times: Samples, values: Values, frequency: float) -> Stiffness:
    """Complex lateral stiffness per spring (half of the pair's), free of what frame and bolster give way."""

    def of(name: str, lag: float) -> complex:
        return without_lag(first_harmonic(times, values[name], frequency), lag, frequency)

    roll = without_lag(first_harmonic(times, roll_of(values), frequency), LASER_LAG, frequency)
    if frequency < SEISMIC:
        pinned = of("lateral.displacement", TRANSDUCER_LAG)
        pinned -= of("lateral.force", TRANSDUCER_LAG) / LATERAL_FRAME
        X = pinned + (CENTRE_HEIGHT + LATERAL_ACTUATOR_HEIGHT) * roll
    else:
        centre = -of("lateral.acceleration", ACCELEROMETER_LAG) / (tau * frequency) ** 2
        X = centre + CENTRE_HEIGHT * roll
    F = -0.5 * sum(of(cell, LOAD_CELL_LAG) for cell in SHEAR_CELLS)
    return Stiffness(F / X, frequency, abs(X))


class Known(NamedTuple):
    """What a sine tells of a stiffness, each with its uncertainty."""

    size: Measured
    storage: Measured
    damping: Measured


def know(
    run: Run,
    times: Samples,
    values: Values,
    frequency: float,
    stiffness: Callable[[Samples, Values, float], Stiffness],
) -> Known:
    """Return what the samples of a sine say of a ``stiffness``, for its curves."""

    def told(read: Values) -> tuple[float, float, float]:
        K = stiffness(times, read, frequency)
        return abs(K.value), K.storage, K.damping

    return Known(*run.measure(told, values))


def measure_sines(
    run: Run,
    sines: Sequence[Sine],
    stiffness: Callable[[Samples, Values, float], Stiffness],
    evaluate: Callable[[list[Stiffness]], float],
) -> Measured:
    """Return what ``evaluate`` makes of the ``stiffness`` of several sines, with its uncertainty.

    A piece is wrong in all of them alike: what that does to a ratio falls out.
    """

    def computed(*read: Values) -> float:
        return evaluate(
            [stiffness(one.times, values, one.frequency) for one, values in zip(sines, read, strict=True)]
        )

    return run.measured(computed, *(one.values for one in sines))


def pressure_of(values: Mapping[str, Samples]) -> float:
    """Mean gauge pressure of both bellows (Pa)."""
    return float(np.mean([values[f"{side}.bellows_pressure"].mean() for side in SIDES]))
