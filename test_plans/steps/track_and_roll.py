"""Steps that measure the response to the track under constant preload, and the roll by unequal preload."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from math import sqrt
from typing import TYPE_CHECKING, Final

import numpy as np
import numpy.typing as npt

from bench_protocol.units import Hz, kN, s
from bench_protocol.words import SIDES
from bench_records.result import CheckVerdict
from test_plans.analysis import GENERATOR, HEIGHTS, Samples, first_harmonic, without_lag
from test_plans.analysis.cells import CELLS, bearing, cell_moment, guiding
from test_plans.analysis.geometry import ACTUATORS, LASERS, Rig, actuator_moment, roll_of
from test_plans.check_names import CheckName
from test_plans.description import lag_of, lags
from test_plans.loads import Load
from test_plans.steps.air import LOAD, PRESSURE
from test_plans.steps.carrying import FREE_SIDEWAYS, PRELOAD_WITHIN
from test_plans.steps.of_the_bench import MASS, SPACING, check_roll_stiffness, of_the_stated_mass, stated
from test_plans.steps.shaking import AMPLITUDE, SAMPLE_RATE, Values, check_band, generator_cycles
from test_plans.steps.stiffness import VERTICAL_SECANT

if TYPE_CHECKING:
    from test_plans.run import Run

PASSED_ON: Final = CheckName(
    "bolster over platform at 1.2 Hz",
    "How much of the track's motion reaches the car near its natural frequency, where passengers feel it.",
)
PEAK: Final = CheckName(
    "peak of the bolster",
    "How high a bump of 5 mm lifts the car: a large overshoot means too little damping.",
)
ROLL_STIFFNESS: Final = CheckName(
    "roll stiffness",
    "Moment over angle under unequal loads: it determines how far the car leans in a curve.",
)
PARTED: Final = CheckName(
    "pressure difference by rolling",
    "The pressure difference under unequal loads: a valve between the springs that leaks or sticks open shows here.",
)
#: The checks of track and roll.
TRACK_AND_ROLL: Final = (ROLL_STIFFNESS, PARTED, PASSED_ON, PEAK)

_TRACK: Final = ("left.height", "right.height", "platform.vertical")
TRACK_FREQUENCY: Final = 1.2 * Hz
TRACK_CYCLES: Final = 3
ROLL_RATE: Final = 20 * kN / s
ROLL_WAIT: Final = 1.5 * s
ROLL_AVERAGE: Final = 0.5 * s
#: Smallest number of samples of such a mean.
AVERAGED: Final = 5
#: Tolerance of the ratio of two readings of one roll, in addition to their uncertainty.
ALIKE: Final = 0.01
#: Uncertainty of the spacing from the stiffness of springs: the gas is warmer in a slow roll than in a loop.
SPACING_WITHIN: Final = 0.04
#: Smallest share of the gas in the stiffness, if no air flows between the springs.
TIGHT_SHARE: Final = 0.5
CONTRADICTED: Final = "a dimension of the rig contradicts the measurement"
CHECK: Final = "Check it with `astb rig check --allow-motion`"
PISTONS: Final = tuple(f"vertical_{side}.displacement" for side in SIDES)


def track_excitation(run: Run) -> None:
    """Move the platform by a unilateral cosine of 5 mm, as on a track, under constant preload. Measure and check how
    the bolster moves.
    """
    bench = run.bench
    if not run.can(
        PASSED_ON,
        PEAK,
        needs=(*_TRACK, *GENERATOR, "platform.vertical_setpoint", "generator.axis", *lags(HEIGHTS)),
    ) or not stated(run, MASS, PASSED_ON, PEAK):
        return
    with run.phase("unilateral cosine"):
        with bench.capture(*_TRACK, *GENERATOR) as capture:
            bench.generator.run(
                "platform_vertical",
                "unilateral_cosine",
                amplitude=AMPLITUDE,
                frequency=TRACK_FREQUENCY,
                cycles=TRACK_CYCLES,
            )
        times, values = capture.aligned(SAMPLE_RATE)
        steady = generator_cycles(times, values, 1, TRACK_CYCLES - 1, TRACK_FREQUENCY)
        ratio, highest = run.measure(
            partial(_answer, times, steady, run.specimen.bench[MASS]), run.rig, values
        )
        limits = run.specimen.limits
        check_band(run, PASSED_ON, ratio, "1", limits.band("track_transmissibility"))
        check_band(run, PEAK, highest, "mm", limits.band("track_peak"))


def _answer(
    times: Samples, steady: npt.NDArray[np.bool_], mass: float, rig: Rig, values: Values
) -> tuple[float, float]:
    """Return the ratio of the first harmonics of bolster and platform, and the peak of the bolster (m).

    Both are converted to a bolster of ``mass`` (kg). The peak is the mean (half the platform's travel) plus the
    amplitude (half the bolster's travel).
    """
    platform = values["platform.vertical"] - values["platform.vertical"][0]
    spring = 0.5 * (values["left.height"] + values["right.height"])
    bolster = platform + spring - spring[0]
    compressed, excitation = (
        first_harmonic(times[steady], motion[steady], TRACK_FREQUENCY) for motion in (spring, platform)
    )
    ratio = 1 + without_lag(compressed, lag_of(rig, *HEIGHTS), TRACK_FREQUENCY) / excitation
    alike = of_the_stated_mass(ratio, rig, mass)
    return abs(alike), float(bolster.max()) * (1 + abs(alike)) / (1 + abs(ratio))


def roll_by_unequal_preload(run: Run, load: Load) -> None:
    """Load the two sides unequally with locked air, first the left side more, then the right. Measure and check the
    roll stiffness.
    """
    bench = run.bench
    # A bolster that is held sideways rolls about another axis, and is stiffer by a quarter to a third.
    if not run.can(ROLL_STIFFNESS, PARTED, needs=(*FREE_SIDEWAYS, *ACTUATORS, *LASERS)):
        return
    with run.phase("roll"):
        names = [f"{side}.{what}" for side in SIDES for what in ("height", "bellows_pressure")]
        names += [f"vertical_{side}.force" for side in SIDES]
        names += filter(bench.has, dict.fromkeys((*PISTONS, *bearing(run.rig), *guiding(run.rig))))
        rolled = []
        force = load.actuator_force(run.rig)
        for more in (load.roll_load, -load.roll_load):
            bench.vertical.preload(force + more, force - more, rate=ROLL_RATE, within=PRELOAD_WITHIN)
            bench.wait(ROLL_WAIT)
            rolled.append(bench.averages(*names, over=ROLL_AVERAGE))
        bench.vertical.preload(force, force, rate=ROLL_RATE, within=PRELOAD_WITHIN)
        stiffness, swing = run.measure(_between, run.rig, *rolled, averaged=AVERAGED)
        if contradiction := description_contradicted(run, rolled[0], rolled[1], float(stiffness)):
            run.warn(contradiction)
            run.not_available((ROLL_STIFFNESS,), contradiction)
        else:
            check_roll_stiffness(run, ROLL_STIFFNESS, stiffness, load.limits.band("roll_stiffness"))
        limit = run.specimen.limits.band("roll_pressure_difference")
        check_band(run, PARTED, swing, "bar", limit)


def description_contradicted(
    run: Run, one: Mapping[str, float], other: Mapping[str, float], stiffness: float
) -> str:
    """Return a text on a stated dimension that contradicts the measured roll of the free bolster; "" if there is none.

    Lasers and pistons measure the same roll, load cells and actuators the same moment. If only one pair disagrees, the
    position of lasers or cells is wrong. If both disagree, the position of the actuators is wrong.
    """
    found = {}
    if all(name in one for name in PISTONS) and not run.rig.lacks("vertical_frame_stiffness"):
        (found["roll"],) = run.measure(_roll_ratio, run.rig, one, other, averaged=AVERAGED)
    if all(cell in one for cell in (*bearing(run.rig), *guiding(run.rig))) and not run.rig.lacks(*CELLS):
        (found["moment"],) = run.measure(_moment_ratio, run.rig, one, other, averaged=AVERAGED)
    wrong = {
        name: ratio
        for name, ratio in found.items()
        if ratio.expanded is not None and abs(ratio.value - 1.0) > ALIKE + ratio.expanded
    }
    if wrong:
        of = {"roll": "lasers", "moment": "load cells"}
        text = "; ".join(
            f"the {name} by the {of[name]} is {ratio.value:.3f} ± {ratio.expanded:.3f} times that by the actuators"
            for name, ratio in wrong.items()
        )
        named = "vertical actuators" if len(wrong) == len(of) else of[next(iter(wrong))]
        return f"{CONTRADICTED}: {text}; the stated positions of the {named}, or their scales, are wrong. {CHECK}"
    return _spacing_contradicted(run, one, other, stiffness)


def _roll_ratio(rig: Rig, one: Mapping[str, float], other: Mapping[str, float]) -> float:
    """Return the ratio of the roll by the lasers to the roll by the pistons, corrected for the deflection of the
    frames.
    """
    more = {name: np.asarray(other[name] - one[name]) for name in one}
    left, right = (
        more[f"vertical_{side}.displacement"]
        + more[f"vertical_{side}.force"] / rig["vertical_frame_stiffness"]
        for side in SIDES
    )
    spacing = rig[ACTUATORS[0]] - rig[ACTUATORS[1]]
    return float(roll_of(more, rig) * spacing / (left - right))


def _moment_ratio(rig: Rig, one: Mapping[str, float], other: Mapping[str, float]) -> float:
    """Return the ratio of the moment by the load cells to the moment by the vertical actuators."""
    more = {name: np.asarray(other[name] - one[name]) for name in one}
    return float(cell_moment(more, rig) / actuator_moment(more, rig))


def _spacing_contradicted(
    run: Run, one: Mapping[str, float], other: Mapping[str, float], stiffness: float
) -> str:
    """Return a text if the measured stiffness contradicts the stated spacing 2b of the springs; otherwise "".

    For intact springs K_roll = (k_l + k_r) b². Air flow between the springs also reduces K_roll, but then their
    pressures hardly change.
    """
    judged = {check.name: check for check in run.checks if check.verdict is CheckVerdict.PASS}
    names = [name.of(side=side) for name in (VERTICAL_SECANT["slow"], LOAD, PRESSURE) for side in SIDES]
    stated = run.rig.stated(SPACING)
    if stated is None or not all(name in judged for name in names):
        return ""
    numbers = [judged[name].number for name in names]
    upright, load, pressure = (sum(numbers[k : k + 2]) for k in (0, 2, 4))
    found = sqrt(stiffness / upright)
    moved, swing = (
        (other[f"left.{what}"] - one[f"left.{what}"]) - (other[f"right.{what}"] - one[f"right.{what}"])
        for what in ("height", "bellows_pressure")
    )
    gas = abs(swing / moved) * load / pressure / (0.5 * upright)
    if abs(found / stated.value - 1.0) <= SPACING_WITHIN or gas < TIGHT_SHARE:
        return ""
    return (
        f"{CONTRADICTED}: spring_half_spacing is stated as {stated.value:.4g} m, but the roll stiffness over the "
        f"vertical stiffness gives {found:.3g} m ± {100 * SPACING_WITHIN:.0f} %. {CHECK}, or search for a leak"
    )


def _between(rig: Rig, one: Mapping[str, float], other: Mapping[str, float]) -> tuple[float, float]:
    """Return roll stiffness (N·m/rad) and half the change of the pressure difference (Pa) between two rolls.

    Offsets of transducers cancel in the differences.
    """
    more = {name: np.asarray(other[name] - one[name]) for name in one}
    stiffness = float(actuator_moment(more, rig) / roll_of(more, rig))
    return stiffness, 0.5 * float(more["right.bellows_pressure"] - more["left.bellows_pressure"])
