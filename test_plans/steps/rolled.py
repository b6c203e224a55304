"""Lateral stiffness of springs that are rolled and sheared together."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Final

import numpy as np

from bench_protocol.units import Hz, mm, rad, s
from bench_protocol.words import SIDES
from test_plans import steps
from test_plans.analysis import PRESSURES, Stiffness
from test_plans.analysis.cells import cells_in, sideways_force
from test_plans.analysis.geometry import Rig, roll_of, shear_of
from test_plans.loads import Load
from test_plans.steps.poses import Home, restore_the_air, take_pose
from test_plans.steps.tables import DAMPING, ROLL, SECANT, STORAGE, Quantity, keep
from test_plans.steps.waves import LEAD, Known, Sine, Values, know, lateral_stiffness, shake

if TYPE_CHECKING:
    from test_plans.analysis.uncertainty import Measured
    from test_plans.run import Run

ROLL_SHEAR: Final = 20 * mm
ROLL_FREQUENCY: Final = 1 * Hz
ROLL_AMPLITUDE: Final = 5 * mm
SAME_ROLL: Final = 0.001 * rad
#: Friction depends on how the springs reached y = +20 mm, for some cycles.
ROLL_CENTRING: Final = 10 * s
#: Time in which the compressed gas cools: then the lower spring under AW3 needs less force than its actuator has.
COOL_BEFORE_LAST: Final = 20 * s


@dataclass(slots=True)
class RollAngle:
    """Results of lateral measurements on rolled springs at y = +20 mm: secant, first harmonic, and pressure difference,
    by roll angle.
    """

    rolls: list[float] = field(default_factory=list)
    secants: list[float] = field(default_factory=list)
    found: list[Stiffness] = field(default_factory=list)
    differences: list[float] = field(default_factory=list)
    sines: list[Sine] = field(default_factory=list)
    known: list[tuple[Measured, Known]] = field(default_factory=list)  #: secant and first harmonic

    def measure(self, run: Run, home: Home, angles: Sequence[float]) -> None:
        """Roll the springs to 0 and to each of the ``angles`` (rad): all of them to one side, then all to the other. At
        each angle, run a lateral sine of 5 mm about y = +20 mm, and add its results to this object.
        """
        rest = run.bench.averages(*PRESSURES, over=steps.AVERAGE_OVER)
        for side in (1.0, -1.0):
            self._measure(run, home, 0.0, lead=ROLL_CENTRING)
            for roll in angles:
                if roll == max(angles):
                    with run.phase("cool"):
                        run.bench.wait(COOL_BEFORE_LAST)
                self._measure(run, home, side * roll)
            with run.phase("back"):
                take_pose(run, home, shear=ROLL_SHEAR)
                restore_the_air(run, rest)
        with run.phase("back"):
            take_pose(run, home)

    def _measure(self, run: Run, home: Home, roll: float, lead: float = LEAD) -> None:
        with run.phase(f"roll {roll:+.3g} rad"):
            take_pose(run, home, shear=ROLL_SHEAR, roll=roll)
            times, values = shake(run, "lateral", ROLL_FREQUENCY, ROLL_AMPLITUDE, lead=lead)
        self.rolls.append(float(roll_of(values, run.rig).mean()))
        self.sines.append(Sine(times, values, ROLL_FREQUENCY))
        self.secants.append(_secant(values, run.rig))
        self.found.append(lateral_stiffness(times, run.rig, values, ROLL_FREQUENCY))
        sine = know(run, times, values, ROLL_FREQUENCY, lateral_stiffness)
        self.known.append((run.measured(_secant, values, run.rig), sine))
        left, right = (float(values[f"{side}.auxiliary_pressure"].mean()) for side in SIDES)
        self.differences.append(left - right)

    def keep(self, run: Run, load: Load, valve: str) -> None:
        """Record secant, first harmonic and pressure difference over the roll angle."""
        order = np.argsort(self.rolls)
        rolls = np.array(self.rolls)[order]
        name = f"{load.name}, valve {valve}"
        rows: tuple[tuple[str, Quantity, Sequence[float | Measured]], ...] = (
            ("Lateral secant F/y at +20 mm per spring", SECANT, [secant for secant, _ in self.known]),
            (
                "Lateral stiffness K' of 5 mm about +20 mm per spring",
                STORAGE,
                [sine.storage for _, sine in self.known],
            ),
            (
                "Lateral damping c of 5 mm about +20 mm per spring",
                DAMPING,
                [sine.damping for _, sine in self.known],
            ),
            ("Pressure left less right", ("pressure difference", "bar"), self.differences),
        )
        for group, quantity, ys in rows:
            keep(run, name, group, ROLL, quantity, rolls.tolist(), [ys[place] for place in order])

    def judge(
        self, run: Run, evaluate: Callable[[list[float], list[float]], tuple[float, ...]], *rolls: float
    ) -> tuple[Measured, ...]:
        """Return the result of ``evaluate`` with its uncertainty. It receives the secants and K' (N/m) at the ``rolls``
        (rad).

        For each angle the nearest measurement is used. Angle 0 has two measurements; their mean is used.
        """
        near = [self._near(roll) for roll in rolls]
        used = sorted({place for places in near for place in places})

        def computed(rig: Rig, *read: Values) -> tuple[float, ...]:
            values = dict(zip(used, read, strict=True))
            secant = {place: _secant(values[place], rig) for place in used}
            storage = {
                place: lateral_stiffness(self.sines[place].times, rig, values[place], ROLL_FREQUENCY).storage
                for place in used
            }
            secants, storages = (
                [float(np.mean([one[place] for place in places])) for places in near]
                for one in (secant, storage)
            )
            return evaluate(secants, storages)

        return run.measure(computed, run.rig, *(self.sines[place].values for place in used))

    def _near(self, roll: float) -> list[int]:
        away = np.abs(np.array(self.rolls) - roll)
        return [int(place) for place in np.flatnonzero(away < away.min() + SAME_ROLL)]


def _secant(values: Values, rig: Rig) -> float:
    """Return F/y (N/m) of one spring, from mean values of the samples."""
    force = -0.5 * float(sideways_force({cell: values[cell].mean() for cell in cells_in(values)}, rig))
    return force / float(shear_of(values, rig).mean())
