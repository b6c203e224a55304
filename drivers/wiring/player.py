"""The player: the waves of a function generator, added by the bench to its set-points where a rig has none.

It answers for the settings ``generator.*`` and the actions ``action.program_*`` as a rig's own generator would, with
the same waves. It is moved on by every beat of the set-points.
"""

from __future__ import annotations

import math
import threading
from collections.abc import Mapping
from typing import Final

import numpy as np
import numpy.typing as npt

from bench_protocol.modbus import DEVICE_FAILURE
from bench_protocol.rates import COMMAND_RATE
from bench_protocol.signals import Kind
from bench_protocol.units import NS, s
from bench_protocol.wires import Table
from bench_protocol.words import AXES, CONTROL_MODES, WAVES, Program
from drivers.errors import NotAvailable, Refused
from drivers.wiring.lines import PlayerLimits

Floats = npt.NDArray[np.float64]

#: How long the axis of a stopped program takes to come back.
RETURN: Final = 1 * s
#: A wave of which fewer set-points are streamed in a cycle would be a staircase.
POINTS_MIN: Final = 5
#: What a wave moves on by at the most from one beat to the next: one beat may be missing, a stall is left out.
_STEP_MAX: Final = round(2 * NS / COMMAND_RATE)
#: Peak speed of a wave of amplitude 1 and frequency 1 Hz, in the order of the waves.
_STEEPEST: Final = {"sine": math.tau, "unilateral_cosine": math.pi, "triangle": 4.0}
assert tuple(_STEEPEST) == WAVES
#: What the axis is controlled by, which actuators it moves, and which way each goes.
_MOVES: Final[Mapping[str, tuple[str, Mapping[str, int]]]] = {
    "vertical": ("vertical.control", {"vertical_left": 1, "vertical_right": 1}),
    "roll": ("vertical.control", {"vertical_left": 1, "vertical_right": -1}),
    "lateral": ("lateral.control", {"lateral": 1}),
    "platform_vertical": ("", {"platform.vertical": 1}),
    "platform_lateral": ("", {"platform.lateral": 1}),
    "platform_roll": ("", {"platform.roll": 1}),
}
assert tuple(_MOVES) == AXES


def waveform(wave: str, phase: float, cycles: float) -> float:
    """Return the unit wave at ``phase`` (cycles since start) of a program of ``cycles`` whole cycles.

    Sine and triangle fade in over the first cycle and out over the last; the unilateral cosine
    ``(1 - cos(2 pi phase)) / 2`` starts and ends at rest by itself.
    """
    if wave == "unilateral_cosine":
        return 0.5 * (1.0 - math.cos(math.tau * phase))
    edge = min(phase, cycles - phase)
    envelope = 0.5 * (1.0 - math.cos(math.pi * max(edge, 0.0))) if edge < 1.0 else 1.0
    turn = phase - math.floor(phase)
    if wave == "triangle":
        return envelope * (
            4.0 * turn if turn < 0.25 else 2.0 - 4.0 * turn if turn < 0.75 else 4.0 * turn - 4.0
        )
    return envelope * math.sin(math.tau * turn)


class Player:
    """A program of waves: settings, state and phase. Thread-safe.

    ``rig`` names the rig in errors; ``absent`` are the set-points that it does not have.
    """

    def __init__(self, rig: str, table: Table, limits: PlayerLimits, absent: Mapping[str, str]) -> None:
        self._rig, self._table, self._limits, self._absent = rig, table, limits, absent
        self._settings = {
            signal.name: signal.default
            for signal in table.of_kind(Kind.SETTING)
            if signal.name.startswith("generator.")
        }
        self._lock = threading.Lock()
        self._program = Program.IDLE
        self._phase = 0.0
        self._last: int | None = None  # ns of the last beat
        self._elapsed = 0  # ns of beats so far, without stalls
        self._time: int | None = None  # ns of the last beat of the program, in time elapsed
        self._wave, self._cycles, self._frequency = WAVES[0], 1.0, 1.0
        self._heights: dict[int, float] = {}  # amplitude (SI) by table row
        self._added: dict[int, float] = {}  # offset (SI) by table row on the last beat
        self._returning: dict[int, float] = {}  # the same at the time of the stop
        self._stopped: int | None = None  # ns in time elapsed; None: at the next beat

    @property
    def busy(self) -> bool:
        """Whether a program runs or is held."""
        return self._program in (Program.RUN, Program.HOLD)

    def told(self) -> dict[str, float]:
        """Return what the program says of itself, and its settings (SI)."""
        with self._lock:
            cycle = float(math.floor(self._phase))
            return {"rig.program": float(self._program), "rig.generator_cycle": cycle, **self._settings}

    def write(self, values: Mapping[str, float]) -> None:
        """Set settings (SI) for the next program."""
        with self._lock:
            self._settings.update(values)

    # -- actions -------------------------------------------------------------------------------------------------

    def run(self, modes: Mapping[str, float], setpoints: Floats, *, active: bool) -> None:
        """Start the program that is set, or go on with the one that is held.

        ``modes``: the control modes in force by the name of their setting; ``setpoints`` (SI) by table row. Refused
        in words for what a generator would refuse, NotAvailable for a set-point that the rig does not have.
        """
        with self._lock:
            if not active:
                raise _refused("run", "the bench is not ACTIVE")
            if self._program is Program.RUN:
                raise _refused("run", "a program runs already")
            if self._program is Program.HOLD:
                self._program, self._time = Program.RUN, None
                return
            settings = dict(self._settings)
            axis = AXES[round(settings["generator.axis"])]
            wave = WAVES[round(settings["generator.wave"])]
            heights = self._heights_of(axis, settings, modes)
            self._refuse_steep(axis, wave, heights, settings["generator.frequency"])
            self._refuse_far(heights, setpoints)
            self._heights, self._wave = heights, wave
            self._frequency, self._cycles = settings["generator.frequency"], settings["generator.cycles"]
            self._phase, self._time, self._program = 0.0, None, Program.RUN

    def hold(self) -> None:
        """Freeze the wave where it is."""
        with self._lock:
            if self._program is not Program.RUN:
                raise _refused("hold", "no program runs")
            self._program = Program.HOLD

    def stop(self) -> None:
        """End the program; its axis comes back on a straight line within `RETURN`."""
        with self._lock:
            if not self.busy:
                raise _refused("stop", "no program runs")
            self._returning, self._stopped = dict(self._added), None
            self._program, self._phase = Program.STOPPED, 0.0

    # -- beats ---------------------------------------------------------------------------------------------------

    def advance(self, time: int, *, active: bool) -> dict[int, float]:
        """Move the program on to ``time`` (ns); return what to add to the set-points (SI) by table row.

        A bench that is not ACTIVE any more has no program: its set-points are taken over anew before the next.
        """
        with self._lock:
            time = self._played(time)
            if not active:
                if self.busy:
                    self._program, self._phase = Program.STOPPED, 0.0
                self._returning, self._added = {}, {}
                return {}
            if self._program is Program.RUN:
                if self._time is not None:
                    self._phase += self._frequency * (time - self._time) / NS
                self._time = time
                if self._phase >= self._cycles:
                    self._phase, self._program = self._cycles, Program.IDLE
            offsets = self._offsets() if self.busy else {}
            for row, offset in self._return(time).items():
                offsets[row] = offsets.get(row, 0.0) + offset
            self._added = offsets
            return dict(offsets)

    def _played(self, time: int) -> int:
        """Return how long there have been set-points (ns), without what a stall took: no wave jumps over it."""
        if self._last is not None:
            self._elapsed += min(time - self._last, _STEP_MAX)
        self._last = time
        return self._elapsed

    def _offsets(self) -> dict[int, float]:
        unit = waveform(self._wave, self._phase, self._cycles)
        return {row: height * unit for row, height in self._heights.items()}

    def _return(self, time: int) -> dict[int, float]:
        if not self._returning:
            return {}
        self._stopped = time if self._stopped is None else self._stopped
        share = 1.0 - (time - self._stopped) / (RETURN * NS)
        if share <= 0.0:
            self._returning = {}
        return {row: offset * share for row, offset in self._returning.items()}

    # -- what is possible ----------------------------------------------------------------------------------------

    def _heights_of(
        self, axis: str, settings: Mapping[str, float], modes: Mapping[str, float]
    ) -> dict[int, float]:
        """Return the amplitude (SI) by table row of the set-points that ``axis`` moves in its present control mode."""
        control, moved = _MOVES[axis]
        number = modes.get(control, math.nan) if control else CONTROL_MODES.index("displacement")
        if math.isnan(number):
            raise _refused(
                "run", f"it is not known how {axis} is controlled: {self._rig} does not report {control}"
            )
        mode = CONTROL_MODES[round(number)]
        if mode == "off" or (axis == "roll" and mode == "force"):
            raise _refused("run", f"{axis} cannot move so: {control} is {mode}")
        kind = "roll_amplitude" if axis.endswith("roll") else "amplitude"
        height = settings[f"generator.{'force_amplitude' if mode == 'force' else kind}"]
        if axis == "roll":
            height *= self._limits.lever
        heights = {}
        for target, way in moved.items():
            name = f"{target}_setpoint" if not control else f"{target}.{mode}_setpoint"
            if name in self._absent:
                raise NotAvailable(
                    f"{self._rig} has no {name}, which {axis} would move: {self._absent[name]}"
                )
            heights[self._table.index[name]] = way * height
        return heights

    def _refuse_steep(self, axis: str, wave: str, heights: Mapping[int, float], frequency: float) -> None:
        if frequency * POINTS_MIN > COMMAND_RATE:
            raise _refused(
                "run",
                f"{frequency:g} Hz is too fast for {COMMAND_RATE:g} set-points a second; "
                f"{COMMAND_RATE / POINTS_MIN:g} Hz is the most",
            )
        for row, height in heights.items():
            unit = self._table.signals[row].si
            limits = {"m": self._limits.speed, "rad": self._limits.roll_rate, "N": self._limits.force_rate}
            peak = _STEEPEST[wave] * abs(height) * frequency
            if peak > limits[unit]:
                raise _refused(
                    "run",
                    f"this {wave.replace('_', ' ')} on {axis} reaches {peak:.3g} {unit}/s, and the wiring's [player] "
                    f"allows {limits[unit]:.3g} {unit}/s",
                )

    def _refuse_far(self, heights: Mapping[int, float], setpoints: Floats) -> None:
        for row, height in heights.items():
            signal, base = self._table.signals[row], float(setpoints[row])
            if math.isnan(base):
                raise _refused("run", f"{signal.name} has no value to ride on; arm the bench first")
            if not signal.low <= base - abs(height) <= base + abs(height) <= signal.high:
                raise _refused(
                    "run",
                    f"{signal.name} would go from {signal.show(base - abs(height))} to "
                    f"{signal.show(base + abs(height))}, and can from {signal.range_text()}",
                )


def _refused(verb: str, why: str) -> Refused:
    return Refused(f"action.program_{verb} was refused: {why}", DEVICE_FAILURE)
