"""The conformance kit for transports: checks of the rules of a transport, for any implementation.

::

    from astb.acceptance.transports import Subject, check_transport

    def test_my_transport():
        subject = Subject(make=lambda: MyTransport(...), readable=("height",), written={"target": "target"})
        assert [str(result) for result in check_transport(subject) if result.breach] == []

The checks need a real or simulated rig that answers. They write only the given points. Some rules need more from the
subject, such as a function that cuts the connection. Without it, such a rule is not checked, and its result states why.
"""

from __future__ import annotations

import itertools
import math
import threading
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Final

from bench_protocol.clock import Clock, RealClock
from bench_protocol.units import NS, ms, s
from drivers.errors import LinkLost, Refused, WiringError
from drivers.wiring.contract import Transport

_UNKNOWN: Final = "no.such.point.of.this.rig"
_POLL: Final = 10 * ms
_BUSY: Final = 2 * ms
_THREADS: Final = 4
_ROUNDS: Final = 10
_REASON: Final = "state what is wrong, and how to correct it"
#: Permitted lead of a time stamp over the clock: the difference between two clocks of one machine.
_AHEAD: Final = round(5 * ms * NS)


@dataclass(frozen=True, slots=True)
class Subject:
    """A transport to check, and the necessary facts about the rig behind it."""

    make: Callable[[], Transport]  #: makes a transport, not yet connected, to a rig that answers
    readable: Sequence[str]  #: points that have a value
    written: Mapping[str, str] = field(
        default_factory=dict
    )  #: points to write, each with the point that reads it back
    streamed: Mapping[str, str] = field(
        default_factory=dict
    )  #: points to stream, each with the point that reads it back
    values: tuple[float, float] = (1.0, 0.0)  #: two valid numbers for all of these points
    unavailable: str = ""  #: a point that the rig reports as not available
    refused: str = ""  #: a point that the rig refuses
    nobody: Callable[[], Transport] | None = None  #: makes a transport to an address without a rig
    cut: Callable[[], None] | None = None  #: cuts the connection of the transport made last
    clock: Clock = field(default_factory=RealClock)
    within: float = 2 * s  #: time limit for every expected event


@dataclass(frozen=True, slots=True)
class RuleResult:
    """Result of one rule.

    ``breach`` states how the rule was broken; it is empty if the rule was kept or not checked.
    """

    rule: str
    breach: str = ""
    skipped: str = ""  #: reason why it was not checked

    def __str__(self) -> str:
        return f"{self.rule}: {self.breach or self.skipped or 'kept'}"


class Breach(Exception):
    """A rule is broken; the text states how."""


class _Skipped(Exception):
    pass


class _Listener:
    """A listener of a transport that records breaches of the rules."""

    def __init__(self, clock: Clock, busy: float = 0.0) -> None:
        self._clock, self._inside, self._busy = clock, threading.Lock(), busy
        self.samples: list[tuple[int, int, dict[str, float]]] = []  # (time, now, points)
        self.lost: list[str] = []
        self.overlaps = 0

    def receive(self, time: int, points: Mapping[str, float]) -> None:
        if not self._inside.acquire(blocking=False):
            self.overlaps += 1
            return
        if self._busy:
            threading.Event().wait(self._busy)
        self.samples.append((time, self._clock.now(), dict(points)))
        self._inside.release()

    def on_lost(self, reason: str) -> None:
        self.lost.append(reason)


class _Bench:
    """One connected transport and its listener, for the duration of a rule."""

    def __init__(self, subject: Subject, busy: float = 0.0) -> None:
        self.subject, self.clock = subject, subject.clock
        self.transport = subject.make()
        self.listener = _Listener(subject.clock, busy)

    def __enter__(self) -> _Bench:
        self.transport.subscribe(self.listener.receive)
        self.transport.connect(self.clock, self.listener.on_lost, within=self.subject.within)
        return self

    def __exit__(self, *_: object) -> None:
        self.transport.close()

    def wait(self, seconds: float) -> None:
        self.clock.sleep_until(self.clock.now() + round(seconds * NS))

    def until(self, condition: Callable[[], bool], what: str) -> None:
        deadline = self.clock.now() + round(self.subject.within * NS)
        while not condition():
            if self.clock.now() >= deadline:
                raise Breach(
                    f"{what}: not reached within {self.subject.within:g} s; correct the transport, or increase `within`"
                )
            self.wait(_POLL)


def check_transport(subject: Subject, only: str = "") -> list[RuleResult]:
    """Check every rule, or those whose names begin with ``only``.

    Return the results; one with a ``breach`` is a broken rule.
    """
    results = []
    for rule in _RULES:
        name = (rule.__doc__ or "").rstrip(".")
        if not name.startswith(only):
            continue
        try:
            rule(subject)
        except Breach as breach:
            results.append(RuleResult(name, breach=str(breach)))
        except _Skipped as skipped:
            results.append(RuleResult(name, skipped=f"not checked: {skipped}"))
        except Exception as error:
            results.append(RuleResult(name, breach=f"{type(error).__name__}: {error}"))
        else:
            results.append(RuleResult(name))
    return results


def _expect(error: type[Exception], what: str, call: Callable[[], object]) -> Exception:
    try:
        call()
    except error as caught:
        if len(str(caught)) < 10:
            raise Breach(f"{what}: {error.__name__} has no reason, only {str(caught)!r}; {_REASON}") from None
        return caught
    except Exception as other:
        raise Breach(f"{what} raises {type(other).__name__} ({other}); raise {error.__name__}") from None
    raise Breach(f"{what} raises nothing; raise {error.__name__}")


def _before_connecting(subject: Subject) -> None:
    """Before connect, reading raises LinkLost and alive() is infinite."""
    transport = subject.make()
    try:
        _expect(LinkLost, "read before connect", lambda: transport.read(list(subject.readable)))
        if transport.alive() != math.inf:
            raise Breach(f"alive() = {transport.alive():g} s before connect; return math.inf")
    finally:
        transport.close()


def _unknown_points(subject: Subject) -> None:
    """An unknown point raises a WiringError, before and after connect."""
    transport = subject.make()
    _expect(WiringError, f"require({_UNKNOWN!r})", lambda: transport.require(_UNKNOWN))
    for name in subject.readable:
        transport.require(name)
    for name in (*subject.written, *subject.streamed):
        transport.require(name, writable=True)
    with _Bench(subject) as bench:
        _expect(WiringError, "read of an unknown point", lambda: bench.transport.read([_UNKNOWN]))
        _expect(WiringError, "write of an unknown point", lambda: bench.transport.write({_UNKNOWN: 1.0}))


def _no_answer(subject: Subject) -> None:
    """If no rig answers, connect raises LinkLost within the time limit, and does not report a lost link."""
    if subject.nobody is None:
        raise _Skipped("the subject does not define `nobody`")
    transport, listener = subject.nobody(), _Listener(subject.clock)
    start = subject.clock.now()
    _expect(
        LinkLost, "connect", lambda: transport.connect(subject.clock, listener.on_lost, within=subject.within)
    )
    took = (subject.clock.now() - start) / NS
    transport.close()
    if took > subject.within + 1 * s:
        raise Breach(
            f"connect(within={subject.within:g}) took {took:.1f} s to refuse; raise LinkLost within this time"
        )
    if listener.lost:
        raise Breach(f"connect reported a loss: {listener.lost[0]}; raise LinkLost instead")


def _what_comes(subject: Subject) -> None:
    """Received values are known points, arrive within the time limit, and have increasing times of the bench clock."""
    with _Bench(subject) as bench:
        start, transport, samples = bench.clock.now(), bench.transport, bench.listener.samples
        expected = {name for name in subject.readable if transport.stale(name) > 0}
        if not expected and not transport.period:
            raise _Skipped("the transport reads all points on request only")
        bench.until(
            lambda: expected <= {name for _, _, points in samples for name in points},
            f"reception of {', '.join(sorted(expected))}",
        )
        bench.wait(3 * transport.period)
        received, end = list(samples), bench.clock.now()
    last = -1
    for time, now, points in received:
        # In virtual time the simulation runs first, and the clock follows.
        latest = now + _AHEAD if isinstance(bench.clock, RealClock) else end
        if type(time) is not int or not start - 10 * NS <= time <= latest:
            raise Breach(
                f"the time {time!r} is not a time of the bench clock, which is at {now} ns; convert it to this clock"
            )
        if time < last:
            raise Breach(f"the times go back: {time} ns after {last} ns; report values in order")
        last = time
        for name, value in points.items():
            transport.require(name)
            if type(value) is not float:
                raise Breach(f"{name} = {value!r} is not a float; convert it")
    for name in expected:
        times = [time for time, _, points in received if name in points]
        widest = max((b - a for a, b in itertools.pairwise(times)), default=0) / NS
        if widest > transport.stale(name):
            raise Breach(
                f"{name} was missing for {widest:.3f} s, but is stale after {transport.stale(name):g} s; report it "
                "more often, or increase its stale time"
            )


def _reading(subject: Subject) -> None:
    """Read returns exactly the requested points, in order, as numbers; alive() is then small."""
    with _Bench(subject) as bench:
        names = list(subject.readable)
        bench.until(
            lambda: not any(math.isnan(value) for value in bench.transport.read(names).values()),
            f"values of {', '.join(names)}",
        )
        for asked in (names, names[::-1], names[:1]):
            found = bench.transport.read(asked)
            if list(found) != asked:
                raise Breach(f"read({asked}) gives {list(found)}; return the requested points, in order")
            if wrong := {name: value for name, value in found.items() if type(value) is not float}:
                raise Breach(f"read gives {wrong}, which are not floats; convert them")
        if not bench.transport.alive() <= subject.within:
            raise Breach(
                f"alive() = {bench.transport.alive():g} s right after an answer; return the time since the last answer"
            )


def _round_trip(subject: Subject) -> None:
    """Written values are read back."""
    if not subject.written:
        raise _Skipped("the subject does not define `written`")
    with _Bench(subject) as bench:
        for value in (*subject.values, subject.values[0]):
            bench.transport.write(dict.fromkeys(subject.written, value))
            for name, back in subject.written.items():
                bench.until(
                    partial(_reads, bench.transport, back, value), f"{back} = {value:g}, written to {name}"
                )


def _reads(transport: Transport, name: str, value: float) -> bool:
    return transport.read([name])[name] == value


def _streaming(subject: Subject) -> None:
    """Streamed values arrive."""
    if not subject.streamed:
        raise _Skipped("the subject does not define `streamed`")
    with _Bench(subject) as bench:
        for value in (*subject.values, subject.values[0]):

            def arrived(value: float = value) -> bool:
                bench.transport.stream(dict.fromkeys(subject.streamed, value), bench.clock.now())
                backs = list(subject.streamed.values())
                return all(found == value for found in bench.transport.read(backs).values())

            bench.until(arrived, f"{', '.join(subject.streamed.values())} = {value:g} after streaming it")


def _empty_stream(subject: Subject) -> None:
    """A cycle without points changes no value and causes no loss."""
    backs = sorted({*subject.written.values(), *subject.streamed.values()} or subject.readable)
    with _Bench(subject) as bench:
        bench.wait(2 * bench.transport.period)
        before = bench.transport.read(backs)
        for _ in range(_ROUNDS):
            bench.transport.stream({}, bench.clock.now())
            bench.wait(_POLL)
        after = bench.transport.read(backs)
        if bench.listener.lost:
            raise Breach(
                f"the cycle without points lost the connection: {bench.listener.lost[0]}; accept such a cycle"
            )
    for name in sorted({*subject.written.values(), *subject.streamed.values()}):
        if before[name] != after[name] and not math.isnan(before[name]):
            raise Breach(
                f"{name} was {before[name]:g} before the cycle without points and is {after[name]:g} after it; "
                "write nothing in such a cycle"
            )


def _atomic_write(subject: Subject) -> None:
    """If one of several points is unknown, none is sent."""
    if not subject.written:
        raise _Skipped("the subject does not define `written`")
    old, new = subject.values
    with _Bench(subject) as bench:
        bench.transport.write(dict.fromkeys(subject.written, old))
        for name, back in subject.written.items():
            bench.until(partial(_reads, bench.transport, back, old), f"{back} = {old:g}, written to {name}")
        wrong = {**dict.fromkeys(subject.written, new), _UNKNOWN: 1.0}
        _expect(WiringError, "write with an unknown point", lambda: bench.transport.write(wrong))
        now = bench.clock.now()
        also = {**dict.fromkeys(subject.streamed, new), _UNKNOWN: 1.0}
        _expect(WiringError, "stream with an unknown point", lambda: bench.transport.stream(also, now))
        bench.wait(max(3 * bench.transport.period, 5 * _POLL))
        for name, back in subject.written.items():
            if not _reads(bench.transport, back, old):
                raise Breach(
                    f"{name} = {new:g} was sent before the unknown point was noticed; check all names first"
                )


def _refusing(subject: Subject) -> None:
    """A value that the rig refuses raises Refused with a reason, and causes no loss."""
    if not subject.refused:
        raise _Skipped("the subject does not define `refused`")
    with _Bench(subject) as bench:
        for value in subject.values:
            one = {subject.refused: value}
            _expect(Refused, f"write of {subject.refused}", partial(bench.transport.write, one))
        bench.transport.read(list(subject.readable))
        if bench.listener.lost:
            raise Breach(
                f"the refusal was reported as a loss: {bench.listener.lost[0]}; raise Refused instead"
            )


def _unavailable(subject: Subject) -> None:
    """A value that the rig marks as not available is NaN."""
    if not subject.unavailable:
        raise _Skipped("the subject does not define `unavailable`")
    with _Bench(subject) as bench:
        bench.wait(2 * bench.transport.period)
        value = bench.transport.read([subject.unavailable])[subject.unavailable]
    if not math.isnan(value):
        raise Breach(f"{subject.unavailable} is not available, but reads {value:g}; return NaN")


def _threads(subject: Subject) -> None:
    """Several threads can use a transport at the same time; the listener gets one call at a time."""
    failures: list[str] = []
    with _Bench(subject, busy=_BUSY) as bench:
        bench.wait(2 * bench.transport.period)

        def work() -> None:
            try:
                for k in range(_ROUNDS):
                    found = bench.transport.read(list(subject.readable))
                    if list(found) != list(subject.readable):
                        failures.append(f"read gives {list(found)}")
                    if subject.written:
                        bench.transport.write(dict.fromkeys(subject.written, subject.values[k % 2]))
            except Exception as error:
                failures.append(f"{type(error).__name__}: {error}")

        threads = [threading.Thread(target=work, daemon=True) for _ in range(_THREADS)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join(10 * subject.within)
        if any(thread.is_alive() for thread in threads):
            raise Breach(f"{_THREADS} threads do not end: they block each other; correct the locks")
        if failures:
            raise Breach(f"{failures[0]}, while {_THREADS} threads use the transport; add a lock")
        if bench.listener.overlaps:
            raise Breach(
                f"the listener was called {bench.listener.overlaps} times while it was busy; use one thread for it"
            )


def _closing(subject: Subject) -> None:
    """After close, nothing is received or read; a second close has no effect."""
    with _Bench(subject) as bench:
        bench.wait(2 * bench.transport.period)
        bench.transport.close()
        count = len(bench.listener.samples)
        bench.transport.close()
        bench.wait(max(3 * bench.transport.period, 5 * _POLL))
        if len(bench.listener.samples) > count:
            raise Breach(
                f"{len(bench.listener.samples) - count} callbacks came after close; end the receiver in close"
            )
        _expect(LinkLost, "read after close", lambda: bench.transport.read(list(subject.readable)))
        if bench.listener.lost:
            raise Breach(
                f"closing was reported as a loss: {bench.listener.lost[0]}; report no loss after close"
            )


def _losing(subject: Subject) -> None:
    """A lost connection is reported once, with a reason; reading then raises LinkLost within the time limit."""
    if subject.cut is None:
        raise _Skipped("the subject does not define `cut`")
    with _Bench(subject) as bench:
        bench.wait(2 * bench.transport.period)
        subject.cut()
        reads = list(subject.readable)

        def loss_reported() -> bool:
            if not bench.transport.period:  # such a transport notices the loss at the next request
                _expect(LinkLost, "read without a rig", lambda: bench.transport.read(reads))
            return bool(bench.listener.lost)

        bench.until(loss_reported, "the loss of the connection")
        start = bench.clock.now()
        _expect(LinkLost, "read after the loss", lambda: bench.transport.read(reads))
        if (bench.clock.now() - start) / NS > subject.within:
            raise Breach(
                f"reading took more than {subject.within:g} s to report the lost connection; raise LinkLost earlier"
            )
        bench.wait(3 * bench.transport.period + 5 * _POLL)
        if len(bench.listener.lost) != 1:
            raise Breach(f"the loss was reported {len(bench.listener.lost)} times; report it once")
        if len(bench.listener.lost[0]) < 10:
            raise Breach(f"the reason of the loss is only {bench.listener.lost[0]!r}; {_REASON}")


_RULES: Final[tuple[Callable[[Subject], None], ...]] = (
    _before_connecting,
    _unknown_points,
    _no_answer,
    _what_comes,
    _reading,
    _round_trip,
    _streaming,
    _empty_stream,
    _atomic_write,
    _refusing,
    _unavailable,
    _threads,
    _closing,
    _losing,
)
