"""Leveling valve: dead band, delay, and how long it takes from the empty to the full car and back."""

from collections.abc import Mapping, Sequence
from contextlib import suppress
from functools import partial
from math import inf, nan
from typing import Annotated, Final

import numpy as np

from bench_protocol.units import mbar, minutes, mm, s
from bench_protocol.words import SIDES
from drivers.errors import BenchTimeout
from test_plans import steps
from test_plans.analysis import HEIGHTS, Samples, straight_line
from test_plans.analysis.uncertainty import EVEN, SAMPLING, Measured
from test_plans.check_names import CheckName
from test_plans.loads import AW0, AW3, Limits, SpecimenError
from test_plans.parameters import ParameterRefused, Range
from test_plans.plan import plan
from test_plans.preconditions import on_the_bench
from test_plans.run import Run
from test_plans.steps.fittings import leave_connected
from test_plans.steps.poses import Home, go_home, restore_the_air
from test_plans.steps.shaking import SAMPLE_RATE, check_band

PRESSURES: Final = tuple(f"{side}.auxiliary_pressure" for side in SIDES)
#: Steps (m) through both ends of the dead band; the lever follows each step with its lag.
STAIRS: Final = tuple(z * mm for z in np.arange(2.0, 8.25, 0.5))
#: The valve opens somewhere between two of them.
STAIR: Final = "between two stairs"
NOT_OPENED: Final = "the valve did not open by the last step"
#: Smallest number of samples of the mean height at a step.
STAIR_SAMPLES: Final = 15
#: Number of samples (half a second) before the target is reached, for the interpolation of the time.
ON_THE_WAY: Final = 100
STAIR_WAIT: Final = 2.5 * s
STAIR_LOOK: Final = 1.5 * s
#: Time for the gas of the filling to cool; after it the pressure changes by less than 0.5 mbar/s between stairs.
COOL: Final = 30 * s
#: A valve that is only just open fills with 18 mbar/s and exhausts with 6 mbar/s.
FLOWING: Final = 3 * mbar / s
#: A fully open valve fills with 150 mbar/s or more.
WIDE_FLOW: Final = 30 * mbar / s
RATE: Final = 40 * mm / s
#: Times after the first motion of a step: end of the step, and the time when the valve is certainly fully open.
STEP_DONE: Final = (0.42 * s, 0.52 * s)
WIDE_OPEN: Final = (4.0 * s, 6.0 * s)
MOVED: Final = 1 * mm

OPENS: Final = CheckName(
    "{side} valve opens to {verb}",
    "The height at which the valve begins to fill or to exhaust: it determines the ride height of the car.",
)
DEAD_BAND: Final = CheckName(
    "{side} valve, dead band",
    "The heights between which the valve is shut: if too close, every rail joint wastes air; if too far apart, the "
    "car leans.",
)
TIME: Final = CheckName(
    "{side} valve, time to {verb} to {name}",
    "How long the spring needs to reach the other load: at a stop, the car must be level again before it leaves.",
)
DELAY: Final = CheckName(
    "{side} valve, delay",
    "How much later air flows than through a valve without delay: without a delay, every jolt would waste air.",
)


def lift(run: Run, within: float) -> None:
    """Lift the bolster to design height and fill both springs to the pressure of the empty car.

    Raises ParameterRefused if ``within`` is too short for the slowest valve that passes, and SpecimenError for limits
    that a valve would pass without opening.
    """
    load, limits = run.specimen.load(AW0), run.specimen.limits
    _refuse_limits_that_pass_anything(limits)
    allowed = max(limits.band(f"leveling_{verb}_time").high or 0.0 for verb in ("fill", "exhaust"))
    if within <= allowed:
        raise ParameterRefused(
            f"within = {within:g} s must be longer than the {allowed:g} s that a valve may take"
        )
    steps.shim(run, load)
    steps.power_up(run)
    steps.raise_the_air(run, load)


def _refuse_limits_that_pass_anything(limits: Limits) -> None:
    for limit, unit, most in (
        ("leveling_opening", "", STAIRS[-1]),
        ("leveling.dead_band", "mm", 2 * STAIRS[-1]),
        ("leveling_fill_time", "", inf),
        ("leveling_exhaust_time", "", inf),
    ):
        high = limits.band(limit, unit).high
        if high is None or high > most:
            right = "an upper limit" if most == inf else f"an upper limit of {most / mm:g} mm at most"
            raise SpecimenError(f"{limits.where}.{limit} would pass a valve that does not open; give {right}")


@plan(
    setup=lift,
    needs=(*steps.CARRYING, *PRESSURES, "air.dpv"),
    teardown=leave_connected,
    lasts=150 * s,
    requires=on_the_bench(AW0, AW3),
    checks=(OPENS, DEAD_BAND, TIME, DELAY),
)
def leveling(
    run: Run,
    *,
    step: Annotated[float, Range(14 * mm, 17 * mm, "mm")] = 15 * mm,
    within: Annotated[float, Range(20 * s, 10 * minutes, "s")] = 60 * s,
) -> None:
    """Leveling valve: dead band, delay, filling from AW0 to AW3 and exhausting back to AW0, at held height.

    The actuators hold the height, and the leveling valves are connected. First the bolster moves up and then down in
    steps of half a millimetre, until the pressure of each spring changes. The valve opens at this height. The dead band
    is the distance between both heights; a wrong setting of the rod shifts it but does not change its width. Then the
    bolster goes down by `step`, which opens the valve fully, and stays there until both springs have the pressure of
    the full car. Then it goes up by the same distance, until both springs have the pressure of the empty car again.

    The delay is how much later the air flows than through a valve that opens immediately. It ends where the pressure
    line of the fully open valve, extended backward, meets the initial pressure.

    A valve passes if each result is within the limits of the specimen's file, on each side. A valve fails if it does
    not open by the last step, or if the spring does not reach its pressure within the time.
    """
    limits = run.specimen.limits
    dead_band = limits.band("leveling.dead_band", "mm")
    opening = limits.band("leveling_opening")
    fill, exhaust = limits.band("leveling_fill_time"), limits.band("leveling_exhaust_time")
    home = go_home(run)
    steps.lock_the_air(run)
    run.bench.wait(COOL)
    run.bench.air.isolate_dpv()  # each side for itself
    run.bench.air.level()
    read: dict[str, list[dict[str, float]]] = {side: [] for side in SIDES}
    for way, verb in ((1.0, "exhaust"), (-1.0, "fill")):
        with run.phase(f"stairs to {verb}"):
            for side, around in _stairs(run, home, way).items():
                height = _opened(run, side, way, around)
                check_band(run, OPENS.of(side=side, verb=verb), height, "mm", opening)
                read[side] += around
            _move_from_home(run, home, 0.0)
            run.bench.wait(STAIR_WAIT)
    for side in SIDES:
        width = _dead_band(run, side, read[side])
        check_band(run, DEAD_BAND.of(side=side), width, "mm", dead_band)
    run.hold_point("before the other load")
    empty = run.specimen.load(AW0).fill_pressure
    restore_the_air(run, {f"{side}.auxiliary_pressure": empty for side in SIDES})
    for way, verb, name, band in ((-1.0, "fill", AW3, fill), (1.0, "exhaust", AW0, exhaust)):
        with run.phase(f"{verb} to {name}"):
            times, values = _step(run, home, way * step, run.specimen.load(name).fill_pressure, within)
            for side in SIDES:
                target = -way * run.specimen.load(name).fill_pressure
                took = _took(run, side, way, times, values, target, within)
                check_band(run, TIME.of(side=side, verb=verb, name=name), took, "s", band)
                if verb == "fill":
                    _check_delay(run, side, step, times, values)


def _check_delay(run: Run, side: str, step: float, times: Samples, values: Mapping[str, Samples]) -> None:
    """Check the delay after a ``step`` (m) against its limit. The limit depends on the step, because a larger step
    opens the valve sooner.
    """
    check, limits = DELAY.of(side=side), run.specimen.limits
    stated = limits.curve("leveling_delay")
    if not min(stated) <= step <= max(stated):
        steps_stated = f"{min(stated) / mm:g} to {max(stated) / mm:g} mm"
        run.lack([check], f"step = {step / mm:g} mm; the specimen states limits for steps of {steps_stated}")
        return
    low, high = limits.curve_at("leveling_delay", step)
    late = run.measured(partial(_delay, side, times), values)
    run.check(check, late, "s", low=low, high=high)


def _stairs(run: Run, home: Home, way: float) -> dict[str, list[dict[str, float]]]:
    """Move the bolster in steps until each valve opens. Return by side the mean heights of the two steps around the
    opening.

    ``way`` is the direction, +1 or −1. If a valve does not open, only the last step is returned for its side.
    """
    found: dict[str, list[dict[str, float]]] = {}
    before, low = _slopes(run)
    for stair in STAIRS:
        _move_from_home(run, home, way * stair)
        run.bench.wait(STAIR_WAIT)
        slopes, high = _slopes(run)
        for side in SIDES:
            if side not in found and -way * (slopes[side] - before[side]) > FLOWING:
                found[side] = [low, high]
        if len(found) == len(SIDES):
            break
        before, low = slopes, high
    return {side: found.get(side, [low]) for side in SIDES}


def _slopes(run: Run) -> tuple[dict[str, float], dict[str, float]]:
    """Measure for a while. Return the rate of pressure change (Pa/s) of each side, and the mean heights (m)."""
    names = {side: f"{side}.auxiliary_pressure" for side in SIDES}
    with run.bench.capture(*names.values(), *HEIGHTS) as capture:
        run.bench.wait(STAIR_LOOK)
    slopes = {
        side: straight_line(capture.times(name), capture.values(name))[1] for side, name in names.items()
    }
    return slopes, {name: float(np.nanmean(capture.values(name))) for name in HEIGHTS}


def _opened(run: Run, side: str, way: float, around: list[dict[str, float]]) -> Measured:
    """Return the distance (m) from design height at which a valve opens, from the steps ``around``."""
    if len(around) < 2:
        return Measured(STAIRS[-1] + 1 * mm, unknown=NOT_OPENED)
    height = run.measured(lambda *read: way * _middle(side, read), *around, averaged=STAIR_SAMPLES)
    return height.with_uncertainty(STAIR, _half(side, around), even=True)


def _dead_band(run: Run, side: str, around: list[dict[str, float]]) -> Measured:
    """Return the distance (m) between the heights at which a valve opens to exhaust and to fill.

    ``around`` holds the two steps around each opening, those of the upper one first.
    """
    if len(around) < 4:
        return Measured(2 * (STAIRS[-1] + 1 * mm), unknown=NOT_OPENED)
    width = run.measured(
        lambda *read: _middle(side, read[:2]) - _middle(side, read[2:]), *around, averaged=STAIR_SAMPLES
    )
    for two in (around[:2], around[2:]):
        width = width.with_uncertainty(STAIR, _half(side, two), even=True)
    return width


def _half(side: str, stairs: Sequence[Mapping[str, float]]) -> float:
    """Return the standard uncertainty (m) of a height that is somewhere between two steps."""
    below, above = (stair[f"{side}.height"] for stair in stairs)
    return 0.5 * EVEN * abs(above - below)


def _middle(side: str, stairs: Sequence[Mapping[str, float]]) -> float:
    return 0.5 * sum(stair[f"{side}.height"] for stair in stairs)


def _took(
    run: Run,
    side: str,
    way: float,
    times: Samples,
    values: Mapping[str, Samples],
    target: float,
    within: float,
) -> Measured:
    """Return the time (s) after the start of a step until a pressure is reached.

    ``way`` is the direction of the step, ``target`` the pressure (Pa) times −``way``. ``within`` (s) is returned if it
    is not reached.
    """
    reached = np.flatnonzero(-way * values[f"{side}.auxiliary_pressure"] >= target)
    if not reached.size:
        return Measured(within, unknown="the pressure was not reached in time")
    last = slice(max(int(reached[0]) - ON_THE_WAY, 0), int(reached[0]) + 1)

    def when(read: Mapping[str, Samples]) -> float:
        pressure = -way * read[f"{side}.auxiliary_pressure"][last]
        level, slope = straight_line(times[last], pressure)
        return float(times[last].mean() + (target - level) / slope)

    return run.measured(when, values).with_uncertainty(SAMPLING, 0.5 * EVEN / SAMPLE_RATE, even=True)


def _step(
    run: Run, home: Home, step: float, pressure: float, within: float
) -> tuple[Samples, Mapping[str, Samples]]:
    """Move the bolster by ``step`` (m), and shut each side when it reaches ``pressure``. Return times (s) and readings.

    Times count from the first motion.
    """
    bench, waiting = run.bench, set(SIDES)
    bench.air.level()

    def there() -> set[str]:
        read = {side: bench.readings.value(f"{side}.auxiliary_pressure") for side in waiting}
        return {side for side, one in read.items() if (one >= pressure if step < 0.0 else one <= pressure)}

    names = [f"{side}.{what}" for side in SIDES for what in ("height", "auxiliary_pressure")]
    with bench.capture(*names) as capture:
        _move_from_home(run, home, step)
        end = bench.now + within
        with suppress(BenchTimeout):  # a valve that does not do it in time has failed, which is reported
            while waiting:
                left = max(end - bench.now, 0.0)
                bench.wait_for(lambda: bool(there()), within=left, what="pressure of the other load")
                arrived = there()
                bench.settings.write({f"air.{side}_mode": "hold" for side in arrived})
                waiting -= arrived
    times, values = capture.aligned(SAMPLE_RATE)
    moved = np.abs(values["left.height"] - values["left.height"][0]) > MOVED
    return times - times[np.argmax(moved)], values


def _delay(side: str, times: Samples, values: Mapping[str, Samples]) -> float:
    """Return how late (s) the air flow begins after a step, from a line through the pressure of the fully open valve.
    NaN if the valve was not seen fully open.
    """
    pressure = values[f"{side}.auxiliary_pressure"]
    early, late = ((times >= start) & (times <= end) for start, end in (STEP_DONE, WIDE_OPEN))
    if times[-1] < WIDE_OPEN[1]:
        return nan
    before = float(np.nanmean(pressure[early]))
    level, slope = straight_line(times[late], pressure[late])
    if slope < WIDE_FLOW:
        return nan
    middle = 0.5 * (times[late][0] + times[late][-1])
    return float(middle - (level - before) / slope)


def _move_from_home(run: Run, home: Home, z: float) -> None:
    run.bench.vertical.move_to(home.left + z, home.right + z, rate=RATE)
