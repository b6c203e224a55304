"""Tests of motion: the way from DISABLED to ACTIVE, a small move, and the reaction to the end of commands."""

from typing import Final

import numpy as np

from astb.acceptance.conformance.commanding import READY_WITHIN, Stream
from astb.acceptance.conformance.leaving import give_back, leave, note_rest, take
from astb.acceptance.conformance.raw_access import ModbusConnection, RawAccess
from astb.acceptance.conformance.report import Notebook
from astb.acceptance.conformance.stillness import WATCH
from bench_protocol.rates import DISABLE_AFTER, HOLD_AFTER
from bench_protocol.table import TABLE
from bench_protocol.units import NS, mm, ms, s
from bench_protocol.words import PLATFORM_AXES, STATES

STEP_WITHIN: Final = 5 * s
#: Distance of the platform, and thresholds for the begin and the end of the move.
MOVE: Final = 2 * mm
BEGUN: Final = 0.2 * mm
THERE: Final = 0.3 * mm
MOVE_WITHIN: Final = 3 * s
LATENCY_MAX: Final = 200 * ms
#: Differences between the times of two rigs from which they are reported.
TIME_APART: Final = 40 * ms
#: A command is due every 20 ms, and the rig reports its state every 20 ms.
REACTION_BAND: Final = 50 * ms

#: The way up: start state, rising bit or coil, end state.
_WAY_UP: Final = (
    ("DISABLED", "control.reset", "AIR_LOW"),
    ("AIR_LOW", "action.air_high", "AIR_HIGH"),
    ("AIR_HIGH", "control.hold", "HOLD"),
    ("HOLD", "control.active", "ACTIVE"),
)


def move(access: RawAccess) -> list[Notebook]:
    """Arm the bench, move its platform by 2 mm, and stop all commands. Return the findings."""
    states, motion, silence = Notebook("states"), Notebook("motion"), Notebook("loss of commands")
    line = access.modbus()
    if not (token := take(line)):
        states.skip("start up to ACTIVE", "another client has the lease")
        return [states]
    stream = Stream(access, token)
    stream.carry("Control", "PlatformSetpoints")
    stream.start()
    try:
        if way_up(access, line, stream, states):
            left = leave(line, targets=True)
            _small_move(access, stream, motion)
            _silence(access, stream, silence)
            if left:
                note_rest(access, silence, "loss of commands")
    finally:
        stream.stop()
        give_back(line)
    return [states, motion, silence]


def way_up(
    access: RawAccess, line: ModbusConnection, stream: Stream, book: Notebook, to: str = "ACTIVE"
) -> bool:
    """Bring the bench from DISABLED to the state ``to``; its platform does not move.

    Record each step, and return whether all succeeded.
    """
    if not access.wait_for(lambda: access.listener.state == "DISABLED", READY_WITHIN):
        book.skip(
            "start up to ACTIVE",
            f"the bench is {access.listener.state}, not DISABLED; bring it to DISABLED first",
        )
        return False
    stream.set("control.enable", 1.0)
    for axis in PLATFORM_AXES:
        stream.set(f"platform.{axis}_setpoint", access.listener.latest(f"platform.{axis}"))
    access.wait(100 * ms)
    for start, by, end in _WAY_UP:
        before = access.clock.now()
        if by.startswith("control."):
            stream.set(by, 1.0)
        else:
            line.press(TABLE[by].address or 0)
        reached = access.wait_for(lambda end=end: access.listener.state == end, STEP_WITHIN)  # type: ignore[misc]
        took = (access.clock.now() - before) / NS
        if by == "control.reset":
            stream.set(by, 0.0)
        book.note(
            f"{start} to {end}, by {by}",
            reached,
            f"after {took / ms:.0f} ms" if reached else access.listener.state,
            f"within {STEP_WITHIN:g} s",
            value=took,
            apart=TIME_APART,
        )
        if not reached:
            return False
        if end == to:
            break
    return True


def _small_move(access: RawAccess, stream: Stream, book: Notebook) -> None:
    access.wait(500 * ms)
    start = access.listener.latest("platform.vertical")
    commanded = access.clock.now()
    stream.set("platform.vertical_setpoint", start + MOVE)
    arrived = access.wait_for(
        lambda: abs(access.listener.latest("platform.vertical") - start - MOVE) <= THERE, MOVE_WITHIN
    )
    way = access.listener.latest("platform.vertical") - start
    book.note(
        "platform up by 2 mm",
        arrived,
        f"{way / mm:.2f} mm",
        "2 ± 0.3 mm",
        value=way,
        apart=THERE,
    )
    times, values = access.listener.series("platform.vertical")
    begun = times[(times > commanded) & (values - start > BEGUN)]
    latency = (begun[0] - commanded) / NS if begun.size else float("nan")
    book.note(
        "latency from set-point to motion",
        latency <= LATENCY_MAX,
        f"{latency / ms:.0f} ms",
        f"at most {LATENCY_MAX / ms:.0f} ms",
        value=float(latency),
        apart=TIME_APART,
    )
    _hold(access, stream, start, book)
    back = access.wait_for(
        lambda: abs(access.listener.latest("platform.vertical") - start) <= THERE, MOVE_WITHIN
    )
    book.note(
        "platform back to its start",
        back,
        f"{(access.listener.latest('platform.vertical') - start) / mm:.2f} mm",
        "0 ± 0.3 mm",
    )


def _hold(access: RawAccess, stream: Stream, elsewhere: float, book: Notebook) -> None:
    """Bring the bench to HOLD, send ``elsewhere`` (m) as set-point of its platform, and record how far it moves.

    Then request ACTIVE.
    """
    stream.set("control.active", 0.0)
    held = access.wait_for(lambda: access.listener.state == "HOLD", STEP_WITHIN)
    before, here = access.clock.now(), access.listener.latest("platform.vertical")
    stream.set("platform.vertical_setpoint", elsewhere)
    access.wait(WATCH)
    times, values = access.listener.series("platform.vertical")
    way = float(np.abs(values[times >= before] - here).max(initial=0.0))
    book.note(
        "motion in HOLD after a new set-point",
        held and way <= THERE,
        f"{way / mm:.2f} mm" if held else access.listener.state,
        f"at most {THERE / mm:g} mm",
        value=way,
        apart=THERE,
    )
    stream.set("control.active", 1.0)


def _silence(access: RawAccess, stream: Stream, book: Notebook) -> None:
    stream.stop()
    last = access.clock.now()
    access.wait_for(lambda: access.listener.state == "FAULT_DISABLED", STEP_WITHIN)
    times, values = access.listener.series("rig.state")
    for what, states, right in (
        ("hold", ("FAULT_REACTION", "FAULT_HOLD"), HOLD_AFTER),
        ("the start for the safe position", ("FAULT_DISABLED",), DISABLE_AFTER),
    ):
        codes = [STATES.index(state) for state in states]
        when = times[(times > last) & np.isin(values, codes)]
        took = float((when[0] - last) / NS) if when.size else float("nan")
        book.note(
            f"time from the last command to {what}",
            abs(took - right) <= REACTION_BAND,
            f"{took / ms:.0f} ms",
            f"{right / ms:.0f} ± {REACTION_BAND / ms:.0f} ms",
            value=took,
            apart=TIME_APART,
        )
    stream.set("control.hold", 0.0)
    stream.set("control.active", 0.0)
    stream.start()
    book.note("reset", reset(access, stream), access.listener.state, "DISABLED")


def reset(access: RawAccess, stream: Stream) -> bool:
    """Clear a fault. Return whether the bench is DISABLED afterwards."""
    access.wait(100 * ms)
    stream.set("control.reset", 1.0)
    cleared = access.wait_for(lambda: access.listener.state == "DISABLED", STEP_WITHIN)
    stream.set("control.reset", 0.0)
    stream.set("control.enable", 0.0)
    access.wait(100 * ms)
    return cleared
