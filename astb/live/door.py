"""The control socket of a run in real time, called door: its user can watch, hold, answer and stop the run there.

It is a Unix socket. Its path follows from the path of the rig file, so that a panel that is started later finds the
run. A request is a line of JSON, and so is the answer.
"""

import os
import signal
import socketserver
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from hashlib import sha256
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import msgspec

from astb.live.model import Live
from bench_protocol.runtime.own_folder import own_directory
from bench_sim.rig.control_socket import LINE_MAX, ask, control_path, is_alive
from drivers.errors import BenchError

if TYPE_CHECKING:
    from test_plans.operator import QuestionBox
    from test_plans.suspension import Suspension

_PATIENCE: Final = 2.0  # s, until a line must have arrived
_LOOK_UP: Final = 0.1  # s, until the end is noticed


class NoRun(Exception):
    """No plan runs on this rig, or its run cannot be reached."""


class Deaf(NoRun):
    """A run exists, but does not answer in time."""


def door_path(rig_file: Path) -> Path:
    """Return the path of the control socket of a run on the rig of this file."""
    place = sha256(str(rig_file.resolve()).encode()).hexdigest()[:16]
    return control_path("run", 0).with_name(f"run-{place}.sock")


def knock(rig_file: Path, order: dict[str, Any], within: float = 2.0) -> dict[str, Any]:
    """Send a request to the run on this rig, and return the answer.

    Raises NoRun without a run, Deaf without an answer ``within`` s.
    """
    try:
        line = ask(door_path(rig_file), msgspec.json.encode(order), within)
        answer = msgspec.json.decode(line, type=dict[str, Any])
    except TimeoutError as error:
        raise Deaf(str(error)) from None
    except (OSError, ValueError, RecursionError) as error:
        raise NoRun(str(error)) from None
    return answer


class Door:
    """Answers requests to a run. ``live`` returns the present run, None between two runs."""

    def __init__(
        self, live: Callable[[], Live | None], suspension: "Suspension", box: "QuestionBox | None"
    ) -> None:
        self._live, self._suspension, self._box = live, suspension, box
        self._stopped = False

    def answer(self, line: bytes) -> bytes:
        """Execute the request in a line of JSON, and return the answer.

        For an impossible request, this has an ``error``.
        """
        try:
            order = msgspec.json.decode(line, type=dict[str, str])
            answer = self._execute(order)
        except (msgspec.MsgspecError, ValueError, RecursionError, BenchError) as error:
            answer = {"error": str(error)}
        return msgspec.json.encode(answer) + b"\n"

    def _execute(self, order: dict[str, str]) -> dict[str, Any]:
        do, by = order.get("do", ""), order.get("by") or "the panel"
        match do:
            case "look":
                live = self._live()
                return {"pid": os.getpid(), "snapshot": None if live is None else live.snapshot()}
            case "hold":
                if (live := self._live()) is not None and live.cannot_hold:
                    raise ValueError(live.cannot_hold)
                self._suspension.request(by)
            case "resume":
                self._suspension.resume()
            case "stop":
                self._suspension.stop(by)
                self._interrupt()
            case "safe":
                self._suspension.stop(by)
                # First stop the bench, then the plan, which might arm it again.
                try:
                    if (live := self._live()) is not None:
                        live.bench.settings.go_safe(live.bench.clock)
                finally:
                    self._interrupt()
                return {"done": do, "bench": live is not None}
            case "answer":
                if self._box is None:
                    raise ValueError(
                        "this run takes no answers from here; start it with an operator who answers in the panel"
                    )
                self._box.reply(order.get("text", ""), by, order.get("to", ""))
            case _:
                raise ValueError(f"{do!r} is not a known order; use look, hold, resume, stop, safe or answer")
        return {"done": do}

    def _interrupt(self) -> None:
        """End the run as a signal does, from any thread and only once: a second signal would end its tear-down."""
        if not self._stopped:
            self._stopped = True
            os.kill(os.getpid(), signal.SIGTERM)


@contextmanager
def opened_door(rig_file: Path, door: Door) -> Iterator[None]:
    """Answer requests to the run on this rig during the block. Without a usable socket, the run gets no requests."""
    path = door_path(rig_file)

    class Visit(socketserver.StreamRequestHandler):
        timeout = _PATIENCE

        def handle(self) -> None:
            with suppress(OSError):
                if line := self.rfile.readline(LINE_MAX):
                    self.wfile.write(door.answer(line))

    try:
        own_directory(path.parent)
        if is_alive(path):
            raise FileExistsError(path)
        path.unlink(missing_ok=True)
        server = socketserver.ThreadingUnixStreamServer(str(path), Visit)
    except OSError:
        yield
        return
    server.daemon_threads = True
    path.chmod(0o600)
    threading.Thread(
        target=server.serve_forever, args=(_LOOK_UP,), name="the run's door", daemon=True
    ).start()
    try:
        yield
    finally:
        server.shutdown()
        server.server_close()
        path.unlink(missing_ok=True)
