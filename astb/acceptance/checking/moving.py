"""One small move of each axis, without air: its readings, their sign and scale, and their delay.

The bolster is first lifted by 5 mm, off its stops. Then each axis goes 2 mm (2 mrad) and back, and the lateral
actuator pushes with 500 N if it can. Each axis is first tried with a tenth of the move. Then the motions of `measuring`
follow, and their fit is compared with the stated dimensions of the rig. In every case, the bench is brought to rest
at the end.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Final

import numpy as np

from astb.acceptance.checking.measuring import Measuring
from astb.acceptance.checking.report import MoveLine, Plausibility
from bench_protocol.units import N, bar, kN, mm, mrad, ms, s
from bench_protocol.words import PLATFORM_AXES, SIDES
from drivers.bench import Bench
from drivers.errors import BenchError, NotAvailable, RigFault
from test_plans.analysis import SHEAR_CELLS, VERTICAL_CELLS

LIFT: Final = 5 * mm
STEP: Final = 2 * mm
TILT: Final = 2 * mrad
PUSH: Final = 500 * N
RATE: Final = 10 * mm / s
_WITHIN: Final = 6 * s
_SETTLE: Final = 0.5 * s
_OVER: Final = 0.4 * s
#: Air in the springs would change the move.
_EMPTY: Final = 0.3 * bar
#: Permitted relative difference between a change and that of the other transducer.
_BAND: Final = 0.2
_NOISE: Final = {"m": 0.3 * mm, "rad": 0.3 * mrad, "N": 0.15 * kN}
_LATENCY_MAX: Final = 500 * ms


def move_each(bench: Bench) -> list[MoveLine]:
    """Move each axis of a connected ``bench``, and return the findings.

    The bench must be at rest without air; at the end it is brought to rest.
    """
    book = _Moves(bench)
    if why := _not_now(bench):
        book.note("all moves", False, why, "at rest, without air")
        return book.lines
    try:
        bench.arm()
        book.note(
            "the way up", bench.state == "ACTIVE", f"from rest to {bench.state}", "ACTIVE by its sequences"
        )
        for part in (_lift, _sides, _platform, _sideways, _push, _hanging, _one_by_one, _pressed):
            try:
                part(bench, book)
            except NotAvailable as error:
                book.skip(part.__name__.strip("_"), str(error))
    except (BenchError, ValueError) as error:  # a position out of its range is no set-point
        book.note("the moves", False, str(error), "no fault")
    finally:
        _return_to_rest(bench, book)
    return book.lines


def _not_now(bench: Bench) -> str:
    if bench.state not in bench.wiring.sequences.at_rest:
        return f"the bench is {bench.state}, and not at rest"
    for side in SIDES:
        name = f"{side}.bellows_pressure"
        if bench.has(name) and not abs(bench.readings.value(name)) <= _EMPTY:
            return f"{bench.readings.show(name)}: the springs must be without air"
    return ""


def _return_to_rest(bench: Bench, book: _Moves) -> None:
    try:
        bench.disarm()
        book.note("the way to rest", True, f"state {bench.state}")
    except BenchError as error:
        book.note("the way to rest", False, str(error), f"one of {', '.join(bench.wiring.sequences.at_rest)}")


class _Moves:
    """Makes moves and records their results."""

    def __init__(self, bench: Bench) -> None:
        self._bench = bench
        self._known: set[str] = set()  #: axes that have made their first small move
        self.lines: list[MoveLine] = []
        self.dimensions = Measuring(bench, self.lines)

    def note(self, what: str, good: bool, found: str, right: str = "") -> None:
        verdict = Plausibility.FINE if good else Plausibility.DOUBTFUL
        self.lines.append(MoveLine(what=what, verdict=verdict, found=found, right=right))

    def skip(self, what: str, why: str) -> None:
        self.lines.append(MoveLine(what=what, verdict=Plausibility.UNTOLD, found=why))

    def by(self, targets: Mapping[str, float], rate: float, *also: str) -> dict[str, float]:
        """Change the readings ``targets`` by these amounts (SI). Return the measured changes of ``targets`` and
        ``also``, by name.

        Only the end of the ramps is awaited. The readings need not reach their targets, because this is what the test
        checks.
        """
        bench = self._bench
        names = [name for name in dict.fromkeys([*targets, *also]) if bench.has(name)]
        before = bench.averages(*names, over=_OVER)
        start = {name: self._setpoint(name, before[name]) for name in targets}
        for name, change in targets.items():
            if name not in self._known:
                self._feel(name, start[name], 0.1 * change, rate)
        moving = [f"{name}_setpoint" for name in targets]
        with bench.capture(*targets) as capture:
            lasts = bench.commander.ramp_all(
                {f"{name}_setpoint": start[name] + change for name, change in targets.items()}, rate
            )
            bench.wait_for(lambda: not bench.commander.moving(*moving), _WITHIN, "the end of the ramps")
            bench.wait(_SETTLE)
        after = bench.averages(*names, over=_OVER)
        for name, change in targets.items():
            self._follows(name, change, after[name] - before[name])
            self._latency(name, capture.times(name), capture.values(name), change, lasts)
        return {name: after[name] - before[name] for name in names}

    def _feel(self, name: str, start: float, change: float, rate: float) -> None:
        """Move an axis by ``change`` for the first time.

        Raises RigFault if it goes more than three times as far, as with a wrong scale.
        """
        bench, signal = self._bench, self._bench.table[name]
        before = bench.average(name, over=_OVER)
        bench.commander.ramp(f"{name}_setpoint", start + change, rate)
        bench.wait(_SETTLE)
        found = bench.average(name, over=_OVER) - before
        if abs(found) > 3 * abs(change) + _NOISE[signal.si]:
            raise RigFault(
                f"{name} changed by {signal.show(found)} when {signal.show(change)} was commanded; correct the scale "
                "of the reading or of its set-point"
            )
        self._known.add(name)

    def _setpoint(self, name: str, measured: float) -> float:
        value = self._bench.commander.value(f"{name}_setpoint")
        return measured if math.isnan(value) else value

    def _follows(self, name: str, wanted: float, found: float) -> None:
        self.compare(f"{name} follows its set-point", name, found, wanted)

    def compare(self, what: str, name: str, found: float, right: float) -> None:
        """Record whether the changes ``found`` and ``right`` agree, within the noise of the signal ``name`` or 20 %,
        the larger of both.
        """
        signal = self._bench.table[name]
        noise = _NOISE[signal.si]
        good = abs(found - right) <= max(noise, _BAND * abs(right))
        self.note(
            what,
            good,
            signal.show(found) + ("" if good else _describe_mismatch(found, right, noise)),
            signal.show(right),
        )

    def _latency(self, name: str, times: np.ndarray, values: np.ndarray, change: float, lasts: float) -> None:
        """Record the delay of a reading behind its set-point, at half of the change.

        Nothing is recorded for a reading that makes less than half of the change.
        """
        if values.size < 2 or abs(values[-1] - values[0]) < 0.5 * abs(change):
            return
        past = np.abs(values - values[0]) >= 0.5 * abs(values[-1] - values[0])
        late = float(times[int(np.argmax(past))]) - 0.5 * lasts
        self.note(
            f"{name}, from set-point to reading",
            late <= _LATENCY_MAX,
            f"{late / ms:.0f} ms",
            f"at most {_LATENCY_MAX / ms:.0f} ms",
        )


def _describe_mismatch(found: float, right: float, noise: float) -> str:
    if abs(found) <= noise:
        return ": it does not move"
    if found * right < 0 and abs(found + right) <= max(noise, _BAND * abs(right)):
        return ": the sign is wrong"
    ratio = found / right
    return (
        f": {ratio:.3g} times the expected change; check the scale" if ratio > 0 else ": check sign and scale"
    )


def _sum(changes: Mapping[str, float], names: tuple[str, ...]) -> float | None:
    """Return the sum of the changes of ``names``, None if one is missing."""
    return sum(changes[name] for name in names) if all(name in changes for name in names) else None


def _lift(bench: Bench, book: _Moves) -> None:
    """Lift both sides.

    Check that the heights follow the actuators, and that the load cells lose the weight that these carry.
    """
    _in_displacement(bench, "vertical")
    book.dimensions.resting()
    pistons = {f"vertical_{side}.displacement": LIFT for side in SIDES}
    forces = tuple(f"vertical_{side}.force" for side in SIDES)
    heights = tuple(f"{side}.height" for side in SIDES)
    changes = book.by(pistons, RATE, *heights, *forces, *VERTICAL_CELLS)
    for side in SIDES:
        if f"{side}.height" in changes:
            piston = changes[f"vertical_{side}.displacement"]
            book.compare(
                f"{side}.height goes with the actuator", f"{side}.height", changes[f"{side}.height"], piston
            )
    force, cells = _sum(changes, forces), _sum(changes, VERTICAL_CELLS)
    if force is not None and cells is not None:
        book.compare(
            "load cells 1 to 4 lose what the vertical forces take up", VERTICAL_CELLS[0], cells, force
        )
        for cell in VERTICAL_CELLS:
            book.compare(f"{cell} has its share", cell, changes[cell], force / 4)


def _sides(bench: Bench, book: _Moves) -> None:
    """Lift one side after the other. Check that the laser on the lifted side measures the larger change."""
    for side, other in (SIDES, SIDES[::-1]):
        name = f"vertical_{side}.displacement"
        changes = book.by({name: STEP}, RATE, *(f"{one}.height" for one in SIDES))
        if f"{side}.height" in changes and f"{other}.height" in changes:
            mine, theirs = changes[f"{side}.height"], changes[f"{other}.height"]
            swapped = abs(theirs) > abs(mine)
            signal = bench.table[f"{side}.height"]
            book.note(
                f"the {side} laser is mounted on the {side}",
                not swapped,
                f"{signal.show(mine)}, the other one {signal.show(theirs)}"
                + (": are the sides swapped?" if swapped else ""),
                signal.show(STEP),
            )
        book.by({name: -STEP}, RATE)


def _hanging(bench: Bench, book: _Moves) -> None:
    """Shake the bolster that hangs on the actuators, and the platform below it."""
    _in_displacement(bench, "lateral")
    book.dimensions.hanging()


def _one_by_one(bench: Bench, book: _Moves) -> None:
    """Press one spring after the other."""
    book.dimensions.one_by_one()


def _pressed(bench: Bench, book: _Moves) -> None:
    """Shake the bolster on its stops, and compare all measured dimensions with the stated ones."""
    book.dimensions.pressed()
    book.dimensions.compare()


def _platform(bench: Bench, book: _Moves) -> None:
    """Move the platform along each of its axes; a move up reduces the height of both springs."""
    for axis in PLATFORM_AXES:
        name = f"platform.{axis}"
        if lacking := bench.lacks(name, f"{name}_setpoint"):
            book.skip(name, lacking)
            continue
        step = TILT if axis == "roll" else STEP
        also = () if axis == "lateral" else tuple(f"{side}.height" for side in SIDES)
        changes = book.by({name: step}, step / STEP * RATE, *also)
        for one in also:
            if one in changes and axis == "vertical":
                book.compare(f"{one} falls as the platform rises", one, changes[one], -changes[name])
        book.by({name: -step}, step / STEP * RATE)


def _sideways(bench: Bench, book: _Moves) -> None:
    """Move the bolster to both sides, and compare the lateral load cells with the force of the lateral actuator."""
    _in_displacement(bench, "lateral")
    for step in (STEP, -2 * STEP, STEP):
        changes = book.by({"lateral.displacement": step}, RATE, "lateral.force", *SHEAR_CELLS)
        _against_cells(book, changes)


def _push(bench: Bench, book: _Moves) -> None:
    """Push to the left with a force, if the bench has force control."""
    if lacking := bench.lacks("lateral.force", "lateral.force_setpoint"):
        book.skip("a push sideways", lacking)
        return
    bench.lateral.control = "force"
    changes = book.by({"lateral.force": PUSH}, 2 * kN / s, "lateral.displacement", *SHEAR_CELLS)
    _against_cells(book, changes)
    if "lateral.displacement" in changes:
        moved = changes["lateral.displacement"]
        book.note(
            "a push to the left moves to the left",
            moved > 0,
            bench.table["lateral.displacement"].show(moved),
            "positive",
        )
    book.by({"lateral.force": -PUSH}, 2 * kN / s)
    bench.lateral.hold_position()


def _against_cells(book: _Moves, changes: Mapping[str, float]) -> None:
    cells = _sum(changes, SHEAR_CELLS)
    if cells is not None and "lateral.force" in changes:
        book.compare(
            "load cells 5 and 6 hold against the lateral force",
            SHEAR_CELLS[0],
            cells,
            -changes["lateral.force"],
        )


def _in_displacement(bench: Bench, axis: str) -> None:
    device = getattr(bench, axis)
    if device.control != "displacement":
        device.control = "displacement"
