"""Safety: reaction times of the bench to the loss of its commander or air supply, and to the emergency stop."""

from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import AbstractContextManager, ExitStack, contextmanager, suppress
from functools import partial
from typing import Final

import numpy as np

from bench_protocol.rates import COMMAND_RATE, DISABLE_AFTER, HOLD_AFTER
from bench_protocol.units import NS, bar, kN, minutes, mm, ms, s
from bench_protocol.words import FAULT_STATES, SIDES, STATES
from drivers.errors import BenchTimeout
from drivers.receiver import Capture
from test_plans import steps
from test_plans.air_left import RESIDUAL_PRESSURE
from test_plans.analysis import HEIGHTS, Samples
from test_plans.analysis.uncertainty import EVEN, SAMPLING, Measured, timed, yes_or_no
from test_plans.check_names import CheckName
from test_plans.loads import AW0
from test_plans.operator import DONE, Question, Unanswered
from test_plans.plan import plan
from test_plans.preconditions import load_cases, supply_for
from test_plans.run import Run
from test_plans.steps.air import AVERAGED

BELLOWS: Final = tuple(f"{side}.bellows_pressure" for side in SIDES)
FORCES: Final = tuple(f"vertical_{side}.force" for side in SIDES)
READ: Final = ("rig.state", *BELLOWS, *FORCES, *HEIGHTS)
#: Between two set-points, and between two words of the rig's state.
CYCLE: Final = 1 / COMMAND_RATE
OF_A_CYCLE: Final = 0.5 * EVEN * CYCLE
#: Additional time: one cycle of the set-points, one of the reported state, and the transmission of both.
TELLING: Final = 2 * CYCLE + 10 * ms
#: The rig's own watchdog for its settings, and its word for how long the safe position takes.
SETTINGS_AFTER: Final = 1 * s
SAFE_AFTER: Final = 15 * s
#: An operator presses first and answers then.
ESTOP_AFTER: Final = 0.1 * s
#: Observation beyond the allowed time, to measure the excess.
LONGER: Final = 3 * s
#: After a silence of this length the state of the signal is unknown.
UNSEEN: Final = 1 * s
LET_GO: Final = 2 * kN
THROWN: Final = 8 * mm
#: The gas of a filling cools before it is weighed.
COOL: Final = 20 * s
HOLD: Final = 15 * s
NO_SUPPLY: Final = 1 * bar
SUPPLY_WITHIN: Final = 1 * minutes
UNDO_WITHIN: Final = 5 * s
OFF_WITHIN: Final = 5 * s
#: The bench continues venting when it is disabled: below this the springs may be opened, for any error of the readings.
EMPTIED: Final = 0.5 * RESIDUAL_PRESSURE
EMPTY_WITHIN: Final = 10 * s
#: Threshold between 0 (no) and 1 (yes).
YES: Final = 0.5
HOLDING: Final = ("FAULT_REACTION", "FAULT_HOLD", "FAULT_DISABLED")
#: The checks of every transition to the safe position.
SAFE: Final = (
    CheckName(
        "{after}: springs without air after",
        "How long the springs keep their air after this event: until then keep out of the bench.",
    ),
    CheckName(
        "{after}: actuators let go after",
        "How long the actuators keep pressing after this event: a hand between them would be crushed.",
    ),
    CheckName(
        "{after}: the bolster rises by",
        "How far filled springs lift the bolster when the actuators release: 1200 kg must not jump.",
    ),
)
HOLDS: Final = CheckName(
    "{after}: holds",
    "How long the bench continues without its commander: in this time it moves without anybody being in control.",
)
DISABLED: Final = CheckName(
    "{after}: is disabled",
    "How long the bench waits for its commander before it releases "
    "everything by itself: the commander may never return.",
)
STAYS: Final = CheckName(
    "{after}: stays ACTIVE",
    "Whether the bench stays ACTIVE without an air supply: springs with closed valves must not need it.",
)
ACTS: Final = CheckName(
    "{after}: acts",
    "How long after the button is pressed the bench stops: it is the last means of a person to stop it.",
)
EMPTY: Final = CheckName(
    "pressure at the end",
    "The pressure that remains in the springs at the end of the test: the next person may open them.",
)
IS_OFF: Final = CheckName(
    "is off at the end",
    "Whether the bench can be switched off by command: otherwise it stays armed when everybody has left.",
)


def switch_off(run: Run) -> None:
    """Make the bench safe, switch it off, and check that it is off and without pressure."""
    with ExitStack() as last_first:
        last_first.callback(_check_off, run)
        last_first.callback(steps.make_safe, run)


@plan(
    teardown=switch_off,
    needs=(*steps.CARRYING, *READ),
    lasts=90 * s,
    requires=[load_cases(AW0), supply_for(AW0)],
    checks=(HOLDS, DISABLED, *SAFE, STAYS, steps.TIGHT, ACTS, EMPTY, IS_OFF),
)
def safety(run: Run) -> None:
    """Safety: loss of set-points, of the PLC settings, of the air supply, and the emergency stop; then power off.

    Before each test, the springs are filled to the pressure of the empty car. The actuators hold the bolster at design
    height, because it must not be thrown up. Then four events follow:

    * The set-points stop, as with a broken wire or a failed commander.
    * No message is written to the PLC any more.
    * The air supply is shut.
    * The emergency stop is pressed.

    The bench asks the operator to do the last two; a simulated rig does them by itself. At last the bench is switched
    off.

    The limits are those of the bench, for any specimen:

    * It holds 100 ms after the last set-point and disables itself after 500 ms.
    * It holds one second after the last message to the PLC.
    * Springs keep their air without a supply.
    * The emergency stop acts at once.
    * Each time the bench goes to its safe position, the springs are without pressure and the actuators are released
      within 15 s, and the bolster rises by at most 8 mm.
    * At the end, the bench is off and without pressure.

    An event that cannot be provoked is reported as not available.
    """
    _lose_the_setpoints(run)
    _lose_the_settings(run)
    _lose_the_supply(run)
    _press_the_stop(run)


Read = Mapping[str, Samples]


class Course:
    """The captured response of the bench to a provocation. Times count from ``since`` s after the start of the
    capture.
    """

    def __init__(self, capture: Capture, watched: float, since: float = 0.0) -> None:
        self._values = {name: capture.values(name) for name in READ}
        self._times = {name: capture.times(name) - since for name in READ}
        self._since, self._watched = since, watched

    def until_state(self, *states: str) -> float:
        """Return the time (s) until one of ``states``; the observed time if none was reached."""
        there = np.isin(self._values["rig.state"], [STATES.index(state) for state in states])
        return float(self._times["rig.state"][np.argmax(there)]) if there.any() else self._watched

    def until_small(self, names: Iterable[str], limit: float, read: Read | None = None) -> float:
        """Return the time (s) after which the magnitudes of all ``names`` stay within ``limit`` (SI). ``read`` replaces
        the captured readings.
        """
        return max(self._last_large(name, (read or self._values)[name], limit) for name in names)

    def rise(self, read: Read | None = None) -> float:
        """Return the rise (m) of the side that rises more; NaN if a height has gaps. ``read`` replaces the captured
        readings.
        """
        rises = []
        for name in HEIGHTS:
            values = (read or self._values)[name]
            rises.append(values.max() - values[0] if self._arrived_without_gaps(name) else np.nan)
        return float(np.max(rises))

    def measured(self, run: Run, evaluate: Callable[[Read], float]) -> Measured:
        """Return the result of ``evaluate`` on the readings, with its uncertainty."""
        return run.measured(evaluate, self._values, rate=self._rates)

    def _last_large(self, name: str, values: Samples, limit: float) -> float:
        if not self._arrived_without_gaps(name):
            return self._watched  # unknown
        times = self._times[name]
        large = np.flatnonzero(~(np.abs(values) <= limit))
        after = large[-1] + 1 if large.size else 0
        return 0.0 if not after else float(times[after]) if after < times.size else self._watched

    def _arrived_without_gaps(self, name: str) -> bool:
        """Return whether a reading arrived without gaps."""
        gaps = np.diff(self._times[name], prepend=-self._since, append=self._watched)
        return bool(np.all(gaps < UNSEEN))

    @property
    def _rates(self) -> dict[str, float]:
        """Number of samples per second of each reading; 1 for a reading with one sample or none."""
        return {
            name: (times.size - 1) / (times[-1] - times[0]) if times.size > 1 else 1.0
            for name, times in self._times.items()
        }


def _charge(run: Run) -> None:
    """Hold the bolster at design height, fill the springs, and shut them."""
    steps.power_up(run)
    steps.raise_the_air(run, run.specimen.load(AW0))
    steps.lock_the_air(run)


def _course(run: Run, provocation: AbstractContextManager[None], watched: float) -> Course:
    """Start a ``provocation``, and return the response of the bench in the next ``watched`` s."""
    bench = run.bench
    with bench.despite_faults(), bench.capture(*READ) as capture, provocation:
        bench.wait(watched)
    return Course(capture, watched)


def _supervised(run: Run, names: Iterable[str]) -> bool:
    """Return whether the rig has a watchdog that detects the loss of its commander.

    If not, record the checks ``names`` as not available.
    """
    known = run.bench.wiring.capabilities.watchdog
    if not known:
        run.not_available(
            names,
            f"the wiring of {run.bench.wiring.rig} does not state that the rig detects a silent commander",
        )
    return known


def _check_safe(run: Run, name: str, course: Course) -> None:
    """Check how the bench went to its safe position: the times until pressures and forces are gone, and the rise of the
    bolster.
    """
    for what, names, limit in ((SAFE[0], BELLOWS, RESIDUAL_PRESSURE), (SAFE[1], FORCES, LET_GO)):
        took = course.measured(run, partial(course.until_small, names, limit)).with_uncertainty(
            SAMPLING, OF_A_CYCLE, even=True
        )
        run.check(what.of(after=name), took, "s", high=SAFE_AFTER)
    run.check(SAFE[2].of(after=name), course.measured(run, course.rise), "mm", high=THROWN)


def _lose_the_setpoints(run: Run) -> None:
    name = "set-points lost"
    holds, disabled, *safe = (one.of(after=name) for one in (HOLDS, DISABLED, *SAFE))
    if not _supervised(run, [holds, disabled, *safe]):
        return
    _charge(run)
    with run.phase(name):
        course = _course(run, run.bench.silent("set-points"), SAFE_AFTER + LONGER)
        for what, states, after in (
            (holds, HOLDING, HOLD_AFTER),
            (disabled, ("FAULT_DISABLED",), DISABLE_AFTER),
        ):
            took = timed(course.until_state(*states), CYCLE, CYCLE)
            run.check(what, took, "ms", high=after + TELLING)
        _check_safe(run, name, course)


def _lose_the_settings(run: Run) -> None:
    name = "settings lost"
    holds, rises = (one.of(after=name) for one in (HOLDS, SAFE[-1]))
    if not _supervised(run, [holds, rises]):
        return
    _charge(run)
    with run.phase(name):
        course = _course(run, run.bench.silent("settings"), SETTINGS_AFTER + LONGER)
        run.check(
            holds, timed(course.until_state(*HOLDING), CYCLE, CYCLE), "s", high=SETTINGS_AFTER + TELLING
        )
        run.check(rises, course.measured(run, course.rise), "mm", high=THROWN)
        run.bench.reset()


def _lose_the_supply(run: Run) -> None:
    name, load = "supply lost", run.specimen.load(AW0)
    stays = STAYS.of(after=name)
    lost = [steps.TIGHT.of(f", {name}", side=side) for side in SIDES]
    if not run.can(stays, *lost, needs=("supply.pressure",)):
        return
    if not run.confirm("See to it that the supply of air is open", stays, *lost, deed="supply_loss off"):
        return
    _charge(run)
    with run.phase(name):
        bench = run.bench
        bench.wait(COOL)
        with _undone(run, "Open the supply of air again", "supply_loss off"):
            if not run.confirm(
                "Shut the supply of air and let the line off", stays, *lost, deed="supply_loss on"
            ):
                return
            bench.wait_for(
                lambda: bench.supply.pressure < NO_SUPPLY,
                within=SUPPLY_WITHIN,
                what="supply without pressure",
            )
            before = steps.weigh_the_air(run)
            bench.wait(HOLD)
            steps.check_tightness(run, load, before, at=f", {name}")
            run.check(stays, yes_or_no(bench.state == "ACTIVE"), "1", low=YES)
            run.ask("Open the supply of air again", (DONE,), deed="supply_loss off")


@contextmanager
def _undone(run: Run, what: str, deed: str) -> Iterator[None]:
    """If an error ends the block, undo the action ``deed`` on a simulated rig, because the rig continues to run."""
    try:
        yield
    except BaseException:
        if run.bench.hand is not None:
            with suppress(Unanswered):
                run.bench.hand.ask(Question(what, (DONE,), UNDO_WITHIN, deed))
                run.bench.hand.withdraw()
        raise


def _press_the_stop(run: Run) -> None:
    name = "emergency stop"
    names = [acts, *_] = [one.of(after=name) for one in (ACTS, *SAFE)]
    if not run.confirm("See to it that the emergency stop is released", *names, deed="estop off"):
        return
    _charge(run)
    bench, watched = run.bench, SAFE_AFTER + LONGER
    released = _undone(run, "Release the emergency stop", "estop off")
    with run.phase(name), bench.despite_faults(), released:
        # The operator confirms some time after pressing, when the springs may already be empty.
        with bench.capture(*READ) as capture:
            if not run.confirm("Press the emergency stop", *names, deed="estop on"):
                return
            answered = (bench.clock.now() - capture.start) / NS
            bench.wait(watched)
        pressed = Course(capture, answered + watched).until_state("ESTOP")
        run.check(acts, timed(max(0.0, pressed - answered), CYCLE), "ms", high=ESTOP_AFTER)
        _check_safe(run, name, Course(capture, watched, min(pressed, answered)))
        run.ask("Release the emergency stop", (DONE,), deed="estop off")


def _check_off(run: Run) -> None:
    """Check that the bench is off and its springs are without pressure."""
    bench = run.bench
    with run.phase("power off"), bench.despite_faults():
        if bench.state in FAULT_STATES:
            bench.reset()
        # Air that was vented fast is cold. Its pressure rises for a while as it warms, although the valves are open.
        with suppress(BenchTimeout):
            bench.wait_for(
                lambda: all(bench.readings.value(name) < EMPTIED for name in BELLOWS),
                within=EMPTY_WITHIN,
                what="the springs empty",
                steady=1 * s,
            )
        mean = bench.averages(*BELLOWS, over=steps.AVERAGE_OVER)
        highest = run.measured(lambda read: max(read[name] for name in BELLOWS), mean, averaged=AVERAGED)
        run.check(EMPTY, highest, "bar", high=RESIDUAL_PRESSURE)
        if not run.can(IS_OFF, needs=("action.power_off",)):
            return
        bench.action.power_off()
        with suppress(BenchTimeout):
            bench.wait_for(lambda: bench.state == "OFF", within=OFF_WITHIN, what="the bench off")
        run.check(IS_OFF, yes_or_no(bench.state == "OFF"), "1", low=YES)
