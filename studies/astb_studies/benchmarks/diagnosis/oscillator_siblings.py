"""Sibling oscillators with memory, warming or fatigue, which no parameter of the model and no effect describes.

Theory of operation
-------------------
An additional force h on the mass depends on time and on the past motion. It acts as a part of the drive:
m ẍ + c ẋ + k x = f − h. First, the oscillator is run with the drive alone, and h is computed from its motion. Then it
is run with f − h, again and again, until the motion converges. A few rounds are enough, because h is small relative to
f. The force on the ground includes h.
"""

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Final

import numpy as np

from astb_studies.oscillator import Oscillator
from diagnosis.contracts import Array, Effects, Experiment

#: Rounds until the motion has converged.
_ROUNDS: Final = 5
#: Work per damping (m²/s) after which a damper has tired, amplitude after which a spring has softened, and mean of two
#: turning points at which the seat of the spring has moved (m).
_TIRED, _SOFTENED, _MOVED = 0.03, 0.02, 0.005


def _tiring(t: Array, x: Array, v: Array) -> Array:
    """A damper that loses 1 N s/m with the work that it has done."""
    work = np.cumsum(v**2) * (t[1] - t[0])
    return -v * (1.0 - np.exp(-work / _TIRED))


def _softening(t: Array, x: Array, v: Array) -> Array:
    """Rubber that is softer by 1 N/m below the largest displacement that it has seen (Mullins)."""
    return -x * np.tanh(np.maximum.accumulate(np.abs(x)) / _SOFTENED)


def _warming(t: Array, x: Array, v: Array) -> Array:
    """A spring that loses 1 N/m in the course of a run."""
    return -x * (t - t[0]) / (t[-1] - t[0])


def _seating(t: Array, x: Array, v: Array) -> Array:
    """A spring whose seat moves, by up to 1 N, toward the middle of the last two turning points."""
    turns = np.flatnonzero(v[1:] * v[:-1] < 0.0) + 1
    levels = np.concatenate(([0.0, 0.0], np.tanh(0.5 * (x[turns][1:] + x[turns][:-1]) / _MOVED)))
    return levels[np.searchsorted(turns, np.arange(len(t)), side="right")]


#: The force of one unit (N) over time, displacement and speed (n,) of a run.
FORMS: Final[Mapping[str, Callable[[Array, Array, Array], Array]]] = {
    "tiring": _tiring,
    "softening": _softening,
    "warming": _warming,
    "seating": _seating,
}


def run(
    oscillator: Oscillator,
    form: Mapping[str, float],
    experiment: Experiment,
    parameters: Mapping[str, float],
    effects: Effects,
) -> Array:
    """Run an ``oscillator`` with the given size of each ``form``."""
    outputs = oscillator.run(experiment, parameters, effects)
    for _ in range(_ROUNDS if form else 0):
        x = outputs[:, 0]
        v = np.gradient(x, experiment.time)
        extra = sum(size * FORMS[name](experiment.time, x, v) for name, size in form.items())
        drive = experiment.inputs["drive"] - extra
        outputs = oscillator.run(replace(experiment, inputs={"drive": drive}), parameters, effects)
        outputs[:, 1] += extra
    return outputs
