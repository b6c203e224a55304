"""Crosswind and track at once, and roll: the paper's own experiment, a plan for each car."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import partial
from math import ceil, floor, inf, tau
from typing import Annotated, Any, Final, Literal

import numpy as np
import numpy.typing as npt

from bench_protocol.units import FACTORS, Hz, kN, mm, mrad, ms, s
from bench_protocol.words import SIDES
from bench_records.curves import Axis
from drivers.generator import Wave
from test_plans import steps
from test_plans.analysis import HEIGHTS, PRESSURES, SHEAR_CELLS, NotMeasured, Samples, Stiffness, harmonic
from test_plans.analysis.cells import CELLS_ACROSS, guiding, sideways_force
from test_plans.analysis.geometry import (
    ACTUATORS,
    POSE_SIGNALS,
    SEEING,
    WEIGHT,
    Rig,
    actuator_moment,
    bolster_weight,
    roll_of,
    shear_of,
    stop_travel_of,
)
from test_plans.analysis.uncertainty import EVEN, Measured
from test_plans.check_names import CheckName
from test_plans.description import lags
from test_plans.loads import AW0, AW3, Band, Load, SpecimenError
from test_plans.parameters import Range
from test_plans.plan import plan_under
from test_plans.preconditions import ConditionResult, Precondition, on_the_bench
from test_plans.run import Run
from test_plans.steps.carrying import FREE_SIDEWAYS, PRELOAD_WITHIN, part_of
from test_plans.steps.fittings import leave_connected
from test_plans.steps.of_the_bench import bench_mismatch
from test_plans.steps.shaking import SAMPLE_RATE
from test_plans.steps.stop_travel import ROLL_STIFFNESS, blown, leaned, shaken
from test_plans.steps.tables import AMPLITUDE, DAMPING, STORAGE, keep
from test_plans.steps.track_and_roll import ROLL_AVERAGE, ROLL_RATE, ROLL_WAIT
from test_plans.steps.waves import pressure_of
from test_plans.steps.wind import (
    GUST_FACTOR,
    RISE,
    admittance,
    fade,
    gust,
    on_the_bolster,
    random_process,
    side_force,
    spectrum,
)

Values = Mapping[str, Samples]
Wind = Literal["steady", "gust", "stochastic"]

TRAIN_SPEED: Final = 100 * FACTORS["km/h"]
TRACK: Final = ("platform.vertical", "platform.lateral")
PUSHED: Final = tuple(f"vertical_{side}.force" for side in SIDES)
READ: Final = (*POSE_SIGNALS, *PUSHED, *TRACK, *PRESSURES)
STEP: Final = 0.02 * s
#: Range of the winds, and step of the search for the strongest wind that the bench can hold.
WINDS: Final = Range(3.0, 25.0, "m/s")
WIND_STEP: Final = 0.1
#: The unequal preload is raised in steps until the roll is within this fraction of the requested roll.
ROLLED_WITHIN: Final = 0.03
ROLL_STEPS: Final = 6
#: The host cannot stream faster motions.
FASTEST: Final = 5 * Hz
BEFORE: Final = 2 * s
#: Shortest duration of the track, and duration of its transient.
TRACK_LASTS: Final = 10 * s
LEAD: Final = 1.5 * s
#: Number of pieces of the record that give the scatter of a first harmonic in unsteady wind.
PIECES: Final = 4
SCATTER: Final = "wind of other frequencies"
#: The limits hold for springs that the track shears. An unsteady wind also shears them, reduces their friction, and
#: makes them softer. They are judged only if the shear by the wind is at most this fraction of the shear by the track.
WINDY_MOST: Final = 0.5
#: The latency of the platform's transducer is not specified. It is assumed to be that of the lateral actuator,
#: within ``LATE_BY``.
LATE: Final = "lag of the platform's transducer"
LATE_BY: Final = 0.5 * ms
#: The motion of the track overcomes friction, so the roll by unequal preload grows by this fraction. The fraction and
#: its uncertainty are given for a bolster that leans into the wind, and for one that leans with it.
GIVEN_BACK: Final = {True: (0.11, 0.04), False: (0.07, 0.07)}
#: Beyond this roll the fraction is unknown, because the springs of the full car creep.
GIVEN_BACK_TO: Final = 20 * mrad
RELEASED: Final = "roll that friction gives back"
#: The roll torque is judged if its limits are so many times wider than its expanded uncertainty. The error by friction
#: is even, at most 1.05 U: a value from the middle of the limits stays within them.
WIDTH_PER_U: Final = 2.5
ROLL_BY_PRESSURE: Final = "crosswind_and_track.roll_stiffness_by_pressure"
#: Interval of the recorded samples of a loop.
KEPT: Final = 10

TRAVEL: Final = CheckName(
    "largest travel of the bolster",
    "How far wind and track together move the car sideways: beyond the limit it leans on its bump stop.",
)
STIFF: Final = CheckName(
    "lateral stiffness K'",
    "Lateral stiffness of the pair while wind, track and roll act at once, as they do under a car.",
)
DAMPED: Final = CheckName(
    "lateral damping c",
    "Lateral damping under wind, track and roll: with too little damping, the car continues to swing after a gust.",
)
ROLLED: Final = CheckName(
    "roll torque over roll",
    "The roll torque of the springs over the roll that the wind causes while the track moves them: it keeps the car "
    "upright.",
)


def excitation(
    rig: Rig, wind: float, kind: Wind, amplitude: float, frequency: float, draw: int
) -> tuple[Samples, dict[str, Samples], tuple[float, float]]:
    """Return times (s), the part of each set-point (SI) due to wind and track, and start and end (s) of the track.

    The wind rises within 4 s, has its full strength, and falls again. At full strength the platform follows equation
    (24) of the paper, z = a (1 − cos ωt)/2, upward and sideways.
    """
    cycles = ceil(TRACK_LASTS * frequency)
    track = cycles / frequency
    count = ceil((track + 2 * RISE) / STEP)
    times = np.linspace(0.0, count * STEP, count + 1)
    moves = on_the_bolster(fade(times) * side_force(_wind(times, wind, kind, draw), TRAIN_SPEED), rig)
    phase = np.clip((times - RISE) * frequency, 0.0, cycles)
    cosine = 0.5 * amplitude * (1.0 - np.cos(2 * np.pi * phase))
    cosine[-1] = 0.0
    return times, {**moves, **dict.fromkeys(TRACK, cosine)}, (RISE, RISE + track)


def _wind(times: Samples, wind: float, kind: Wind, draw: int) -> Samples:
    """Return the wind (m/s) at ``times`` (s), with the mean ``wind``."""
    if kind == "gust":
        return gust(GUST_FACTOR * wind, TRAIN_SPEED, times, 0.5 * float(times[-1]))
    if kind == "stochastic":
        f = np.fft.rfftfreq(times.size, times[1])
        density = spectrum(f, wind, TRAIN_SPEED) * admittance(f, wind, TRAIN_SPEED) * (f <= FASTEST)
        return wind + random_process(times, density, np.random.default_rng(draw))
    return np.full_like(times, wind)


def programme(rig: Rig, wind: float, amplitude: float, frequency: float) -> tuple[Wave, ...]:
    """Return the steady wind and the track of `excitation` as waves of the rig's function generator. All waves start
    together.

    A generator requires whole cycles, so rise, plateau and fall of the wind consist of these. The rise takes at most 4
    s.
    """
    cycles = ceil(TRACK_LASTS * frequency)
    track = cycles / frequency
    rising = ceil(track / RISE)
    moves = on_the_bolster(side_force(wind, TRAIN_SPEED), rig)
    plateau = partial(Wave, form="plateau", frequency=rising / track, cycles=rising + 2)
    cosine = partial(Wave, form="unilateral_cosine", frequency=frequency, cycles=cycles, delay=track / rising)
    return (
        plateau("lateral", force_amplitude=float(moves["lateral.force"])),
        plateau("roll", force_amplitude=float(moves[PUSHED[0]])),
        cosine("platform_vertical", amplitude=amplitude),
        cosine("platform_lateral", amplitude=amplitude),
    )


def _look_at_the_wind(run: Run) -> ConditionResult:
    by, kind = run.values["by"], run.values["kind"]
    if by == "rig" and kind != "steady":
        return ConditionResult(False, f"the generator of the rig cannot play a {kind} wind; use by=host")
    return ConditionResult(True, f"a {kind} wind by the {by}")


CAN_BLOW: Final = Precondition("the rig can make the wind and the track", _look_at_the_wind)


def _bench_holds(name: str) -> Precondition:
    """Return a precondition: under the requested wind, track and roll, the bolster must not reach its bump stop."""

    def look(run: Run) -> ConditionResult:
        load, given = run.specimen.load(name), dict[str, Any](run.values)
        try:
            clear = load.limits.band("crosswind_and_track.travel", "mm").high or inf
            room = min(clear, run.rig["stop_gap"])
            way = foreseen_travel(run.rig, load, given, given["wind"])
            if way <= room:
                return ConditionResult(True, f"at most {way / mm:.1f} of {room / mm:g} mm")
            held = _strongest_wind(partial(foreseen_travel, run.rig, load, given), room)
        except SpecimenError as error:
            return ConditionResult(None, str(error))
        right = (
            f"with --set wind={held:.1f}m/s the bolster stays clear of it"
            if held
            else f"no wind from {WINDS.low:g} m/s on can be held; set a smaller amplitude, frequency or roll"
        )
        text = (
            f"wind = {given['wind']:g} m/s ({given['kind']}), amplitude = {given['amplitude'] / mm:g} mm, frequency = "
            f"{given['frequency']:g} Hz and roll = {given['roll'] / mrad:g} mrad would move the bolster by up to "
            f"{way / mm:.1f} mm, and it has {room / mm:g} mm to its bump stop; {right}"
        )
        return ConditionResult(False, text)

    return Precondition("travel of the bolster to its bump stop", look, strict=False)


def _strongest_wind(travel: Callable[[float], float], room: float) -> float | None:
    """Return the strongest wind whose ``travel`` (m) is at most ``room``; None if there is none.

    The search has steps of 1 m/s, then of ``WIND_STEP`` around the strongest wind found or, without one, around the
    least travel.
    """
    coarse = np.arange(WINDS.high, WINDS.low - 0.5, -1.0)
    ways = np.array([travel(wind) for wind in coarse])
    near = coarse[np.argmax(ways <= room)] if (ways <= room).any() else coarse[np.argmin(ways)]
    fine = np.arange(min(near + 1.0, WINDS.high), max(near - 1.0, WINDS.low) - WIND_STEP / 2, -WIND_STEP)
    return next((float(wind) for wind in fine if travel(wind) <= room), None)


def foreseen_travel(rig: Rig, load: Load, values: Mapping[str, Any], wind: float) -> float:
    """Return the largest travel (m) of the bolster toward its bump stop, for the softest springs within the limits.

    ``values`` are the values of the plan's parameters.
    """
    amplitude, frequency, pressure, roll = (
        values[name] for name in ("amplitude", "frequency", "pressure", "roll")
    )
    times, moves, _ = excitation(rig, wind, values["kind"], amplitude, frequency, values["draw"])
    way = blown(load, rig, moves["lateral.force"], pressure)
    way += shaken(load, rig, times, moves["platform.lateral"], pressure)
    return max(float(np.abs(offset + way).max()) for offset in leaned(load, rig, roll, pressure))


def take_up(load: str) -> Callable[..., None]:
    """Return the set-up. It loads the springs at the requested pressure, shuts and connects them, releases the bolster,
    and rolls it if requested.
    """

    def set_up(run: Run, pressure: float, roll: float) -> None:
        around = run.specimen.load(load)
        carried = around if pressure == 1.0 else part_of(run, load, pressure)
        steps.carry(carried)(run)
        steps.lock_the_air(run)
        run.bench.air.connect_dpv()
        steps.free_the_bolster(run)
        if roll:
            _roll(run, around, carried.actuator_force(run.rig), roll)

    return set_up


def _roll(run: Run, load: Load, force: float, roll: float) -> None:
    """Move the vertical actuators to unequal preloads until the bolster rolls by ``roll`` (rad).

    Springs soften with roll. So the first step applies only half of the moment from the specimen's limits. Each further
    step multiplies it by the requested roll over the reached one.
    """
    left, right = (run.rig[one] for one in ACTUATORS)
    more = -0.5 * roll * middle(load.limits.band("roll_stiffness")) / (left - right)
    with run.phase("roll by unequal preload"):
        for _ in range(ROLL_STEPS):
            run.bench.vertical.preload(force + more, force - more, rate=ROLL_RATE, within=PRELOAD_WITHIN)
            run.bench.wait(ROLL_WAIT)
            reached = float(roll_of(run.bench.averages(*HEIGHTS, over=ROLL_AVERAGE), run.rig))
            if abs(reached / roll - 1.0) <= ROLLED_WITHIN:
                break
            more *= roll / reached


def _crosswind_and_track(
    run: Run,
    load: str,
    *,
    wind: Annotated[float, WINDS] = 5.0,
    kind: Literal["steady", "gust", "stochastic"] = "steady",
    amplitude: Annotated[float, Range(5 * mm, 25 * mm, "mm")] = 20 * mm,
    frequency: Annotated[float, Range(0.5 * Hz, 2.0 * Hz, "Hz")] = 1.2 * Hz,
    pressure: Annotated[float, Range(0.85, 1.1)] = 1.0,
    roll: Annotated[float, Range(-50 * mrad, 50 * mrad, "mrad")] = 5 * mrad,
    draw: Annotated[int, Range(0, 1_000_000)] = 1,
    by: Literal["host", "rig"] = "host",
) -> None:
    """Crosswind and track at once, {car} car: stiffness, damping and roll torque of the springs.

    The springs carry {preload} each, or the preload that belongs to `pressure` times their pressure. Their valves are
    shut, the differential pressure valve connects them, and the bolster is free in all directions under the preload. An
    unequal preload rolls the bolster by `roll`; with a positive `roll`, it leans into the wind.

    The `wind` is steady, has the gust of EN 14067-6, or is stochastic with von Kármán's spectrum. It rises within 4 s.
    The lateral actuator applies the force on one bogie, and the vertical actuators apply its moment. During the wind,
    the platform follows a unilateral cosine of `amplitude` and `frequency`, vertically and laterally together. All five
    axes use one time base. The host streams the motion. With `by` = rig, the function generator of the rig makes a
    steady wind and the track in one program.

    Before the start, the plan computes the largest travel of the bolster from the limits of the specimen. If it reaches
    the bump stop, the run is refused, and the message states the strongest wind that the bench can hold.

    The specimen's file has the limits for four results:

    * the travel toward the bump stop;
    * the lateral stiffness, over the measured shear of the springs and corrected for the pressure;
    * the lateral damping;
    * the roll torque of the springs over the roll that the wind causes.
    """
    if by == "rig":
        waves = programme(run.rig, wind, amplitude, frequency)
        track = waves[-1]
        between = (track.delay, track.end)
        move = partial(run.bench.generator.run_together, *waves)
    else:
        times, moves, between = excitation(run.rig, wind, kind, amplitude, frequency, draw)
        move = partial(run.bench.waveform.run, times, moves)
    with run.phase("wind and track"):
        with run.bench.capture(*READ, *guiding(run.rig)) as capture:
            run.bench.wait(BEFORE)
            move()
        at, values = capture.aligned(SAMPLE_RATE)
    _check_response(run, run.specimen.load(load), Seen(at - BEFORE, between, frequency), values, roll)


@dataclass(frozen=True, slots=True, eq=False)
class Seen:
    """The captured motion: times of the samples (s from the start of the wind), start and end of the track, and its
    frequency (Hz).
    """

    at: Samples
    between: tuple[float, float]
    frequency: float

    @property
    def shaken(self) -> npt.NDArray[np.bool_]:
        """A mask of the samples during the track, in whole cycles after the transient."""
        lead = ceil(LEAD * self.frequency) / self.frequency
        return np.asarray((self.at >= self.between[0] + lead) & (self.at < self.between[1]))

    @property
    def calm(self) -> npt.NDArray[np.bool_]:
        """A mask of the samples in the second before the wind."""
        return np.asarray((self.at >= -1 * s) & (self.at < 0.0))

    def pieces(self) -> Iterator[npt.NDArray[np.bool_]]:
        """Yield a mask of the samples for each piece of whole cycles. The first piece ends with the track; the others
        come before it.
        """
        times = self.at[self.shaken]
        length = floor((self.between[1] - times[0]) * self.frequency / PIECES + 1e-6) / self.frequency
        for k in range(PIECES):
            end = self.between[1] - k * length
            # One sample more: whole cycles, whatever the frequency.
            yield np.asarray((self.at >= end - length - 1 / SAMPLE_RATE) & (self.at < end))

    def stiffness(self, which: npt.NDArray[np.bool_], rig: Rig, values: Values) -> Stiffness:
        """Return the complex lateral stiffness of the pair (N/m), from first harmonics of force and shear. ``which`` is
        a mask of samples.
        """

        def of(series: Samples, *names: str) -> complex:
            return harmonic(rig, self.at[which], series[which], self.frequency, *names)

        moved = of(values["lateral.displacement"], "lateral.displacement")
        moved -= of(values["lateral.force"], "lateral.force") / rig["lateral_frame_stiffness"]
        above = rig["centre_height"] + rig["lateral_actuator_height"]
        moved += above * of(roll_of(values, rig) + values["platform.roll"], *HEIGHTS)
        moved -= of(values["platform.lateral"], "lateral.displacement")  # a transducer of its kind
        force = -of(sideways_force(values, rig), *SHEAR_CELLS)
        return Stiffness(force / moved, self.frequency, abs(moved))

    def windy(self, rig: Rig, values: Values) -> float:
        """Return the ratio of the shear by the wind to the shear by the track, as medians of their absolute values over
        time.

        A single gust is short and changes a median little. Steady drift, for example creep, is excluded.
        """
        turn = tau * self.frequency * self.at[self.shaken]
        track = np.column_stack([np.cos(turn), np.sin(turn), np.ones_like(turn), turn])
        shear = (shear_of(values, rig) - values["platform.lateral"])[self.shaken]
        found = np.linalg.lstsq(track, shear, rcond=None)[0]
        return float(np.median(np.abs(shear - track @ found)) / np.median(np.abs(track[:, :2] @ found[:2])))

    def leaning(self, rig: Rig, values: Values) -> tuple[float, float]:
        """Return the roll (rad) and roll torque (N·m) due to the wind, as means during the motion of the track."""
        roll, torque = (
            float(one[self.shaken].mean() - one[self.calm].mean())
            for one in (roll_of(values, rig), roll_torque(values, rig))
        )
        return roll, torque


def roll_torque(values: Values, rig: Rig) -> Samples:
    """Return the moment (N·m) of the springs about the middle between the top plates, from the actuator forces.

    It is the sum of the moment of the vertical actuators, of the lateral actuator above the plates, and of the weight
    of the rolled bolster.
    """
    above = rig["centre_height"] + rig["lateral_actuator_height"]
    roll = roll_of(values, rig) + values["platform.roll"]
    leaning = bolster_weight(rig) * rig["centre_height"] * roll
    return np.asarray(actuator_moment(values, rig) - above * values["lateral.force"] + leaning)


def _check_response(run: Run, load: Load, seen: Seen, values: Values, rolled: float) -> None:
    """Check the response of the springs and record their loops. ``rolled`` (rad) is the roll by unequal preload."""
    if not all(np.isfinite(values[name][seen.shaken | seen.calm]).all() for name in READ):
        raise NotMeasured("samples of wind and track are missing")
    travel = run.measured(_travel, run.rig, values)
    clear = load.limits.band("crosswind_and_track.travel", "mm")
    if (
        not run.check(TRAVEL, travel, "mm", low=clear.low, high=clear.high)
        and float(travel) > run.rig["stop_gap"]
    ):
        run.not_available(
            [STIFF, DAMPED, ROLLED], "the bolster leaned on its bump stop, which is stiffer than the springs"
        )
        return

    part, _ = GIVEN_BACK[rolled > 0.0]

    def numbers(rig: Rig, read: Values) -> tuple[float, ...]:
        K = seen.stiffness(seen.shaken, rig, read)
        roll, torque = seen.leaning(rig, read)
        return K.storage, K.damping, torque / (roll - part * rolled), torque

    stiffness, damping, leans, torque = run.measure(numbers, run.rig, values)
    K = seen.stiffness(seen.shaken, run.rig, values)
    pieces = [seen.stiffness(piece, run.rig, values) for piece in seen.pieces()]
    text = f"sheared by {K.amplitude / mm:.2f} mm at {K.frequency:g} Hz"
    stiffness = stiffness.with_uncertainty(SCATTER, spread([one.storage for one in pieces]))
    damping = damping.with_uncertainty(SCATTER, spread([one.damping for one in pieces]))
    wide = float(np.ptp(values["platform.lateral"][seen.shaken])) / 2 / K.amplitude
    damping = damping.with_uncertainty(LATE, EVEN * abs(K.value) * wide * LATE_BY, even=True)
    for check, quantity, one in ((STIFF, STORAGE, stiffness), (DAMPED, DAMPING, damping)):
        keep(run, "pair", f"{check}, wind and track", AMPLITUDE, quantity, [K.amplitude], [one])
    beyond = pressure_of({name: values[name][seen.shaken] for name in PRESSURES}) - load.fill_pressure
    if unstated := _unstated(load, K, seen.windy(run.rig, values)):
        run.not_available([STIFF, DAMPED], unstated)
    else:
        rolls = load.limits.curves.get("crosswind_and_track.stiffness_by_roll", {0.0: Band(1.0, 1.0)})
        stiffer = float(np.interp(abs(rolled), list(rolls), [middle(band) for band in rolls.values()]))
        low, high = (stiffer * end for end in _limits(load, "stiffness", K))
        more = 2 * middle(load.limits.band("lateral_stiffness_by_pressure")) * beyond
        run.check(STIFF, stiffness, "kN/m", low=low + more, high=high + more, note=text)
        low, high = (end / (tau * K.frequency) for end in _limits(load, "loss", K))
        run.check(DAMPED, damping, "kN*s/m", low=low, high=high, note=text)
    _judge_roll(run, load, seen, values, rolled, leans, torque, beyond)
    _record_loops(run, load, seen, values)


def _judge_roll(
    run: Run,
    load: Load,
    seen: Seen,
    values: Values,
    rolled: float,
    leans: Measured,
    torque: Measured,
    beyond: float,
) -> None:
    """Check the roll stiffness ``leans``, if it can be judged. ``torque`` is the mean roll torque, ``rolled`` (rad) the
    roll by unequal preload. The pressure is ``beyond`` (Pa) above that for which the limits are stated.
    """
    part, known_to = GIVEN_BACK[rolled > 0.0]
    if other := bench_mismatch(run):
        run.not_available([ROLLED], other)
    elif abs(rolled) > GIVEN_BACK_TO:
        run.not_available(
            [ROLLED], f"the roll is {rolled / mrad:g} mrad; it is judged up to {GIVEN_BACK_TO / mrad:g} mrad"
        )
    else:
        band = load.limits.band(ROLL_STIFFNESS, "kN*m/rad")
        more = beyond * middle(load.limits.band(ROLL_BY_PRESSURE, "m3"))
        sure = "" if torque.expanded is None else f" ± {torque.expanded / kN:.2g}"
        roll, _ = seen.leaning(run.rig, values)
        given_back = known_to * abs(rolled / (roll - part * rolled) * float(leans))
        leans = leans.with_uncertainty(RELEASED, EVEN * given_back, even=True)
        text = f"roll torque of the pair {torque.value / kN:.2f}{sure} kN·m at {roll / mrad:.2f} mrad"
        low, high = (end + more for end in (band.low or 0.0, band.high or 0.0))
        U = leans.expanded or 0.0
        if high - low < WIDTH_PER_U * U:
            run.not_available(
                [ROLLED],
                f"{float(leans) / kN:.0f} ± {U / kN:.0f} kN·m/rad cannot be judged: friction gives back a part of "
                "the roll by unequal preload; set a smaller roll or a stronger wind",
            )
        else:
            run.check(ROLLED, leans, "kN*m/rad", low=low, high=high, note=text)


def _travel(rig: Rig, values: Values) -> float:
    """Return the largest travel (m) of the bolster from the middle. It is the 99.5th percentile, so that noise does not
    count.
    """
    way = stop_travel_of(values, rig) - values["platform.lateral"]
    return float(np.percentile(np.abs(way), 99.5))


def _unstated(load: Load, K: Stiffness, windy: float) -> str:
    """Return why the specimen has no limits for the stiffness ``K`` at this shear by the wind (`Seen.windy`); "" if it
    has limits.
    """
    if windy > WINDY_MOST:
        return (
            f"the wind sheared the springs {windy:.2f} times as far as the track; the limits hold up to "
            f"{WINDY_MOST:g}; set a smaller wind or a larger amplitude"
        )
    places = load.limits.curve("crosswind_and_track.stiffness", "kN/m")
    if min(places) <= K.amplitude <= max(places):
        return ""
    return (
        f"the springs were sheared by {K.amplitude / mm:.2f} mm at {K.frequency:g} Hz; the specimen states limits for "
        f"{min(places) / mm:g} to {max(places) / mm:g} mm"
    )


def _limits(load: Load, name: str, K: Stiffness) -> tuple[float, float]:
    """Return the lower and upper limit of ``name`` at the amplitude of ``K``."""
    return load.limits.curve_at(f"crosswind_and_track.{name}", K.amplitude, "kN/m")


def middle(band: Band) -> float:
    """Return the mean of the lower and the upper limit."""
    return 0.5 * ((band.low or 0.0) + (band.high or 0.0))


def spread(found: list[float]) -> float:
    """Return the standard uncertainty of the mean of the results of several pieces."""
    return float(np.std(found, ddof=1)) / len(found) ** 0.5


def _record_loops(run: Run, load: Load, seen: Seen, values: Values) -> None:
    shear = shear_of(values, run.rig) - values["platform.lateral"]
    force = -sideways_force(values, run.rig)
    roll, torque = roll_of(values, run.rig), roll_torque(values, run.rig)
    for what, x, y, xs, ys in (
        ("force over displacement", Axis("displacement", "mm", mm), Axis("force", "kN", kN), shear, force),
        ("roll torque over roll", Axis("roll", "mrad", mrad), Axis("roll torque", "kN*m", kN), roll, torque),
    ):
        along, up = (one - one[seen.calm].mean() for one in (xs, ys))
        run.loop(load.name, x, y, along[::KEPT], up[::KEPT], group=f"Wind and track: {what}")


crosswind_and_track_aw0, crosswind_and_track_aw3 = (
    plan_under(
        load,
        _crosswind_and_track,
        name,
        setup=take_up(load),
        teardown=leave_connected,
        lasts=lasts,
        needs=(
            *steps.CARRYING,
            *READ,
            *SHEAR_CELLS,
            *FREE_SIDEWAYS,
            *(f"{axis}_setpoint" for axis in TRACK),
            *(f"{name}_setpoint" for name in PUSHED),
            *SEEING,
            *CELLS_ACROSS,
            *ACTUATORS,
            *WEIGHT,
            "spring_half_spacing",
            "stop_gap",
            *lags((*HEIGHTS, "lateral.displacement", "lateral.force", *SHEAR_CELLS)),
        ),
        requires=(*on_the_bench(load), CAN_BLOW, _bench_holds(load)),
        checks=(TRAVEL, STIFF, DAMPED, ROLLED),
    )
    for load, name, lasts in (
        (AW0, "crosswind_and_track_aw0", 60 * s),
        (AW3, "crosswind_and_track_aw3", 64 * s),
    )
)
