"""The conformance kit bites: the example of a transport keeps every rule, and each way to break one is found."""

import contextlib
import io
import re
import shutil
import socketserver
import threading
import tomllib
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from astb.acceptance.transports import RuleResult, Subject, check_transport
from drivers.errors import LinkLost, Refused
from drivers.wiring.transports import open_transport
from tests.foreign import lines

PAGE = Path(__file__).resolve().parents[2] / "docs" / "how-to" / "connect-a-rig.md"
BLOCKS = re.findall(r"^```\w*\n(.*?)^```", PAGE.read_text(), flags=re.MULTILINE | re.DOTALL)


def block(words: str) -> str:
    """The one block of the page with these words."""
    (found,) = (one for one in BLOCKS if words in one)
    return found


POINTS = ["height", "target", "broken"]
Good = lines.Controller


class Controller:
    """A server of the how-to's lines; it can disconnect."""

    def __init__(self) -> None:
        self.values = {"height": "12.5", "target": "0.0", "broken": "none"}
        self._connections: list = []
        controller = self

        class Handler(socketserver.StreamRequestHandler):
            def handle(self) -> None:
                controller._connections.append(self.connection)
                with contextlib.suppress(OSError):
                    for line in self.rfile:
                        self.wfile.write(controller.answer(line.decode()).encode() + b"\n")

        self._server = socketserver.ThreadingTCPServer(("127.0.0.1", 0), Handler)
        self._server.daemon_threads = True
        self.port = self._server.server_address[1]
        self._thread = threading.Thread(target=self._server.serve_forever, args=(0.01,))
        self._thread.start()

    def answer(self, line: str) -> str:
        verb, name, *value = line.split()
        if verb == "!":
            if name == "height":
                return "no: it is measured"
            self.values[name] = value[0]
            return "ok"
        return self.values[name]

    def hang_up(self) -> None:
        for connection in self._connections:
            with contextlib.suppress(OSError):
                connection.shutdown(2)

    def stop(self) -> None:
        self.hang_up()
        self._server.shutdown()
        self._thread.join()
        self._server.server_close()


@pytest.fixture(scope="module")
def rig() -> Iterator[Controller]:
    controller = Controller()
    yield controller
    controller.stop()


@pytest.mark.slow
def test_the_how_tos_check_prints_what_the_page_shows(rig: Controller, dead_port: int) -> None:
    said = io.StringIO()
    names = {
        "controller": lines.controller,
        "port": rig.port,
        "dead_port": dead_port,
        "points": POINTS,
        "here": Path(),
        "hang_up": rig.hang_up,
    }
    with contextlib.redirect_stdout(said):
        exec(compile(block("check_transport(subject)"), "the page", "exec"), names)
    *shown, rest = block(": kept\n").splitlines()
    assert rest == "…"
    assert said.getvalue().splitlines()[: len(shown)] == shown
    assert all(line.endswith(": kept") for line in said.getvalue().splitlines())


def test_the_how_tos_wiring_file_finds_it(tmp_path: Path) -> None:
    table = tomllib.loads(block("[transports.press]"))["transports"]["press"]
    shutil.copy(lines.__file__, tmp_path)
    transport = open_transport("press", table, tmp_path)
    assert type(transport).__name__ == "Controller"
    transport.require("height")


class Mute(Good):
    def alive(self):
        return 0.0


class ReadsUnconnected(Good):
    def read(self, names):
        return super().read(names) if self._socket else dict.fromkeys(names, 0.0)


class KnowsEverything(Good):
    def require(self, name, *, writable=False):
        pass


class TellsALossThatNeverWas(Good):
    def connect(self, clock, lost, *, within):
        try:
            super().connect(clock, lost, within=within)
        except LinkLost as error:
            lost(str(error))
            raise


class WrongError(Good):
    def connect(self, clock, lost, *, within):
        try:
            super().connect(clock, lost, within=within)
        except LinkLost as error:
            raise OSError(str(error)) from None


class Silent(Good):
    def subscribe(self, receive):
        pass


class TimesOfTheDay(Good):
    def subscribe(self, receive):
        super().subscribe(lambda time, points: receive(time + 10**18, points))


class TimesGoBack(Good):
    def subscribe(self, receive):
        super().subscribe(lambda time, points: (receive(time, points), receive(time - 1000, points)))


class Words(Good):
    def subscribe(self, receive):
        super().subscribe(
            lambda time, points: receive(time, {name: str(value) for name, value in points.items()})
        )


class Disorder(Good):
    def read(self, names):
        return dict(reversed(super().read([*names, "target"]).items()))


class Forgets(Good):
    def write(self, points):
        if not points:
            super().write(points)


class Deaf(Good):
    def stream(self, points, time):
        pass


class LossOnEmptyStream(Good):
    def stream(self, points, time):
        if not points:
            self._listener.lose("there is nothing to stream")
        super().stream(points, time)


class ZeroOnEmptyStream(Good):
    def stream(self, points, time):
        super().stream(points or {"target": 0.5}, time)


class SendsTheFirst(Good):
    def write(self, points):
        for name, value in points.items():
            super().write({name: value})


class StreamsWhatItKnows(Good):
    def stream(self, points, time):
        super().stream({name: value for name, value in points.items() if name in self._points}, time)


class SwallowsANo(Good):
    def write(self, points):
        with contextlib.suppress(Refused):
            super().write(points)


class LostByANo(Good):
    def write(self, points):
        try:
            super().write(points)
        except Refused as no:
            self._listener.lose(str(no))
            raise


class NumberForNone(Good):
    @staticmethod
    def _number(answer):
        return -999.0 if answer == "none" else float(answer)


class Impatient(Good):
    def _ask(self, line):
        if not self._lock.acquire(blocking=False):
            raise RuntimeError("somebody else is asking")
        try:
            return super()._ask(line)
        finally:
            self._lock.release()


class TwoAtOnce(Good):
    def subscribe(self, receive):
        def both(time, points):
            threads = [threading.Thread(target=receive, args=(time, points)) for _ in range(2)]
            for thread in threads:
                thread.start()
            for thread in threads:
                thread.join()

        super().subscribe(both)


class NeverQuiet(Good):
    def close(self):
        for listener in self._listener._subscribers:
            threading.Timer(0.05, listener, args=(self._clock.now(), {"height": 1.0})).start()
        super().close()


class ClosesOnce(Good):
    def close(self):
        if not self._listener._open and self._socket is not None:
            raise RuntimeError("closed already")
        super().close()


class TellsItsOwnEnd(Good):
    def connect(self, clock, lost, *, within):
        self._told = lost
        super().connect(clock, lost, within=within)

    def close(self):
        if self._listener._open:
            self._told("the connection was closed by ourselves")
        super().close()


class KeepsALossToItself(Good):
    def connect(self, clock, lost, *, within):
        super().connect(clock, lambda reason: None, within=within)


class TellsItTwice(Good):
    def connect(self, clock, lost, *, within):
        super().connect(clock, lambda reason: (lost(reason), lost(reason)), within=within)


class AtALossForWords(Good):
    def connect(self, clock, lost, *, within):
        super().connect(clock, lambda reason: lost("lost"), within=within)


#: Ways to break a rule, each with how its rule begins.
BAD = {
    Mute: "Before connect",
    ReadsUnconnected: "Before connect",
    KnowsEverything: "An unknown point",
    TellsALossThatNeverWas: "If no rig answers",
    WrongError: "If no rig answers",
    Silent: "Received values",
    TimesOfTheDay: "Received values",
    TimesGoBack: "Received values",
    Words: "Received values",
    Disorder: "Read returns exactly",
    Forgets: "Written values",
    Deaf: "Streamed values",
    LossOnEmptyStream: "A cycle without points",
    ZeroOnEmptyStream: "A cycle without points",
    SendsTheFirst: "If one of several points",
    StreamsWhatItKnows: "If one of several points",
    SwallowsANo: "A value that the rig refuses",
    LostByANo: "A value that the rig refuses",
    NumberForNone: "A value that the rig marks",
    Impatient: "Several threads",
    TwoAtOnce: "Several threads",
    NeverQuiet: "After close",
    ClosesOnce: "After close",
    TellsItsOwnEnd: "After close",
    KeepsALossToItself: "A lost connection",
    TellsItTwice: "A lost connection",
    AtALossForWords: "A lost connection",
}


def broken(kind: type, rule: str, rig: Controller, dead_port: int) -> list[RuleResult]:
    rig.values.update(height="12.5", target="0.0", broken="none")
    subject = Subject(
        make=lambda: kind("press", "127.0.0.1", rig.port, POINTS),
        readable=["height"],
        written={"target": "target"},
        streamed={"target": "target"},
        unavailable="broken",
        refused="height",
        nobody=lambda: kind("press", "127.0.0.1", dead_port, POINTS),
        cut=rig.hang_up,
        within=0.3,
    )
    return [finding for finding in check_transport(subject, only=rule) if finding.breach]


@pytest.mark.slow
@pytest.mark.parametrize("way", BAD, ids=lambda way: way.__name__)
def test_each_rule_bites(way: type, rig: Controller, dead_port: int) -> None:
    rule = BAD[way]
    assert broken(Good, rule, rig, dead_port) == []
    assert [finding.rule.startswith(rule) for finding in broken(way, rule, rig, dead_port)] == [True]


def test_what_is_not_offered_is_not_checked(rig: Controller) -> None:
    make: Callable = lambda: lines.Controller("press", "127.0.0.1", rig.port, POINTS)  # noqa: E731
    skipped = [finding for finding in check_transport(Subject(make, readable=["height"])) if finding.skipped]
    assert len(skipped) == 7
    assert all(str(finding).endswith(finding.skipped) for finding in skipped)
