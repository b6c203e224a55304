"""A motion of any shape, which the host streams to the rig as set-points, cycle by cycle."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Final

import numpy as np

from bench_protocol.arrays import Floats
from bench_protocol.units import NS, s
from drivers.commander import CYCLE
from drivers.declarations import Device
from drivers.errors import Misuse, NotAvailable
from drivers.link import STREAM_CYCLES

#: The wind on a car in the loop, which is a load and needs no axis.
WIND: Final = "car.wind"
#: Time that a waveform may take in addition to its duration.
MARGIN: Final = 5 * s
#: Time in which the set-points of a stopped waveform return.
RETURN: Final = 1 * s


class Waveform(Device):
    """A motion of any shape: ``bench.waveform``. It is relative to the present set-points and ends where it began.

    It is sent with the set-points, in 50 cycles a second, and a rig interpolates them linearly. This reduces the
    amplitude of a sine of 2 Hz by 0.5 %, of 5 Hz by 3 %. The delay is two cycles.
    """

    __slots__ = ()

    def run(self, times: Floats, offsets: Mapping[str, Floats], *, margin: float = MARGIN) -> None:
        """Run the motion to its end; ``times`` (s, (n,)) increase from 0, ``offsets`` (SI, each (n,)) are by name of a
        reading.

        ``{"lateral.force": F}`` moves ``lateral.force_setpoint`` by F, which begins and ends at 0. Errors are raised
        before the motion: Misuse for a wrong shape, range, rate or control mode, NotAvailable for a signal that the rig
        lacks. Raises BenchTimeout if the motion takes ``margin`` s longer than planned. RigFault or LinkLost stop the
        motion at its present position.
        """
        self.start(times, offsets)
        self.wait_done(within=float(times[-1]) + margin)

    def start(self, times: Floats, offsets: Mapping[str, Floats]) -> None:
        """Start the motion of :meth:`run` and return at once."""
        link = self._link
        names = {name: f"{name}_setpoint" for name in offsets}
        cycles = self._foreseen(times, offsets)
        for name in cycles:
            if name != WIND:
                self._refuse_mode(name)
        if link.commander.moving(*names.values()):
            raise Misuse(
                f"{', '.join(names.values())}: a waveform begins at rest, but a set-point still moves; "
                "wait for its end"
            )
        link.commander.play({names[name]: way for name, way in cycles.items()})

    def foresee(self, times: Floats, offsets: Mapping[str, Floats]) -> None:
        """Raise the errors of :meth:`run` that depend neither on the set-points nor on the control mode.

        These are a wrong shape, a motion that is too fast, or offsets beyond the range of the set-point.
        """
        for name, way in self._foreseen(times, offsets).items():
            signal = self._link.table[f"{name}_setpoint"]
            far = int(np.argmax(np.maximum(way - signal.high, signal.low - way)))
            if not signal.low <= way[far] <= signal.high:
                raise Misuse(
                    f"{signal.name} would be {signal.show(way[far])} at {far * CYCLE / NS:g} s; "
                    f"use {signal.show(signal.low)} to {signal.show(signal.high)}"
                )

    def _foreseen(self, times: Floats, offsets: Mapping[str, Floats]) -> dict[str, Floats]:
        """Return ``offsets`` at each cycle. Raises NotAvailable if the rig lacks a signal, Misuse if the motion is
        faster than the rig can follow.
        """
        if lacking := self._link.lacks(*(f"{name}_setpoint" for name in offsets)):
            raise NotAvailable(lacking)
        cycles = _cycles(times, offsets)
        for name, way in cycles.items():
            if name != WIND:
                self._refuse_pace(f"{name}_setpoint", way)
        return cycles

    def wait_done(self, within: float) -> None:
        """Wait until all cycles are sent and have taken effect; an error stops the waveform at its present position.

        Raises Misuse if a set-point was given another value in the meantime, and BenchTimeout after ``within`` s.
        """
        link = self._link
        played = link.commander.played
        try:
            link.wait_for(
                lambda: not link.commander.played.going,
                within=within,
                what="end of the waveform",
                not_before=max(0, played.cycles - played.cycle - 1) * CYCLE / NS if played.going else 0.0,
            )
        except BaseException:
            link.commander.freeze()
            raise
        played = link.commander.played
        if played.cycle < played.cycles:
            raise Misuse(
                f"the waveform ended at {played.cycle * CYCLE / NS:g} s of "
                f"{played.cycles * CYCLE / NS:g} s, because one of its set-points received another "
                "value; do not set it during a waveform"
            )
        link.wait_cycles(STREAM_CYCLES)

    def stop(self) -> None:
        """Stop the waveform, if one runs, and return its set-points to their start values within 1 s."""
        link = self._link
        if not link.commander.played.going:
            return
        names = link.commander.recall(RETURN)
        link.wait_for(
            lambda: not link.commander.moving(*names),
            within=RETURN + MARGIN,
            what="return of the waveform's set-points to their start",
        )

    def _refuse_mode(self, name: str) -> None:
        """Raise Misuse if the axis of the reading ``name`` is not in the control mode that the waveform needs."""
        device, _, needed = name.partition(".")
        if device == "platform":
            return
        control = "lateral.control" if device == "lateral" else "vertical.control"
        if self._link.has(control) and (mode := self._link.settings.choice(control)) != needed:
            raise Misuse(f"waveform of {name}: {control} is {mode!r}; it must be {needed!r}")

    def _refuse_pace(self, name: str, way: Floats) -> None:
        """Raise Misuse if ``way`` (SI, one value each cycle) is faster than the rig follows the set-point ``name``,
        NotAvailable if the wiring does not state how fast that is.
        """
        link, signal = self._link, self._link.table[name]
        pace = link.wiring.capabilities.pace.get(signal.si, math.nan)
        if math.isnan(pace):
            raise NotAvailable(
                f"the wiring of {link.wiring.rig} does not state how fast {name} can move; add the "
                "limits in [player]"
            )
        speeds = np.diff(way) * NS / CYCLE
        worst = int(np.argmax(np.abs(speeds)))
        if abs(speeds[worst]) > pace * (1 + 1e-9):
            raise Misuse(
                f"{name} would move with {signal.show(abs(speeds[worst]))}/s at "
                f"{(worst + 1) * CYCLE / NS:g} s; {link.wiring.rig} follows {signal.show(pace)}/s at "
                "most, so use a slower waveform"
            )


def _cycles(times: Floats, offsets: Mapping[str, Floats]) -> dict[str, Floats]:
    """Return ``offsets`` at each cycle, the first one at 0 s. Raises Misuse for an invalid waveform."""
    times = np.asarray(times, np.float64)
    if times.ndim != 1 or times.size < 2 or times[0] != 0.0 or not (np.diff(times) > 0.0).all():
        raise Misuse("the times of the waveform do not rise from 0 s; give 0 s and at least one later time")
    if not offsets:
        raise Misuse("the waveform has no set-point; give at least one")
    cycles = np.arange(math.ceil(times[-1] * NS / CYCLE - 1e-6) + 1) * CYCLE / NS
    found = {}
    for name, given in offsets.items():
        values = np.asarray(given, np.float64)
        if values.shape != times.shape or not np.isfinite(values).all():
            good = np.count_nonzero(np.isfinite(values))
            raise Misuse(
                f"waveform of {name}: {good} finite numbers for {times.size} times; give one for each time"
            )
        if values[0] != 0.0 or values[-1] != 0.0:
            raise Misuse(
                f"waveform of {name}: it begins at {values[0]:g} and ends at {values[-1]:g}; use 0 for "
                "both, because it is added to the present set-point"
            )
        found[name] = np.interp(cycles, times, values)
    return found
