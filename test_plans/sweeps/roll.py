"""Lateral stiffness of rolled springs, with the differential pressure valve isolated and open (figure 10)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Final

import numpy as np

from bench_protocol.units import Hz, mm, rad, s
from bench_protocol.words import SIDES
from test_plans import steps
from test_plans.analysis import Stiffness
from test_plans.analysis.geometry import Rig, roll_of, shear_of
from test_plans.analysis.readings import PRESSURES, SHEAR_CELLS
from test_plans.check_names import CheckName
from test_plans.loads import Load
from test_plans.steps.poses import COOL, Home, go_home, restore_the_air, take_pose
from test_plans.steps.tables import DAMPING, ROLL, SECANT, STORAGE, Quantity, keep
from test_plans.steps.waves import LEAD, Known, Sine, Values, know, lateral_stiffness, shake

if TYPE_CHECKING:
    from test_plans.analysis.uncertainty import Measured
    from test_plans.run import Run

RISE: Final = CheckName(
    "valve {valve}: secant, rise to 0.05 rad",
    "How much the lateral secant stiffness grows when the car leans: a sheared bellows that rolls pushes by itself.",
)
BEYOND: Final = CheckName(
    "valve {valve}: secant, change beyond over rise",
    "Whether the force keeps rising with the roll angle: it must not, or a leaning car would steer its bogie.",
)
ODD: Final = CheckName(
    "valve {valve}: odd part of the force at 0.05 rad",
    "The part of the force that changes sign with the roll angle: the coupling alone, without friction and offsets.",
)
OVER_LEVEL: Final = CheckName(
    "valve {valve}: first harmonic at 0.05 rad over level",
    "Whether a rolled spring is stiffer than a level one in small motion: the ride would be harder in curves.",
)
ROLL_CHECKS: Final = (RISE, BEYOND, ODD, OVER_LEVEL)
ROLL_SHEAR: Final = 20 * mm
ROLL_FREQUENCY: Final = 1 * Hz
ROLL_AMPLITUDE: Final = 5 * mm
SAME_ROLL: Final = 0.001 * rad
#: Friction remembers how the springs came to y = +20 mm, for some cycles.
ROLL_CENTRING: Final = 10 * s
#: What the gas was squeezed by warms it; without its heat the lower spring under AW3 stays below what its actuator can.
COOL_BEFORE_LAST: Final = 20 * s


@dataclass(slots=True)
class RollAngle:
    """Lateral stiffness of rolled springs at y = +20 mm: secant and first harmonic, and how the pressures part."""

    rolls: list[float] = field(default_factory=list)
    secants: list[float] = field(default_factory=list)
    found: list[Stiffness] = field(default_factory=list)
    differences: list[float] = field(default_factory=list)
    sines: list[Sine] = field(default_factory=list)
    known: list[tuple[Measured, Known]] = field(default_factory=list)  #: secant and first harmonic

    def measure(self, run: Run, home: Home, angles: Sequence[float]) -> None:
        """Roll by each angle, first to one side and then to the other; sine of 5 mm about y = +20 mm."""
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
        """Keep secant, first harmonic and pressure difference over the roll angle."""
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
        """Return what ``evaluate`` makes of secants and K' (N/m) at some roll angles (rad), with its uncertainty.

        Each is measured nearest to its angle; level, it is the mean of both times.
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
    """Return F/y (N/m) of one spring, of the means of both."""
    force = -0.5 * sum(float(values[cell].mean()) for cell in SHEAR_CELLS)
    return force / float(shear_of(values, rig).mean())


def _coupling(secants: list[float], storages: list[float]) -> tuple[float, float, float, float]:
    """Return rise of the secant to the knee and change beyond over the rise, odd force (N), and K' over level.

    Of what was measured level, at the knee, at the largest roll, and at the knee to the other side.
    """
    level, knee, largest, other = secants
    rise = knee - level
    odd = 0.5 * ROLL_SHEAR * (knee - other)
    return rise / level, abs(largest - knee) / rise, odd, storages[1] / storages[0]


#: Beyond 0.05 rad the coupling is saturated: what follows is small beside what went before.
KNEE: Final = 0.05 * rad


def lateral_stiffness_over_roll(run: Run, load: Load, angles: Sequence[float]) -> None:
    """Measure under the load that is carried, first with the differential pressure valve isolated, then with it."""
    band = load.limits.band("coupling_force")
    rises = run.specimen.limits.band("coupling_rise")
    saturated = run.specimen.limits.band("coupling_saturated")
    home = go_home(run)
    run.bench.wait(COOL)
    steps.lock_the_air(run)
    for valve, change in (("isolated", run.bench.air.isolate_dpv), ("open", run.bench.air.connect_dpv)):
        if run.hold_point(f"before the angles with the valve {valve}"):
            home = steps.stand_again(run, load, go_home, COOL)
        change()
        found = RollAngle()
        with run.phase(f"valve {valve}"):
            found.measure(run, home, angles)
        found.keep(run, load, valve)

        rise, beyond, odd, ratio = found.judge(run, _coupling, 0.0, KNEE, max(angles), -KNEE)
        for name, value, limit in ((RISE, rise, rises), (BEYOND, beyond, saturated)):
            run.check(name.of(valve=valve), value, "%", low=limit.low, high=limit.high)
        run.check(ODD.of(valve=valve), odd, "kN", low=band.low, high=band.high)
        run.check(OVER_LEVEL.of(valve=valve), ratio, "1", high=1.0, margin=0.01)
