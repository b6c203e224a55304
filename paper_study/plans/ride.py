"""A car that rides on the springs: they are measured, the car is computed, and the actuators do what it would do."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from math import hypot, pi, sqrt
from typing import Annotated, Final, Literal

import numpy as np

from bench_protocol.units import Hz, ms, s
from paper_study.comfort import WINDOW, WINDOWS, block_percentiles, mean_comfort, weighted, window_rms
from paper_study.hybrid.car import STEP, Car, Ride, Springs, linear
from paper_study.hybrid.coupling import COUPLED, HOST_STEP, Course, path_of, ride_on
from paper_study.hybrid.loop import FREQUENCIES, LEAST_GAIN, LEAST_PHASE, Margins, loci, margins
from test_plans import steps
from test_plans.analysis import Samples
from test_plans.analysis.geometry import Rig
from test_plans.analysis.readings import HEIGHTS, VERTICAL_CELLS
from test_plans.analysis.uncertainty import Exact, Measured
from test_plans.check_names import CheckName
from test_plans.description import lag_of
from test_plans.loads import Load
from test_plans.parameters import Range
from test_plans.plan import plan
from test_plans.preconditions import ConditionResult, Precondition, on_the_bench
from test_plans.run import Run
from test_plans.steps.carrying import HELD_SIDEWAYS
from test_plans.steps.fittings import CONNECTIONS, leave_connected
from test_plans.steps.poses import COOL, Home, go_home, take_pose
from test_plans.steps.wind import RISE, admittance, fade, random_process, side_force, spectrum

CAR: Final = Car()
#: What swings when wind and track begin dies away; then a ride counts.
RUN_IN: Final = 20 * s
#: A block of EN 12299: five minutes.
BLOCK: Final = WINDOW * WINDOWS
#: The wind's samples; the car's length lets nothing faster through.
WIND_STEP: Final = 0.01 * s
#: Where the springs' stiffness and damping are taken for the margins: the track's frequency.
AT: Final = 1.2 * Hz
#: The largest lateral index that is comfortable, and what shakes and leans more than any car should.
COMFORTABLE: Final = 2.0
SHAKE_MOST: Final = 0.5
LEAN_MOST: Final = 0.035
#: So much of the delay may be left uncompensated, either way: of the stiffness it makes 4 % of loss at 1.2 Hz.
LATE_MOST: Final = 5 * ms
LATE_U: Final = LATE_MOST / sqrt(3.0)
#: How well lags are known, and the sum of six load cells (standard uncertainties).
LAGS_U: Final = 0.5 * ms
CELLS_U: Final = 0.003
CELLS_TELL, COMES_LATE = "gain of the load cells", "delay that is left"
FROM_THE_FILE: Final = "it was computed from the files of rig and specimen"
#: All of the time is no more than all of it.
ROUNDED: Final = 1e-6

PHASE: Final = CheckName(
    "phase margin of the loop",
    "How far car, delay and springs together are from swinging by themselves, where the gain is 1: without it the ride "
    "would be the loop's, not the car's.",
)
GAIN: Final = CheckName(
    "gain margin of the loop",
    "How much stiffer the springs could be before the loop swings by itself at a higher frequency.",
)
FOLLOWS: Final = CheckName(
    "springs behind the car",
    "How much later than the car the springs were where it had them: what the compensation leaves of the delay acts "
    "as damping that is not there.",
)
SHAKES: Final = CheckName(
    "lateral acceleration of the floor, rms",
    "How hard wind and track shake the floor on these springs, about the mean.",
)
COMFORT: Final = CheckName(
    "comfort index N, lateral",
    "Mean comfort by EN 12299: six times the 95th percentile of the weighted 5-s values of five minutes.",
)
TOUCHES: Final = CheckName(
    "time on the bump stop",
    "For how much of the time the car leans on its bump stop, which is harder than the springs.",
)
LEANS: Final = CheckName(
    "mean lean", "How far the mean wind leans the car over on springs and anti-roll bar."
)


#: What is judged of the ride itself: check, unit, limits.
JUDGED: Final = (
    (SHAKES, "m/s2", None, SHAKE_MOST),
    (COMFORT, "1", None, COMFORTABLE),
    (TOUCHES, "%", None, 1.0 + ROUNDED),
    (LEANS, "mrad", None, LEAN_MOST),
)


def car_mass(load: Load, rig: Rig) -> float:
    """Return what rests on both springs (kg)."""
    return 2.0 * load.preload / rig["gravity"]


def springs_of_the_file(load: Load, rig: Rig, stiff: float, damped: float) -> tuple[Samples, Samples]:
    """Return what is good for the springs' stiffness (N/m, N·m/rad) and damping over `Place`, as a diagonal each.

    ``stiff`` and ``damped`` say where in the band: 0 its lower end, 1 its upper. In roll both springs are their
    vertical stiffness at their distance.
    """
    found = []
    for what, part in (("stiffness", stiff), ("damping", damped)):
        lateral, vertical = (
            low + part * (high - low)
            for low, high in (load.limits.curve_at(f"{way}_{what}", AT) for way in ("lateral", "vertical"))
        )
        both = 2.0 * vertical
        found.append(np.array([lateral, both, rig["spring_half_spacing"] ** 2 * both]))
    return found[0], found[1]


def margins_of(load: Load, rig: Rig) -> Margins:
    """Return the margins of the ride's loop, with springs as stiff and as little damped as their file allows."""
    stiffness, damping = map(np.diag, springs_of_the_file(load, rig, 1.0, 0.0))
    path = path_of(rig)
    of_car = linear(CAR, car_mass(load, rig), rig["gravity"])
    H = path.response(FREQUENCIES, path.delay)
    return margins(FREQUENCIES, loci(FREQUENCIES, of_car, stiffness, damping, H))


def _look_at_the_loop(run: Run) -> ConditionResult:
    found = margins_of(run.specimen.load(str(run.values["load"])), run.rig)
    needed = f"{LEAST_PHASE * 180 / pi:g}° and {LEAST_GAIN:g} are needed"
    delay = path_of(run.rig).delay
    return ConditionResult(
        found.enough, f"{found.told()}, with {1e3 * delay:.0f} ms that are compensated; {needed}"
    )


STABLE: Final = Precondition("the loop of car, delay and springs is stable", _look_at_the_loop)


def take_up(run: Run, load: str) -> None:
    """Let the springs carry the load, hold them at design height, and shut them in."""
    steps.carry_load(run, load)


def wind_force(mean: float, duration: float, draw: int) -> tuple[Samples, Samples]:
    """Return times (s) and the force (N) on this half of the car of a wind with the ``mean`` (m/s), from 0 and to 0."""
    times: Samples = WIND_STEP * np.arange(round(duration / WIND_STEP) + 1, dtype=np.float64)
    f: Samples = np.asarray(np.fft.rfftfreq(times.size, WIND_STEP), np.float64)
    gusts = spectrum(f, mean, CAR.train_speed) * admittance(f, mean, CAR.train_speed)
    gusts[0] = 0.0
    wind = mean + random_process(times, gusts, np.random.default_rng(draw))
    return times, fade(times) * side_force(wind, CAR.train_speed)


def ride_in(
    load: Load, rig: Rig, mean: float, duration: float, draw: int, car: Car = CAR
) -> tuple[Ride, float]:
    """Return a car at rest that will ride through wind and track, and for how long in all (s)."""
    whole = duration + RUN_IN + RISE
    times, force = wind_force(mean, whole, draw)
    share = fade(times)

    def between(values: Samples) -> Callable[[float], float]:
        last = len(values) - 1

        def at(t: float) -> float:
            place = min(max(t / WIND_STEP, 0.0), last - 1e-9)
            n = int(place)
            return float(values[n] + (place - n) * (values[n + 1] - values[n]))

        return at

    return Ride(car, car_mass(load, rig), rig["gravity"], between(force), between(share)), whole


@plan(
    setup=take_up,
    needs=(*steps.CARRYING, *COUPLED, *HELD_SIDEWAYS, *CONNECTIONS),
    teardown=leave_connected,
    lasts=160 * s,
    requires=(*on_the_bench("load"), STABLE),
    checks=(PHASE, GAIN, FOLLOWS, SHAKES, COMFORT, TOUCHES, LEANS),
)
def ride(
    run: Run,
    *,
    load: Literal["AW0", "AW3"] = "AW0",
    wind: Annotated[float, Range(5.0, 25.0, "m/s")] = 10.0,
    duration: Annotated[float, Range(20 * s, 1000 * s, "s")] = 60 * s,
    draw: Annotated[int, Range(0, 1_000_000)] = 1,
) -> None:
    """Ride: a car at 100 km/h on these springs, in a gusty crosswind and on a track.

    The springs stand on the bench and are measured. The car, with its mass, roll, lateral damper, bump stop and
    anti-roll bar, is computed 200 times a second from what the load cells read, and the actuators put the springs where
    it would have them: real-time hybrid simulation. Wires and actuators take some 35 ms, by which the car's motion is
    told ahead. The plan begins only if car, delay and springs together are stable by their gain and phase.

    Wind of this mean has von Kármán's spectrum with 15 % of turbulence; the track is a unilateral cosine of 5 mm at
    1.2 Hz, lateral and vertical. The same number `draw` makes the same wind. The comfort index by EN 12299 needs a
    `duration` of five minutes; good is one below 2.
    """
    limits = margins_of(run.specimen.load(load), run.rig)
    run.check(PHASE, Exact(limits.phase, unknown=FROM_THE_FILE), "deg", low=LEAST_PHASE)
    run.check(GAIN, Exact(limits.gain, unknown=FROM_THE_FILE), "1", low=LEAST_GAIN)
    ways = (run.specimen.load(load), run.rig, wind, duration, draw)
    car, whole = ride_in(*ways)
    home = go_home(run)
    run.bench.wait(COOL)
    steps.lock_the_air(run)
    with run.phase("ride"):
        course = ride_on(run, car, home, whole)
    with run.phase("back"):
        take_pose(run, Home(home.left, home.right))
    times = RUN_IN, whole - RISE
    judge(run, course, times, sensitivities(*ways, *times))


def ridden(course: Course, since: float, until: float) -> dict[str, float]:
    """Return what the floor did between two times (s) of a ride, by check (SI); an index only of a whole block."""
    a, stop, roll = (course.of(name, since, until) for name in ("acceleration", "bump_stop", "roll"))
    found: dict[str, float] = {
        SHAKES: float(a.std()),
        TOUCHES: float(np.mean(stop != 0.0)),
        LEANS: abs(float(roll.mean())),
    }
    if until - since >= BLOCK:
        shaken = weighted(course.of("acceleration", 0.0, until), 1.0 / STEP)[round(since / STEP) :]
        found[COMFORT] = float(mean_comfort(block_percentiles(window_rms(shaken, 1.0 / STEP))).mean())
    return found


def sensitivities(
    load: Load, rig: Rig, mean: float, duration: float, draw: int, since: float, until: float
) -> dict[str, dict[str, float]]:
    """Return the parts of the standard uncertainty of what is ridden, by check and cause.

    Each is what the same car does otherwise in the same wind, on linear springs as the specimen's file has them, if the
    load cells tell so much more, or the springs come so much later.
    """
    K, C = springs_of_the_file(load, rig, 0.5, 0.5)

    def on_springs(gain: float, late: float) -> dict[str, float]:
        ride, whole = ride_in(load, rig, mean, duration, draw)
        course, before = Course(), ride.place_at(0.0)
        for _ in range(round(whole / STEP)):
            now = ride.place_at(0.0)
            force = [
                -gain * (k * x + (c - k * late) * (x - y) / STEP)
                for k, c, x, y in zip(K.tolist(), C.tolist(), now, before, strict=True)
            ]
            ride.step(Springs(*force))
            course.keep(ride)
            before = now
        return ridden(course, since, until)

    as_it_is = on_springs(1.0, 0.0)
    changed = {CELLS_TELL: on_springs(1.0 + CELLS_U, 0.0), COMES_LATE: on_springs(1.0, LATE_U)}
    return {
        name: {cause: abs(one[name] - value) for cause, one in changed.items()}
        for name, value in as_it_is.items()
    }


def judge(
    run: Run, course: Course, times: tuple[float, float], parts: Mapping[str, Mapping[str, float]]
) -> None:
    """Check what the floor did between two ``times`` (s) of the ride; ``parts`` are those of its uncertainty."""
    # What the cells read, and the car then keeps for a step, is as late as the lasers but for the difference of lags.
    late = lateness(*(course.of(name, *times) for name in ("bounce", "bounced"))) - lag_of(run.rig, *HEIGHTS)
    late += lag_of(run.rig, *VERTICAL_CELLS) + 0.5 * HOST_STEP
    known = Measured(late, LAGS_U, parts={"lags of lasers and cells": LAGS_U})
    run.check(FOLLOWS, known, "ms", low=-LATE_MOST, high=LATE_MOST)
    found = ridden(course, *times)
    for name, unit, low, high in JUDGED:
        if name not in found:
            run.lack([name], f"a ride of {times[1] - times[0]:g} s has no block of {BLOCK:g} s (EN 12299)")
            continue
        u = hypot(*parts[name].values())
        run.check(name, Measured(found[name], u, parts=parts[name]), unit, low=low, high=high)


def lateness(asked: Samples, moved: Samples) -> float:
    """Return by how much (s) a motion comes later than what was asked for, both each of the host's steps."""
    asked, moved = asked - asked.mean(), moved - moved.mean()
    rate = np.gradient(asked, HOST_STEP)
    return float(-np.dot(moved - asked, rate) / np.dot(rate, rate))
