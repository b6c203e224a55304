"""The ride of a computed car on the measured springs; the actuators reproduce the motion of the car."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from math import hypot, pi
from typing import Annotated, Final, Literal

import numpy as np

from astb_studies.paper.comfort import WINDOW, window_rms
from astb_studies.paper.hybrid.agreement import (
    CARRIED,
    CARRIED_U,
    DAMPED_MORE,
    LAGS_U,
    SCATTER,
    STIFFER_SIDEWAYS,
    STIFFER_UPWARD,
    WARM,
    WARM_U,
    Agreement,
    Followed,
    RideResult,
    followed,
    noise_of,
    of_the_loop,
    of_the_springs,
    scatter,
)
from astb_studies.paper.hybrid.car import Car, Ride, linear
from astb_studies.paper.hybrid.coupling import BEATS, COUPLED, By, Course, Delay, move_on, path_of
from astb_studies.paper.hybrid.floor import BLOCK, COMPARED, JUDGED, JUDGED_OF, MADE_OF, ridden
from astb_studies.paper.hybrid.in_tick import TickCourse, ride_in_tick, settings_of, shake_in_tick, waves_for
from astb_studies.paper.hybrid.loop import LEAST_GAIN, LEAST_PHASE, Margins, loci, margins
from astb_studies.paper.hybrid.shaking import shake_loose
from bench_protocol.units import FACTORS, Hz, ms, s
from bench_records.curves import Axis
from drivers.car import RIDES
from test_plans import steps
from test_plans.analysis import Samples
from test_plans.analysis.geometry import Rig
from test_plans.analysis.uncertainty import EVEN, Exact, Measured
from test_plans.check_names import CheckName
from test_plans.loads import Load
from test_plans.parameters import Range
from test_plans.plan import plan
from test_plans.preconditions import ConditionResult, Precondition, on_the_bench
from test_plans.run import Run
from test_plans.steps.carrying import HELD_SIDEWAYS
from test_plans.steps.fittings import CONNECTIONS, leave_connected
from test_plans.steps.poses import go_home, take_pose
from test_plans.steps.wind import RISE, admittance, fade, random_process, side_force, spectrum

CAR: Final = Car()
Ridden = Course | TickCourse
#: After filling, the warm gas in the shut springs continues to cool, and the car sinks: after a wait of 20 s it still
#: sank by 8 mm, and its springs became 7 % softer sideways.
COOL: Final = 120 * s
#: What swings when wind and track begin dies away; then a ride counts.
RUN_IN: Final = 20 * s
#: The wind's samples; the car's length lets nothing faster through.
WIND_STEP: Final = 0.01 * s
#: Where the springs' stiffness and damping are taken for the margins: the track's frequency.
AT: Final = 1.2 * Hz
#: Largest error of the compensated delay, either sign: at 1.2 Hz it adds a loss of 4 % of the stiffness.
LATE_MOST: Final = 5 * ms
COMPUTED: Final = "it was computed of the files of rig and specimen, and the delay that was measured"
#: Largest relative uncertainty at which the comparison with the simulation is useful.
TELLS: Final = 0.2
A_COMPARISON: Final = "it is a difference over its uncertainty"

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
    "springs behind the car, {way}",
    "How much later than the car the springs were where it had them: what the compensation leaves of the delay acts "
    "as damping that is not there.",
)
AGREES: Final = CheckName(
    "{what} against the simulation, E_n",
    "How the same car rides in the same wind on the model's springs: beyond ±1 the difference is more than loop and "
    "readings account for, and springs and model are not alike.",
)


def car_mass(load: Load, rig: Rig) -> float:
    """Return the mass on both springs (kg)."""
    return 2.0 * load.preload / rig["gravity"]


def springs_of_the_file(load: Load, rig: Rig, stiff: float, damped: float) -> tuple[Samples, Samples]:
    """Return the permitted stiffness (N/m, N·m/rad) and damping of the springs over `SpringPose`, as a diagonal each.

    ``stiff`` and ``damped`` are positions in the band of the limits: 0 is the lower end, 1 the upper. The values in
    roll follow from the vertical ones and the spacing of the springs.
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


def margins_of(load: Load, rig: Rig, delay: Delay | None = None, by: By = "host") -> Margins:
    """Return the margins of the ride's loop, for the stiffest and least damped springs that their file permits.

    ``delay`` is the measured delay of the bench; without it, the delay is computed from the dimensions of the rig.
    """
    stiffness, damping = map(np.diag, springs_of_the_file(load, rig, 1.0, 0.0))
    path = path_of(rig, delay, by)
    of_car = linear(CAR, car_mass(load, rig), rig["gravity"])
    f = path.frequencies
    return margins(f, loci(f, of_car, stiffness, damping, path.response(f, path.delay)))


def _look_at_the_loop(run: Run) -> ConditionResult:
    by: By = "rig" if run.values["by"] == "rig" else "host"
    if by == "rig" and (lacking := run.bench.lacks(*RIDES)):
        return ConditionResult(False, f"{lacking}: by the host it can")
    found = margins_of(run.specimen.load(str(run.values["load"])), run.rig, by=by)
    needed = f"{LEAST_PHASE * 180 / pi:g}° and {LEAST_GAIN:g} are needed"
    delay = path_of(run.rig, by=by).delay
    return ConditionResult(
        found.enough, f"{found.text()}, with {1e3 * delay:.0f} ms that are compensated; {needed}"
    )


STABLE: Final = Precondition("the loop of car, delay and springs is stable", _look_at_the_loop)


def take_up(run: Run, load: str) -> None:
    """Load the springs, hold them at design height, and shut their valves."""
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
    lasts=260 * s,
    requires=(*on_the_bench("load"), STABLE),
    checks=(PHASE, GAIN, FOLLOWS, *JUDGED_OF, AGREES),
)
def ride(
    run: Run,
    *,
    load: Literal["AW0", "AW3"] = "AW0",
    wind: Annotated[float, Range(5.0, 25.0, "m/s")] = 10.0,
    duration: Annotated[float, Range(20 * s, 1000 * s, "s")] = 60 * s,
    draw: Annotated[int, Range(0, 1_000_000)] = 1,
    by: Literal["host", "rig"] = "host",
) -> None:
    """Ride: a car at 100 km/h on these springs, in a gusty crosswind and on a track.

    This is a real-time hybrid simulation: the springs are on the bench, and the car is computed. The model of the car
    has its mass, roll, lateral damper, bump stop and anti-roll bar. It is computed 200 times a second from the forces
    of the load cells, and the actuators move the springs to the computed place. Buses and actuators have a delay of
    some 35 ms, by which the motion of the car is predicted. With `by` = rig, a rig that supports it computes the car
    in its own tick, a thousand times a second; this delay is a third as long. First the springs are moved with
    decreasing amplitude, which removes friction and measures the delay of this rig. The ride begins only if the loop
    of car, delay and springs has enough gain margin and phase margin.

    The `wind` is a mean speed; the gusts have von Kármán's spectrum with 15 % of turbulence. The track is a unilateral
    cosine of 5 mm at 1.2 Hz, lateral and vertical. The same number `draw` gives the same wind. Comfort indices by
    EN 12299, lateral (W_d), vertical (W_b) and of both, need a `duration` of five minutes; an index below 2 is good.

    Afterwards, the same car is simulated in the same wind on the springs of the `model` in the specimen's file: both
    results must agree within their uncertainty. A named parameter set describes the drawing, so the uncertainty
    includes the tolerances of the file's limits. A model file, as `astb identify` writes it, describes these springs.
    """
    ways = (run.specimen.load(load), run.rig, wind, duration, draw)
    car, whole = ride_in(*ways)
    home = go_home(run)
    run.bench.wait(COOL)
    steps.lock_the_air(run)
    in_tick = shake_in_tick(run) if by == "rig" else None
    by_host = shake_loose(run)
    delay = in_tick or by_host
    if not look_at_the_loop(run, load, delay):
        take_pose(run, home)
        return
    with run.phase("ride"):
        course: Ridden = (
            move_on(run, car, delay, whole) if by == "host" else _by_the_rig(run, car, delay, whole)
        )
    with run.phase("back"):
        take_pose(run, home)
    times = RUN_IN, whole - RISE
    followed_as = follow(run, course, times)
    again = (lambda: ride_in(*ways), ridden, times, BEATS[by].hold)
    springs = springs_of_the_file(run.specimen.load(load), run.rig, 0.5, 0.0)
    parts = of_the_loop(springs, followed_as, noise_of(run.instruments, run.rig), *again)
    found = judge(run, course, times, parts)
    # A set of parameters describes the drawing, not these springs.
    if run.specimen.model and not run.specimen.model.endswith(".toml"):
        stated, others = _tolerated(run.specimen.load(load), run.rig)
        tolerated = of_the_springs(stated, others, *again)
        parts = {check: {**one, **tolerated[check]} for check, one in parts.items()}
    hold_against_the_simulation(run, course, times, parts, found)


Linear = tuple[Samples, Samples]


def _tolerated(load: Load, rig: Rig) -> tuple[Linear, dict[str, Linear]]:
    """Return the nominal springs of the file and, by cause, springs that deviate by one standard deviation of its
    limits.
    """
    part = 0.5 + 0.5 * EVEN
    stiffness, damping = springs_of_the_file(load, rig, 0.5, 0.5)
    stiffer, damped = springs_of_the_file(load, rig, part, part)
    return (stiffness, damping), {
        STIFFER_SIDEWAYS: (np.array([stiffer[0], *stiffness[1:]]), damping),
        STIFFER_UPWARD: (np.array([stiffness[0], *stiffer[1:]]), damping),
        DAMPED_MORE: (stiffness, damped),
    }


def _by_the_rig(run: Run, ride: Ride, delay: Delay, whole: float) -> TickCourse:
    values = run.values
    wind = wind_force(float(values["wind"]), whole, int(values["draw"]))
    settings = settings_of(ride.car, ride.mass, delay, waves_for(ride.car, whole))
    return ride_in_tick(run, settings, delay, wind)


def look_at_the_loop(run: Run, name: str, delay: Delay) -> bool:
    """Check the stability margins of the loop with the measured delay; return whether a ride may begin."""
    load = run.specimen.load(name)
    found = margins_of(load, run.rig, delay)
    text = f"{1e3 * delay.pistons:.0f} ms late, with readings every {1e3 * delay.hold:.0f} ms"
    if not found.enough:
        reason = (
            f"{run.rig.rig} is {text}: {found.text()}; a car on it would swing by itself, and does not ride"
        )
        if longest := longest_delay(load, run.rig, delay):
            reason += f". It would with {1e3 * longest:.0f} ms"
        run.not_available((PHASE, GAIN, *JUDGED_OF), reason)
        return False
    phase, gain = (Exact(one, unknown=COMPUTED) for one in (found.phase, found.gain))
    run.check(PHASE, phase, "deg", low=LEAST_PHASE, note=text)
    run.check(GAIN, gain, "1", low=LEAST_GAIN, note=text)
    return True


def longest_delay(load: Load, rig: Rig, delay: Delay) -> float:
    """Return the longest delay (s, in steps of 5 ms) with a stable loop, for this interval of readings; 0 for none."""
    shorter = np.arange(delay.pistons - 5 * ms, _least(rig, delay), -5 * ms).tolist()
    return next((one for one in shorter if margins_of(load, rig, replace(delay, pistons=one)).enough), 0.0)


def _least(rig: Rig, delay: Delay) -> float:
    path = path_of(rig, delay)
    return path.delay - path.latency


def follow(run: Run, course: Ridden, times: tuple[float, float]) -> dict[str, Followed]:
    """Check the delay of the springs between two ``times`` (s) of the ride; return gain and delay by direction."""
    ways = followed(*course.places(run.rig, *times), course.held(*times), run.rig, course.period)
    for way, one in ways.items():
        known = Measured(one.late, LAGS_U, parts={"lags of the readings": LAGS_U})
        note = f"by {1e2 * one.part:.1f} % of what the car has them"
        run.check(FOLLOWS.of(way=way), known, "ms", low=-LATE_MOST, high=LATE_MOST, note=note)
    return ways


def judge(
    run: Run, course: Ridden, times: tuple[float, float], parts: Mapping[str, Mapping[str, float]]
) -> dict[str, float]:
    """Check the motion of the floor between two ``times`` (s), and return it; ``parts`` are of its uncertainty."""
    found = ridden(course, *times)
    if left_out := [str(name) for name, *_ in JUDGED if name not in found]:
        rides = f"this ride has {times[1] - times[0]:g} s"
        run.say(f"not part of a ride this short: {', '.join(left_out)} (EN 12299 needs {BLOCK:g} s, {rides})")
    for name, unit, low, high in JUDGED:
        if name not in found:
            continue
        u = hypot(*parts[name].values())
        run.check(name, Measured(found[name], u, parts=parts[name]), unit, low=low, high=high)
    return found


def hold_against_the_simulation(
    run: Run,
    course: Ridden,
    times: tuple[float, float],
    loop: Mapping[str, Mapping[str, float]],
    found: Mapping[str, float],
) -> None:
    """Simulate the same car on the model's springs, and check whether both agree within their uncertainty.

    ``loop`` has the parts of the uncertainty of the values ``found`` on the bench, and of the model's springs.
    """
    from astb_studies.paper.hybrid.simulated_ride import (  # compiled: not for a list of plans
        NoModel,
        SimulatedRide,
        SimulatedSprings,
        simulate_ride,
    )

    names = [AGREES.of(what=what) for what, check in COMPARED.items() if check in found]
    values, specimen = run.values, run.specimen
    if not specimen.model:
        run.not_available(
            names,
            f'specimen {specimen.file} names no model of its springs; model = "identified.toml", as `astb identify` '
            "writes it, would",
        )
        return
    load = specimen.load(str(values["load"]))
    whole = times[1] + RISE
    acted = _acted(run, course, whole)

    def on(carried: float = 1.0, warmer: float = 0.0) -> SimulatedRide:
        springs = SimulatedSprings(specimen.model, load.name, carried * course.carried, run.rig, warmer)
        return simulate_ride(CAR, car_mass(load, run.rig), springs, *acted)

    try:
        alone = on()
        otherwise = {
            CARRIED: ridden(on(carried=1.0 - CARRIED_U), *times),
            WARM: ridden(on(warmer=WARM_U), *times),
        }
    except NoModel as reason:
        run.not_available(names, f"the car cannot ride on the model {specimen.model}: {reason}")
        return
    simulated = ridden(alone, *times)
    scattered = scatter((course, alone), ridden, times)
    for index, of in MADE_OF.items():
        scattered[index] = scattered[of] / found[of] * found.get(index, 0.0)
    for what, check in COMPARED.items():
        if check not in found:
            continue
        parts = {
            **loop[check],
            **{cause: abs(one[check] - simulated[check]) for cause, one in otherwise.items()},
            SCATTER: scattered[check],
        }
        _compare(run, what, check, Agreement(found[check], simulated[check], parts))
    _draw(run, {"bench": course, "simulation": alone}, times)


def _acted(run: Run, course: Ridden, whole: float) -> tuple[Samples, float, Samples]:
    """Return the wind that blew for ``whole`` s (N), its samples' distance (s), and the track's share by sample."""
    if isinstance(course, TickCourse):  # as the rig says that it blew
        wind = course.of("wind", 0.0, whole)
        return wind, course.step, np.ones_like(wind)
    times, wind = wind_force(float(run.values["wind"]), whole, int(run.values["draw"]))
    return wind, WIND_STEP, fade(times)


def _draw(run: Run, rides: Mapping[str, RideResult], times: tuple[float, float]) -> None:
    for name, rode in rides.items():
        at = np.arange(*times, WINDOW) + 0.5 * WINDOW
        for column, way in (("acceleration", "lateral"), ("rising", "vertical")):
            shaken = window_rms(rode.of(column, *times), 1.0 / rode.step)
            run.curve(
                name,
                Axis("time", "s"),
                Axis("acceleration, rms of 5 s", "m/s2"),
                at[: len(shaken)],
                shaken,
                group=f"Floor of the car, {way}",
            )


def _compare(run: Run, what: str, check: str, both: Agreement) -> None:
    unit = next(unit for name, unit, *_ in JUDGED if name == check)
    factor, shown = FACTORS[unit], "" if unit == "1" else f" {unit}"
    text = (
        f"bench {both.bench / factor:.4g}, simulation {both.alone / factor:.4g}, "
        f"U of the difference {both.expanded / factor:.2g}{shown}"
    )
    if both.expanded > TELLS * both.alone:
        run.not_available([AGREES.of(what=what)], f"{text}: the uncertainty is larger than the effect")
        return
    run.check(
        AGREES.of(what=what), Exact(both.normalised, unknown=A_COMPARISON), "1", low=-1.0, high=1.0, note=text
    )
