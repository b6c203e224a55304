"""Amplitude control: a wave is repeated with a corrected command until the motion has the wanted amplitude.

The command is multiplied by wanted over reached amplitude. One repetition is exact for a linear axis, whose gain at a
frequency does not depend on the amplitude.
"""

from __future__ import annotations

from collections.abc import Callable
from math import pi
from typing import TYPE_CHECKING, Final

from bench_protocol.units import mm
from drivers.errors import Misuse, Refused
from test_plans.analysis import Samples, Wave
from test_plans.driven import Driven

if TYPE_CHECKING:
    from test_plans.run import Run

#: Largest relative error of an amplitude, and the number of repetitions to reach it.
WITHIN: Final = 0.01
REPETITIONS: Final = 3
#: Largest command over the wanted amplitude: an axis that needs more does not follow, and more would strain it.
MOST: Final = 1.5
#: Amplitude of the first harmonic over that of the wave.
_FIRST_HARMONIC: Final = {"sine": 1.0, "triangle": 8 / pi**2}
_PROGRAM: Final = "generator.amplitude"

Moved = tuple[Samples, dict[str, Samples]]


def controlled(
    run: Run,
    axis: str,
    wave: Wave,
    frequency: float,
    wanted: float,
    once: Callable[[float], Moved],
    harmonic_of: Callable[[Samples, dict[str, Samples]], complex],
) -> Moved:
    """Return the samples of a wave that ``once`` runs with a command (m).

    If the rig requires amplitude control, the wave is repeated until the amplitude is ``wanted`` (m) within 1 %, at
    most three times. ``harmonic_of`` returns the first harmonic of the motion (m). The command stays below 1.5 times
    the wanted amplitude and within the range of the rig. It is kept for the next wave of this kind in the run.
    """
    if not run.bench.amplitude_control:
        return once(wanted)
    key = (axis, wave, frequency, wanted)
    known = [one.command for one in run.driven if one[:4] == key]
    command = known[-1] if known else wanted
    most = min(MOST * wanted, max(wanted, float(run.bench.table[_PROGRAM].high)))
    moved, repetition = once(command), 0
    while True:
        reached = abs(harmonic_of(*moved)) / _FIRST_HARMONIC[wave]
        corrected = min(command * wanted / reached, most) if reached else command
        done = abs(reached / wanted - 1.0) <= WITHIN
        if done or corrected == command or repetition == REPETITIONS:
            break
        run.say(
            f"{axis} {wave} of {frequency:g} Hz reached {reached / mm:.3g} of {wanted / mm:.3g} mm: "
            f"repeated with {corrected / mm:.3g} mm"
        )
        try:
            moved = once(corrected)
        except (Misuse, Refused) as error:  # before it moves: a limit of the rig
            run.say(f"{axis} {wave} of {frequency:g} Hz: the rig refuses {corrected / mm:.3g} mm: {error}")
            break
        command, repetition = corrected, repetition + 1
    run.driven.append(Driven(*key, command, reached, repetition))
    if not done:
        run.warn(
            f"{axis} {wave} of {frequency:g} Hz: the amplitude is {reached / mm:.3g} mm instead of "
            f"{wanted / mm:.3g} mm, with a command of {command / mm:.3g} mm after {repetition} repetitions"
        )
    return moved
