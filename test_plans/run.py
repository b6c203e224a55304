"""One execution of a plan: its measurements, checks and progress."""

from __future__ import annotations

import math
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Final, Protocol

from msgspec import to_builtins
from msgspec.structs import replace

from bench_protocol.dimensions import UNKNOWN as NO_DIMENSIONS
from bench_protocol.dimensions import Dimensions
from bench_protocol.units import FACTORS, NS, minutes
from bench_records.curves import curve
from bench_records.layout import RecordedEvent, RecordError
from bench_records.result import MARGIN, unavailable
from bench_records.result import check as judged
from test_plans.analysis.uncertainty import Captured, Evaluation, Exact, Measured, measured
from test_plans.asking import Aborted, NotInTime, answer_to
from test_plans.check_names import about
from test_plans.description import Description, is_dimension, stamps_of
from test_plans.driven import Driven
from test_plans.holding import can_still_be_held
from test_plans.instruments import UNKNOWN, Instruments
from test_plans.operator import DONE, NOT_POSSIBLE, NoOperator, Operator, Question, Unanswered
from test_plans.parameters import Value
from test_plans.specimen import Specimen, ordinary
from test_plans.suspension import HOLD_WITHIN, Suspension

if TYPE_CHECKING:
    from bench_records.curves import Axis, Curve
    from bench_records.layout import Condition
    from bench_records.result import Check
    from drivers.bench import Bench
    from test_plans.loads import Band
from bench_records.twin import Deviation


class TwinState(Protocol):
    """What a plan can read of the twin. Reads return the present state; in real time they never wait for the model."""

    @property
    def watching(self) -> bool:
        """Whether a twin watches this run."""

    @property
    def deviation(self) -> Deviation | None:
        """The present deviation of rig and model; None if they agree or there is no twin."""


class NoTwin:
    """The state of a run without a twin."""

    watching = False
    deviation: Deviation | None = None
    parted = deviation  # the old name, for one release


#: Signal that counts the ticks that began more than one period after their deadline.
LATE_TICKS: Final = "rig.late_ticks"
#: Why a plain number has no uncertainty.
PLAIN: Final = "the plan states none"


class PlanError(Exception):
    """Raised for an error in the code of a plan. The text names the plan and the missing part."""


class Watcher(Protocol):
    """Receiver of the progress of a run, for example a progress bar or a log."""

    def say(self, text: str) -> None:
        """Receive a note on the present step of the plan."""

    def phase(self, path: tuple[str, ...], *, begins: bool) -> None:
        """Receive the start or end of a phase; ``path`` are the open phases, outermost first."""

    def progress(self, fraction: float) -> None:
        """Receive the completed fraction of the plan (0 to 1)."""

    def checked(self, check: Check) -> None:
        """Receive a check with its verdict."""


class EventLog(Protocol):
    """The receiver of the events of a run."""

    def event(self, time: int, kind: str, text: str, **data: Any) -> None:
        """Store an event that happened at ``time`` (ns). Raises RecordError if that fails."""


class NullWatcher:
    """Watcher that ignores all calls."""

    def say(self, text: str) -> None:
        pass

    def phase(self, path: tuple[str, ...], *, begins: bool) -> None:
        pass

    def progress(self, fraction: float) -> None:
        pass

    def checked(self, check: Check) -> None:
        pass


class SafeWatcher:
    """Forwards calls to a watcher until a call fails, and ignores further calls. A watcher must not prevent the
    tear-down of a run.
    """

    def __init__(self, watcher: Watcher) -> None:
        self._watcher = watcher

    def say(self, text: str) -> None:
        self._forward(lambda watcher: watcher.say(text))

    def phase(self, path: tuple[str, ...], *, begins: bool) -> None:
        self._forward(lambda watcher: watcher.phase(path, begins=begins))

    def progress(self, fraction: float) -> None:
        self._forward(lambda watcher: watcher.progress(fraction))

    def checked(self, check: Check) -> None:
        self._forward(lambda watcher: watcher.checked(check))

    def _forward(self, call: Callable[[Watcher], None]) -> None:
        try:
            call(self._watcher)
        except (Exception, SystemExit):  # rich raises SystemExit on a broken pipe
            self._watcher = NullWatcher()


@dataclass(slots=True)
class Run:
    """One execution of a plan: the bench, the specimen on it, and all results."""

    bench: Bench
    log: EventLog
    watcher: Watcher = field(default_factory=NullWatcher)
    lasts: float = 0.0
    specimen: Specimen = field(default_factory=ordinary)
    operator: Operator = field(default_factory=NoOperator)
    instruments: Instruments = UNKNOWN
    dimensions: Dimensions = NO_DIMENSIONS
    suspension: Suspension = field(default_factory=Suspension)
    values: Mapping[str, Value] = field(default_factory=dict)  #: of the plan's parameters (SI)
    judges: bool = True  #: as the plan
    twin: TwinState = field(default_factory=NoTwin)  #: the model that runs in parallel, if any
    held: list[tuple[int, int]] = field(default_factory=list)  #: start and end of each hold (ns)
    preconditions: list[Condition] = field(default_factory=list)
    warnings: list[str] = field(default_factory=list)  #: shown with the result
    checks: list[Check] = field(default_factory=list)
    curves: list[Curve] = field(default_factory=list)
    phases: list[RecordedEvent] = field(default_factory=list)  #: start and end of each
    driven: list[Driven] = field(default_factory=list)  #: waves under amplitude control
    disturbed: dict[str, int] = field(default_factory=dict)  #: late ticks during the measurement, by check
    #: Parts of the plan that follow the present one; None outside the execution of a plan.
    to_come: Sequence[Any] | None = None
    _announced_hold: str = ""
    _in_hold: bool = False
    _open: list[str] = field(default_factory=list)
    #: Late ticks that the rig had counted when each open phase began, and when the last phase began.
    _late_at_begin: list[float] = field(default_factory=list)
    _late_at_last: float = math.nan
    start: int = field(init=False)  #: ns of the bench's clock
    rig: Description = field(init=False)  #: its dimensions by name (SI)

    def __post_init__(self) -> None:
        self.start = self.now
        self.rig = Description(self.bench.wiring.rig, self.dimensions)

    def check(
        self,
        name: str,
        value: float | Measured,
        unit: str,
        *,
        low: float | None = None,
        high: float | None = None,
        margin: float | None = None,
        note: str = "",
        since: int | None = None,
    ) -> bool:
        """Judge ``value`` by its limits (SI), record the check, and return whether it passed. The plan continues.

        A `CheckName` as ``name`` adds a sentence that explains the measured quantity. A value with an uncertainty U
        passes if its probability of conformity is high enough. It is *marginal* if it is within the limits with a lower
        probability (see `judged`). A value without U is *marginal* within ``margin`` (a fraction of the band) of a
        limit, unless it is `Exact`. A check is *not available* if U exceeds half the width of the limits and value ± U
        reaches into them, or if a hold began after the time ``since`` (ns). ``unit`` is the display unit.

        Raises PlanError for an undeclared unit, and ValueError for limits that no value can break or meet.
        """
        if unit not in FACTORS:
            raise PlanError(f"check {name!r}: unit {unit!r} is unknown; use one of {', '.join(FACTORS)}")
        if since is not None and any(begun >= since for begun, _ in self.held):
            self.not_available([name], "the run was held while it was measured")
            return False
        if late := self._late_ticks_since_begin():
            self.disturbed[str(name)] = late
            note = "; ".join(filter(None, (note, f"late ticks during the measurement: {late}")))
        found = value if isinstance(value, Measured) else Measured(value, unknown=PLAIN)
        if found.expanded is not None and low is not None and high is not None:
            U, width = found.expanded, high - low
            # With this U even the middle of the band could not pass. A value outside by more than U still fails.
            if width < 2 * U and low - U <= found.value <= high + U:
                shown = [f"{one / FACTORS[unit]:.3g} {unit}" for one in (found.value, U, width)]
                reason = "{} ± {} cannot be judged: the limits are only {} wide".format(*shown)
                self.not_available([name], reason)
                return False
        if margin is None:
            margin = 0.0 if isinstance(found, Exact) else MARGIN
        one = judged(
            str(name),
            found.value,
            "" if unit == "1" else unit,
            FACTORS[unit],
            low=low,
            high=high,
            margin=margin,
            phase=self._open[-1] if self._open else "",
            note=note,
            u=found.u,
            even=found.even,
            parts=found.parts,
            at=(self.now - self.start) / NS,
            without=found.unknown,
            about=about(name),
        )
        self._store_check(one, name)
        return one.passed

    def measured(self, evaluate: Evaluation, *captures: Captured, **how: Any) -> Measured:
        """Return the value that ``evaluate(*captures)`` computes from readings, with its uncertainty.

        See `uncertainty.measured`; this is for an evaluation with one value. The instruments are those of the rig. If
        the evaluation needs dimensions of the rig, pass ``run.rig`` as a capture, because dimensions are uncertain too.
        """
        (one,) = self.measure(evaluate, *captures, **how)
        return one

    def measure(
        self, evaluate: Evaluation, *captures: Captured, over: float = 0.0, **how: Any
    ) -> tuple[Measured, ...]:
        """Return the values that ``evaluate(*captures)`` computes from readings, each with its uncertainty.

        If the readings are means, ``over`` is their averaging time (s); the number of samples follows from the receive
        rates.
        """
        came = self.bench.receiver.rates
        if over:
            how["averaged"] = {name: max(round(hertz * over), 1) for name, hertz in came.items()}
        stamps = stamps_of(self.bench)
        return measured(evaluate, *captures, instruments=self.instruments, came=came, stamps=stamps, **how)

    def can(self, *checks: str, needs: Iterable[str]) -> bool:
        """Return whether the rig has everything that ``checks`` need. If not, record these checks as *not available*.

        ``needs`` are names of signals and dimensions. Call this before any motion that only these checks require, and
        skip the motion if it returns False.
        """
        if lacking := self.lacks(*needs):
            self.not_available(checks, lacking)
        return not lacking

    def lacks(self, *needs: str) -> str:
        """Return a text that names the missing signals and dimensions; "" if the rig has all."""
        texts = (
            self.bench.lacks(*(name for name in needs if not is_dimension(name))),
            self.rig.lacks(*filter(is_dimension, needs)),
        )
        return "; ".join(filter(None, texts))

    def hold_point(self, where: str) -> bool:
        """Hold the run here, between two measurements, if a hold was requested. Return whether it was held.

        During the hold all valves are shut, and set-points are still sent. The plan must restore the state of the gas
        afterwards (`steps.restore_state`). Raises HeldTooLong if the hold is not released in time.
        """
        if not (by := self.suspension.wanted_by):
            self._look_for_hold_points()
            return False
        start, self._announced_hold, self._in_hold = self.now, by, True
        try:
            with self.phase(f"held {where}"):
                self.say(
                    f"held {where}, on request of {by}: the valves are shut, and the actuators do not move"
                )
                self.suspension.hold(self, where, HOLD_WITHIN)
                self.say(f"continues after {(self.now - start) / NS:.0f} s")
        finally:
            self._in_hold = False
        self.held.append((start, self.now))
        self._announced_hold = ""
        self._look_for_hold_points()
        return True

    def _look_for_hold_points(self) -> None:
        """Cancel a requested hold if the plan has no hold point left."""
        if self.to_come is None or self._in_hold:
            return
        self.suspension.left = can_still_be_held(sys._getframe(1), self.to_come)
        if not self.suspension.left and (by := self.suspension.wanted_by):
            self.suspension.resume()
            self.say(
                f"{by} requested a hold, but this plan has no further hold point: it continues to its end"
            )

    def not_available(self, checks: Iterable[str], reason: str) -> None:
        """Record ``checks`` as *not available*, with the ``reason``."""
        for name in checks:
            phase = self._open[-1] if self._open else ""
            one = unavailable(str(name), reason, phase=phase, about=about(name))
            self._store_check(one, name)

    lack = not_available  # the old name, for one release

    def _store_check(self, one: Check, name: str) -> None:
        if requirement := self.specimen.requirement(name):
            one = replace(one, requirement=requirement)
        self.checks.append(one)
        # The complete check is kept, because a killed run has a record but no result.
        self.keep("check", str(one), verdict=one.verdict.value, whole=to_builtins(one))
        self.watcher.checked(one)

    def ask(
        self,
        question: str,
        answers: Iterable[str] = (DONE, NOT_POSSIBLE),
        *,
        within: float = 10 * minutes,
        deed: str = "",
        checks: Iterable[str] = (),
    ) -> str:
        """Ask the operator, and return the answer. If no one answers in time, return "" and record ``checks`` as *not
        available*.

        The bench is commanded and monitored during the wait. ``within`` (s) limits the wait. ``deed`` names the action
        that a simulated rig can perform without an operator (`Question`). The answer *abort* ends the run.
        """
        prompt = Question(question, tuple(answers), within, deed)
        try:
            return answer_to(self, prompt).text
        except Unanswered as reason:
            self.not_available(checks, str(reason))
            return ""

    def confirm(self, what: str, *checks: str, within: float = 10 * minutes, deed: str = "") -> bool:
        """Ask the operator to do ``what``, and return whether it was done. If not, record ``checks`` as *not
        available*.

        Call this before any motion that only these checks require, and skip the motion if it returns False. If the
        operator does not answer in time, a person may be at work on the rig: the run ends (Aborted).
        """
        try:
            answer = answer_to(self, Question(what, (DONE, NOT_POSSIBLE), within, deed)).text
        except NotInTime as reason:
            raise Aborted(f"{reason}; a person may be at the rig, so it does not move") from None
        except Unanswered as reason:
            self.not_available(checks, str(reason))
            return False
        if answer == NOT_POSSIBLE:
            self.not_available(checks, f"{what}: the operator answered {NOT_POSSIBLE!r}")
        return answer == DONE

    @contextmanager
    def phase(self, name: str) -> Iterator[None]:
        """Give the block a name as a phase of the run, and record its start and end. Phases may be nested."""
        self._open.append(name)
        self._late_at_last = self.bench.readings.glimpse(LATE_TICKS)
        self._late_at_begin.append(self._late_at_last)
        self._edge(name, "begin")
        self.watcher.phase(tuple(self._open), begins=True)
        self._look_for_hold_points()
        if (by := self.suspension.wanted_by) and not self.suspension.held_at and by != self._announced_hold:
            self._announced_hold = by
            self.say(f"{by} requests a hold: the plan continues to its next hold point")
        if self.lasts:
            self.progress((self.now - self.start) / NS / self.lasts)
        try:
            yield
        finally:
            self._edge(name, "end")
            self._open.pop()
            self._late_at_begin.pop()
            self.watcher.phase(tuple(self._open), begins=False)

    def _late_ticks_since_begin(self) -> int:
        """Return the number of late ticks since the start of the innermost open phase. Without an open phase, count
        from the start of the last one.

        0 if the rig does not count them.
        """
        begin = self._late_at_begin[-1] if self._late_at_begin else self._late_at_last
        if math.isnan(begin):
            return 0
        late = self.bench.readings.glimpse(LATE_TICKS) - begin
        return max(round(late), 0) if math.isfinite(late) else 0

    def _edge(self, name: str, edge: str) -> None:
        self.phases.append(RecordedEvent(self.now, "phase", name, {"edge": edge}))
        self.keep("phase", name, edge=edge)

    def loop(
        self, name: str, x: Axis, y: Axis, xs: Iterable[float], ys: Iterable[float], *, group: str = ""
    ) -> None:
        """Store a closed curve of ``ys`` over ``xs`` (SI) for the report."""
        self.curves.append(curve(name, x, y, xs, ys, kind="loop", group=group))

    def curve(
        self,
        name: str,
        x: Axis,
        y: Axis,
        xs: Iterable[float],
        ys: Iterable[float | Measured],
        *,
        group: str = "",
        limits: Iterable[Band] = (),
    ) -> None:
        """Store a table of a few points, ``ys`` over ``xs`` (SI), for the report. ``limits`` are those of each point,
        if any.

        The table includes the uncertainties of `Measured` values.
        """
        pairs, points = [(band.low, band.high) for band in limits], list(ys)
        numbers = [float(one) for one in points]
        expanded = [one.expanded if isinstance(one, Measured) else None for one in points]
        known = expanded if any(one is not None for one in expanded) else ()
        one = curve(name, x, y, xs, numbers, kind="sweep", group=group, limits=pairs, expanded=known)
        self.curves.append(one)

    def say(self, text: str) -> None:
        """Send a note to the watcher, and write it to the record."""
        self.keep("note", text)
        self.follow(text)

    def warn(self, text: str) -> None:
        """Send a warning to the watcher, and add it to the record and the result."""
        self.warnings.append(text)
        self.say(text)

    def follow(self, text: str) -> None:
        """Send a note to the watcher only."""
        self.watcher.say(text)

    def keep(self, kind: str, text: str, **data: Any) -> None:
        """Write an event of a ``kind`` to the record.

        A disk error is not raised here, because it must not prevent the tear-down. The record reports it when it is
        closed.
        """
        with suppress(RecordError):
            self.log.event(self.now, kind, text, **data)

    def progress(self, fraction: float) -> None:
        """Send the completed fraction of the plan (0 to 1) to the watcher."""
        self.watcher.progress(min(max(fraction, 0.0), 1.0))

    @property
    def now(self) -> int:
        """The time of the bench's clock (ns)."""
        return self.bench.clock.now()
