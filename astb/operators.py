"""Operators that answer the questions of a plan: a terminal, a file of answers, or a simulated rig."""

import sys
import threading
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any, Final, TextIO

from rich.console import Console
from rich.text import Text

from bench_protocol.input_limits import read_toml
from bench_protocol.os_errors import file_errors
from bench_protocol.runtime.own_process import forget_typed, in_the_foreground
from test_plans.operator import (
    DONE,
    Answer,
    FirstOf,
    NoOperator,
    Operator,
    Question,
    QuestionBox,
    Script,
    Unanswered,
)

#: Value of ``--answers`` if a panel answers through the door of the run.
PANEL: Final = "@panel"
#: Value of ``--answers`` if the answers are lines of the standard input.
STDIN: Final = "-"

_OTHERS: Final = "answer at a terminal, in the panel or by --answers FILE"
_CLOSED: Final = "the terminal is closed; answer in the panel or by --answers FILE"


class AnswersFileError(ValueError):
    """A wrong file of answers; the text names it and states the correct form."""


class SimulatedHand:
    """Performs manual actions of an operator on a simulated rig, such as ``estop on``; ``estop`` is the name of a
    fault.

    ``order`` sends the rig an order of its fault panel and returns the answer.
    """

    def __init__(self, order: Callable[[dict[str, Any]], dict[str, Any]]) -> None:
        self._order = order
        self._answer: Answer | None = None

    def ask(self, question: Question) -> None:
        name, _, way = question.deed.rpartition(" ")
        if way not in {"on", "off"} or DONE not in question.answers:
            raise Unanswered(f"the simulated rig cannot do this by itself; {_OTHERS}")
        try:
            answer = self._order({"do": way, "name": name, **({"values": {}} if way == "on" else {})})
            done = "error" not in answer or (
                way == "off" and self._has(name)
            )  # a fault that was not on is off
        except OSError as error:  # the rig runs in another process, or has ended
            raise Unanswered(
                f"the simulated rig does not receive the command: {error.strerror or error}; check that it runs"
            ) from None
        if not done:
            raise Unanswered(f"the simulated rig cannot do this by itself: {answer['error']}; {_OTHERS}")
        self._answer = Answer(DONE, "the simulated rig")

    def _has(self, name: str) -> bool:
        return any(name == fault["name"] for fault in self._order({"do": "list"}).get("faults", ()))

    def answer(self) -> Answer | None:
        return self._answer

    def withdraw(self) -> None:
        self._answer = None


class Terminal(QuestionBox):
    """An operator at a terminal.

    Questions are printed; an answer is a line with the first letters of a permitted answer.
    """

    def __init__(self, console: Console, lines: TextIO) -> None:
        super().__init__()
        self._console, self._lines = console, lines
        self._reader: threading.Thread | None = None
        self._wanted = threading.Event()  # a line, by the question that waits
        self._ended = False

    def ask(self, question: Question) -> None:
        if self._ended:
            raise Unanswered(_CLOSED)
        if self._lines.isatty() and not in_the_foreground(self._lines):
            # To read would stop this process, and with it the set-points of a bench under air.
            raise Unanswered(
                "the process runs in the background of its terminal and cannot read an answer; "
                "start it in the foreground"
            )
        self._forget_what_was_typed()
        super().ask(question)
        self._wanted.set()
        answers = " / ".join(question.allowed)
        self._print(f"? {question.text}  [{answers}], within {question.within:g} s", "bold")
        if self._reader is None:
            # The read cannot be cancelled; the process does not wait for this thread.
            self._reader = threading.Thread(target=self._read, name="terminal", daemon=True)
            self._reader.start()

    def answer(self) -> Answer | None:
        found = super().answer()
        if found is None and self._ended:
            raise Unanswered(_CLOSED)
        return found

    def withdraw(self) -> None:
        self._wanted.clear()
        super().withdraw()

    def _forget_what_was_typed(self) -> None:
        """Discard input that was typed before a question; the lines of a pipe are kept, in their order."""
        if self._lines.isatty():
            forget_typed(self._lines)

    def _read(self) -> None:
        try:
            with suppress(OSError, ValueError):  # the terminal is gone, or its input is not text
                while self._wanted.wait() and (line := self._lines.readline()):
                    self._process_line(line)
        finally:  # after any error, this terminal gives no more answers
            self._ended = True

    def _process_line(self, line: str) -> None:
        question = self.question
        if question is None or not line.strip():
            return
        typed = line.strip().lower()
        fitting = [one for one in question.allowed if one.lower().startswith(typed)]
        if len(fitting) == 1 or typed in fitting:
            self._wanted.clear()  # the next line is for the next question
            try:
                self.reply(typed if typed in fitting else fitting[0], "the operator at the terminal")
            except ValueError:  # the question's time has just passed
                self._wanted.set()
        else:
            self._print(f"  {line.strip()!r} is not an answer; type {' / '.join(question.allowed)}", "bold")

    def _print(self, text: str, style: str) -> None:
        self._console.print(Text(text, style), soft_wrap=True)


def read_answers(path: Path) -> Script:
    """Return the answers in a TOML file: ``"text of the question, or its manual action" = "answer"``. ``*`` stands for
    any text. Raises AnswersFileError for a file in another format.
    """
    with file_errors(f"answers {path}", AnswersFileError):
        content = read_toml(path)
    for question, answer in content.items():
        if not isinstance(answer, str):
            raise AnswersFileError(
                f'answers {path}: {question} = {answer!r}; an answer must be a text, such as "done"'
            )
    return Script(content, by=path.name)


def operator_for(answers: str | None, console: Console) -> Operator:
    """Return the operator: the file ``answers``, the standard input for ``-``, or a panel for ``@panel``.

    Without ``answers``, the operator is at the terminal. If there is no terminal, no question is answered.
    Raises AnswersFileError like `read_answers`.
    """
    if answers == PANEL:
        return QuestionBox()
    if answers not in {None, STDIN}:
        return read_answers(Path(answers))
    if sys.stdin is not None and (answers == STDIN or sys.stdin.isatty()):
        return Terminal(console, sys.stdin)
    return NoOperator()


def with_hand(operator: Operator | None, hand: Operator | None) -> Operator:
    """Return the operator for a rig. A simulated rig has a ``hand`` that performs manual actions.

    Prepared answers have priority over the hand. The hand answers before an operator at a terminal, who cannot change a
    simulated rig.
    """
    both = (operator, hand) if isinstance(operator, Script) else (hand, operator)
    return FirstOf(*filter(None, both))
