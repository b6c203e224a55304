"""How a run asks its operator: the bench is kept meanwhile, and every wait has an end."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, Final, Protocol

from bench_protocol.clock import RealClock, VirtualClock
from bench_protocol.units import NS, ms
from drivers.errors import BenchTimeout
from test_plans.operator import ABORT, Answer, Operator, Question, Unanswered

if TYPE_CHECKING:
    from drivers.bench import Bench

#: How often somebody who thinks is looked at.
_LOOK: Final = round(20 * ms * NS)


class Asking(Protocol):
    """Who asks: as much of a run as that takes."""

    bench: Bench
    operator: Operator

    @property
    def now(self) -> int:
        """The time of the bench's clock (ns)."""

    def keep(self, kind: str, text: str, **data: Any) -> None:
        """Let the record keep an event."""

    def follow(self, text: str) -> None:
        """Tell whoever watches."""


class Aborted(Exception):
    """The operator ended the run, or nobody knows what an operator is doing at the rig."""


class NotInTime(Unanswered):
    """Somebody was asked, and gave no answer in time."""


def answer_to(run: Asking, question: Question) -> Answer:
    """Ask, and wait for the answer.

    Unanswered if none comes, NotInTime if somebody was there to give one, Aborted if the operator ends the run.
    """
    run.keep("prompt", question.text, answers=list(question.answers), within=question.within)
    run.follow(f"asked: {question.text}")
    asked = run.now
    try:
        found = _put(run, question)
    except Unanswered as reason:
        run.keep("answer", f"none: {reason}")
        raise type(reason)(f"{question.text}: {reason}") from None
    run.keep("answer", found.text, by=found.by, after=(run.now - asked) / NS)
    if found.text == ABORT:
        raise Aborted(f"{found.by} ended the run when asked: {question.text}")
    return found


def _put(run: Asking, question: Question) -> Answer:
    found: list[Answer] = []

    def answered() -> bool:
        found.extend(filter(None, [run.operator.answer()]))
        return bool(found)

    run.operator.ask(question)
    try:
        if not wait_for_somebody(run, answered, question.within, f"an answer to: {question.text}"):
            raise NotInTime(f"no answer within {question.within:g} s")
    finally:
        run.operator.withdraw()
    return found[0]


def wait_for_somebody(run: Asking, condition: Callable[[], bool], within: float, what: str) -> bool:
    """Wait until somebody has done something; return whether it happened within so many s.

    In real time the bench is commanded and watched meanwhile: RigFault and LinkLost come at once. A rig in virtual
    time stands still while people think, and what is counted is their time.
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
