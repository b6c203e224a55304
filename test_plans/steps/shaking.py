"""Runs a wave of 5 mm on one axis, returns its samples at full amplitude, and checks and records its results."""

from __future__ import annotations

from cmath import phase
from collections.abc import Callable, Mapping, Sequence
from math import ceil
from operator import itemgetter
from typing import TYPE_CHECKING, Final, Literal, NamedTuple

import numpy as np
import numpy.typing as npt

from bench_protocol.units import Hz, kN, mm, s
from bench_protocol.words import PROGRAM_STATES, SIDES
from bench_records.curves import Axis
from test_plans.analysis import (
    GENERATOR,
    HEIGHTS,
    SHEAR_CELLS,
    Samples,
    Stiffness,
    Wave,
    distortion,
    harmonic,
    loop_energy,
    secant_stiffness,
    whole_cycles,
    without_drift,
)
from test_plans.analysis.cells import (
    CELLS,
    CELLS_ACROSS,
    LOADED,
    cells_under,
    load_on,
    sideways_force,
)
from test_plans.analysis.geometry import LASERS, Rig, height_of_spring
from test_plans.analysis.uncertainty import Measured
from test_plans.description import lags
from test_plans.loads import Band
from test_plans.steps.amplitude import controlled
from test_plans.steps.tables import DAMPING, FREQUENCY, LOSS, STORAGE, TANGENT, keep

if TYPE_CHECKING:
    from drivers.receiver import Capture
    from test_plans.run import Run

Values = dict[str, Samples]

AMPLITUDE: Final = 5 * mm
#: Slow: below this frequency, the losses of a vertical spring in its orifice are small; above 0.1 Hz, those through its
#: walls.
LOOP_FREQUENCY: Final = 0.3 * Hz
#: Shortest measured time. The generator fades in over its first cycle and out over its last; both are not measured.
MEASURED: Final = 1.5 * s
SAMPLE_RATE: Final = 200 * Hz
#: Limit of the distortion above which a wave is repeated, and the number of attempts. A sine without disturbance has
#: 0.3 to 0.7 %. Set-points lost for 20 to 60 ms gave 1 to 19 %, and an error of the damping of up to 1/6 at 1 Hz. A
#: triangle has 0.3 to 0.6 %. An actuator that stops between set-points gave 2 to 3 %, and an error of the secant of
#: 1/4.
DISTORTED: Final[Mapping[Wave, float]] = {"sine": 0.02, "triangle": 0.01}
TRIES: Final = 3

#: Signals read while an axis is shaken, as far as the rig has them, in addition to its load cells.
VERTICAL: Final = (*HEIGHTS, *(f"vertical_{side}.force" for side in SIDES), *GENERATOR)
LATERAL: Final = ("lateral.displacement", *GENERATOR)
#: Readings that move with an axis.
MOTION: Final = {"vertical": HEIGHTS, "lateral": ("lateral.displacement",)}
#: Signals and dimensions for a lateral stiffness.
LATERAL_NEEDS: Final = (
    *LATERAL,
    *SHEAR_CELLS,
    "lateral.control",
    "lateral.displacement_setpoint",
    "generator.axis",
    *CELLS_ACROSS,
    *lags(("lateral.displacement", *SHEAR_CELLS)),
)


def vertical_needs(rig: Rig, side: str) -> tuple[str, ...]:
    """Return the signals and dimensions needed to measure the vertical stiffness of one spring."""
    seen = (f"{side}.height", *cells_under(rig, side))
    return (*seen, *GENERATOR, "generator.axis", *CELLS, *LASERS, *lags(seen))


def shake(
    run: Run,
    axis: Literal["vertical", "lateral"],
    frequency: float,
    names: tuple[str, ...],
    wave: Wave = "sine",
) -> tuple[Samples, dict[str, Samples]]:
    """Run a wave of 5 mm. Return times (s) and aligned samples of its whole cycles at full amplitude.

    A disturbed wave is repeated. If it stays disturbed, the bench is the cause. Then the best wave is returned, and the
    result has a warning. A rig with amplitude control repeats the wave until the motion has this amplitude.
    """
    moving = MOTION[axis]

    def harmonic_of(times: Samples, values: Values) -> complex:
        motion = sum((values[name] for name in moving), np.zeros_like(times)) / len(moving)
        return harmonic(run.rig, times, motion, frequency, *moving)

    def once(command: float) -> tuple[Samples, Values]:
        return _undisturbed(run, axis, frequency, names, wave, command)

    return controlled(run, axis, wave, frequency, AMPLITUDE, once, harmonic_of)


def _undisturbed(
    run: Run,
    axis: Literal["vertical", "lateral"],
    frequency: float,
    names: tuple[str, ...],
    wave: Wave,
    amplitude: float,
) -> tuple[Samples, Values]:
    disturbed = []
    for left in reversed(range(TRIES)):
        times, values = _once(run, axis, frequency, names, wave, amplitude)
        moved = [values[name] for name in MOTION[axis] if name in values]
        part = max(distortion(times, one, frequency, wave) for one in moved)
        if part <= DISTORTED[wave]:
            return times, values
        disturbed.append((part, (times, values)))
        if left:
            run.say(
                f"{part:.1%} of the motion are not the {wave} of {frequency:g} Hz, so the disturbed "
                "motion is repeated"
            )
    least, best = min(disturbed, key=itemgetter(0))
    run.warn(
        f"{axis} {wave} of {frequency:g} Hz: no clean {wave} in {TRIES} tries; in the best one, which "
        f"is judged, {least:.1%} of the motion is something else. The actuator does not follow, or "
        "set-points come late"
    )
    return best


def _once(
    run: Run,
    axis: Literal["vertical", "lateral"],
    frequency: float,
    names: tuple[str, ...],
    wave: Wave,
    amplitude: float,
) -> tuple[Samples, dict[str, Samples]]:
    cycles = 2 + ceil(MEASURED * frequency)
    names = (*names, *LOADED[axis](run.rig))
    with run.bench.capture(*(name for name in names if run.bench.has(name))) as capture:
        run.bench.generator.run(axis, wave, amplitude=amplitude, frequency=frequency, cycles=cycles)
    return _at_full_amplitude(capture, frequency, cycles)


def _at_full_amplitude(capture: Capture, frequency: float, cycles: int) -> tuple[Samples, dict[str, Samples]]:
    times, values = capture.aligned(SAMPLE_RATE)
    steady = generator_cycles(times, values, 1, cycles - 2, frequency)
    return times[steady], {name: series[steady] for name, series in values.items()}


def generator_cycles(
    times: Samples, values: dict[str, Samples], first: int, count: int, frequency: float
) -> npt.NDArray[np.bool_]:
    """Return a mask of the samples in ``count`` cycles of the generator, beginning with cycle ``first``."""
    running = values["rig.program"] == PROGRAM_STATES.index("RUN")
    return whole_cycles(
        times, values["rig.generator_cycle"], running, first=first, count=count, frequency=frequency
    )


def spring_motion(values: Values, rig: Rig, side: str) -> tuple[Samples, Samples]:
    """Return the compression of a spring (m) and the force on it (N), both positive downward."""
    return -height_of_spring(values, rig, side), load_on(values, rig, side)


def lateral_motion(values: Values, rig: Rig) -> tuple[Samples, Samples]:
    """Return the lateral displacement of the bolster (m), and the force with which the springs oppose it (N)."""
    return values["lateral.displacement"], -sideways_force(values, rig)


def check_band(run: Run, name: str, value: float | Measured, unit: str, band: Band) -> None:
    """Check that ``value`` (SI) lies in ``band``."""
    run.check(name, value, unit, low=band.low, high=band.high)


def check_secant(
    run: Run,
    name: str,
    values: Values,
    motion_of: Callable[[Values, Rig], tuple[Samples, Samples]],
    band: Band,
) -> None:
    """Check the secant stiffness (N/m) of a slow loop. ``motion_of`` computes motion and force from the readings."""

    def secant(rig: Rig, values: Values) -> float:
        motion, force = motion_of(values, rig)
        # The gas cools while a slow loop lasts.
        return secant_stiffness(motion, without_drift(motion, force))

    motion, force = motion_of(values, run.rig)
    lost = f"{loop_energy(motion, without_drift(motion, force)):.2f} J lost in the loop"
    slope = run.measured(secant, run.rig, values)
    run.check(name, slope, "kN/m", low=band.low, high=band.high, note=lost)


class MeasuredStiffness(NamedTuple):
    """The parts of a complex stiffness at one frequency, each with its uncertainty."""

    storage: Measured  #: K' in N/m
    damping: Measured  #: c = K''/ω in N·s/m
    loss: Measured  #: K'' in N/m
    tangent: Measured  #: tan δ = K''/K'
    angle: Measured  #: δ in rad


def measure_stiffness(
    run: Run, stiffness: Callable[[Rig, Values], Stiffness], values: Values
) -> MeasuredStiffness:
    """Return the parts of a stiffness with their uncertainties. ``stiffness`` computes it from the readings."""

    def parts(rig: Rig, values: Values) -> tuple[float, ...]:
        K = stiffness(rig, values)
        return K.storage, K.damping, K.loss, K.loss / K.storage, phase(K.value)

    return MeasuredStiffness(*run.measure(parts, run.rig, values))


def check_stiffness(
    run: Run,
    stiffness: Callable[[Rig, Values], Stiffness],
    values: Values,
    storage: Mapping[str, Band] | None = None,
    damping: Mapping[str, Band] | None = None,
) -> MeasuredStiffness:
    """Check K' and c of the ``stiffness`` that is computed from readings. Return all its parts.

    ``storage`` and ``damping`` hold the limits of K' and c, by the name of the check.
    """
    found = measure_stiffness(run, stiffness, values)
    for one, unit, bands in ((found.storage, "kN/m", storage), (found.damping, "kN*s/m", damping)):
        for name, band in (bands or {}).items():
            check_band(run, name, one, unit, band)
    return found


def keep_loop(run: Run, name: str, what: str, motion: Samples, force: Samples) -> None:
    """Record force over displacement for the report, both minus their means."""
    run.loop(
        name,
        Axis("displacement", "mm", mm),
        Axis("force", "kN", kN),
        motion - motion.mean(),
        force - force.mean(),
        group=f"{what.capitalize()}: force over displacement",
    )


def keep_sweep(
    run: Run,
    name: str,
    direction: str,
    found: Sequence[MeasuredStiffness],
    sweep: Sequence[tuple[float, Band, Band]],
) -> None:
    """Record K', K'', c and tan δ over the frequencies of ``sweep`` for the report. K' and c are recorded with their
    limits.
    """
    frequencies = [frequency for frequency, _, _ in sweep]
    for quantity, values, limits in (
        (STORAGE, [one.storage for one in found], [storage for _, storage, _ in sweep]),
        (LOSS, [one.loss for one in found], ()),
        (DAMPING, [one.damping for one in found], [damping for _, _, damping in sweep]),
        (TANGENT, [one.tangent for one in found], ()),
    ):
        group = f"{direction.capitalize()} {quantity[0]}"
        keep(run, name, group, FREQUENCY, quantity, frequencies, values, limits)
