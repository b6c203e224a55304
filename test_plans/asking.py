"""Questions of a run to its operator, with a time limit. The bench is still commanded during the wait."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, Final, Protocol

from bench_protocol.clock import RealClock, VirtualClock
from bench_protocol.units import NS, ms
from drivers.errors import BenchTimeout
from test_plans.operator import ABORT, Answer, Operator, Question, Unanswered

if TYPE_CHECKING:
    from drivers.bench import Bench

#: Poll interval (ns) of an answer in virtual time.
_LOOK: Final = round(20 * ms * NS)


class Asking(Protocol):
    """What a run must offer so that it can ask questions."""

    bench: Bench
    operator: Operator

    @property
    def now(self) -> int:
        """The time of the bench's clock (ns)."""

    def keep(self, kind: str, text: str, **data: Any) -> None:
        """Write an event of a ``kind`` to the record."""

    def follow(self, text: str) -> None:
        """Send a note to the watcher."""


class Aborted(Exception):
    """Raised if the operator ended the run, or did not answer and may be at work on the rig."""


class NotInTime(Unanswered):
    """Raised if the operator did not answer in time."""


def answer_to(run: Asking, question: Question) -> Answer:
    """Ask the operator, and return the answer. Question and answer are recorded.

    Raises Unanswered without an operator, NotInTime after the time limit, and Aborted if the operator ends the run.
    """
    run.keep("prompt", question.text, answers=list(question.answers), within=question.within)
    run.follow(f"asked: {question.text}")
    start = run.now
    try:
        found = _ask_and_wait(run, question)
    except Unanswered as reason:
        run.keep("answer", f"not answered: {reason}")
        raise type(reason)(f"{question.text}: {reason}") from None
    run.keep("answer", found.text, by=found.by, after=(run.now - start) / NS)
    if found.text == ABORT:
        raise Aborted(f"{found.by} ended the run when asked: {question.text}")
    return found


def _ask_and_wait(run: Asking, question: Question) -> Answer:
    found: list[Answer] = []

    def answered() -> bool:
        found.extend(filter(None, [run.operator.answer()]))
        return bool(found)

    run.operator.ask(question)
    try:
        if not wait_for_somebody(run, answered, question.within, f"an answer to: {question.text}"):
            raise NotInTime(f"no answer within {question.within:g} s; repeat the run, and answer in time")
    finally:
        run.operator.withdraw()
    return found[0]


def wait_for_somebody(run: Asking, condition: Callable[[], bool], within: float, what: str) -> bool:
    """Wait for a ``condition`` that depends on a person. Return whether it was met within the time limit ``within``
    (s).

    In real time the bench is commanded and monitored during the wait: RigFault and LinkLost are raised at once. In
    virtual time the rig is paused, and the time limit counts real time.
    """
    if not isinstance(run.bench.clock, VirtualClock):
        try:
            run.bench.wait_for(condition, within=within, what=what)
        except BenchTimeout:
            return False
        return True
    clock = RealClock()
    end = clock.now() + round(within * NS)
    while not condition():
        if clock.now() >= end:
            return False
        clock.sleep_until(clock.now() + _LOOK)
    return True
