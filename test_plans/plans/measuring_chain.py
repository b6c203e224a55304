"""Measuring chain: the zero of every transducer, a known weight, known forces, and the stiffness of a stiff dummy."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from math import inf
from typing import Annotated, Final, Literal

import numpy as np

from bench_protocol.dimensions import across
from bench_protocol.signals import Group
from bench_protocol.table_signals import BY_GROUP
from bench_protocol.units import MN, K, N, kg, kN, m, mbar, minutes, mm, mrad, s
from bench_protocol.words import SIDES
from drivers.errors import BenchTimeout, RigFault
from test_plans import steps
from test_plans.analysis import HEIGHTS, SHEAR_CELLS, VERTICAL_CELLS, Samples, straight_line
from test_plans.analysis.cells import (
    CELLS,
    CELLS_ACROSS,
    bearing,
    guiding,
    load_on,
    rest_load,
    sideways_force,
    upward_force,
)
from test_plans.analysis.geometry import (
    ACTUATORS,
    LASERS,
    Rig,
    height_at,
    height_of_spring,
    pressed_on,
)
from test_plans.check_names import CheckName
from test_plans.loads import Band, within
from test_plans.parameters import Range
from test_plans.plan import plan
from test_plans.preconditions import COLD_FROM_BEFORE, HALL, gas
from test_plans.run import Run
from test_plans.steps.carrying import FREE_SIDEWAYS, PRELOAD_WITHIN, VENT_WITHIN
from test_plans.steps.cell_loads import ACROSS, AGAINST, AHEAD, check_across, check_against, check_ahead
from test_plans.steps.shaking import check_band
from test_plans.steps.tables import keep

TEMPERATURES: Final = BY_GROUP[Group.TEMPERATURE]
FORCES: Final = tuple(f"vertical_{side}.force" for side in SIDES)
PISTONS: Final = tuple(f"vertical_{side}.displacement" for side in SIDES)
#: Largest reading of each transducer where its quantity is zero, by the data sheets of the bench, and its unit.
ZEROS: Final = {
    Group.PRESSURE: (25 * mbar, "mbar"),
    Group.VERTICAL_FORCE: (200 * N, "N"),
    Group.LATERAL_FORCE: (50 * N, "N"),
    Group.LATERAL_LOAD_CELL: (50 * N, "N"),
    Group.ACCELERATION: (0.02, "m/s2"),
}
CELL_ZERO: Final = 200 * N
PLACE_ZERO: Final = 0.05 * mm
#: The platform is held where its own transducers read 0; lasers measure the bolster relative to it.
PLATFORM_ZERO: Final = 0.02 * mm
PLATFORM_ROLL_ZERO: Final = 0.05 * mrad
THERMOMETER_ZERO: Final = 0.1 * K
#: Factor on the tolerances for noise and for the steps of the converters.
ROOM: Final = 1.1
READ_OVER: Final = 2 * s

#: Rising and falling forces, so that friction and creep of a cell separate the two branches.
FORCE_STEPS: Final = tuple(F * kN for F in (5, 20, 40, 60, 40, 20, 5))
#: Fraction of the force on the right side; unequal forces reveal sides that are connected crosswise.
RIGHT_SHARE: Final = 0.8
PUSH_STEPS: Final = tuple(F * kN for F in (0.0, 0.7, 1.4, 0.0, -0.7, -1.4, 0.0))
PRESS_RATE: Final = 10 * kN / s
PUSH_RATE: Final = 0.5 * kN / s
STEP_WAIT: Final = 2 * s
#: Two cells and a transducer, each good for 0.1 % of 200 kN, over 55 kN: 0.7 % if their errors are alike.
GAIN: Final = within(1.0, 0.01)
LATERAL_GAIN: Final = within(1.0, 0.02)
#: Largest deviation from the straight line, as a fraction of the largest force.
NONLINEAR: Final = Band(high=0.005)
FRAME_WITHIN: Final = 0.10
#: Smallest stiffness of the measuring chain, with which the stiffness of a spring is correct within 1 %.
BLOCK: Final = Band(low=200 * MN / m)
#: Above this stiffness, the displacement is too small to be measured.
STIFFEST: Final = 10_000 * MN / m
#: With the dummy blocks the bolster is at design height; on the stops of the springs it is far below.
AT_BLOCKS: Final = 10 * mm
READS_ZERO: Final = {
    Group.PRESSURE: CheckName(
        "{of}",
        "What the transducer reads without air: every pressure has this error, and every load computed from it.",
    ),
    Group.VERTICAL_FORCE: CheckName(
        "{of}",
        "What an actuator's force reads without load: every preload has this error.",
    ),
    Group.LATERAL_FORCE: CheckName(
        "{of}",
        "What the lateral actuator's force reads without load: it shifts the middle of every lateral loop.",
    ),
    Group.LATERAL_LOAD_CELL: CheckName(
        "{of}",
        "What a lateral load cell reads without a lateral force: it looks like a spring force that does not exist.",
    ),
    Group.ACCELERATION: CheckName(
        "{of}",
        "What an accelerometer reads at rest: when it is integrated, it becomes a motion that did not happen.",
    ),
}
CELL_OF_BOLSTER: Final = CheckName(
    "{of}",
    "The reading of a load cell below a spring, less the known weight "
    "of the bolster: its zero error is in every load.",
)
LASER_LESS_PISTON: Final = CheckName(
    "{of}",
    "Laser reading and the platform's own motion, less piston position, with nothing between them: a difference looks "
    "like compliance of the frame.",
)
FROM_THE_MEAN: Final = CheckName(
    "{of}",
    "A thermometer less the mean of all, in gas as warm as the hall: a "
    "wrong one looks like a leak when air is weighed.",
)
OVER_MASS: Final = CheckName(
    "cells over the known mass",
    "What the cells read of an independently known weight: only this "
    "shows a scale error that cells and actuators share.",
)
OVER_ACTUATOR: Final = CheckName(
    "{side} cells over actuator",
    "The slope of the cells' force over the actuator's force: if it is not 1, one of the two instruments is wrong.",
)
OFF_THE_LINE: Final = CheckName(
    "{side} cells over actuator, off the line",
    "How far the cells deviate from a straight line over the actuator: nonlinearity or lag makes a stiffness depend "
    "on the load.",
)
SIDEWAYS: Final = CheckName(
    "lateral cells over actuator",
    "The slope of the lateral cells' force over the lateral actuator's: every lateral stiffness has this error.",
)
SIDEWAYS_OFF_THE_LINE: Final = CheckName(
    "lateral cells over actuator, off the line",
    "How far the lateral cells deviate from a straight line: friction of the chain itself looks like friction of a "
    "spring.",
)
GIVES_WAY: Final = CheckName(
    "{side} stiffness of the dummy",
    "Force over displacement of a body of known stiffness: it tests lasers and cells together, as with a spring.",
)
FRAME_GIVES_WAY: Final = CheckName(
    "{side} stiffness of the frame",
    "Force over the difference between piston and spring travel: a soft frame reduces every commanded displacement.",
)
#: The readings of each step: means by signal. The applied force (N), and the force by the load cells.
Steps = Sequence[Mapping[str, float]]
Forces = tuple[Samples, Samples]
#: Vented air is cold, and warms with a time constant of 20 s (virtual rig). At this rate, a deviation of 0.08 K
#: remains.
WARM: Final = 0.02 * K
WARM_OVER: Final = 5 * s
#: The air that an earlier run vented may be as cold as 290 K when this run begins.
WARM_WITHIN: Final = 5 * minutes
#: A released bolster oscillates for some seconds.
STILL: Final = 8 * s


def without_air(run: Run) -> None:
    """Vent the springs and release the actuators, so that only the weight of the bolster acts. Wait until the gas is
    warm again.

    The bolster presses out the last air, which cools by that. Therefore the wait for the gas temperature is the last
    step.
    """
    steps.power_up(run)
    with run.phase("without air"):
        run.bench.air.vent(within=VENT_WITHIN)
    run.bench.disarm()
    with run.phase("still"):
        run.bench.wait(STILL)
        gas = [name for name in TEMPERATURES if run.bench.has(name)]
        if gas:
            try:
                run.bench.settle(*gas, band=WARM, over=WARM_OVER, within=WARM_WITHIN)
            except BenchTimeout as error:
                raise BenchTimeout(
                    f"the gas is not yet as warm as the hall: {error}; {COLD_FROM_BEFORE}"
                ) from None


@plan(
    setup=without_air,
    needs=(*steps.CARRYING, *VERTICAL_CELLS, *CELLS, *ACTUATORS, *LASERS),
    lasts=110 * s,
    requires=[gas(*HALL)],
    checks=(
        *(name.of(of=f"<{group}>") for group, name in READS_ZERO.items()),
        CELL_OF_BOLSTER.of(of="<vertical load cell>"),
        LASER_LESS_PISTON.of(of="<height> less <displacement>"),
        FROM_THE_MEAN.of(of="<temperature> less the mean"),
        OVER_MASS,
        OVER_ACTUATOR,
        OFF_THE_LINE,
        GIVES_WAY,
        FRAME_GIVES_WAY,
        ACROSS,
        AHEAD["force upward"],
        AGAINST,
        SIDEWAYS,
        SIDEWAYS_OFF_THE_LINE,
        AHEAD["force sideways"],
    ),
)
def measuring_chain(
    run: Run,
    *,
    dummy: Literal["stops", "blocks"] = "stops",
    mass: Annotated[float, Range(0 * kg, 3000 * kg, "kg")] = 0 * kg,
) -> None:
    """Measuring chain: zeros, known weights and forces, and the stiffness of a dummy.

    The springs are without air and the actuators without force. In this state, every pressure, force and acceleration
    must be zero, the thermometers must agree, and lasers and pistons must be at one height. The four load cells carry
    only the bolster, whose mass the dimensions of the rig state. If there is a known `mass`, the operator puts it on
    the bolster and takes it off again. Only this test detects a scale error that cells and actuators have in common.

    Then the vertical actuators press in steps up to 60 kN on the left, with a fifth less on the right, and back. Equal
    forces would hide cells or lasers that are connected crosswise. The vertical cells must read these forces, and the
    lateral cells must not. The lasers show the compression of the dummy, and the further travel of the pistons is that
    of the frame. At last the lateral actuator pushes to both sides, and the lateral cells must read this force.

    The `dummy` is the support of the bolster: the stops of the springs, whose stiffness the specimen's file states, or
    steel blocks in place of the springs. The compression of blocks is too small to be measured, so the measured
    stiffness is that of the measuring chain.

    The run passes with these results:

    * zeros within the data sheets of the transducers;
    * a weighed mass within 1 %;
    * forces that agree within 1 % (2 % laterally), with a linearity error below 0.5 %;
    * lateral cells that read less than 0.2 % of a vertical force;
    * a frame stiffness within 10 % of the dimensions of the rig, and blocks with more than 200 MN/m;
    * forces that act lengthwise within 5 mm of the middle (10 mm for the small lateral forces);
    * less than 0.5 % of the force as internal force between the cells.
    """
    stop = run.specimen.limits.band("measuring_chain.stop_stiffness", "MN/m")
    with run.phase("zero"):
        _check_zeros(run)
    high = [run.bench.readings.value(name) for name in HEIGHTS]
    if dummy == "blocks" and not all(abs(one) < AT_BLOCKS for one in high):
        places = " and ".join(f"{one / mm:.1f} mm" for one in high)
        raise RigFault(
            f"the bolster rests at {places} instead of 0 mm on the blocks; insert them in place of the springs"
        )
    if mass > 0.0:
        _weigh(run, mass)
    steps.power_up(run)
    with run.phase("press"):
        cells = bearing(run.rig)
        across = [cell for cell in SHEAR_CELLS if run.bench.has(cell) and cell not in cells]
        pressed = _steps(run, (*FORCES, *cells, *HEIGHTS, *PISTONS, *across), FORCE_STEPS, _press)
    for side in SIDES:
        _check_side(run, side, pressed, BLOCK if dummy == "blocks" else stop)
    check_across(run, across, pressed, over=READ_OVER)
    check_ahead(run, "force upward", pressed, over=READ_OVER)
    check_against(run, pressed, over=READ_OVER)
    if run.can(SIDEWAYS, needs=(*FREE_SIDEWAYS, *SHEAR_CELLS, *CELLS_ACROSS)):
        run.hold_point("before the push")
        with run.phase("push"):
            pushed = _steps(run, ("lateral.force", *guiding(run.rig)), PUSH_STEPS, _push)
        names = SIDEWAYS, SIDEWAYS_OFF_THE_LINE
        _check_line(run, names, pushed, _sideways, LATERAL_GAIN)
        check_ahead(run, "force sideways", pushed, over=READ_OVER)


def _zeros(
    rig: Rig, has: Callable[[str], bool]
) -> Iterator[tuple[CheckName, dict[str, float], float, float, str]]:
    """Yield each value that is known without air and force: name of the check, weights of the readings to sum, expected
    value and tolerance (SI), unit.
    """
    for group, (tolerance, unit) in ZEROS.items():
        for name in (one for one in BY_GROUP[group] if one not in bearing(rig)):
            read, off = {name: 1.0}, tolerance
            if group is Group.ACCELERATION:  # it leans with the bolster: gφ is not an error of it
                lean = rig["gravity"] / (rig[LASERS[0]] - rig[LASERS[1]])
                read |= {"left.height": -lean, "right.height": lean}
                off += 2 * lean * PLACE_ZERO
            yield READS_ZERO[group].of(of=name), read, 0.0, off, unit
    for cell in bearing(rig):
        yield CELL_OF_BOLSTER.of(of=cell), {cell: 1.0}, rest_load(rig, cell), CELL_ZERO, "N"
    for height, piston in zip(HEIGHTS, PISTONS, strict=True):
        title = LASER_LESS_PISTON.of(of=f"{height} less {piston}")
        sum_of, tolerance = {height: 1.0, piston: -1.0}, 2 * PLACE_ZERO
        for name, share, zero in (
            ("platform.vertical", 1.0, PLATFORM_ZERO),
            ("platform.roll", rig[across(height)], PLATFORM_ROLL_ZERO),
        ):
            if has(name):  # a platform without readings is at rest
                sum_of[name] = share
                tolerance += abs(share) * zero
        yield title, sum_of, 0.0, tolerance, "mm"
    share = 1 / len(TEMPERATURES)
    for name in TEMPERATURES:
        away = {one: (one == name) - share for one in TEMPERATURES}
        yield FROM_THE_MEAN.of(of=f"{name} less the mean"), away, 0.0, 2 * THERMOMETER_ZERO, "K"


def _check_zeros(run: Run) -> None:
    """Check each transducer whose true value is known in this state."""
    zeros = [zero for zero in _zeros(run.rig, run.bench.has) if run.can(zero[0], needs=zero[1])]
    mean = run.bench.averages(
        *dict.fromkeys(name for _, sum_of, *_ in zeros for name in sum_of), over=READ_OVER
    )
    for title, sum_of, expected, tolerance, unit in zeros:
        value = partial(_zero, sum_of, (title, expected) if title in bearing(run.rig) else None)
        zero = run.measured(value, run.rig, mean, over=READ_OVER, themselves=True)
        check_band(run, title, zero, unit, Band(expected - ROOM * tolerance, expected + ROOM * tolerance))


def _zero(
    sum_of: Mapping[str, float], cell: tuple[str, float] | None, rig: Rig, read: Mapping[str, float]
) -> float:
    """Return the sum of readings with the weights ``sum_of``.

    ``cell`` is a load cell under the bolster, with its expected load (N). The rest load minus this load is subtracted
    from the sum.
    """
    more = rest_load(rig, cell[0]) - cell[1] if cell else 0.0
    return sum(share * read[name] for name, share in sum_of.items()) - more


def _weigh(run: Run, mass: float) -> None:
    """Ask the operator to put a known ``mass`` (kg) on the bolster, and check how much the readings of the cells
    increase.
    """
    with run.phase("known mass"):
        cells = bearing(run.rig)
        before = run.bench.averages(*cells, over=READ_OVER)
        if run.confirm(f"Put {mass:g} kg on the bolster, over its middle.", OVER_MASS):
            run.bench.wait(STEP_WAIT)
            after = run.bench.averages(*cells, over=READ_OVER)

            def over_mass(rig: Rig, before: Mapping[str, float], after: Mapping[str, float]) -> float:
                more = {cell: np.asarray(after[cell] - before[cell]) for cell in cells}
                return float(upward_force(more, rig)) / (mass * rig["gravity"])

            found = run.measured(over_mass, run.rig, before, after, over=READ_OVER, themselves=True)
            check_band(run, OVER_MASS, found, "1", GAIN)
            if not run.confirm(f"Take the {mass:g} kg off the bolster again."):
                raise RigFault(
                    f"it was not confirmed that the {mass:g} kg and all hands are off the bolster, so it is not "
                    "loaded; repeat the run, and confirm it"
                )


def _steps(
    run: Run, names: Sequence[str], forces: Sequence[float], press: Callable[[Run, float], None]
) -> list[Mapping[str, float]]:
    """Apply each of the ``forces`` (N) with ``press``; return the mean readings of each step."""
    read: list[Mapping[str, float]] = []
    for force in forces:
        press(run, force)
        run.bench.wait(STEP_WAIT)
        read.append(run.bench.averages(*names, over=READ_OVER))
    return read


def _press(run: Run, force: float) -> None:
    run.bench.vertical.preload(force, RIGHT_SHARE * force, rate=PRESS_RATE, within=PRELOAD_WITHIN)


def _push(run: Run, force: float) -> None:
    run.bench.lateral.push(force, rate=PUSH_RATE, within=PRELOAD_WITHIN)


def _check_side(run: Run, side: str, read: Steps, dummy: Band) -> None:
    """Check one side: its cells against its actuator, and the stiffness of dummy and frame."""
    names = OVER_ACTUATOR.of(side=side), OFF_THE_LINE.of(side=side)
    _check_line(run, names, read, partial(_downward, side), GAIN)
    _check_stiffness(run, GIVES_WAY.of(side=side), partial(_stiffness, _dummy, side), read, dummy)
    frame = FRAME_GIVES_WAY.of(side=side)
    if run.can(frame, needs=("vertical_frame_stiffness",)):
        stated = within(run.rig["vertical_frame_stiffness"], FRAME_WITHIN)
        _check_stiffness(run, frame, partial(_stiffness, _frame, side), read, stated)
    _, pressed = _downward(side, run.rig, read)
    down = _dummy(side, run.rig, read)
    keep(run, side, "Dummy: way over force", ("force", "kN"), ("way", "mm"), pressed.tolist(), down.tolist())


def _check_stiffness(run: Run, name: str, stiffness: Callable[..., float], read: Steps, band: Band) -> None:
    found = run.measured(stiffness, run.rig, *read, over=READ_OVER, themselves=True)
    check_band(run, name, found, "MN/m", band)


def _check_line(
    run: Run,
    names: tuple[CheckName, CheckName],
    read: Steps,
    forces: Callable[[Rig, Steps], Forces],
    gain: Band,
) -> None:
    """Check the slope of the load cells' readings over the applied force, and their deviation from a straight line."""

    def line(rig: Rig, *means: Mapping[str, float]) -> tuple[float, float]:
        applied, cells = forces(rig, means)
        level, slope = straight_line(applied, cells)
        away = cells - level - slope * (applied - applied.mean())
        return slope, float(np.abs(away).max() / np.ptp(applied))

    slope, bent = run.measure(line, run.rig, *read, over=READ_OVER, themselves=True)
    for name, found, unit, band in zip(names, (slope, bent), ("1", "%"), (gain, NONLINEAR), strict=True):
        check_band(run, name, found, unit, band)


def _sum(read: Steps, *names: str) -> Samples:
    return np.array([sum(one[name] for name in names) for one in read])


def _series(read: Steps) -> dict[str, Samples]:
    """Return the readings of all steps, by signal."""
    return {name: _sum(read, name) for name in read[0]}


def _downward(side: str, rig: Rig, read: Steps) -> Forces:
    """Return two series of the force on one side (N, downward): by the actuators, and by the cells."""
    values = _series(read)
    return pressed_on(values, rig, side), load_on(values, rig, side)


def _sideways(rig: Rig, read: Steps) -> Forces:
    """Return two series of the lateral force (N): by the actuator, and by the lateral cells."""
    return _sum(read, "lateral.force"), -sideways_force(_series(read), rig)


def _dummy(side: str, rig: Rig, read: Steps) -> Samples:
    """Return the compression (m) of the dummy under one side at each step."""
    return -height_of_spring(_series(read), rig, side)


def _frame(side: str, rig: Rig, read: Steps) -> Samples:
    """Return the deflection (m) of the frame under one side at each step: position of the bolster minus that of the
    piston.
    """
    values = _series(read)
    bolster = height_at(values, rig, side, rig[across(f"vertical_{side}")])
    return bolster - values[f"vertical_{side}.displacement"]


def _stiffness(
    way: Callable[[str, Rig, Steps], Samples], side: str, rig: Rig, *read: Mapping[str, float]
) -> float:
    """Return a stiffness (N/m) of one side: force of its actuators over the displacement ``way``, at most
    `STIFFEST`.
    """
    _, pressed = _downward(side, rig, read)
    compliance = straight_line(pressed, way(side, rig, read))[1]
    return min(1 / compliance if compliance > 0.0 else inf, STIFFEST)
