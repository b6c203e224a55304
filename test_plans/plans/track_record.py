"""A measured track: the platform moves as the track under a train of a given speed, with or without wind."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Annotated, Final, Literal

import numpy as np
import numpy.typing as npt

from bench_protocol.units import FACTORS, m, mm, mrad, ms, s
from bench_records.curves import Axis
from drivers.errors import Misuse, NotAvailable
from drivers.receiver import Capture
from test_plans import steps
from test_plans.analysis import HEIGHTS, PRESSURES, SHEAR_CELLS, VERTICAL_CELLS, NotMeasured, Samples
from test_plans.analysis.cells import CELLS, CELLS_ACROSS
from test_plans.analysis.geometry import POSE_SIGNALS, SEEING, Rig, stop_travel_of
from test_plans.check_names import CheckName
from test_plans.description import lags
from test_plans.loads import SpecimenError
from test_plans.parameters import File, Range
from test_plans.plan import plan
from test_plans.plans.stochastic_crosswind import (
    LEVEL,
    LOST,
    RATE,
    STEP,
    STIFF,
    TRAIN_SPEED,
    check_stiffness,
    irregularity,
    keep_stiffness,
    take_up,
    upright,
)
from test_plans.preconditions import ConditionResult, Precondition, on_the_bench
from test_plans.run import Run
from test_plans.steps.amplitude import LATEST, continuous, controlled_track
from test_plans.steps.carrying import FREE_SIDEWAYS
from test_plans.steps.fittings import leave_connected
from test_plans.steps.stop_travel import blown, shaken
from test_plans.steps.wind import RISE, fade, random_process, side_force
from test_plans.track_file import NoTrack, TrackRecord, read_track

Values = Mapping[str, Samples]
KMH: Final = FACTORS["km/h"]

#: Name of a generated track instead of a file: low level of ERRI B 176, always the same.
DRAWN: Final = "ERRI-low"
DRAWN_LENGTH: Final = 20_000 * m
DRAWN_STEP: Final = 0.5 * m
#: Range of its wavelengths: D1 and D2 of EN 13848-1. Longer waves belong to the line; no wheel follows shorter ones.
WAVES: Final = (3 * m, 70 * m)
WAYS: Final = ("platform.vertical", "platform.lateral", "platform.roll")
READ: Final = (*POSE_SIGNALS, *WAYS[:2], *SHEAR_CELLS, *VERTICAL_CELLS, *PRESSURES)
BEFORE: Final = 2 * s
#: Allowed difference from the requested motion, rms, as a fraction: set-points 20 ms apart, lag and noise.
BESIDE_MOST: Final = 0.1
#: Motions with a smaller rms are within the resolution of the transducer (m, rad).
LEAST: Final = 2e-4
#: The limits of the vertical stiffness hold for the drawn track at `TRAIN_SPEED`. A speed so much different as a
#: fraction changes K' by 1 % and the loss angle by 3 %, a tenth and a fifth of their tolerances.
SPEED_WITHIN: Final = 0.05
#: Interval of the drawn samples.
KEPT: Final = 4

BESIDE: Final = CheckName(
    "platform beside the record, {way}",
    "Deviation of the platform from the record, rms over rms; if it is large, the springs met another track.",
)
TRAVEL: Final = CheckName(
    "largest travel of the bolster",
    "How far track and wind together move the car sideways: beyond the limit it leans on its bump stop.",
)


def drawn() -> TrackRecord:
    """Return the track that is used instead of a file: vertical and lateral, with the spectrum of ERRI B 176."""
    places: Samples = DRAWN_STEP * np.arange(round(DRAWN_LENGTH / DRAWN_STEP), dtype=np.float64)
    waves = np.asarray(np.fft.rfftfreq(places.size, DRAWN_STEP), np.float64)
    passing = (waves >= 1.0 / WAVES[1]) & (waves <= 1.0 / WAVES[0])
    generator = np.random.default_rng(1)
    ways = {
        axis: random_process(places, irregularity(waves, level, 1.0) * passing, generator)
        for axis, level in zip(WAYS, LEVEL, strict=False)
    }
    return TrackRecord(DRAWN, places, ways)


def read(track: str) -> TrackRecord:
    """Return the track that a parameter names. Raises NoTrack for a file that is not a track."""
    return drawn() if track == DRAWN else read_track(Path(track))


def excitation(
    record: TrackRecord, speed: float, duration: float, wind: float
) -> tuple[Samples, dict[str, Samples]]:
    """Return times (s), and the part of each set-point (SI) due to track and steady crosswind.

    All parts rise and fade within 4 s. They are complete for the ``duration`` (s) in between. Raises NoTrack for a
    record that is too short.
    """
    count = round((duration + 2 * RISE) / STEP)
    times = np.linspace(0.0, count * STEP, count + 1)
    share = fade(times)
    if (lasts := float(record.times(speed)[-1])) < times[-1]:
        under = "" if record.timed else f" at {speed / KMH:.4g} km/h"
        raise NoTrack(
            f"{record.name} lasts {lasts:.4g} s{under}, of which {2 * RISE:g} s are needed to begin "
            f"and end; use a duration of at most {lasts - 2 * RISE:.4g} s"
        )
    moves = {name: share * way for name, way in record.at(times, speed).items()}
    if wind:
        moves["lateral.force"] = share * side_force(wind, speed)
    return times, moves


def _look_at_the_track(run: Run) -> ConditionResult:
    speed, duration, wind = (float(run.values[name]) for name in ("speed", "duration", "wind"))
    try:
        record = read(str(run.values["track"]))
        run.bench.waveform.foresee(*excitation(record, speed, duration, wind))
    except (NoTrack, Misuse, NotAvailable) as error:
        return ConditionResult(False, str(error))
    if beyond := _reaches_the_stop(run, record):
        return ConditionResult(False, beyond)
    text = f"{record.name}, {record.times(speed)[-1]:.4g} s"
    text += f", SHA-256 {record.digest[:16]}" if record.digest else ""
    text += f"; not read: {', '.join(record.unread)}" if record.unread else ""
    return ConditionResult(True, text)


def _reaches_the_stop(run: Run, record: TrackRecord) -> str:
    """Return a text if the bolster can reach its bump stop on the softest springs within the limits; otherwise "".

    The result is also "" if limits in the specimen's file or dimensions of the rig are missing.
    """
    speed, duration, wind = (float(run.values[name]) for name in ("speed", "duration", "wind"))
    times, moves = excitation(record, speed, duration, wind)
    still = np.zeros_like(times)
    try:
        load, room = run.specimen.load(str(run.values["load"])), run.rig["stop_gap"]
        way = blown(load, run.rig, moves.get("lateral.force", still), 1.0)
        way += shaken(load, run.rig, times, moves.get("platform.lateral", still), 1.0)
    except (SpecimenError, NotAvailable):
        return ""
    if (most := float(np.abs(way).max())) <= room:
        return ""
    return (
        f"wind = {wind:g} m/s and {record.name} at {speed / KMH:.4g} km/h would move the bolster by up to "
        f"{most / mm:.1f} mm, and it has {room / mm:g} mm to its bump stop; set a smaller wind or speed"
    )


CAN_RUN: Final = Precondition("the track is a record that the platform can follow", _look_at_the_track)


@plan(
    setup=take_up,
    needs=(
        *steps.CARRYING,
        *READ,
        *FREE_SIDEWAYS,
        *(f"{axis}_setpoint" for axis in WAYS),
        *SEEING,
        *CELLS,
        *CELLS_ACROSS,
        "stop_gap",
        *lags(("lateral.displacement", *HEIGHTS, *SHEAR_CELLS, *VERTICAL_CELLS)),
    ),
    teardown=leave_connected,
    lasts=121 * s,
    requires=(*on_the_bench("load"), CAN_RUN),
    checks=(BESIDE, TRAVEL, STIFF["vertical"], LOST),
)
def track_record(
    run: Run,
    *,
    load: Literal["AW0", "AW3"] = "AW0",
    track: Annotated[
        str, File("a table of distance or time, vertical, lateral, cant or roll, with units", (DRAWN,))
    ] = DRAWN,
    speed: Annotated[float, Range(20 * KMH, 360 * KMH, "km/h")] = 100 * KMH,
    duration: Annotated[float, Range(20 * s, 600 * s, "s")] = 60 * s,
    wind: Annotated[float, Range(0.0, 6.5, "m/s")] = 0.0,
) -> None:
    """Track record: the springs on a track that a user measured, under a train of a given speed.

    The springs carry the load with shut valves at design height. The vertical actuators hold the bolster in its place,
    as the inertia of a car does. The lateral actuator applies the force of a steady `wind` on one bogie, or releases
    the bolster.

    The platform follows the record vertically, laterally and in roll, about its mean, from its beginning. A record over
    distance is run at `speed`, a record over time as it is. All axes use one time base; the host streams the motion,
    which rises and fades within 4 s. Instead of a file, ERRI-low is the low level of ERRI B 176 between waves of 3 and
    70 m. The run is refused before any motion if the platform cannot follow, or if the wind would move the bolster to
    its bump stop.

    A rig with amplitude control repeats the track with a corrected command, at most three times, until the motion of
    the platform is right within 1 %.

    The run passes if the platform follows the record, and if the bolster stays clear of its bump stop. The vertical
    stiffness of the springs over frequency is recorded. Its limits hold only for the motion for which they were stated.
    On ERRI-low at 95 to 105 km/h, the vertical stiffness and loss angle between 0.5 and 2 Hz are judged. The limits are
    those of `stochastic_crosswind`.
    """
    times, moves = excitation(read(track), speed, duration, wind)
    controlled_axes = [name for name in WAYS if name in moves and np.std(moves[name]) >= LEAST]
    with run.phase("track"):
        capture = controlled_track(run, times, moves, controlled_axes, BEFORE, partial(_once, run, times))
        at, values = capture.aligned(RATE)
    at = at - BEFORE
    if not all(np.isfinite(values[name]).all() for name in READ):
        raise NotMeasured("samples of the track are missing")
    for name in WAYS:
        if name in moves:
            _compare(run, name, at, values, times, moves[name])
    calm, shaken = at < 0.0, (at >= RISE) & (at < times[-1] - RISE)
    travel = run.measured(partial(_travel, calm, shaken), run.rig, values, rate=RATE)
    run.check(TRAVEL, travel, "mm", high=run.rig["stop_gap"])
    # Not sideways: the lateral actuator releases the bolster, so that the lateral force is too small to measure
    # stiffness.
    if track == DRAWN and round(abs(speed / TRAIN_SPEED - 1.0), 6) <= SPEED_WITHIN:
        check_stiffness(run, load, "vertical", values, partial(upright, shaken))
    else:
        run.say(
            f"vertical stiffness is not judged: its limits hold for {DRAWN} at {TRAIN_SPEED / KMH:g} km/h"
        )
        keep_stiffness(run, load, "vertical", upright(shaken, run.rig, values))


def _once(run: Run, times: Samples, moves: Mapping[str, Samples]) -> Capture:
    """Move the platform by set-points (SI, (n,)) at ``times`` (s, (n,)). Return the readings; they begin `BEFORE` s
    before the start.
    """
    with run.bench.capture(*READ) as capture:
        run.bench.wait(BEFORE)
        run.bench.waveform.run(times, moves)
        run.bench.wait(LATEST)
    return capture


def _compare(run: Run, name: str, at: Samples, values: Values, times: Samples, way: Samples) -> None:
    """Check how well the platform follows the commanded ``way`` (n,) at ``times`` (n,), and record both motions."""
    played = (at >= 0.0) & (at <= times[-1])
    rms = float(np.std(np.interp(at[played], times, way)))
    shown = name.partition(".")[2]
    if rms < LEAST:
        few = f"{rms / mm:.2g} {'mrad' if shown == 'roll' else 'mm'} rms"
        run.not_available([BESIDE.of(way=shown)], f"it moves by {few}, less than its transducer resolves")
        return

    # Straight lines are the motion without amplitude control: those between set-points.
    way_at = continuous(times, way) if run.bench.amplitude_control else partial(np.interp, xp=times, fp=way)

    def left(late: float, read: Samples) -> Samples:
        apart = (read - way_at(at - late))[played]
        return np.asarray(apart - apart.mean())

    delays = np.arange(0.0, LATEST, 0.1 / RATE)
    late = min(delays.tolist(), key=lambda one: float(left(one, values[name]).std()))

    def deviation_share(_: Rig, read: Values) -> float:
        return float(left(late, read[name]).std()) / rms

    note = f"{late / ms:.0f} ms late; asked for {rms / mm:.3g} {'mrad' if shown == 'roll' else 'mm'} rms"
    run.check(
        BESIDE.of(way=shown),
        run.measured(deviation_share, run.rig, values, rate=RATE),
        "%",
        high=BESIDE_MOST,
        note=note,
    )
    unit = Axis(shown, "mrad", mrad) if shown == "roll" else Axis(shown, "mm", mm)
    motion = values[name] - values[name][at < 0.0].mean()
    for label, xs, ys in (("record", times, way), ("platform", at - late, motion)):
        run.loop(label, Axis("time", "s"), unit, xs[::KEPT], ys[::KEPT], group=f"Track, {shown}")


def _travel(calm: npt.NDArray[np.bool_], shaken: npt.NDArray[np.bool_], rig: Rig, values: Values) -> float:
    """Return the largest travel (m) of the bolster from its position at rest, to either side. It is the 99.9th
    percentile, so that noise does not count.
    """
    way = stop_travel_of(values, rig) - values["platform.lateral"]
    return float(np.percentile(np.abs(way - way[calm].mean())[shaken], 99.9))
