"""Tests of a rig with other messages than ours. They use the signals that its wiring file defines."""

import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Final

import numpy as np

from astb.acceptance.conformance.moving import LATENCY_MAX, MOVE, MOVE_WITHIN, THERE, TIME_APART
from astb.acceptance.conformance.report import Notebook
from astb.acceptance.conformance.stillness import OVER, PLACES, PRESSURES, WATCH, note_still
from bench_protocol.signals import MEASURED, Kind, Signal
from bench_protocol.units import NS, minutes, mm, ms, s
from drivers.errors import BenchError

if TYPE_CHECKING:
    from drivers.bench import Bench

LISTEN: Final = 3 * s
_COME: Final = (*MEASURED, Kind.STATUS)
#: Difference between the rates of two rigs from which it is reported, relative to the rate.
RATE_APART: Final = 0.1
#: Signals without a stale time are sent on events only.
_EVENTS: Final = 3600 * NS
#: Signals that the bench reports if it generates the waves itself.
_PLAYED: Final = ("rig.program", "rig.generator_cycle")
ANSWER_MAX: Final = 1 * s
ANSWER_APART: Final = 50 * ms
#: After the loss of its commander a bench must leave ACTIVE within this time.
SILENCE_MAX: Final = 2 * s
_RATE: Final = 20 * mm / s
_ARM_WITHIN: Final = 1 * minutes


def listen(bench: "Bench") -> list[Notebook]:
    """Return the findings on the signals that the rig sends: rates, longest gaps, and plausible values."""
    rates, contents = Notebook("signals"), Notebook("values of signals")
    coming = [
        signal
        for signal in _present(bench, *_COME)
        if _sent_periodically(bench, signal)
        and (bench.wiring.capabilities.generator or signal.name not in _PLAYED)
    ]
    with bench.capture(*(signal.name for signal in coming)) as capture:
        bench.wait(LISTEN)
    outside, silent = [], []
    for signal in coming:
        times, values = capture.times(signal.name), capture.values(signal.name)
        limit = _limit(bench, signal) / NS
        if times.size < 2:
            rates.note(
                f"{signal.name}, rate", False, f"{times.size} samples in {LISTEN:g} s", "sent periodically"
            )
            continue
        gaps = np.diff(times)
        rate = float(1.0 / gaps.mean())
        rates.note(f"{signal.name}, rate", True, f"{rate:.1f} Hz", "", value=rate, apart=RATE_APART * rate)
        longest = float(max(gaps.max(), LISTEN - times[-1]))
        rates.note(
            f"{signal.name}, longest gap",
            longest <= limit,
            f"{longest / ms:.0f} ms",
            f"at most {limit / ms:.0f} ms (its age limit)",
            value=longest,
            apart=limit,
        )
        good = values[np.isfinite(values)]
        if good.size == 0 and signal.group is not None:
            silent.append(signal.name)
        if good.size and (good.min() < signal.low or good.max() > signal.high):
            outside.append(f"{signal.name} = {signal.show(float(good[np.abs(good).argmax()]))}")
    contents.note("values out of their range", not outside, ", ".join(outside) or "none", "none")
    contents.note("measurements that are not available", not silent, ", ".join(silent) or "none", "none")
    for name, why in bench.wiring.absent.items():
        if bench.table[name].group is not None:
            contents.skip(name, f"absent: {why}")
    return [rates, contents]


def ask(bench: "Bench") -> list[Notebook]:
    """Request settings in force, contacts, and signals that the rig does not send by itself. Return the findings."""
    book = Notebook("answers")
    wanted = [
        *_present(bench, Kind.SETTING, Kind.INTERLOCK),
        *(one for one in _present(bench, *_COME) if _limit(bench, one) == 0),
    ]
    slowest, outside, refused = 0.0, [], []
    for signal in wanted:
        before = bench.clock.now()
        try:
            value = bench.settings.reading(signal.name)
        except BenchError as error:
            refused.append(f"{signal.name}: {error}")
            continue
        slowest = max(slowest, (bench.clock.now() - before) / NS)
        if np.isfinite(value) and not signal.low <= value <= signal.high:
            outside.append(f"{signal.name} = {signal.show(value)}")
    book.note(
        "response time, slowest",
        slowest <= ANSWER_MAX,
        f"{slowest / ms:.1f} ms",
        f"at most {ANSWER_MAX / ms:.0f} ms",
        value=slowest,
        apart=ANSWER_APART,
    )
    book.note("values out of their range", not outside, ", ".join(outside) or "none", "none")
    book.note("signals that cannot be read", not refused, "; ".join(refused) or "none", "none")
    book.skip(
        "exceptions, lease, wrong frames", "the wiring does not state how this rig rejects wrong requests"
    )
    return [book]


def lead(bench: "Bench") -> list[Notebook]:
    """Arm the bench, move its platform by 2 mm, and stop all commands. Return the findings."""
    states, motion, silence = Notebook("states"), Notebook("motion"), Notebook("loss of commands")
    in_force = bench.settings.in_force()
    took = _arm(bench, states)
    limit = f"within {_ARM_WITHIN:g} s"
    states.note("start up to ACTIVE", True, f"after {took:.2f} s", limit, value=took, apart=1 * s)
    if bench.has("platform.vertical", "platform.vertical_setpoint"):
        _small_move(bench, motion)
    else:
        motion.skip("platform up by 2 mm", "the rig cannot move it or does not report its position")
    _silence(bench, silence)
    left = {name: value for name, value in bench.settings.in_force().items() if value != in_force[name]}
    found = ", ".join(f"{name} = {bench.table[name].show(value)}" for name, value in left.items())
    silence.note("settings after: loss of commands", not left, found or "unchanged", "unchanged")
    _hold(bench, states)
    return [states, motion, silence]


def _arm(bench: "Bench", book: Notebook) -> float:
    """Arm the bench, and record the largest motion meanwhile. Return the time that it took (s)."""
    with _watched(bench, book, "ACTIVE without set-points"):
        before = bench.clock.now()
        bench.arm(within=_ARM_WITHIN)
        return (bench.clock.now() - before) / NS


def _hold(bench: "Bench", book: Notebook) -> None:
    """Arm the bench up to HOLD, send another set-point for its platform, record the largest motion, and bring the bench
    to rest.
    """
    what, moved = "HOLD after a new set-point", "platform.vertical"
    if not any("HOLD" in step.end for step in bench.wiring.sequences.up):
        book.skip(what, "the start sequence of the rig has no HOLD")
        return
    with _watched(bench, book, what):
        here = bench.readings.value(moved) if bench.has(moved, f"{moved}_setpoint") else math.nan
        bench.arm(within=_ARM_WITHIN, to="HOLD")
        if not math.isnan(here):
            bench.commander.set(f"{moved}_setpoint", here + MOVE)
    if not math.isnan(here):
        bench.commander.set(f"{moved}_setpoint", here)
    bench.disarm()


@contextmanager
def _watched(bench: "Bench", book: Notebook, what: str) -> Iterator[None]:
    """Record the largest motion during the block and shortly after it, under the name ``what``."""
    told = [one.name for one in _present(bench, *MEASURED) if _sent_periodically(bench, one)]
    with bench.capture(*(name for name in (*PLACES, *PRESSURES) if name in told)) as capture:
        bench.wait(2 * OVER)
        yield
        bench.wait(WATCH)
    courses = {name: (capture.times(name), capture.values(name)) for name in capture.names}
    note_still(book, what, courses)


def _small_move(bench: "Bench", book: Notebook) -> None:
    start = bench.average("platform.vertical", over=0.2 * s)
    with bench.capture("platform.vertical") as capture:
        told = (bench.clock.now() - capture.start) / NS
        bench.commander.ramp("platform.vertical_setpoint", start + MOVE, _RATE)
        bench.wait(min(1 * s, MOVE_WITHIN))
    way = bench.average("platform.vertical", over=0.2 * s) - start
    right = "2 ± 0.3 mm"
    book.note(
        "platform up by 2 mm",
        abs(way - MOVE) <= THERE,
        f"{way / mm:.2f} mm",
        right,
        value=way,
        apart=THERE,
    )
    times, values = capture.times("platform.vertical"), capture.values("platform.vertical")
    begun = times[(times > told) & (values - start > MOVE / 4)]
    latency = float(begun[0] - told - MOVE / 4 / _RATE) if begun.size else float("nan")
    limit = LATENCY_MAX + 2 * bench.wiring.capabilities.latency
    book.note(
        "latency from set-point to motion",
        latency <= limit,
        f"{latency / ms:.0f} ms",
        f"at most {limit / ms:.0f} ms, from the latency in the wiring",
        value=latency,
        apart=TIME_APART,
    )
    bench.platform.move_to(vertical=start, rate=_RATE)


def _silence(bench: "Bench", book: Notebook) -> None:
    bench.commander.stop()
    last = bench.clock.now()
    try:
        with bench.despite_faults():
            bench.wait_for(
                lambda: bench.state != "ACTIVE", within=2 * SILENCE_MAX, what="the bench out of ACTIVE"
            )
        took = (bench.clock.now() - last) / NS
    except BenchError:
        took = float("nan")
    finally:
        bench.commander.start()
    book.note(
        "time from the last command to the end of ACTIVE",
        took <= SILENCE_MAX,
        f"{took / ms:.0f} ms, then {bench.state}",
        f"at most {SILENCE_MAX:g} s",
        value=took,
        apart=100 * ms,
    )
    bench.disarm()
    bench.reset()
    book.note("return to rest", True, bench.state, "at rest")


def _present(bench: "Bench", *kinds: Kind) -> list[Signal]:
    return [signal for signal in bench.table.of_kind(*kinds) if bench.has(signal.name)]


def _limit(bench: "Bench", signal: Signal) -> int:
    return int(bench.wiring.freshness[bench.table.index[signal.name]])


def _sent_periodically(bench: "Bench", signal: Signal) -> bool:
    return 0 < _limit(bench, signal) < _EVENTS


#: Groups without motion, and groups with motion.
AT_REST: Final[tuple[tuple[str, Callable[["Bench"], list[Notebook]]], ...]] = (
    ("messages", listen),
    ("requests", ask),
)
MOVING: Final[tuple[tuple[str, Callable[["Bench"], list[Notebook]]], ...]] = (("motion", lead),)
