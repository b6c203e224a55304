"""Amplitude control: a motion is repeated with a corrected command until it has the target amplitude.

The command is multiplied by the ratio of target to reached amplitude. For a wave this is a number; for a track it is
the inverse of the measured transfer function. One repetition is exact for a linear axis, whose gain at a frequency does
not depend on the amplitude.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from math import pi, sqrt
from typing import TYPE_CHECKING, Final, Generic, NamedTuple, TypeVar

import numpy as np
import numpy.typing as npt

from bench_protocol.units import Hz, mm, ms, s
from drivers.errors import Misuse, Refused
from test_plans.analysis import Samples, Wave
from test_plans.analysis.spectra import Spectra, spectra
from test_plans.driven import TRACK, Driven

if TYPE_CHECKING:
    from drivers.receiver import Capture
    from test_plans.run import Run

#: Largest relative error of an amplitude, and the number of repetitions to reach it.
WITHIN: Final = 0.01
REPETITIONS: Final = 3
#: Largest ratio of the command to the target. An axis that needs more does not follow, and a larger command would
#: strain it.
MOST: Final = 1.5
#: Amplitude of the first harmonic over that of the wave.
_FIRST_HARMONIC: Final = {"sine": 1.0, "triangle": 8 / pi**2}
_PROGRAM: Final = "generator.amplitude"
#: Largest delay of a track, and the interval in which it is searched.
LATEST: Final = 0.5 * s
_LATE_STEP: Final = 2 * ms
#: Length of a segment of the spectra of a track, and width of the bands of its transfer function.
_SEGMENT: Final = 4 * s
_BAND: Final = 0.5 * Hz
#: Octaves of a track are judged from here up to this part of half the sampling rate, if they have this share of it.
_SLOWEST: Final = 0.25 * Hz
_FASTEST: Final = 0.85
_SHARE: Final = 0.02
#: Number of points per step of a track. With them, straight lines between the points lose less than 0.1 % at 10 Hz.
_FINER: Final = 16

Moved = tuple[Samples, dict[str, Samples]]
Offsets = Mapping[str, Samples]
Way = Callable[[Samples], Samples]
Command = TypeVar("Command")
Motion = TypeVar("Motion")


class Answer(NamedTuple, Generic[Command]):
    """The assessment of a motion: whether it is good enough, and the command for its repetition. ``corrected`` is None
    if the command would not change.
    """

    done: bool
    corrected: Command | None
    reached: str
    correction: str


def controlled(
    run: Run,
    axis: str,
    wave: Wave,
    frequency: float,
    target: float,
    once: Callable[[float], Moved],
    harmonic_of: Callable[[Samples, dict[str, Samples]], complex],
) -> Moved:
    """Run a wave with ``once``, which takes a command amplitude (m), and return its samples.

    If the rig requires amplitude control, the wave is repeated until the amplitude is ``target`` (m) within 1 %, at
    most three times. ``harmonic_of`` returns the first harmonic of the motion (m). The command is at most 1.5 times the
    target amplitude, and within the range of the rig. It is kept for the next wave of this kind in the run.
    """
    if not run.bench.amplitude_control:
        return once(target)
    key = (axis, wave, frequency, target)
    known = [one.command for one in run.driven if one[:4] == key]
    most = min(MOST * target, max(target, float(run.bench.table[_PROGRAM].high)))

    def reached_by(moved: Moved) -> float:
        return abs(harmonic_of(*moved)) / _FIRST_HARMONIC[wave]

    def answer(command: float, moved: Moved) -> Answer[float]:
        reached = reached_by(moved)
        corrected = min(command * target / reached, most) if reached else command
        return Answer(
            abs(reached / target - 1.0) <= WITHIN,
            None if corrected == command else corrected,
            f"{reached / mm:.3g} of {target / mm:.3g} mm",
            f"{corrected / mm:.3g} mm",
        )

    name = f"{axis} {wave} of {frequency:g} Hz"
    moved, command, found, repetitions = _repeat(run, name, known[-1] if known else target, once, answer)
    run.driven.append(Driven(*key, command, reached_by(moved), repetitions))
    if not found.done:
        run.warn(
            f"{name}: the amplitude is {found.reached}, with a command of {command / mm:.3g} mm after "
            f"{repetitions} repetitions"
        )
    return moved


def _repeat(
    run: Run,
    name: str,
    command: Command,
    once: Callable[[Command], Motion],
    answer: Callable[[Command, Motion], Answer[Command]],
) -> tuple[Motion, Command, Answer[Command], int]:
    """Repeat a motion with corrected commands. Return the last motion, its command, its assessment, and the number of
    repetitions.
    """
    moved, repetition = once(command), 0
    while True:
        found = answer(command, moved)
        if found.done or found.corrected is None or repetition == REPETITIONS:
            break
        run.say(f"{name} reached {found.reached}: repeated with {found.correction}")
        try:
            moved = once(found.corrected)
        except (Misuse, Refused) as error:  # before it moves: a limit of the rig
            run.say(f"{name}: the rig refuses {found.correction}: {error}")
            break
        command, repetition = found.corrected, repetition + 1
    return moved, command, found, repetition


class Followed(NamedTuple):
    """Spectra of the motion of one axis on a track: relative to the track, and relative to the command. The common
    delay is removed.
    """

    axis: str
    by_track: Spectra
    by_command: Spectra

    def octaves(self) -> dict[tuple[float, float], complex]:
        """Return by octave of the track (from, to; Hz) the complex ratio of the reached motion to the target motion.
        Octaves in which the track hardly moves are left out.
        """
        highest = float(self.by_track.frequency[-1])
        count = int(np.log2(_FASTEST * highest / _SLOWEST))
        bands = [(_SLOWEST * 2**k, _SLOWEST * 2 ** (k + 1)) for k in range(count)]
        least = _SHARE * self.by_track.rms(0.0, highest)
        return {
            band: self.by_track.between(*band).value for band in bands if self.by_track.rms(*band) >= least
        }

    def inverse(self, frequency: Samples) -> npt.NDArray[np.complex128]:
        """Return the inverse of the transfer function from command to motion at ``frequency`` (Hz, (n,)).

        The transfer function of a band is reduced toward 1 by its uncertainty, so that noise is not corrected.
        """
        middles = np.arange(_BAND, _FASTEST * self.by_command.frequency[-1], _BAND)
        found = []
        for middle in middles.tolist():
            one = self.by_command.between(middle - 0.5 * _BAND, middle + 0.5 * _BAND)
            apart = one.value - 1.0
            found.append(1.0 + apart * abs(apart) ** 2 / (abs(apart) ** 2 + one.uncertainty**2))
        transfer = np.interp(frequency, middles, np.array(found))
        return np.asarray(1.0 / (transfer * np.maximum(1.0, 1.0 / (MOST * np.abs(transfer)))))


def controlled_track(
    run: Run,
    times: Samples,
    target: Offsets,
    axes: Sequence[str],
    before: float,
    once: Callable[[Offsets], Capture],
) -> Capture:
    """Run a track with ``once``, which takes the command: offsets (SI, (n,)) at ``times`` (s, (n,)). Return the
    capture.

    If the rig requires amplitude control, the track is repeated at most three times, until the motion of each of the
    ``axes`` is ``target`` in each octave: within 1 % in amplitude and 0.01 rad in phase. A delay that all axes have in
    common is no error. The capture begins ``before`` (s) the track. The command of a frequency is at most 1.5 times the
    track, and a command beyond the limits of the rig is not used.
    """
    if not (run.bench.amplitude_control and axes):
        return once(target)

    followed: list[Followed] = []

    def answer(command: Offsets, moved: Capture) -> Answer[Offsets]:
        followed[:] = _followed(times, target, command, axes, before, moved)
        wrong = [
            f"{_axis_text(one.axis)} {low:g} to {high:g} Hz {abs(ratio):.1%} at {np.angle(ratio, deg=True):+.1f}°"
            for one in followed
            for (low, high), ratio in one.octaves().items()
            if abs(ratio - 1.0) > WITHIN
        ]
        corrected = {one.axis: _filtered(times, target[one.axis], one) for one in followed}
        return Answer(not wrong, {**command, **corrected}, ", ".join(wrong), "the inverse transfer function")

    moved, _, found, repetitions = _repeat(run, TRACK, target, once, answer)
    for one in followed:
        for band, ratio in one.octaves().items():
            track, sent = one.by_track.rms(*band), one.by_command.rms(*band)
            place = _axis_text(one.axis), TRACK, sqrt(band[0] * band[1])
            run.driven.append(
                Driven(*place, track, sent, abs(ratio) * track, repetitions, float(np.angle(ratio)))
            )
    if not found.done:
        run.warn(f"{TRACK}: after {repetitions} repetitions, the motion over the track is {found.reached}")
    return moved


def _axis_text(axis: str) -> str:
    return axis.replace(".", " ")


def _followed(
    times: Samples, target: Offsets, command: Offsets, axes: Sequence[str], before: float, moved: Capture
) -> list[Followed]:
    """Return the spectra of each axis. The samples are used at their own times, because interpolation would smooth
    them.
    """
    motions = {}
    for name in axes:
        at, values = moved.times(name) - before, moved.values(name)
        played = (at >= 0.0) & (at <= times[-1])
        motions[name] = at[played], values[played] - values[at < 0.0].mean()
    late = _common_delay({name: continuous(times, target[name]) for name in axes}, motions)

    def spectra_of(name: str, way: Samples) -> Spectra:
        at, motion = motions[name]
        rate = (at.size - 1) / float(at[-1] - at[0])
        return spectra(continuous(times, way)(at - late), motion, rate, segment=_SEGMENT)

    return [Followed(name, spectra_of(name, target[name]), spectra_of(name, command[name])) for name in axes]


def _common_delay(targets: Mapping[str, Way], motions: Mapping[str, tuple[Samples, Samples]]) -> float:
    """Return the delay (s), common to all axes, that gives the least sum of squares of their relative deviations."""
    delays = np.arange(0.0, LATEST, _LATE_STEP)
    squares = np.zeros_like(delays)
    for name, (at, motion) in motions.items():
        way_at = targets[name]
        left = [np.sum((motion - way_at(at - late)) ** 2) for late in delays.tolist()]
        squares += np.array(left) / np.sum(motion**2)
    k = int(np.clip(np.argmin(squares), 1, delays.size - 2))
    low, least, high = squares[k - 1 : k + 2]
    return float(delays[k] + 0.5 * _LATE_STEP * (low - high) / (low - 2.0 * least + high))


def continuous(times: Samples, way: Samples) -> Way:
    """Return a smooth function of time (s) through the points ``way`` (n,) at equally spaced ``times`` from 0 on.

    The way begins and ends at 0; outside of its times the function is 0. Straight lines between the points would reduce
    fast motions.
    """
    fine = _FINER * np.fft.irfft(np.fft.rfft(way), _FINER * way.size)
    places = np.arange(fine.size) * (times[1] / _FINER)
    return lambda at: np.asarray(np.interp(at, places, fine, 0.0, 0.0))


def _filtered(times: Samples, way: Samples, followed: Followed) -> Samples:
    """Return the command (n,) that makes the axis move by the ``way`` (n,). It begins and ends at 0."""
    size = 2 * way.size
    lines = np.fft.rfft(way, size) * followed.inverse(np.asarray(np.fft.rfftfreq(size, times[1])))
    found = np.fft.irfft(lines, size)[: way.size]
    return np.asarray(found - np.linspace(found[0], found[-1], found.size))
