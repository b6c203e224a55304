"""Sibling rigs: the same bench with one law of another form, which no parameter of the model and no effect covers.

Theory of operation ------------------- Parameters that differ between springs are fitted, and effects are candidates. A
sibling has another difference: the memory of rubber in small loops, or the law of the orifice at a very small pressure
difference. Others are a wall temperature that differs from the hall, a slow actuator, and a bellows area that is curved
over the height.

The curved area needs a term that the model does not have: V = V_0 + A_0 ζ + ½ A_1 ζ² + (1/6) A_2 ζ³. Around the present
height ζ_0 that is, to the third order of ζ − ζ_0, the parabola of a spring with

    A_1' = A_1 + A_2 ζ_0,   A_0' = A_0 − ½ A_2 ζ_0²,   V_0' = V_0 + (1/6) A_2 ζ_0³

which is sent to the rig again and again while it runs.
"""

from collections.abc import Callable, Mapping
from typing import Any, Final, NamedTuple

import numpy as np

from bench_protocol.frames import Block, join
from bench_protocol.rates import FAST_RATE, TICK
from bench_sim.rig.rig import Rig

FAST: Final = round(1.0 / (FAST_RATE * TICK))
#: A_2 of bellows with a curved area (1): over 10 mm it moves the force of an empty car by 20 N, one deviation of noise.
CURVATURE: Final = 2.0


class Form(NamedTuple):
    """A law of a sibling that replaces the one of the model; ``sizes`` are equally likely."""

    name: str
    sizes: tuple[float, ...]


#: Replacement of each parameter of the set.
_PARAMETERS: Final[Mapping[str, Callable[[float], dict[str, float]]]] = {
    "friction_memory": lambda share: {"friction_small_loop": share},
    "warm_wall": lambda kelvin: {"wall_temperature_offset": kelvin},
    "orifice_near_zero": lambda ratio: {"laminar_limit": ratio},
    "slow_actuator": lambda hertz: {"actuator_frequency": hertz},
}
CURVED: Final = "curved_area"
FORMS: Final = (
    Form("friction_memory", (0.0, 0.2)),
    Form("warm_wall", (-0.1, 0.1)),
    Form("orifice_near_zero", (0.998, 0.99995)),
    Form("slow_actuator", (12.0, 15.0)),
    Form(CURVED, (-CURVATURE, CURVATURE)),
)


def drawn(rng: np.random.Generator) -> dict[str, float]:
    """Draw a form and its size, by name."""
    form = FORMS[int(rng.integers(len(FORMS)))]
    return {form.name: float(rng.choice(form.sizes))}


def parameters(forms: Mapping[str, float]) -> dict[str, float]:
    """Return the parameters of the set that differ in a sibling."""
    found: dict[str, float] = {}
    for name, size in forms.items():
        if name in _PARAMETERS:
            found |= _PARAMETERS[name](size)
    return found


class Curved:
    """Runs a rig whose effective area is curved over the height: ``curvature`` A_2, at every fifth tick again."""

    def __init__(self, rig: Rig, curvature: float) -> None:
        self._run: Callable[[int], Block] = rig.run
        self._record: Any = rig.plant.parameter_array[0]
        self._memory: Any = rig.plant.memory
        self._curvature = curvature
        names = ("effective_area", "effective_area_slope", "bellows_volume")
        self._flat = tuple(self._record[name].copy() for name in names)

    def run(self, ticks: int) -> Block:
        """Run a number of ticks."""
        blocks = []
        while ticks > 0:
            piece = min(ticks, FAST)
            self._bend()
            blocks.append(self._run(piece))
            ticks -= piece
        return join(blocks)

    def _bend(self) -> None:
        area, slope, volume = self._flat
        height = np.array(self._memory.bellows_vertical)
        self._record.effective_area[:] = area - 0.5 * self._curvature * height**2
        self._record.effective_area_slope[:] = slope + self._curvature * height
        self._record.bellows_volume[:] = volume + self._curvature * height**3 / 6.0
