"""The model of a run in progress: it receives events in the run's thread, and returns snapshots to any other thread."""

from collections import Counter
from math import isnan, nan
from typing import TYPE_CHECKING, Final

from astb.live.outline import NONE, Follower, Outline
from astb.live.snapshot import LiveReading, Snapshot
from astb.rig_limits import ASSUMED, KnownLimit
from bench_protocol.units import NS
from bench_protocol.words import FAULT_STATES, LimitKind
from drivers.settings import UNKNOWN

if TYPE_CHECKING:
    from bench_records.result import Check, Result
    from drivers.bench import Bench
    from test_plans.operator import Question, QuestionBox
    from test_plans.suspension import Suspension

_ENDS: Final = (LimitKind.LOWER, LimitKind.UPPER)
#: Maximum number of reported checks, and their verdicts.
_FAILED_MAX: Final = 20
_FAILED: Final = ("fail", "error")
#: Signals that are shown in addition to the readings with limits.
_ALSO: Final = ("supply.pressure",)


class Live:
    """A run of ``plan`` on ``bench``: the plan's watcher, and the source of its snapshots.

    ``record`` is the directory of its record, ``limits`` are the known limits of the rig, ``outline`` are the steps of
    an earlier run. In ``box`` a question waits for its answer. ``suspension`` states whether the run is held,
    ``can_hold`` whether the plan has places to hold it. A snapshot sends no request to the rig: it uses the received
    values. The run's thread assigns whole values, and any other thread reads them.
    """

    def __init__(
        self,
        plan: str,
        bench: "Bench",
        *,
        rig: str = "",
        operator: str = "",
        record: str = "",
        limits: list[KnownLimit] | None = None,
        outline: Outline = NONE,
        box: "QuestionBox | None" = None,
        suspension: "Suspension | None" = None,
        can_hold: bool = True,
    ) -> None:
        self._plan, self._rig, self._by, self.bench = plan, rig, operator, bench
        self.can_hold = can_hold
        self._record = record
        self._limits: dict[str, list[KnownLimit]] = {}
        for one in limits or ():
            if one.limit.kind in _ENDS and bench.has(one.limit.signal):
                self._limits.setdefault(one.limit.signal, []).append(one)
        self._names = (*self._limits, *(name for name in _ALSO if bench.has(name)))
        self._follower, self._source = Follower(outline), outline.source
        self._box, self._suspension = box, suspension
        self._start = self._step_start = bench.clock.now()
        self._first: dict[str, float] = {}
        self._late_before = bench.readings.glimpse("rig.late_ticks")
        self._step: tuple[str, ...] = ()
        self._said = self._last_check = self._ended = ""
        self._fraction = 0.0
        self._next, self._counts = "", dict[str, int]()
        self._failed: tuple[str, ...] = ()

    # -- events of the run, in its thread --------------------------------------------------------------------------

    def say(self, text: str) -> None:
        """Record the present action of the plan."""
        self._said = text

    def phase(self, path: tuple[str, ...], *, begins: bool) -> None:
        """Record that the last phase of ``path`` begins or has ended.

        ``path`` are the names of the open phases, outermost first.
        """
        if begins:
            self._follower.begin(path[-1], len(path) - 1)
            self._step_start = self.bench.clock.now()
            self._next = self._follower.next
        self._step = path

    def progress(self, fraction: float) -> None:
        """Record the progress of the plan (0 to 1)."""
        self._fraction = fraction

    def checked(self, check: "Check") -> None:
        """Record a check and its verdict."""
        self._counts = dict(Counter(self._counts) + Counter([check.verdict.value]))
        self._last_check = str(check)
        if check.verdict.value in _FAILED:
            self._failed = (*self._failed, self._last_check)

    def conclude(self, result: "Result") -> None:
        """Record the verdict at the end of the run."""
        self._ended = result.verdict.value

    @property
    def time(self) -> float:
        """Duration of the run so far (s)."""
        return (self.bench.clock.now() - self._start) / NS

    @property
    def question(self) -> "Question | None":
        """The question that waits for an answer, if there is one."""
        return None if self._box is None else self._box.question

    @property
    def cannot_hold(self) -> str:
        """Why the run cannot be held from now on, with advice; "" if it can be held."""
        if self.can_hold and (self._suspension is None or self._suspension.left):
            return ""
        further = "further " if self.can_hold else ""
        return f"this run cannot be held: {self._plan} has no {further}hold point; wait for its end, or stop the run"

    # -- snapshots for other threads -------------------------------------------------------------------------------

    def snapshot(self) -> Snapshot:
        """Return the present snapshot; for any thread."""
        now = self.bench.clock.now()
        in_step = (now - self._step_start) / NS
        left = self._follower.left(in_step)
        time = self.time
        state = self._choice("rig.state")
        late, latest = (self.bench.readings.glimpse(f"rig.{name}") for name in ("late_ticks", "lateness_max"))
        late -= self._late_before if not isnan(self._late_before) else 0.0
        question, held = self.question, self._suspension
        return Snapshot(
            plan=self._plan,
            rig=self._rig,
            operator=self._by,
            record=self._record,
            time=time,
            state=state,
            reason=self._choice("rig.reason") if state in FAULT_STATES else "",
            step=self._step,
            in_step=in_step,
            next=self._next,
            left=left,
            fraction=self._fraction if left is None else time / max(time + left, 1e-9),
            outline=self._source,
            said=self._said,
            question="" if question is None else question.text,
            answers=() if question is None else question.allowed,
            answer_within=None if self._box is None else self._box.left,
            can_hold=self.can_hold,
            cannot_hold=self.cannot_hold,
            held="" if held is None else held.held_at,
            hold_wanted_by="" if held is None else held.wanted_by,
            checks=self._counts,
            failed=self._failed[:_FAILED_MAX],
            last_check=self._last_check,
            readings=tuple(self._reading(name) for name in self._names),
            assumed=sum(one.source == ASSUMED for some in self._limits.values() for one in some),
            commands=self._commands(),
            late=None if isnan(late) else round(late),
            latest=None if isnan(latest) else latest,
            ended=self._ended,
        )

    def _commands(self) -> bool:
        """Whether the rig reports this run as its commander."""
        port = self.bench.readings.glimpse("rig.holder")
        return port > 0 and self.bench.wiring.is_own(int(port), nan)

    def _choice(self, name: str) -> str:
        value, choices = self.bench.readings.glimpse(name), self.bench.table[name].choices
        return choices[round(value)] if 0 <= value < len(choices) else UNKNOWN

    def _reading(self, name: str) -> LiveReading:
        value = self.bench.readings.glimpse(name)
        signal = self.bench.table[name]
        if isnan(value):
            return LiveReading(name, None, "no reading")
        first = self._first.setdefault(name, value)
        used, nearest = nan, None
        for limit, _ in self._limits.get(name, ()):
            sense = -1.0 if limit.kind is LimitKind.LOWER else 1.0
            way = sense * (limit.at - first)
            part = sense * (value - first) / way if way > 0.0 else 1.0
            if nearest is None or part > used:
                used, nearest = part, limit
        if nearest is None:
            return LiveReading(name, value, signal.show(value))
        words = f"{nearest.kind.name.lower()} {signal.show(nearest.at)}"
        return LiveReading(name, value, signal.show(value), max(used, 0.0), words)
