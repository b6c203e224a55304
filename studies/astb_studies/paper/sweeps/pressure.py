"""Lateral stiffness against pressure, at several amplitudes (figure 6a, b)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Final

import numpy as np

from bench_protocol.units import Hz, mm, s
from test_plans import steps
from test_plans.analysis import Stiffness, straight_line
from test_plans.analysis.geometry import Rig
from test_plans.check_names import CheckName
from test_plans.loads import Load
from test_plans.steps.carrying import part_of
from test_plans.steps.fittings import put_down
from test_plans.steps.poses import go_home
from test_plans.steps.tables import AMPLITUDE, DAMPING, PRESSURE, STORAGE, keep
from test_plans.steps.waves import (
    Known,
    Sine,
    Values,
    know,
    lateral_stiffness,
    measure_sines,
    pressure_of,
    shake,
)

if TYPE_CHECKING:
    from test_plans.analysis.uncertainty import Measured
    from test_plans.run import Run

#: Slow enough for a quasi-static spring, and descending: a small loop settles sooner after a large one.
SLOW: Final = 0.5 * Hz
SLOW_LEAD: Final = 6 * s
BY_PRESSURE: Final = CheckName(
    "lateral stiffness by pressure at 10 mm",
    "How much the lateral stiffness grows with pressure: it separates the share of the air from that of the rubber.",
)
SOFTENING: Final = CheckName(
    "lateral stiffness at 2.5 mm over 10 mm",
    "How much stiffer the spring is in a small motion than in a large "
    "one: the cause is friction, which reduces comfort.",
)
AMPLITUDES: Final = (10 * mm, 5 * mm, 2.5 * mm)


@dataclass(slots=True)
class LateralPressure:
    """Lateral stiffness of each amplitude, and the pressure at which it was measured."""

    sines: dict[float, list[Sine]] = field(default_factory=lambda: {a: [] for a in AMPLITUDES})
    pressures: dict[float, list[float]] = field(default_factory=lambda: {a: [] for a in AMPLITUDES})
    found: dict[float, list[Stiffness]] = field(default_factory=lambda: {a: [] for a in AMPLITUDES})
    known: dict[float, list[Known]] = field(default_factory=lambda: {a: [] for a in AMPLITUDES})

    def measure(self, run: Run) -> None:
        """Shear the springs by each amplitude at the pressure they have."""
        for amplitude in AMPLITUDES:
            with run.phase(f"lateral sine {amplitude / mm:g} mm"):
                times, values = shake(run, "lateral", SLOW, amplitude, lead=SLOW_LEAD)
            self.sines[amplitude].append(Sine(times, values, SLOW))
            self.pressures[amplitude].append(pressure_of(values))
            self.found[amplitude].append(lateral_stiffness(times, run.rig, values, SLOW))
            self.known[amplitude].append(know(run, times, values, SLOW, lateral_stiffness))

    def keep(self, run: Run, load: Load) -> None:
        """Keep stiffness, damping and amplitude over pressure, for the report."""
        for amplitude in sorted(AMPLITUDES):
            one, known, at = self.found[amplitude], self.known[amplitude], self.pressures[amplitude]
            name = f"{amplitude / mm:g} mm"
            for quantity, ys in (
                (STORAGE, [each.storage for each in known]),
                (DAMPING, [each.damping for each in known]),
                (AMPLITUDE, [K.amplitude for K in one]),
            ):
                keep(run, name, f"Lateral {quantity[0]} per spring, {load.name}", PRESSURE, quantity, at, ys)

    def slope(self, run: Run, amplitude: float) -> Measured:
        """Return dK'/dp (m) of the straight line through the stiffnesses at one amplitude."""
        sines = self.sines[amplitude]

        def evaluate(rig: Rig, *read: Values) -> float:
            found = [
                lateral_stiffness(one.times, rig, values, SLOW)
                for one, values in zip(sines, read, strict=True)
            ]
            at = np.array([pressure_of(values) for values in read])
            return straight_line(at, np.array([K.storage for K in found]))[1]

        return run.measured(evaluate, run.rig, *(one.values for one in sines))

    def softening(self, run: Run, small: float, large: float) -> Measured:
        """Return the stiffness ratio of amplitude ``small`` to ``large``, as a mean over the loads."""
        loads = len(self.sines[small])

        def evaluate(found: list[Stiffness]) -> float:
            return float(
                np.mean([a.storage / b.storage for a, b in zip(found[:loads], found[loads:], strict=True)])
            )

        return measure_sines(run, [*self.sines[small], *self.sines[large]], lateral_stiffness, evaluate)


def carry_first(name: str, parts: Sequence[float]) -> Callable[[Run], None]:
    """Return the set-up that loads the springs with the first of ``parts`` of the preload of load case ``name``."""
    return lambda run: steps.carry(part_of(run, name, parts[0]))(run)


def lateral_stiffness_over_pressure(run: Run, name: str, parts: Sequence[float]) -> None:
    """Measure under each of ``parts`` of the preload of load case ``name``, of which the first is carried already."""
    around = run.specimen.load(name)
    expected = around.limits.band("lateral_stiffness_by_pressure")
    softening = run.specimen.limits.band("lateral_softening")
    loads = [part_of(run, name, part) for part in parts]
    found = LateralPressure()
    for load in loads:
        with run.phase(load.name):
            if load is not loads[0]:
                run.hold_point(f"before {load.name}")
                put_down(run)
                steps.carry(load)(run)
            go_home(run)
            found.measure(run)
    found.keep(run, around)
    slope = found.slope(run, max(AMPLITUDES))
    run.check(BY_PRESSURE, slope, "m", low=expected.low, high=expected.high)
    ratio = found.softening(run, min(AMPLITUDES), max(AMPLITUDES))
    run.check(SOFTENING, ratio, "1", low=softening.low, high=softening.high)
