"""The player: a function generator in the bench, which adds waves to the set-points of a rig without a generator.

It accepts the settings ``generator.*`` and the actions ``action.program_*`` as a rig's own generator does, with the
same waves. It advances with every cycle of the set-points.
"""

from __future__ import annotations

import math
import threading
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

from bench_protocol.arrays import Floats
from bench_protocol.modbus import DEVICE_FAILURE
from bench_protocol.rates import COMMAND_RATE
from bench_protocol.signals import Kind
from bench_protocol.units import NS, s
from bench_protocol.wires import Table
from bench_protocol.words import AXES, CONTROL_MODES, STEEPEST, WAVES, WAVES_AT_ONCE, Program
from drivers.errors import NotAvailable, Refused
from drivers.wiring.lines import PlayerLimits

#: Time that the axis of a stopped program takes to return.
RETURN: Final = 1 * s
#: Smallest number of set-points in one cycle of a wave; with fewer, the motion would have steps.
POINTS_MIN: Final = 5
#: Largest advance of a wave (ns) from one set-point to the next: one may be missing, a longer stall is skipped.
_STEP_MAX: Final = round(2 * NS / COMMAND_RATE)
#: By axis: the setting of its control mode ("" if it has none), and what it moves, each with its sign.
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

    Sine, triangle and plateau fade in over the first cycle and out over the last; the unilateral cosine
    ``(1 - cos(2 pi phase)) / 2`` starts and ends at rest by itself. Before its start, ``phase`` < 0, a wave is 0.
    """
    if phase < 0.0:
        return 0.0
    if wave == "unilateral_cosine":
        return 0.5 * (1.0 - math.cos(math.tau * phase))
    edge = min(phase, cycles - phase)
    envelope = 0.5 * (1.0 - math.cos(math.pi * max(edge, 0.0))) if edge < 1.0 else 1.0
    if wave == "plateau":
        return envelope
    turn = phase - math.floor(phase)
    if wave == "triangle":
        return envelope * (
            4.0 * turn if turn < 0.25 else 2.0 - 4.0 * turn if turn < 0.75 else 4.0 * turn - 4.0
        )
    return envelope * math.sin(math.tau * turn)


@dataclass(slots=True)
class _Wave:
    """One wave of a program, and its phase (cycles since its start, negative before)."""

    form: str
    frequency: float
    cycles: float
    phase: float
    heights: Mapping[int, float]  #: amplitude (SI) by table row

    @classmethod
    def of(cls, settings: Mapping[str, float], heights: Mapping[int, float]) -> _Wave:
        """Return the wave of these settings, before its start."""
        frequency, delay = settings["generator.frequency"], settings["generator.delay"]
        form = WAVES[round(settings["generator.wave"])]
        return cls(form, frequency, settings["generator.cycles"], -frequency * delay, heights)


class Player:
    """A program of waves: settings, state and phases. Thread-safe.

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
        self._waves: list[_Wave] = []
        self._kept: list[dict[str, float]] = []  # waves added for the next program
        self._last: int | None = None  # ns of the last cycle of the set-points
        self._elapsed = 0  # ns, time played so far, without stalls
        self._time: int | None = None  # ns, time played at the last cycle of the program
        self._added: dict[int, float] = {}  # offset (SI) by table row in the last cycle
        self._returning: dict[int, float] = {}  # offsets at the time of the stop
        self._stopped: int | None = None  # ns, time played at the stop; None: set at the next cycle

    @property
    def busy(self) -> bool:
        """Whether a program runs or is held."""
        return self._program in (Program.RUN, Program.HOLD)

    def state(self) -> dict[str, float]:
        """Return the state of the program, and its settings (SI)."""
        with self._lock:
            cycle = float(math.floor(max(self._waves[-1].phase, 0.0))) if self._waves else 0.0
            return {"rig.program": float(self._program), "rig.generator_cycle": cycle, **self._settings}

    def write(self, values: Mapping[str, float]) -> None:
        """Set settings (SI) for the next program."""
        with self._lock:
            self._settings.update(values)

    # -- actions -------------------------------------------------------------------------------------------------

    def add(self, modes: Mapping[str, float], setpoints: Floats, *, active: bool) -> None:
        """Store the wave of the present settings; the next :meth:`run` starts all stored waves. The arguments are those
        of `run`. Raises Refused as `run` does, while a program is held, and for too many waves.
        """
        with self._lock:
            if not active:
                raise _refused("add", "the bench is not ACTIVE; arm it first")
            if self.busy:
                raise _refused("add", "a program runs or is held; stop it first")
            if len(self._kept) == WAVES_AT_ONCE:
                raise _refused(
                    "add",
                    f"the program has {WAVES_AT_ONCE} waves already; run or stop it first",
                )
            kept = [*self._kept, dict(self._settings)]
            self._possible(kept, modes, setpoints, "add")
            self._kept = kept

    def run(self, modes: Mapping[str, float], setpoints: Floats, *, active: bool) -> None:
        """Start the wave of the present settings, or all added waves, or resume a held program.

        ``modes``: the present control modes by the name of their setting; ``setpoints`` (SI) by table row. Raises
        Refused, with the reason, if the bench is not ``active``, if a program runs, and for a wave that a generator
        would refuse. Raises NotAvailable for a set-point that the rig lacks.
        """
        with self._lock:
            if not active:
                raise _refused("run", "the bench is not ACTIVE; arm it first")
            if self._program is Program.RUN:
                raise _refused("run", "a program runs already; stop it first")
            if self._program is Program.HOLD:
                self._program, self._time = Program.RUN, None
                return
            waves = self._possible(self._kept or [self._settings], modes, setpoints, "run")
            self._waves, self._kept = waves, []
            self._time, self._program = None, Program.RUN

    def hold(self) -> None:
        """Freeze the waves at their present phases. Raises Refused if no program runs."""
        with self._lock:
            if self._program is not Program.RUN:
                raise _refused("hold", "no program runs; start one first")
            self._program = Program.HOLD

    def stop(self) -> None:
        """End the program; its axes return linearly within `RETURN`. If none runs, discard added waves. Raises Refused
        if there are none either.
        """
        with self._lock:
            if not self.busy:
                if self._kept:
                    self._kept = []
                    return
                raise _refused("stop", "no program runs; start one first")
            self._returning, self._stopped = dict(self._added), None
            self._program, self._waves = Program.STOPPED, []

    # -- each cycle of the set-points ---------------------------------------------------------------------------------

    def advance(self, time: int, *, active: bool) -> dict[int, float]:
        """Advance the program to ``time`` (ns); return the offsets of the set-points (SI) by table row.

        If the bench is not ``active``, the program ends at once, and its offsets become 0, because arming sets all
        set-points to the measured values.
        """
        with self._lock:
            time = self._played(time)
            if not active:
                if self.busy:
                    self._program, self._waves = Program.STOPPED, []
                self._returning, self._added, self._kept = {}, {}, []
                return {}
            if self._program is Program.RUN:
                if self._time is not None:
                    for wave in self._waves:
                        moved = wave.phase + wave.frequency * (time - self._time) / NS
                        wave.phase = min(moved, wave.cycles)
                self._time = time
                if all(wave.phase >= wave.cycles for wave in self._waves):
                    self._program = Program.IDLE
            offsets = self._offsets() if self.busy else {}
            for row, offset in self._return(time).items():
                offsets[row] = offsets.get(row, 0.0) + offset
            self._added = offsets
            return dict(offsets)

    def _played(self, time: int) -> int:
        """Return the time (ns) during which set-points were sent. Pauses do not count, so that no wave jumps."""
        if self._last is not None:
            self._elapsed += min(time - self._last, _STEP_MAX)
        self._last = time
        return self._elapsed

    def _offsets(self) -> dict[int, float]:
        offsets: dict[int, float] = {}
        for wave in self._waves:
            unit = waveform(wave.form, wave.phase, wave.cycles)
            for row, height in wave.heights.items():
                offsets[row] = offsets.get(row, 0.0) + height * unit
        return offsets

    def _return(self, time: int) -> dict[int, float]:
        if not self._returning:
            return {}
        self._stopped = time if self._stopped is None else self._stopped
        share = 1.0 - (time - self._stopped) / (RETURN * NS)
        if share <= 0.0:
            self._returning = {}
        return {row: offset * share for row, offset in self._returning.items()}

    # -- checks --------------------------------------------------------------------------------------------------

    def _possible(
        self, given: Sequence[Mapping[str, float]], modes: Mapping[str, float], setpoints: Floats, verb: str
    ) -> list[_Wave]:
        """Return the waves of the settings ``given``. Raises Refused if one of them, or their sum, is invalid."""
        waves = [_Wave.of(settings, self._heights_of(settings, modes, verb)) for settings in given]
        self._refuse_steep(waves, verb)
        self._refuse_far(waves, setpoints, verb)
        return waves

    def _heights_of(
        self, settings: Mapping[str, float], modes: Mapping[str, float], verb: str
    ) -> dict[int, float]:
        """Return the amplitude (SI) of each set-point that the wave moves in the present control mode, by table row."""
        axis = AXES[round(settings["generator.axis"])]
        control, moved = _MOVES[axis]
        number = modes.get(control, math.nan) if control else CONTROL_MODES.index("displacement")
        if math.isnan(number):
            raise _refused(
                verb,
                f"the control mode of {axis} is unknown: {self._rig} does not report {control}; add it to the wiring",
            )
        mode = CONTROL_MODES[round(number)]
        if mode == "off":
            raise _refused(
                verb, f"{axis} cannot make this motion: {control} is {mode}; set it to displacement or force"
            )
        kind = "roll_amplitude" if axis.endswith("roll") else "amplitude"
        height = settings[f"generator.{'force_amplitude' if mode == 'force' else kind}"]
        if axis == "roll" and mode == "displacement":
            height *= self._limits.lever
        heights = {}
        for target, way in moved.items():
            name = f"{target}_setpoint" if not control else f"{target}.{mode}_setpoint"
            if name in self._absent:
                raise NotAvailable(
                    f"{axis} cannot move, because {self._rig} has no {name}: {self._absent[name]}; use another axis"
                )
            heights[self._table.index[name]] = way * height
        return heights

    def _refuse_steep(self, waves: Sequence[_Wave], verb: str) -> None:
        """Raise Refused for a wave with too few set-points per cycle, or if the speeds of all waves together exceed the
        limits of ``[player]``.
        """
        speeds: dict[int, float] = {}
        for wave in waves:
            if wave.frequency * POINTS_MIN > COMMAND_RATE:
                raise _refused(
                    verb,
                    f"{wave.frequency:g} Hz is too fast for {COMMAND_RATE:g} set-points a second; use "
                    f"{COMMAND_RATE / POINTS_MIN:g} Hz or less",
                )
            for row, height in wave.heights.items():
                peak = STEEPEST[wave.form] * abs(height) * wave.frequency
                speeds[row] = speeds.get(row, 0.0) + peak
        what = f"this {waves[0].form.replace('_', ' ')}" if len(waves) == 1 else "these waves together"
        for row, peak in speeds.items():
            signal = self._table.signals[row]
            unit = signal.si
            limits = {"m": self._limits.speed, "rad": self._limits.roll_rate, "N": self._limits.force_rate}
            if peak > limits[unit]:
                raise _refused(
                    verb,
                    f"{signal.name} would reach {peak:.3g} {unit}/s in {what}, but [player] of the "
                    f"wiring allows {limits[unit]:.3g} {unit}/s; use a smaller amplitude or frequency",
                )

    def _refuse_far(self, waves: Sequence[_Wave], setpoints: Floats, verb: str) -> None:
        ways: dict[int, float] = {}
        for wave in waves:
            for row, height in wave.heights.items():
                ways[row] = ways.get(row, 0.0) + abs(height)
        for row, way in ways.items():
            signal, base = self._table.signals[row], float(setpoints[row])
            if math.isnan(base):
                raise _refused(verb, f"{signal.name} has no value yet; arm the bench first")
            if not signal.low <= base - way <= base + way <= signal.high:
                raise _refused(
                    verb,
                    f"{signal.name} would go from {signal.show(base - way)} to "
                    f"{signal.show(base + way)}, beyond its range {signal.range_text()}; use a smaller "
                    "amplitude",
                )


def _refused(verb: str, reason: str) -> Refused:
    return Refused(f"action.program_{verb} was refused: {reason}", DEVICE_FAILURE)
