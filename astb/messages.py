"""Messages of a run at each question and at the end, sent to a command or to a webhook."""

import shlex
import shutil
import socket
import subprocess
import threading
from collections.abc import Callable
from http.client import HTTPConnection, HTTPException, HTTPSConnection
from ipaddress import ip_address
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, Protocol
from urllib.parse import SplitResult, urlsplit

import msgspec

from bench_protocol.os_errors import error_text
from bench_protocol.units import s
from bench_records.report import headline
from test_plans.operator import QuestionBox

if TYPE_CHECKING:
    from bench_records.result import Result
    from test_plans.operator import Answer, Operator, Question, QuestionBox

#: Time limit for sending a message. Later it is dropped, so that neither the run nor its program waits.
WITHIN: Final = 10 * s
_SCHEMES: Final = ("http", "https")
#: Largest number of failed checks that are named.
_NAMED: Final = 20


class MessageError(ValueError):
    """A wrong receiver of messages; the text states how to correct it."""


class Receiver(Protocol):
    """A receiver of messages."""

    def take(self, text: str, content: bytes) -> str:
        """Send a message, as text and as JSON; return an error as text, "" on success."""


class Command:
    """A command of this machine. It gets the text of a message as last argument, and its JSON on standard input."""

    def __init__(self, words: list[str]) -> None:
        self._words = words

    def take(self, text: str, content: bytes) -> str:
        try:
            done = subprocess.run(
                [*self._words, text], input=content, capture_output=True, timeout=WITHIN, check=False
            )
        except subprocess.TimeoutExpired:
            return f"the command did not end within {WITHIN:g} s"
        except OSError as error:
            return error.strerror or str(error)
        errors = done.stderr.decode(errors="replace").strip().splitlines()
        return (
            ""
            if not done.returncode
            else ": ".join([f"the command ended with exit code {done.returncode}", *errors[-1:]])
        )


class Webhook:
    """A web server that receives the JSON as a POST; redirections are not followed."""

    def __init__(self, url: SplitResult, address: str) -> None:
        self._url, self._address = url, address

    def take(self, text: str, content: bytes) -> str:
        kind = HTTPSConnection if self._url.scheme == "https" else HTTPConnection
        path = (self._url.path or "/") + (f"?{self._url.query}" if self._url.query else "")
        line = kind(self._address, self._url.port, timeout=WITHIN)
        try:
            heads = {"Host": self._url.netloc.rpartition("@")[2], "Content-Type": "application/json"}
            line.request("POST", path, content, heads)
            status = line.getresponse().status
        except TimeoutError:
            return f"the server did not answer within {WITHIN:g} s"
        except (OSError, HTTPException) as error:
            return error_text(error)
        finally:
            line.close()
        return "" if 200 <= status < 300 else f"the server answered with status {status}"


def receiver(to: str, *, elsewhere: bool = False) -> Receiver:
    """Return the receiver ``to``: a webhook (http://…), on this machine unless ``elsewhere`` is allowed, or a command.
    Raises MessageError for a wrong receiver, before any message is sent.
    """
    if to.split("://", maxsplit=1)[0].lower() in _SCHEMES:
        return _webhook(to, elsewhere)
    try:
        words = shlex.split(to)
    except ValueError:
        raise MessageError(f"{to} is not a command: a quotation mark is not closed; close it") from None
    if not words or shutil.which(words[0]) is None:
        raise MessageError(
            f"there is no command {words[0] if words else to!r} for messages; give a command of this machine with its "
            "arguments, or a webhook such as http://127.0.0.1:8080/hook"
        )
    return Command(words)


def _webhook(to: str, elsewhere: bool) -> Webhook:
    none = f"{to} is not an address of a webhook; write it as http://127.0.0.1:8080/hook"
    try:
        url = urlsplit(to)
        host, _ = url.hostname, url.port
    except ValueError:
        raise MessageError(none) from None
    if not host:
        raise MessageError(none)
    if elsewhere:
        return Webhook(url, host)
    try:
        found = {str(one[4][0]) for one in socket.getaddrinfo(host, None, type=socket.SOCK_STREAM)}
    except (OSError, UnicodeError):
        raise MessageError(f"{to}: the machine {host} was not found; check the address") from None
    if not all(ip_address(one.partition("%")[0]).is_loopback for one in found):
        raise MessageError(
            f"{to} is another machine, which would receive test data; to allow this, give --message-elsewhere"
        )
    # The checked address, because the next look-up of the name may give another one.
    return Webhook(url, min(found, key=len) if url.scheme == "http" else host)


class Messages:
    """Sends the messages of a run, each in its own thread, so that no run waits."""

    def __init__(self, to: Receiver) -> None:
        self._to = to
        self.warn: Callable[[str], None] = lambda text: None  #: receives undelivered messages

    def ended(self, result: "Result", directory: Path) -> None:
        """Send the verdict at the end of a run."""
        failed = [one.name for one in result.checks if not one.passed]
        self._send(
            f"{result.plan}: {result.verdict.value}: {headline(result)}",
            event="end",
            plan=result.plan,
            rig=result.rig,
            verdict=result.verdict.value,
            reason=result.reason,
            failed=failed[:_NAMED],
            failed_count=len(failed),
            record=str(directory.resolve()),
        )

    def operator(self, operator: "Operator | None", plan: str) -> "Operator | None":
        """Return ``operator``, with a message for each question that waits for an answer."""
        return (
            _Called(operator, self._report_question, plan) if isinstance(operator, QuestionBox) else operator
        )

    def _report_question(self, plan: str, question: "Question") -> None:
        self._send(
            f"{plan} asks: {question.text}",
            event="question",
            plan=plan,
            question=question.text,
            answers=list(question.allowed),
            within_s=question.within,
        )

    def _send(self, text: str, **content: Any) -> None:
        encoded = msgspec.json.encode({"text": text, **content})

        def take() -> None:
            if wrong := self._to.take(text, encoded):
                self.warn(f"the message {text!r} was not delivered: {wrong}; check the receiver of --message")

        threading.Thread(target=take, name="message").start()


class _Called:
    """An operator who receives a message when a question waits."""

    def __init__(self, operator: "QuestionBox", call: "Callable[[str, Question], None]", plan: str) -> None:
        self._operator, self._call, self._plan = operator, call, plan

    def ask(self, question: "Question") -> None:
        self._operator.ask(question)
        self._call(self._plan, question)

    def answer(self) -> "Answer | None":
        return self._operator.answer()

    def withdraw(self) -> None:
        self._operator.withdraw()
