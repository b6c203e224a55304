"""Endurance: many cycles, and at intervals the changes of stiffness, damping, height and tightness."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from functools import partial
from math import ceil
from typing import Annotated, Any, Final, Literal

import numpy as np

from bench_protocol.units import NS, Hz, kN, mm, s
from bench_protocol.words import SIDES
from bench_records.twin import Deviation
from drivers.errors import BenchTimeout
from drivers.generator import MARGIN
from test_plans import steps
from test_plans.analysis import HEIGHTS, Samples, Stiffness, straight_line
from test_plans.analysis.geometry import Rig
from test_plans.analysis.uncertainty import Measured, counted
from test_plans.check_names import CheckName
from test_plans.loads import Load
from test_plans.parameters import Range
from test_plans.plan import plan
from test_plans.preconditions import on_the_bench
from test_plans.run import Run
from test_plans.steps.air import AVERAGED
from test_plans.steps.carrying import PRELOAD_WITHIN
from test_plans.steps.fittings import leave_connected
from test_plans.steps.poses import COOL, Home, go_home
from test_plans.steps.shaking import check_band
from test_plans.steps.tables import DAMPING, HEIGHT, STORAGE, Quantity, keep
from test_plans.steps.waves import (
    SLOW_LATERAL_WAVES,
    VERTICAL_WAVES,
    lateral_stiffness,
    shake,
    stiffness_of_side,
)

#: The largest number of cycles in one program of the generator.
PROGRAM: Final = 1000
#: Time until the gas has its final temperature: four times its thermal time constant. With shorter intervals between
#: inspections it is run in for one interval.
RUN_IN: Final = 60 * s
REST: Final = 30 * s
LOOK_FREQUENCY: Final = 1 * Hz
LOOK_AMPLITUDE: Final = 5 * mm
LOOK_LEAD: Final = 3 * s
LOOK_OVER: Final = 10 * s
PRELOAD_RATE: Final = 5 * kN / s
STAND: Final = 3 * s
RATE: Final = 10 * mm / s
#: Interval (s) at which the twin is checked for a deviation of the rig from the model.
ASKED_EVERY: Final = 20 * s
NOBODY_WATCHES: Final = (
    "no twin watches this run, so a deviation is not detected and does not end the cycles; add --watch"
)
A_THOUSAND: Final = 1000.0
CYCLES: Final = ("cycles", "1")
MADE: Final = CheckName(
    "cycles",
    "How many of the requested cycles were made: a test that was stopped early proves less.",
)
#: The checks: name, curve, limit of the change in 1000 cycles, and its unit.
JUDGED: Final = (
    (
        CheckName(
            "{where} stiffness K', change in 1000 cycles",
            "How fast the stiffness changes in use: softening rubber or damaged cords show here long before a failure.",
        ),
        STORAGE,
        "stiffness_change",
        "%",
    ),
    (
        CheckName(
            "{where} damping c, change in 1000 cycles",
            "How fast the damping changes in use: a worn or clogged "
            "orifice, or aged rubber, changes the damping first.",
        ),
        DAMPING,
        "damping_change",
        "%",
    ),
    (
        CheckName(
            "{where} height, change in 1000 cycles",
            "How fast the height under load changes in use: a falling height means creep or loss of air.",
        ),
        HEIGHT,
        "height_change",
        "mm",
    ),
)
#: The result of an inspection, K' and c of a sine or one height, and the readings for it.
Found = Callable[[Rig, Mapping[str, Any]], tuple[float, ...]]


@dataclass(slots=True)
class Series:
    """One measurement that every inspection repeats: the function that computes it, and its readings, for each
    inspection.
    """

    computed: list[Found] = field(default_factory=list)
    read: list[Mapping[str, Any]] = field(default_factory=list)

    def known(self, run: Run, place: int) -> list[Measured]:
        """Return one quantity of the results (index ``place``) for each inspection, with its own uncertainty."""
        return [
            run.measured(partial(_result_at, of, place), run.rig, read, averaged=AVERAGED)
            for of, read in zip(self.computed, self.read, strict=True)
        ]


@dataclass(slots=True)
class Looks:
    """All inspections so far: the number of completed cycles, and the results by spring."""

    made: int = 0
    cycles: list[float] = field(default_factory=list)
    sines: dict[str, Series] = field(default_factory=dict)
    heights: dict[str, Series] = field(default_factory=dict)

    def add(
        self, sines: Mapping[str, Found], read: Mapping[str, Samples], heights: Mapping[str, float]
    ) -> None:
        """Add one inspection: the functions ``sines`` with their readings ``read``, and mean ``heights`` by signal."""
        self.cycles.append(float(self.made))
        for where, of in sines.items():
            series = self.sines.setdefault(where, Series())
            series.computed.append(of)
            series.read.append(read)
        for name in heights:
            series = self.heights.setdefault(name.partition(".")[0], Series())
            series.computed.append(partial(_mean, name))
            series.read.append(heights)

    def judge(self, run: Run) -> None:
        """Record all curves. Check the changes if there was an inspection before and one after some cycles."""
        for name, quantity, limit, unit in JUDGED:
            band = run.specimen.limits.band(f"endurance.{limit}", unit)
            place = 1 if quantity is DAMPING else 0
            for where, series in (self.heights if quantity is HEIGHT else self.sines).items():
                self._record_over_cycles(run, where, quantity, series.known(run, place))
                if len(set(self.cycles)) > 1:
                    change = self._change(run, series, place, unit)
                    check_band(run, name.of(where=where), change, unit, band)

    def _change(self, run: Run, series: Series, place: int, unit: str) -> Measured:
        """Return the change per 1000 cycles: the slope of a fitted line. With the unit % it is relative to the first
        value.

        All inspections use the same instruments: offsets cancel in changes, gains in ratios.
        """

        def change(rig: Rig, *read: Mapping[str, Any]) -> float:
            values = np.array([of(rig, one)[place] for of, one in zip(series.computed, read, strict=True)])
            slope = A_THOUSAND * straight_line(np.array(self.cycles), values)[1]
            return slope / float(values[0]) if unit == "%" else slope

        return run.measured(change, run.rig, *series.read, averaged=AVERAGED)

    def _record_over_cycles(
        self, run: Run, where: str, quantity: Quantity, values: Sequence[Measured]
    ) -> None:
        keep(
            run,
            where,
            f"{quantity[0][0].upper()}{quantity[0][1:]} over cycles",
            CYCLES,
            quantity,
            self.cycles,
            values,
        )


def _result_at(of: Found, place: int, rig: Rig, read: Mapping[str, Any]) -> float:
    return of(rig, read)[place]


def _mean(name: str, rig: Rig, read: Mapping[str, Any]) -> tuple[float, ...]:
    return (float(read[name]),)


def _sine(
    stiffness: Callable[[Samples, Rig, Any], Stiffness], times: Samples, rig: Rig, read: Mapping[str, Any]
) -> tuple[float, ...]:
    K = stiffness(times, rig, read)
    return K.storage, K.damping


@plan(
    setup=steps.carry_load,
    needs=(*steps.CARRYING, *VERTICAL_WAVES, *SLOW_LATERAL_WAVES, *steps.WEIGHED_BY),
    teardown=leave_connected,
    lasts=665 * s,
    requires=on_the_bench("load"),
    checks=(MADE, *(name for name, *_ in JUDGED), steps.TIGHT),
)
def endurance(
    run: Run,
    *,
    load: Literal["AW0", "AW3"] = "AW0",
    axis: Literal["vertical", "lateral"] = "vertical",
    amplitude: Annotated[float, Range(2 * mm, 20 * mm, "mm")] = 10 * mm,
    frequency: Annotated[float, Range(0.2 * Hz, 3 * Hz, "Hz")] = 1 * Hz,
    cycles: Annotated[int, Range(200, 1_000_000)] = 300,
    intervals: Annotated[int, Range(1, 100)] = 3,
    parting: Literal["noted", "ends"] = "noted",
) -> None:
    """Endurance: how stiffness, damping, height and tightness change over many cycles.

    The springs carry the `load` on their leveling valves at design height. Then all valves are shut. The springs are
    run in for one minute, until the gas temperature is steady, or for one interval if that is shorter. Then follow the
    `cycles` along one `axis`, divided into `intervals`. Before the first interval and after each interval, the bench
    rests for half a minute. Then it measures stiffness and damping (5 mm, 1 Hz), the height at which each spring
    carries its load, and its mass of air.

    The specimen's file has the limits of the change in 1000 cycles, which is the slope of a line through all
    measurements, and of the air loss per minute. The scatter of a measurement has less influence with more cycles: 0.1
    % over 300 cycles is 0.33 % per 1000 cycles. If a run is stopped early, it keeps and judges the results so far.

    With a twin (`astb run --watch`) and `parting` = ends, a deviation of the rig from its model ends the cycles. The
    bench then measures once more, and the report states the start of the deviation and its possible causes.
    """
    if parting == "ends" and not run.twin.watching:
        run.warn(NOBODY_WATCHES)
    case = run.specimen.load(load)
    for _, _, limit, unit in JUDGED:
        run.specimen.limits.band(f"endurance.{limit}", unit)
    run_in = min(ceil(RUN_IN * frequency), cycles // intervals)
    home = go_home(run)
    run.bench.wait(COOL)
    steps.lock_the_air(run)
    with run.phase("run in"):
        _inspect(run, case, axis, home, Looks())  # friction depends on an inspection, too
        _cycle(run, axis, amplitude, frequency, run_in, Looks())
    looks = Looks()
    try:
        before = _inspect(run, case, axis, home, looks)
        for number in range(1, intervals + 1):
            until = cycles * number // intervals
            if run.hold_point(f"before the cycles to {until}"):
                with run.phase("run in again"):
                    _cycle(run, axis, amplitude, frequency, run_in, Looks())
                    _inspect(run, case, axis, home, Looks())  # as before any other interval
            with run.phase(f"cycles to {until}"):
                deviation = _cycle(
                    run, axis, amplitude, frequency, until - looks.made, looks, ends=parting == "ends"
                )
            with _reason(run, deviation):
                _inspect(run, case, axis, home, looks)
            if deviation is not None:
                break
    finally:
        run.check(MADE, counted(looks.made), "1", low=cycles)
        looks.judge(run)
    steps.check_tightness(run, case, before)


@contextmanager
def _reason(run: Run, deviation: Deviation | None) -> Iterator[None]:
    """At the end of the block, report why a ``deviation`` ended the cycles. Its causes may be known only then."""
    try:
        yield
    finally:
        if deviation is not None:
            sentence = (run.twin.deviation or deviation).sentence
            run.warn(f"the cycles were ended because the rig deviates from the model. {sentence}")


def _cycle(
    run: Run,
    axis: Literal["vertical", "lateral"],
    amplitude: float,
    frequency: float,
    count: int,
    looks: Looks,
    *,
    ends: bool = False,
) -> Deviation | None:
    """Run ``count`` cycles in as many generator programs as needed. Add the number of completed cycles to ``looks``.

    With ``ends``, stop at a deviation of rig and model, and return the deviation; None if all cycles were completed.
    """
    while count > 0:
        some = min(count, PROGRAM)
        # A program that did not begin has no cycles; the counter still has those of the previous program.
        run.bench.generator.start(axis, amplitude=amplitude, frequency=frequency, cycles=some)
        try:
            deviation = _wait_done(run, some / frequency + MARGIN, ends)
        finally:
            looks.made += int(np.nan_to_num(run.bench.readings.value("rig.generator_cycle")))
        if deviation is not None:
            run.bench.generator.stop()
            return deviation
        count -= some
    return None


def _wait_done(run: Run, within: float, ends: bool) -> Deviation | None:
    """Wait until the cycles are completed, and return None. With ``ends``, return early if rig and model deviate, with
    the deviation.
    """
    last = run.now + round(within * NS)
    while ends:
        if (deviation := run.twin.deviation) is not None:
            return deviation
        if last - run.now <= ASKED_EVERY * NS:
            break
        with suppress(BenchTimeout):
            run.bench.generator.wait_done(within=ASKED_EVERY)
            return None
    run.bench.generator.wait_done(within=(last - run.now) / NS)
    return None


def _inspect(
    run: Run, load: Load, axis: Literal["vertical", "lateral"], home: Home, looks: Looks
) -> steps.Weighing:
    """Measure stiffness, damping and heights, and add them to ``looks``. Return the readings that give the mass
    of air.
    """
    with run.phase(f"look after {looks.made} cycles"):
        run.bench.wait(REST)
        air = steps.weigh_the_air(run)
        times, values = shake(run, axis, LOOK_FREQUENCY, LOOK_AMPLITUDE, lead=LOOK_LEAD, measured=LOOK_OVER)
        ways: dict[str, Callable[[Samples, Rig, Any], Stiffness]] = (
            {"lateral": partial(lateral_stiffness, frequency=LOOK_FREQUENCY)}
            if axis == "lateral"
            else {side: partial(stiffness_of_side, frequency=LOOK_FREQUENCY, side=side) for side in SIDES}
        )
        force = load.actuator_force(run.rig)
        run.bench.vertical.preload(force, force, rate=PRELOAD_RATE, within=PRELOAD_WITHIN)
        run.bench.wait(STAND)
        heights = run.bench.averages(*HEIGHTS, over=steps.AVERAGE_OVER)
        run.bench.vertical.move_to(home.left, home.right, rate=RATE)
    looks.add({where: partial(_sine, way, times) for where, way in ways.items()}, values, heights)
    return air
