"""Crosswind gust: how far one gust moves and rolls the bolster on its springs, and whether it comes back."""

from collections.abc import Mapping
from functools import partial
from typing import Annotated, Final, Literal

import numpy as np
import numpy.typing as npt

from bench_protocol.units import FACTORS, bar, kN, mm, mrad, s
from bench_records.curves import Axis
from test_plans import steps
from test_plans.analysis import SHEAR_CELLS, NotMeasured, Samples
from test_plans.analysis.cells import CELLS_ACROSS, guiding, sideways_force
from test_plans.analysis.geometry import ACTUATORS, POSE_SIGNALS, SEEING, Rig, roll_of, shear_of
from test_plans.analysis.uncertainty import EVEN, SAMPLING
from test_plans.check_names import CheckName
from test_plans.loads import Band
from test_plans.parameters import ParameterRefused, Range
from test_plans.plan import plan
from test_plans.preconditions import on_the_bench
from test_plans.run import Run
from test_plans.steps.carrying import FREE_SIDEWAYS
from test_plans.steps.fittings import leave_connected
from test_plans.steps.of_the_bench import bench_mismatch
from test_plans.steps.shaking import SAMPLE_RATE, check_band
from test_plans.steps.wind import CAR, GUST_FACTOR, RISE, STEP, fade, gust, on_the_bolster, side_force

PRESSURES: Final = tuple(f"{side}.auxiliary_pressure" for side in ("left", "right"))
READ: Final = (*POSE_SIGNALS, *PRESSURES)
kmh: Final = FACTORS["km/h"]
BEFORE: Final = 2 * s
#: Duration of the mean wind alone, before and after the gust, and of the calm at the end.
MEAN: Final = 4 * s
AFTER: Final = 3 * s
SETTLING: Final = ("time to settle", "s")
MIDDLE: Final = RISE + MEAN
LASTS: Final = 2 * MIDDLE + 2 * s
#: Window for the mean position of the bolster, number of samples against noise, and decimation.
SMOOTH: Final = 1 * s
NOISE: Final = 10
KEPT: Final = 10
#: The gust for which the file states roll, permanent displacement and settle time: its wind and the train's speed.
STATED: Final = (10.0, 100 * kmh)
#: Limits that hold for weaker and slower gusts, too, but not for stronger or faster ones.
NO_MORE: Final = ("roll", "remains")
#: The bolster counts as settled if its distance from the position under the mean wind is at most this fraction of the
#: displacement by the gust.
SETTLED: Final = 0.1
#: The checks of the response, by limit: name and unit.
JUDGED: Final = {
    "displacement": (
        CheckName(
            "largest displacement",
            "How far one gust moves the bolster: beyond the limit, the car leaves its clearance or hits its stop.",
        ),
        "mm",
    ),
    "roll": (
        CheckName(
            "largest roll",
            "How far one gust rolls the bolster: too much roll takes the "
            "roof out of its clearance and unloads a wheel.",
        ),
        "mrad",
    ),
    "roll_stiffness": (
        CheckName(
            "roll stiffness",
            "The wind's moment over the roll that it causes: the total "
            "resistance to leaning, with the springs connected.",
        ),
        "kN*m/rad",
    ),
    "pressure_difference": (
        CheckName(
            "largest pressure difference",
            "The pressure difference that the gust causes: if it is too large, the valve between the springs opens "
            "and the car leans.",
        ),
        "bar",
    ),
    "air_moment": (
        CheckName(
            "moment of the air over that of the wind",
            "The share of the wind's moment that the air pressure carries: the rubber carries the rest and wears.",
        ),
        "1",
    ),
    "remains": (
        CheckName(
            "displacement that remains",
            "Where the bolster stands after the wind: a remaining displacement means friction or a damaged spring.",
        ),
        "mm",
    ),
    "pressure_remains": (
        CheckName(
            "pressure difference that remains",
            "The pressure difference that remains after the wind: air has gone to "
            "the other spring, and the car stands inclined.",
        ),
        "bar",
    ),
}
STIFF: Final = CheckName(
    "lateral stiffness",
    "The gust's force over the displacement that it causes: it shows "
    "whether the spring is as stiff as its drawing states.",
)
SETTLES: Final = CheckName(
    "time to settle",
    "How long the bolster swings after the gust: with too little damping, the next gust adds to the motion.",
)


def blow(wind: float, train_speed: float) -> tuple[Samples, Samples]:
    """Return times (s), and the force (N) on the bogie by a gust up to ``wind`` (m/s), with mean wind before and after
    it.
    """
    times = np.linspace(0.0, LASTS, round(LASTS / STEP) + 1)
    return times, fade(times) * side_force(gust(wind, train_speed, times, MIDDLE), train_speed)


def strongest(wind: float, train_speed: float) -> float:
    """Return the largest force (N) of the gust."""
    return float(blow(wind, train_speed)[1].max())


def passes(train_speed: float) -> float:
    """Return how long after its middle (s) a gust has fallen to the fraction `SETTLED` of its excess over the mean
    wind.
    """
    times = np.linspace(0.0, MEAN, round(MEAN / STEP) + 1)
    more = gust(1.0, train_speed, times, 0.0)
    more -= 1.0 / GUST_FACTOR
    return float(times[more > SETTLED * more[0]][-1])


def holds(run: Run, load: str) -> float:
    """Return the lateral force (N) that moves the bolster to its bump stop if the springs are as soft as their limits
    allow.
    """
    soft = run.specimen.load(load).limits.curve("crosswind_gust.stiffness", "kN/m")
    return (soft[max(soft)].low or 0.0) * run.rig["stop_gap"]


def take_up(run: Run, load: str, wind: float, train_speed: float) -> None:
    """Load and shut the springs, and release the bolster. Raises ParameterRefused for a gust that reaches the bump
    stop.
    """
    most, held = strongest(wind, train_speed), holds(run, load)
    if most > held:
        raise ParameterRefused(
            f"wind = {wind:g} m/s at train_speed = {train_speed / kmh:g} km/h pushes with {most / kN:.1f} kN; springs "
            f"at the lower limit of their stiffness reach the bump stop at {held / kN:.1f} kN; set a smaller wind or "
            "train_speed"
        )
    steps.carry_load(run, load)
    steps.lock_the_air(run)
    run.bench.air.connect_dpv()
    steps.free_the_bolster(run)


@plan(
    setup=take_up,
    needs=(
        *steps.CARRYING,
        *READ,
        *SHEAR_CELLS,
        *FREE_SIDEWAYS,
        "vertical_left.force_setpoint",
        "vertical_right.force_setpoint",
        *SEEING,
        *CELLS_ACROSS,
        *ACTUATORS,
        "spring_half_spacing",
        "stop_gap",
    ),
    teardown=leave_connected,
    lasts=51 * s,
    requires=on_the_bench("load"),
    checks=(STIFF, *(name for name, _ in JUDGED.values()), SETTLES),
)
def crosswind_gust(
    run: Run,
    *,
    load: Literal["AW0", "AW3"] = "AW0",
    wind: Annotated[float, Range(6.0, 20.0, "m/s")] = 10.0,
    train_speed: Annotated[float, Range(40 * kmh, 160 * kmh, "km/h")] = 100 * kmh,
) -> None:
    """Crosswind gust: displacement, roll and stiffness of the springs in one gust.

    The springs carry the load, their valves are shut, and the differential pressure valve connects them. The bolster is
    free in all directions under the preload. The wind rises to its mean within 4 s. After 4 s a gust passes the car. It
    has the shape of EN 14067-6 and a maximum of `wind`, which is 1.7 times the mean. Then the mean wind continues for 4
    s and fades. The wind force on one bogie pushes the bolster sideways, and its moment rolls it. The host sends the
    force of the lateral actuator, and the difference of the vertical forces, as set-points.

    The specimen's file has the limits for these results:

    * the largest displacement and roll;
    * the lateral stiffness and the roll stiffness under the gust;
    * the pressure difference, which must not open the valve between the springs;
    * the share of the moment that the air pressure carries, and not the rubber;
    * the time until the bolster is at rest again;
    * the displacement and the pressure difference that remain after the wind.

    The limits of roll and remaining displacement hold for a gust of 10 m/s at 100 km/h. They are not applied to a
    stronger or faster gust. The limit of the settle time holds for 100 km/h, too. At a lower speed, the gust takes
    longer, and the limit is extended by that time.
    """
    times, force = blow(wind, train_speed)
    with run.phase("gust"):
        with run.bench.capture(*READ, *guiding(run.rig)) as capture:
            run.bench.wait(BEFORE)
            run.bench.waveform.run(times, on_the_bolster(force, run.rig))
            run.bench.wait(AFTER)
        at, values = capture.aligned(SAMPLE_RATE)
    _check_response(run, load, wind, train_speed, at - BEFORE, values)


def _check_response(
    run: Run, load: str, wind: float, train_speed: float, at: Samples, values: Mapping[str, Samples]
) -> None:
    """Check and record the response of the springs. ``at`` are the times (s) since the start of the wind."""
    limits = run.specimen.load(load).limits
    area = run.specimen.effective_area
    y, roll, pushed, parted = _answer(at, run.rig, values)
    if not np.isfinite([y, roll, pushed, parted]).all():
        raise NotMeasured("samples of the gust are missing")
    stiffness, *found, settling = run.measure(partial(_numbers, at, area), run.rig, values)
    # Beyond the abscissas of the file, the displacement exceeds its limit in any case.
    places = limits.curve("crosswind_gust.stiffness", "kN/m")
    place = float(np.clip(y.max(), min(places), max(places)))
    low, high = limits.curve_at("crosswind_gust.stiffness", place, "kN/m")
    run.check(STIFF, stiffness, "kN/m", low=low, high=high)
    settling = settling.with_uncertainty(SAMPLING, 0.5 * EVEN / SAMPLE_RATE, even=True)
    judged = {**JUDGED, "settling": (SETTLES, "s")}
    if other := bench_mismatch(run):
        run.not_available([name for name, _ in judged.values()], other)
    else:
        more = strongest(wind, train_speed) > strongest(*STATED) or train_speed > STATED[1]
        longer = passes(train_speed) - passes(STATED[1])
        for (limit, (name, unit)), value in zip(judged.items(), (*found, settling), strict=True):
            band = limits.band(f"crosswind_gust.{limit}", unit)
            if limit == "settling" and band.high is not None:
                band = Band(band.low, band.high + longer)
            if more and limit in NO_MORE:
                stated = f"{STATED[0]:g} m/s at {STATED[1] / kmh:g} km/h"
                run.lack(
                    [name], f"the gust is stronger or faster than that of {stated}, which its limit holds for"
                )
            else:
                check_band(run, name, value, unit, band)
    for what, x, y_axis, xs, ys in (
        ("force over displacement", Axis("displacement", "mm", mm), Axis("force", "kN", kN), y, pushed),
        (
            "pressure difference over roll",
            Axis("roll", "mrad", mrad),
            Axis("pressure", "bar", bar),
            -roll,
            parted,
        ),
    ):
        run.loop(load, x, y_axis, xs[::KEPT], ys[::KEPT], group=f"Gust: {what}")


def _answer(at: Samples, rig: Rig, values: Mapping[str, Samples]) -> tuple[Samples, ...]:
    """Return shear (m), roll (rad), lateral force (N) and pressure difference (Pa) of the springs, each relative to its
    value before the wind.
    """
    calm = _during(at, -SMOOTH)
    series = (
        shear_of(values, rig),
        roll_of(values, rig),
        -sideways_force(values, rig),
        values[PRESSURES[0]] - values[PRESSURES[1]],
    )
    return tuple(_smooth(one - one[calm].mean()) for one in series)


def _numbers(at: Samples, area: float, rig: Rig, values: Mapping[str, Samples]) -> tuple[float, ...]:
    """Return the results: the lateral stiffness, the others in the order of their names, and the settle time."""
    y, roll, pushed, parted = _answer(at, rig, values)
    peak, calmed = int(np.argmax(y)), _during(at, LASTS + AFTER - SMOOTH)
    moment = pushed[peak] * CAR.pressure_height
    return (
        pushed[peak] / y[peak],
        y[peak],
        np.abs(roll).max(),
        moment / abs(roll[peak]),
        parted.max(),
        parted[peak] * area * rig["spring_half_spacing"] / moment,
        abs(y[calmed].mean()),
        abs(parted[calmed].mean()),
        _settling(at, y),
    )


def _settling(at: Samples, y: Samples) -> float:
    """Return the time (s) from the middle of the gust until the shear stays near its value under the mean wind, within
    the fraction `SETTLED` of its largest excess.
    """
    blown = y[_during(at, MIDDLE + MEAN - SMOOTH)].mean()
    unsettled = np.abs(y - blown) > SETTLED * (y.max() - blown)
    return float(at[np.flatnonzero(unsettled & (at < MIDDLE + MEAN))[-1]] - MIDDLE)


def _during(at: Samples, start: float) -> npt.NDArray[np.bool_]:
    """Return a mask of the samples in the second from ``start`` (s) on."""
    return np.asarray((at >= start) & (at < start + SMOOTH))


def _smooth(series: Samples) -> Samples:
    """Return means over 50 ms. They remove noise, but a gust is much longer."""
    return np.convolve(series, np.full(NOISE, 1 / NOISE), mode="same")
