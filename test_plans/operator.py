"""The operator of a run: interface, questions and answers."""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from fnmatch import fnmatchcase
from typing import Final, Protocol

from bench_protocol.clock import RealClock
from bench_protocol.units import NS, minutes

DONE: Final = "done"
NOT_POSSIBLE: Final = "not possible"
#: This answer is always allowed. It ends the run, as Ctrl-C does.
ABORT: Final = "abort"


class Unanswered(Exception):
    """Raised if no one will answer a question; the text states why."""


@dataclass(frozen=True, slots=True)
class Question:
    """A question of a plan: its text, the allowed answers, and the time limit (s).

    ``deed`` names the manual action, for rigs that can perform it themselves. A simulated rig knows the names of its
    faults, ``estop on`` and ``estop off``.
    """

    text: str
    answers: tuple[str, ...] = (DONE, NOT_POSSIBLE)
    within: float = 10 * minutes
    deed: str = ""

    def __post_init__(self) -> None:
        if not self.text.strip() or not self.answers:
            raise ValueError(
                f"the question {self.text!r} has the answers {list(self.answers)}; give it a text and "
                "at least one answer"
            )

    @property
    def allowed(self) -> tuple[str, ...]:
        """Return the allowed answers, `ABORT` included."""
        return tuple(dict.fromkeys((*self.answers, ABORT)))


@dataclass(frozen=True, slots=True)
class Answer:
    """An answer, and the person or program that gave it."""

    text: str
    by: str


class Operator(Protocol):
    """Interface of an operator. A run asks one question at a time and polls for its answer."""

    def ask(self, question: Question) -> None:
        """Accept a question. Raises Unanswered, with the reason, if no one will answer it."""

    def answer(self) -> Answer | None:
        """Return the answer to the question; None if there is none yet. Raises Unanswered if there will be none."""

    def withdraw(self) -> None:
        """Remove the question, which was answered or timed out."""


_NOBODY: Final = "there is no operator to ask; use a terminal, the panel or --answers FILE"


class NoOperator:
    """An operator that answers no question."""

    def ask(self, question: Question) -> None:
        raise Unanswered(_NOBODY)

    def answer(self) -> Answer | None:
        return None

    def withdraw(self) -> None:
        pass


#: An entry of a script: an answer, or a function that performs an action and returns an answer.
Reply = str | Callable[[Question], str]


class Script:
    """An operator with prepared answers. Each belongs to the text or the deed of a question, in which ``*`` matches any
    text.

    The first match is used. Raises ValueError for an answer that the question does not allow.
    """

    def __init__(self, replies: Mapping[str, Reply], by: str = "a script") -> None:
        self._replies, self._by = dict(replies), by
        self._answer: Answer | None = None

    def ask(self, question: Question) -> None:
        known = [question.text, *filter(None, [question.deed])]
        for pattern, reply in self._replies.items():
            if any(fnmatchcase(text.lower(), pattern.lower()) for text in known):
                self._answer = Answer(
                    _allowed(question, reply(question) if callable(reply) else reply), self._by
                )
                return
        raise Unanswered(f"{self._by} has no answer to this question; add one")

    def answer(self) -> Answer | None:
        return self._answer

    def withdraw(self) -> None:
        self._answer = None


class QuestionBox:
    """An operator that stores a question until another thread answers it, for example a terminal or a panel in a
    browser.
    """

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._question: Question | None = None
        self._answer: Answer | None = None
        self._asked_at = 0  # start of the question, ns of the real clock
        self._clock = RealClock()

    @property
    def left(self) -> float | None:
        """Return the remaining time (s) of the question; None without one."""
        if (question := self.question) is None:
            return None
        return max(0.0, question.within - (self._clock.now() - self._asked_at) / NS)

    @property
    def question(self) -> Question | None:
        """The question that waits for an answer, if any."""
        with self._lock:
            return None if self._answer else self._question

    def reply(self, text: str, by: str, to: str = "") -> None:
        """Answer the current question. Raises ValueError if there is none, or if it does not allow this answer.

        ``to`` is the text of the question that is answered. It prevents a late answer from reaching the next question.
        """
        with self._lock:
            if self._question is None or self._answer is not None:
                raise ValueError(f"{by} answers {text!r}, but no question is open")
            if to and to != self._question.text:
                raise ValueError(
                    f"{by} answers the question {to!r}, but the present question is {self._question.text!r}; answer "
                    "that one"
                )
            self._answer = Answer(_allowed(self._question, text), by)

    def ask(self, question: Question) -> None:
        with self._lock:
            self._question, self._answer, self._asked_at = question, None, self._clock.now()

    def answer(self) -> Answer | None:
        with self._lock:
            return self._answer

    def withdraw(self) -> None:
        with self._lock:
            self._question = self._answer = None


class FirstOf:
    """Several operators: each question goes to the first one that accepts it."""

    def __init__(self, *operators: Operator) -> None:
        self._operators = operators
        self._chosen: Operator | None = None

    def ask(self, question: Question) -> None:
        reasons = []
        for operator in self._operators:
            try:
                operator.ask(question)
            except Unanswered as reason:
                reasons.append(str(reason))
            else:
                self._chosen = operator
                return
        raise Unanswered("; ".join(dict.fromkeys(reasons)) or _NOBODY)

    def answer(self) -> Answer | None:
        return self._chosen.answer() if self._chosen else None

    def withdraw(self) -> None:
        if self._chosen:
            self._chosen.withdraw()
        self._chosen = None


def _allowed(question: Question, text: str) -> str:
    if text not in question.allowed:
        raise ValueError(
            f"{text!r} is not an answer to {question.text!r}; use one of {', '.join(question.allowed)}"
        )
    return text
