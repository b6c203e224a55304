"""Lateral stiffness against pressure, at several amplitudes (figure 6a, b)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Final

import numpy as np

from bench_protocol.units import Hz, mm, s
from test_plans import steps
from test_plans.analysis import Stiffness, straight_line
from test_plans.fittings import put_down
from test_plans.loads import Load
from test_plans.poses import go_home
from test_plans.tables import AMPLITUDE, DAMPING, PRESSURE, STORAGE, keep
from test_plans.waves import lateral_stiffness, pressure_of, shake

if TYPE_CHECKING:
    from test_plans.run import Run

#: Slow enough for a quasi-static spring, and descending: a small loop settles sooner after a large one.
SLOW: Final = 0.5 * Hz
SLOW_LEAD: Final = 6 * s
AMPLITUDES: Final = (10 * mm, 5 * mm, 2.5 * mm)


@dataclass(slots=True)
class LateralPressure:
    """Lateral stiffness of each amplitude, and the pressure at which it was measured."""

    pressures: dict[float, list[float]] = field(default_factory=lambda: {a: [] for a in AMPLITUDES})
    found: dict[float, list[Stiffness]] = field(default_factory=lambda: {a: [] for a in AMPLITUDES})

    def measure(self, run: Run) -> None:
        """Shear the springs by each amplitude at the pressure they have."""
        for amplitude in AMPLITUDES:
            with run.phase(f"lateral sine {amplitude / mm:g} mm"):
                times, values = shake(run, "lateral", SLOW, amplitude, lead=SLOW_LEAD)
            self.pressures[amplitude].append(pressure_of(values))
            self.found[amplitude].append(lateral_stiffness(times, values, SLOW))

    def keep(self, run: Run, load: Load) -> None:
        """Keep stiffness, damping and amplitude over pressure, for the report and for the identification."""
        for amplitude in sorted(AMPLITUDES):
            one, at = self.found[amplitude], self.pressures[amplitude]
            name = f"{amplitude / mm:g} mm"
            for quantity, ys in (
                (STORAGE, [K.storage for K in one]),
                (DAMPING, [K.damping for K in one]),
                (AMPLITUDE, [K.amplitude for K in one]),
            ):
                keep(run, name, f"Lateral {quantity[0]} per spring, {load.name}", PRESSURE, quantity, at, ys)

    def slope(self, amplitude: float) -> float:
        """Return dK'/dp (m) of the straight line through what was found at one amplitude."""
        at = np.array(self.pressures[amplitude])
        return straight_line(at, np.array([K.storage for K in self.found[amplitude]]))[1]

    def softening(self, small: float, large: float) -> float:
        """Return how much stiffer the spring is at amplitude ``small`` than at ``large``, the mean over the loads."""
        ratios = [a.storage / b.storage for a, b in zip(self.found[small], self.found[large], strict=True)]
        return float(np.mean(ratios))


def carry_first(around: str, preloads: Sequence[float]) -> Callable[[Run], None]:
    """Return the set-up that lets the springs carry the first of ``preloads`` (N) around a load case."""
    return lambda run: steps.carry(run.specimen.load_of(around, preloads[0]))(run)


def lateral_stiffness_over_pressure(run: Run, name: str, preloads: Sequence[float]) -> None:
    """Measure under each of the preloads (N), of which the first is carried already, around the load case ``name``."""
    around = run.specimen.load(name)
    expected = around.limits.band("lateral_stiffness_by_pressure")
    softening = run.specimen.limits.band("lateral_softening")
    loads = [run.specimen.load_of(name, preload) for preload in preloads]
    found = LateralPressure()
    for load in loads:
        with run.phase(load.name):
            if load is not loads[0]:
                put_down(run)
                steps.carry(load)(run)
            go_home(run)
            found.measure(run)
    found.keep(run, around)
    slope = found.slope(max(AMPLITUDES))
    run.check("lateral stiffness by pressure at 10 mm", slope, "m", low=expected.low, high=expected.high)
    ratio = found.softening(min(AMPLITUDES), max(AMPLITUDES))
    run.check("lateral stiffness at 2.5 mm over 10 mm", ratio, "1", low=softening.low, high=softening.high)
