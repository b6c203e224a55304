"""Springs at lateral offsets: tangent and secant stiffness, effective area and volume (figures 7 and 9)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Final

import numpy as np

from bench_protocol.units import ATMOSPHERE, Hz, mm, s
from test_plans import steps
from test_plans.analysis import Stiffness
from test_plans.analysis.geometry import shear_of
from test_plans.check_names import CheckName
from test_plans.loads import Load
from test_plans.steps.poses import POSE_SAMPLES, Home, PoseReading, go_home, pose_of, read_pose, take_pose
from test_plans.steps.tables import (
    AREA,
    BELLOWS_SHEAR,
    DAMPING,
    SECANT,
    SHEAR,
    STORAGE,
    VOLUME,
    keep,
)
from test_plans.steps.waves import Known, Sine, know, lateral_stiffness, measure_sines, shake

if TYPE_CHECKING:
    from test_plans.analysis.uncertainty import Measured
    from test_plans.run import Run
    from test_plans.specimen import Specimen

OFFSETS: Final = tuple(y * mm for y in (0.0, 20.0, 40.0, 60.0, -20.0, -40.0, -60.0))
DITHER: Final = 1 * mm
DITHER_FREQUENCY: Final = 2 * Hz
DITHER_LEAD: Final = 3 * s
#: Out and back on both sides, each place from both directions: what friction does falls out of the mean.
STAIRS: Final = tuple(y * mm for y in (0, 20, 40, 60, 40, 20, 0, -20, -40, -60, -40, -20, 0))
LIFTS: Final = tuple(z * mm for z in (8, 0, -8, 0))
#: Gas that was squeezed gives its heat off; friction creeps to rest.
STAIR_WAIT: Final = 3 * s
TRAVEL: Final = CheckName(
    "{load}: travel of the bump stop",
    "How far the bolster's centre moved: beyond the gap, the stop carries "
    "load and the result is not the spring's alone.",
)
LEFT_OF_STIFFNESS: Final = CheckName(
    "{load}: stiffness of 1 mm, 60 mm over centre",
    "The lateral stiffness that remains far from the middle: a car has such an offset in a curve or in wind.",
)
AREA_LOST: Final = CheckName(
    "{load}: effective area lost at 60 mm",
    "How much less load the air carries in a sheared spring: a bellows that loses more sinks in every curve.",
)
VOLUME_LOST: Final = CheckName(
    "{load}: volume lost at 60 mm",
    "How much volume the bellows loses in shear: it depends on the shape of the membrane, and stiffens the spring.",
)
#: Of a spring at its offsets.
OFFSET_CHECKS: Final = (TRAVEL, LEFT_OF_STIFFNESS, AREA_LOST, VOLUME_LOST)
#: Shakes friction out of the vertical direction: the fading wave ends near the middle of its loop.
CENTRING: Final = 8 * mm


@dataclass(slots=True)
class LateralOffset:
    """Small motions about lateral offsets, and the isolated bellows on the same stairs."""

    specimen: Specimen
    offsets: list[float] = field(default_factory=list)
    tangents: list[Stiffness] = field(default_factory=list)
    stairs: list[PoseReading] = field(default_factory=list)
    lifts: list[PoseReading] = field(default_factory=list)
    sines: list[Sine] = field(default_factory=list)
    known: list[Known] = field(default_factory=list)  #: of the tangents

    def dither(self, run: Run, home: Home) -> None:
        """Shake the springs by 1 mm about each offset, bellows and auxiliary chamber joined as in service."""
        for offset in OFFSETS:
            with run.phase(f"dither at {offset / mm:g} mm"):
                take_pose(run, home, shear=offset)
                times, values = shake(run, "lateral", DITHER_FREQUENCY, DITHER, lead=DITHER_LEAD)
            self.offsets.append(float(shear_of(values, run.rig).mean()))
            self.sines.append(Sine(times, values, DITHER_FREQUENCY))
            self.tangents.append(lateral_stiffness(times, run.rig, values, DITHER_FREQUENCY))
            self.known.append(know(run, times, values, DITHER_FREQUENCY, lateral_stiffness))

    def climb(self, run: Run, home: Home) -> None:
        """Shear and lift the springs step by step, with only the gas in their bellows."""
        with run.phase("isolated bellows"):
            take_pose(run, home)
            run.bench.generator.run("vertical", amplitude=CENTRING, frequency=1 * Hz, cycles=3)
            run.bench.air.isolate_reservoirs()
            for shear in STAIRS:
                self.stairs.append(self._pose_reading(run, home, shear, 0.0))
            for height in LIFTS:
                self.lifts.append(self._pose_reading(run, home, 0.0, height))
            run.bench.air.connect_reservoirs()

    @staticmethod
    def _pose_reading(run: Run, home: Home, shear: float, height: float) -> PoseReading:
        take_pose(run, home, shear=shear, height=height)
        run.bench.wait(STAIR_WAIT)
        return read_pose(run)

    def keep(self, run: Run, load: Load) -> None:
        """Keep tangents, secants, area and volume for the report."""
        name = load.name
        keep(
            run,
            name,
            "Lateral stiffness K' of 1 mm per spring",
            SHEAR,
            STORAGE,
            self.offsets,
            [one.storage for one in self.known],
        )
        keep(
            run,
            name,
            "Lateral damping c of 1 mm per spring",
            SHEAR,
            DAMPING,
            self.offsets,
            [one.damping for one in self.known],
        )
        places, _ = secants_of(self.stairs)
        secants = self._of_stairs(run, lambda stairs: tuple(secants_of(stairs)[1]))
        areas = self._of_stairs(run, lambda stairs: tuple(one.vertical / one.pressure for one in stairs))
        volumes = self._of_stairs(run, lambda stairs: tuple(_volumes(self.specimen, load, stairs)))
        keep(run, name, "Lateral secant stiffness per spring", SHEAR, SECANT, places, secants)
        own = [one.shear - one.lateral / self.specimen.emergency_stiffness_lateral for one in self.stairs]
        keep(
            run,
            name,
            "Effective area",
            BELLOWS_SHEAR,
            AREA,
            own,
            areas,
        )
        keep(run, name, "Volume", BELLOWS_SHEAR, VOLUME, own, volumes)

    def tangent_left(self, run: Run) -> Measured:
        """Return the ratio of K' of small motions at ±60 mm to that at the centre."""
        outermost = max(OFFSETS)
        sines = [one for one, y in zip(self.sines, OFFSETS, strict=True) if y in {0.0, outermost, -outermost}]
        centre = sines.index(self.sines[OFFSETS.index(0.0)])

        def evaluate(found: list[Stiffness]) -> float:
            far = [K.storage for place, K in enumerate(found) if place != centre]
            return float(np.mean(far) / found[centre].storage)

        return measure_sines(run, sines, lateral_stiffness, evaluate)

    def travel(self, run: Run) -> Measured:
        """Return how far (m) the bump stop was approached."""
        return self._of_stairs(run, lambda stairs: (max(abs(one.stop_travel) for one in stairs),))[0]

    def losses(self, run: Run, load: Load) -> tuple[Measured, ...]:
        """Return which fractions of effective area and volume are missing at ±60 mm."""
        far, centre = np.isclose(np.abs(STAIRS), max(STAIRS)), np.isclose(STAIRS, 0.0)

        def lost(stairs: Sequence[PoseReading]) -> tuple[float, ...]:
            area = np.array([one.vertical / one.pressure for one in stairs])
            volume = np.array(_volumes(self.specimen, load, stairs))
            return tuple(float(1 - one[far].mean() / one[centre].mean()) for one in (area, volume))

        return self._of_stairs(run, lost)

    def _of_stairs(
        self, run: Run, evaluate: Callable[[Sequence[PoseReading]], tuple[float, ...]]
    ) -> tuple[Measured, ...]:
        read = [one.read for one in self.stairs]
        return run.measure(
            lambda rig, *read: evaluate([pose_of(one, rig) for one in read]),
            run.rig,
            *read,
            averaged=POSE_SAMPLES,
        )


def secants_of(stairs: Sequence[PoseReading]) -> tuple[list[float], list[float]]:
    """Return |y| and (F(y) − F(−y))/(2y) of the outward steps, including friction."""
    places, secants = [], []
    for size in sorted({abs(y) for y in STAIRS} - {0.0}):
        plus, minus = (stairs[STAIRS.index(sign * size)] for sign in (1, -1))
        travel = plus.shear - minus.shear
        places.append(travel / 2)
        secants.append((plus.lateral - minus.lateral) / travel)
    return places, secants


def _volumes(spring: Specimen, load: Load, stairs: Sequence[PoseReading]) -> list[float]:
    """Return V(y)/V(0) of the bellows by its gas, which is always the same: V ∝ T/p, at its own design height.

    The deflection of the emergency spring follows the force; the drawing gives the corresponding volume.
    """
    specific = np.array([one.temperature / (one.pressure + ATMOSPHERE) for one in stairs])
    lifted = np.array(
        [one.height + (one.vertical - load.preload) / spring.emergency_stiffness_vertical for one in stairs]
    )
    centre = np.array([y == 0.0 for y in STAIRS])
    volume = specific / specific[centre].mean() - spring.effective_area * lifted / spring.bellows_volume
    return [float(v) for v in volume / volume[centre].mean()]


def lateral_offsets(run: Run, load: Load) -> None:
    """Measure under the load that is carried."""
    tangent = load.limits.band("tangent_left")
    missing = [run.specimen.limits.band(name) for name in ("area_lost", "volume_lost")]
    found = LateralOffset(run.specimen)
    home = go_home(run)
    found.dither(run, home)  # meanwhile the gas cools, and the air follows
    steps.lock_the_air(run)
    found.climb(run, home)
    with run.phase("back"):
        take_pose(run, home)
    found.keep(run, load)

    run.check(TRAVEL.of(load=load.name), found.travel(run), "mm", high=run.rig["stop_gap"])
    run.check(
        LEFT_OF_STIFFNESS.of(load=load.name),
        found.tangent_left(run),
        "1",
        low=tangent.low,
        high=tangent.high,
    )
    for name, lost, band in zip((AREA_LOST, VOLUME_LOST), found.losses(run, load), missing, strict=True):
        run.check(name.of(load=load.name), lost, "%", low=band.low, high=band.high)
