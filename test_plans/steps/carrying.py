"""Steps to load the air springs, to keep the load, and to vent the springs."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from math import nan
from typing import TYPE_CHECKING, Final, TypeVar

from bench_protocol.rates import DISABLE_AFTER
from bench_protocol.units import K, bar, kN, minutes, mm, s
from bench_protocol.words import LIVE_STATES, SIDES
from drivers.errors import TRY_AGAIN, BenchTimeout, NotAvailable, Refused, RigFault
from test_plans.air_left import RESIDUAL_PRESSURE, springs_are_empty, zeros_off
from test_plans.analysis import CHAMBERS, HEIGHTS
from test_plans.analysis.geometry import WEIGHT
from test_plans.loads import Load
from test_plans.preconditions import HEADROOM

if TYPE_CHECKING:
    from test_plans.run import Run

T = TypeVar("T")

#: Signals that the steps to load, hold and vent need; without one of these they cannot begin.
CARRYING: Final = (
    *HEIGHTS,
    *(f"{side}.bellows_pressure" for side in SIDES),
    *(f"air.{side}_{what}" for side in SIDES for what in ("mode", "target")),
    "vertical.control",
    *(f"vertical_{side}.{quantity}" for side in SIDES for quantity in ("force", "displacement")),
    *(f"vertical_{side}.{quantity}_setpoint" for side in SIDES for quantity in ("force", "displacement")),
    *WEIGHT,
)
#: Signals that hold the bolster sideways, or release it so that it moves sideways without force.
HELD_SIDEWAYS: Final = ("lateral.control", "lateral.displacement", "lateral.displacement_setpoint")
FREE_SIDEWAYS: Final = ("lateral.control", "lateral.force", "lateral.force_setpoint")
#: Valves between each bellows and its auxiliary chamber; all air of a spring flows through this chamber.
CHAMBER_VALVES: Final = tuple(f"air.{side}_reservoir" for side in SIDES)
OPEN: Final = 1.0
ARM_WITHIN: Final = 10 * s
LIFT_RATE: Final = 40 * mm / s
FILL_WITHIN: Final = 60 * s
#: Within this pressure difference below their target, the valves close in proportion.
FILL_BEYOND: Final = 0.15 * bar
PRELOAD_RATE: Final = 20 * kN / s
PRELOAD_WITHIN: Final = 10 * s
#: Leveled: both heights are within the dead zone of their valves for this time.
LEVEL_STEADY: Final = 1 * s
LEVEL_WITHIN: Final = 20 * s
#: Steady: the gas temperature stays within this band for 1 s. It still falls by up to 30 K, which changes no result of
#: the stiffness plans by 2 %.
SETTLE_BAND: Final = 2.0 * K
SETTLE_WITHIN: Final = 30 * s
#: Settle time of the gas on a rig without a gas temperature.
SETTLE_UNSEEN: Final = 15 * s
AVERAGE_OVER: Final = 1 * s
KEEP_AVERAGE: Final = 0.4 * s
KEEP_TOLERANCE: Final = 0.1 * bar
LATERAL_RATE: Final = 2 * kN / s
#: Step of the preloads.
SHIM: Final = 0.5 * kN

VENT_WITHIN: Final = 3 * minutes
NOT_EMPTY: Final = "the springs are not known to be empty"
LOOK_AGAIN: Final = 0.5 * s
#: Twice the time that the safe position needs to vent 7 bar.
LET_OFF_WITHIN: Final = DISABLE_AFTER + 20 * s


def power_up(run: Run) -> None:
    """Bring the bench to the state ACTIVE, and open the valves between the chambers and the differential pressure
    valve.
    """
    with run.phase("power up"):
        run.bench.arm(within=ARM_WITHIN)
        join(run, *CHAMBER_VALVES)
        try:
            join(run, "air.dpv")
        except NotAvailable as lacking:
            run.say(f"{lacking}; it stays so")


def join(run: Run, *valves: str) -> None:
    """Open those of the ``valves`` that are not known to be open. At the start of a rig their state is unknown."""
    settings = run.bench.settings
    shut = [name for name in valves if run.bench.has(name) and settings.known(name) != OPEN]
    settings.write(dict.fromkeys(shut, OPEN))


def make_safe(run: Run) -> None:
    """Stop all motion, vent the springs and disarm the bench. Each step is tried even if the previous one failed."""
    try:  # nested, so that each error keeps the one before as its context
        if run.bench.has("rig.program"):
            run.bench.generator.stop()
    finally:
        try:
            run.bench.waveform.stop()
        finally:
            try:
                depressurise(run)
            finally:
                run.bench.disarm()


def depressurise(run: Run) -> None:
    """Vent both springs while they carry their load, so that nothing jumps. In a fault state, wait until the bench has
    vented them by itself.

    Raises RigFault if the springs still hold air, or if their pressure is unknown.
    """
    bench = run.bench
    with run.phase("depressurise"):
        if bench.rig.state in LIVE_STATES:
            if bench.vertical.control != "force":
                bench.vertical.control = "force"
            join(run, *CHAMBER_VALVES)
            bench.air.vent(tolerance=RESIDUAL_PRESSURE, within=VENT_WITHIN)
            if off := zeros_off(bench):
                run.warn(off)
            return
        if not springs_are_empty(bench):
            with bench.despite_faults(), suppress(BenchTimeout):
                if bench.wiring.sequences.air.get(bench.state) == "shut in":
                    bench.disarm()  # disarming leads from a fault with shut valves to the safe position
                if bench.wiring.sequences.air.get(bench.state) == "let off":
                    bench.wait_for(
                        lambda: springs_are_empty(bench),
                        within=LET_OFF_WITHIN,
                        what="both springs without air",
                    )
        if not springs_are_empty(bench) and not zeros_off(bench):
            raise RigFault(f"{NOT_EMPTY}: {bench.describe()}; {TRY_AGAIN}")


def carry(load: str | Load) -> Callable[[Run], None]:
    """Return a set-up after which both springs carry ``load`` (a load case or its name) on their leveling valves.

    It ends when the temperature of the gas is steady to 2 K over 1 s. The gas can still be 30 K warmer than the walls.
    The leveling valves compensate the pressure loss by cooling. Without them the bolster would sink by 9 mm in 60 s
    after filling to AW0. So a plan that shuts the valves waits first, as `leak_down` does.
    """

    def set_up(run: Run) -> None:
        carried = run.specimen.load(load) if isinstance(load, str) else load
        shim(run, carried)
        power_up(run)
        raise_the_air(run, carried)
        level_to_the_preload(run, carried)

    return set_up


def carry_load(run: Run, load: str) -> None:
    """Make both springs carry ``load``, a load case that is a parameter of the plan."""
    carry(load)(run)


def part_of(run: Run, name: str, part: float) -> Load:
    """Return a load case with ``part`` times the preload of load case ``name``, rounded to `SHIM`."""
    return run.specimen.load_of(name, round(part * run.specimen.load(name).preload / SHIM) * SHIM)


def shim(run: Run, load: Load) -> None:
    """Set the zero of the heights for this load. It depends on the load, because the emergency springs deflect 15 mm
    between empty and full car.
    """
    with run.phase("shim"):
        if lacking := run.bench.lacks("rig.nominal_preload"):
            run.say(f"{lacking}; its heights must have been set to zero for {load.name}")
        else:
            once_let_go(run, lambda: setattr(run.bench.rig, "nominal_preload", load.preload))


def once_let_go(run: Run, change: Callable[[], None]) -> None:
    """Call ``change``, which is possible only with vented springs and released actuators. If the bench is going there,
    wait.
    """
    bench = run.bench
    deadline, reported = bench.now + LET_OFF_WITHIN, False
    while True:
        try:
            change()
        except Refused as refused:
            if bench.state not in bench.wiring.sequences.at_rest or bench.now >= deadline:
                raise
            if not reported:
                run.say(f"waiting until the springs are empty and the actuators are released: {refused}")
            reported = True
        else:
            return
        bench.wait(LOOK_AGAIN)


def raise_the_air(run: Run, load: Load) -> None:
    """Lift the bolster to design height and fill both springs to the pressure for the load."""
    bench = run.bench
    with run.phase("raise the air"):
        # At design height the springs need no further travel to take over the load.
        bench.vertical.move_to(0.0, 0.0, rate=LIFT_RATE)
        # The target is above the pressure, so that it is reached early; the leveling valves correct the rest.
        with _reached(run), _supplied(run, load.fill_pressure):
            bench.air.fill(to=load.fill_pressure + FILL_BEYOND, tolerance=FILL_BEYOND, within=FILL_WITHIN)


def level_to_the_preload(run: Run, load: Load) -> None:
    """Switch the springs to their leveling valves, load them, and wait until the gas temperature is steady to 2 K."""
    bench = run.bench
    with run.phase("level to the preload"):
        bench.air.level()
        force = load.actuator_force(run.rig)
        with _reached(run):
            bench.vertical.preload(force, force, rate=PRELOAD_RATE, within=PRELOAD_WITHIN)
        rest = run.specimen.limits.band("rest_height")
        with _supplied(run, load.fill_pressure):
            bench.wait_for(
                lambda: all(height in rest for height in (bench.left.height, bench.right.height)),
                within=LEVEL_WITHIN,
                what="both springs leveled",
                steady=LEVEL_STEADY,
            )
    with run.phase("settle"):
        gas = [f"{side}.{chamber}_temperature" for side in SIDES for chamber in CHAMBERS]
        seen = [name for name in gas if bench.has(name)]
        if lacking := bench.lacks(*gas):
            followed = f"only {', '.join(seen)} shows whether the gas has settled"
            run.say(f"{lacking}; {followed if seen else f'the gas is given {SETTLE_UNSEEN:g} s to settle'}")
        if seen:
            bench.settle(*seen, band=SETTLE_BAND, over=AVERAGE_OVER, within=SETTLE_WITHIN)
        else:
            bench.wait(SETTLE_UNSEEN)


@contextmanager
def _reached(run: Run) -> Iterator[None]:
    """Handle a timeout in the block: a force or pressure has not reached its set-point. A plan with a verdict ends;
    other plans warn and continue.

    Plans without a verdict search for faults, and the transducer may be faulty.
    """
    try:
        yield
    except BenchTimeout as late:
        if run.judges:
            raise
        run.warn(f"{late}; the plan continued, because a transducer may be the cause")


@contextmanager
def _supplied(run: Run, pressure: float) -> Iterator[None]:
    """If the block times out and the air supply is below the required ``pressure`` (Pa gauge), raise RigFault with this
    cause.
    """
    try:
        yield
    except BenchTimeout as late:
        has = run.bench.readings.value_or_nan("supply.pressure") if run.bench.has("supply.pressure") else nan
        if not has < pressure:
            raise
        remedy = f"open the supply until it has {(pressure + HEADROOM) / bar:.4g} bar"
        raise RigFault(f"{late}; the supply pressure is {has / bar:.2f} bar; {remedy}") from late


def hold_the_height(run: Run) -> None:
    """Hold the bolster at its present height, and refill the pressure that is lost by cooling."""
    bench = run.bench
    with run.phase("hold the height"):
        bench.vertical.hold_position()
        if lacking := bench.lacks(*HELD_SIDEWAYS):
            run.say(f"{lacking}; the lateral position of the bolster is not changed")
        else:
            bench.lateral.hold_position()
        # The valves control the pressure of the auxiliary chambers, so each side keeps its present auxiliary pressure.
        names = [f"{side}.auxiliary_pressure" for side in SIDES]
        if lacking := bench.lacks(*names):
            run.say(f"{lacking}; at rest the bellows have the same pressure")
            names = [f"{side}.bellows_pressure" for side in SIDES]
        left, right = bench.averages(*names, over=KEEP_AVERAGE).values()
        with _reached(run), _supplied(run, max(left, right)):
            bench.air.fill(left=left, right=right, tolerance=KEEP_TOLERANCE)


def restore_state(run: Run, load: Load, hold: Callable[[Run], T], cool: float = 0.0) -> T:
    """Restore the springs after a pause of the run: level them, wait, and shut the valves if they were shut before.

    ``hold`` is the function by which the plan holds the height; its result is returned. After ``hold`` the gas cools
    for ``cool`` s.
    """
    locked = run.bench.air.left_mode == "hold"
    with run.phase("stand again"):
        level_to_the_preload(run, load)
        found = hold(run)
        run.bench.wait(cool)
        if locked:
            lock_the_air(run)
    return found


def lock_the_air(run: Run) -> None:
    """Shut all valves, so that the springs keep their air."""
    with run.phase("lock the air"):
        run.bench.air.hold()


def free_the_bolster(run: Run) -> None:
    """Release the bolster: the vertical actuators change from position control to the constant force that they exert at
    that moment, and the lateral actuator to zero force.
    """
    bench = run.bench
    with run.phase("free the bolster"):
        bench.vertical.control = "force"
        if lacking := bench.lacks(*FREE_SIDEWAYS):
            run.say(f"{lacking}; the bolster stays held in its lateral position")
        else:
            bench.lateral.push(0.0, rate=LATERAL_RATE)
