"""Roll torque: force and torque due to shear and roll of a spring, and the torsional stiffness of one diaphragm."""

from collections.abc import Mapping
from math import ceil
from typing import Annotated, Final, Literal, NamedTuple

import numpy as np

from bench_protocol.units import Hz, kN, mm, mrad, s
from bench_protocol.words import SIDES
from test_plans import steps
from test_plans.analysis import HEIGHTS, SHEAR_CELLS, VERTICAL_CELLS, Samples, harmonic
from test_plans.analysis.cells import cell_moment, sideways_force, upward_force
from test_plans.analysis.geometry import ACTUATORS, POSE_SIGNALS, Rig, roll_of
from test_plans.analysis.uncertainty import EVEN
from test_plans.check_names import CheckName
from test_plans.description import lags
from test_plans.parameters import Range
from test_plans.plan import plan
from test_plans.preconditions import on_the_bench
from test_plans.run import Run
from test_plans.steps.fittings import leave_connected
from test_plans.steps.of_the_bench import check_roll_stiffness
from test_plans.steps.poses import COOL, POSING, go_home
from test_plans.steps.shaking import check_band
from test_plans.steps.wind import fade

READ: Final = (*POSE_SIGNALS, *VERTICAL_CELLS, *SHEAR_CELLS)
FREQUENCY: Final = 0.3 * Hz
#: Sampling rate of the slow motions.
RATE: Final = 50 * Hz
#: Friction loses its memory during the lead; the first and the last cycle fade in and out.
LEAD: Final = 2
MEASURED: Final = 3
STEP: Final = 0.02 * s
SHEAR: Final = 5 * mm
COOLED: Final = "gas that cools between the motions"
BY_ROLL: Final = CheckName(
    "lateral force of a spring per radian of roll, K_yφ",
    "The lateral force that a roll alone causes: a leaning car steers its bogie by this force.",
)
BY_SHEAR: Final = CheckName(
    "roll torque of a spring per metre of shear, K_φy",
    "The roll torque that a lateral displacement alone causes: a crosswind rolls the car by this torque, too.",
)
RECIPROCAL: Final = CheckName(
    "K_yφ over K_φy",
    "Ratio of force by roll and torque by shear: both are equal in a spring without energy loss.",
)
TORSION: Final = CheckName(
    "torsional stiffness of one diaphragm, K_φ",
    "The roll torque of one spring over its roll, without the part of the two springs' heights; the rubber carries it.",
)
STIFF: Final = CheckName(
    "roll torque of the pair over roll",
    "The whole resistance to leaning when nothing moves sideways: heights and diaphragms together.",
)

Values = Mapping[str, Samples]


class Motion(NamedTuple):
    """First harmonics of one motion (SI): shear, roll and height, and the force, torque and load of the pair of
    springs.
    """

    shear: complex
    roll: complex
    height: complex
    force: complex
    torque: complex
    load: complex


class Law(NamedTuple):
    """Coefficients of one spring from three motions: F = K_yy y + K_yφ φ, M = K_φy y + K_φφ φ."""

    by_roll: float  #: N/rad
    by_shear: float  #: N·m per m
    ratio: float
    torsion: float  #: N·m/rad, the torque without the part of the springs' heights
    of_the_pair: float  #: N·m/rad


@plan(
    setup=steps.carry_load,
    needs=(
        *steps.CARRYING,
        *POSING,
        "air.dpv",
        "spring_half_spacing",
        *lags((*HEIGHTS, "lateral.displacement", "lateral.force", *SHEAR_CELLS, *VERTICAL_CELLS)),
    ),
    teardown=leave_connected,
    lasts=150 * s,
    requires=on_the_bench("load"),
    checks=(BY_ROLL, BY_SHEAR, RECIPROCAL, TORSION, STIFF),
)
def roll_torque(
    run: Run,
    *,
    load: Literal["AW0", "AW3"] = "AW0",
    roll: Annotated[float, Range(6 * mrad, 15 * mrad, "mrad")] = 10 * mrad,
) -> None:
    """Roll torque: coupling of shear and roll, and the torsional stiffness of one diaphragm.

    The springs carry the `load` at design height. All valves are shut, and the differential pressure valve is isolated.
    Four slow motions follow. Each is a sine of 0.3 Hz, in which vertical and lateral actuators move together:

    * up and down, by the height that the roll gives a spring;
    * a `roll` to either side about the middle between the top plates, without shear;
    * a shear of 5 mm without roll;
    * up and down again.

    Force and torque in the load cells over shear and roll are the stiffnesses of the paper's equations (11) and (12),
    per spring. The heights of the springs cause a part of the torque, which is the mean of the first and the last
    motion. The rest is the torsional stiffness of the diaphragms, equation (13).

    The specimen's file has the limits of the coupling in both directions, of the ratio of both, which must be near 1,
    and of the torsional stiffness.
    """
    limits = run.specimen.load(load).limits
    go_home(run)
    run.bench.wait(COOL)
    steps.lock_the_air(run)
    run.bench.air.isolate_dpv()
    captured = [_move(run, way) for way in _motions(run.rig, roll)]

    def motions(rig: Rig, *read: Values) -> list[Motion]:
        return [_motion(times, rig, values) for (times, _), values in zip(captured, read, strict=True)]

    def evaluate(rig: Rig, *read: Values) -> tuple[float, ...]:
        return _law(rig, *motions(rig, *read))

    read = [values for _, values in captured]
    before, rolled, _, after = motions(run.rig, *read)
    found = [*run.measure(evaluate, run.rig, *read, rate=RATE)]
    # The mean of both motions cancels an unknown part of the cooling between them.
    b = run.rig["spring_half_spacing"]
    cooled = 0.5 * b**2 * abs(_upright(before) - _upright(after))
    found[3] = found[3].with_uncertainty(COOLED, EVEN * 0.5 * cooled, even=True)
    note = f"rolled by {abs(rolled.roll) / mrad:.2f} mrad, sheared by {abs(rolled.shear) / mm:.2f} mm"
    for name, value, limit, unit in zip(
        (BY_ROLL, BY_SHEAR, RECIPROCAL, TORSION),
        found,
        ("force_by_roll", "torque_by_shear", "reciprocity", "torsional_stiffness"),
        ("kN", "kN", "1", "kN*m/rad"),
        strict=False,
    ):
        check_band(run, name, value, unit, limits.band(f"roll_torque.{limit}", unit))
    note = f"roll torque of the pair {abs(rolled.torque) / kN:.2f} kN·m, {note}"
    check_roll_stiffness(run, STIFF, found[4], limits.band("roll_stiffness"), note=note)


def _motions(rig: Rig, roll: float) -> list[dict[str, float]]:
    """Return the amplitude (m) of each actuator by name, for each of four motions: up, roll, shear, and up again."""
    above = rig["centre_height"] + rig["lateral_actuator_height"]
    travel = roll * rig["spring_half_spacing"]
    up = {f"vertical_{side}": travel for side in SIDES}
    rolled = {f"vertical_{side}": roll * rig[one] for side, one in zip(SIDES, ACTUATORS, strict=True)}
    return [up, {**rolled, "lateral": -above * roll}, {"lateral": SHEAR}, up]


def _move(run: Run, amplitudes: Mapping[str, float]) -> tuple[Samples, dict[str, Samples]]:
    """Move the actuators together; return times and samples of whole cycles at full amplitude."""
    period = 1 / FREQUENCY
    count = ceil((LEAD + MEASURED + 2) * period / STEP)
    times = np.linspace(0.0, count * STEP, count + 1)
    wave = fade(times, period) * np.sin(2 * np.pi * FREQUENCY * times)
    wave[-1] = 0.0
    moves = {f"{actuator}.displacement": size * wave for actuator, size in amplitudes.items()}
    with run.phase(" and ".join(amplitudes)):
        with run.bench.capture(*READ) as capture:
            run.bench.waveform.run(times, moves)
        at, values = capture.aligned(RATE)
    steady = (at >= LEAD * period) & (at < (LEAD + MEASURED) * period + 1 / RATE)
    return at[steady], {one: series[steady] for one, series in values.items()}


def _motion(times: Samples, rig: Rig, values: Values) -> Motion:
    def of(series: Samples, *names: str) -> complex:
        return harmonic(rig, times, series, FREQUENCY, *names)

    roll = of(roll_of(values, rig), *HEIGHTS)
    tilt = of(np.asarray(values["platform.roll"]), "lateral.displacement")  # a transducer of its kind
    pinned = of(values["lateral.displacement"], "lateral.displacement")
    pinned -= of(values["lateral.force"], "lateral.force") / rig["lateral_frame_stiffness"]
    above = rig["centre_height"] + rig["lateral_actuator_height"]
    return Motion(
        pinned + above * (roll + tilt) + rig["column_height"] * tilt,
        roll,
        of(0.5 * (values["left.height"] + values["right.height"]), *HEIGHTS),
        -of(sideways_force(values, rig), *SHEAR_CELLS),
        of(cell_moment(values, rig), *VERTICAL_CELLS),
        -of(upward_force(values, rig), *VERTICAL_CELLS),
    )


def _law(rig: Rig, before: Motion, rolled: Motion, sheared: Motion, after: Motion) -> Law:
    """Solve the linear equations for the lateral force and the roll torque, from a motion in roll and one in shear.

    The vertical stiffness follows from the vertical motions ``before`` and ``after``. Its part of the roll torque is
    subtracted.
    """
    motions = np.array([[rolled.shear, sheared.shear], [rolled.roll, sheared.roll]])
    answers = np.array([[rolled.force, sheared.force], [rolled.torque, sheared.torque]])
    (_, by_roll), (by_shear, whole) = (0.5 * (answers @ np.linalg.inv(motions))).real
    upright = 0.5 * (_upright(before) + _upright(after))
    torsion = whole - rig["spring_half_spacing"] ** 2 * upright
    return Law(by_roll, by_shear, by_roll / by_shear, torsion, 2 * whole)


def _upright(lifted: Motion) -> float:
    """Return the vertical stiffness of one spring (N/m), from a vertical motion of both."""
    return float(0.5 * (lifted.load / lifted.height).real)
