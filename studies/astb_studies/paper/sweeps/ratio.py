"""Vertical damping against pressure ratio, for several orifice plates (figure 6c)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from itertools import pairwise
from typing import TYPE_CHECKING, Final

import numpy as np

from bench_protocol.units import ATMOSPHERE, Hz, mm, s
from bench_protocol.words import SIDES
from test_plans import steps
from test_plans.analysis import PRESSURES, Samples, Stiffness, one_cycle
from test_plans.check_names import CheckName
from test_plans.loads import Load
from test_plans.steps.fittings import PLATE
from test_plans.steps.poses import COOL, go_home
from test_plans.steps.tables import AMPLITUDE, DAMPING, RATIO, STORAGE, keep
from test_plans.steps.waves import Known, Sine, Values, know, measure_sines, shake, vertical_stiffness

if TYPE_CHECKING:
    from test_plans.analysis.uncertainty import Measured
    from test_plans.run import Run

NATURAL: Final = 1.2 * Hz
SWINGS: Final = tuple(a * mm for a in (1.0, 2.0, 3.5, 5.0, 7.5, 10.0, 15.0, 20.0, 25.0))
FITTED: Final = CheckName(
    "c at 13 mm and 5 mm",
    "Damping of the standard plate of the bench: all other plates are compared with it.",
)
NEXT_PLATE: Final = CheckName(
    "c at {larger:g} mm over {smaller:g} mm",
    "How much less a larger bore damps: plates that were confused or are not mounted tightly show here.",
)
BESIDE_PEAK: Final = CheckName(
    "c beside its peak, {plate:g} mm",
    "How far damping falls on both sides of its peak: it shows that the "
    "damping comes from the orifice, not the rubber.",
)
PLATE_CHECKS: Final = (FITTED, NEXT_PLATE, BESIDE_PEAK)
#: The amplitude at which plates are compared.
AT: Final = 5 * mm


@dataclass(slots=True)
class DampingByRatio:
    """The results of one orifice plate: damping per spring, and the pressure difference across the plate."""

    ratios: list[float] = field(default_factory=list)
    found: list[Stiffness] = field(default_factory=list)
    sines: list[Sine] = field(default_factory=list)
    known: list[Known] = field(default_factory=list)

    def measure(self, run: Run) -> None:
        """Shake the springs vertically at 1.2 Hz. Differences of the pressure readings at rest are offsets."""
        rest = run.bench.averages(*PRESSURES, over=steps.AVERAGE_OVER)
        for amplitude in SWINGS:
            with run.phase(f"vertical sine {amplitude / mm:g} mm"):
                times, values = shake(run, "vertical", NATURAL, amplitude, lead=2 * s)
            self.sines.append(Sine(times, values, NATURAL))
            self.found.append(vertical_stiffness(times, run.rig, values, NATURAL))
            self.known.append(know(run, times, values, NATURAL, vertical_stiffness))
            lowest = [self._lowest_ratio(times, values, rest, side) for side in SIDES]
            self.ratios.append(float(np.mean(lowest)))

    @staticmethod
    def _lowest_ratio(times: Samples, values: Values, rest: Mapping[str, float], side: str) -> float:
        bellows, auxiliary = (
            one_cycle(times, values[f"{side}.{part}_pressure"], NATURAL) for part in ("bellows", "auxiliary")
        )
        bellows = bellows - rest[f"{side}.bellows_pressure"] + rest[f"{side}.auxiliary_pressure"]
        low, high = np.minimum(bellows, auxiliary), np.maximum(bellows, auxiliary)
        return float(np.min((low + ATMOSPHERE) / (high + ATMOSPHERE)))

    def keep(self, run: Run, load: Load, plate: float) -> None:
        """Keep damping over ratio and over amplitude."""
        name = f"{plate / mm:g} mm"
        damping = [one.damping for one in self.known]
        keep(
            run,
            name,
            f"Vertical damping c over pressure ratio, {load.name}",
            RATIO,
            DAMPING,
            self.ratios,
            damping,
        )
        amplitudes = [K.amplitude for K in self.found]
        keep(
            run,
            name,
            f"Vertical damping c over amplitude, {load.name}",
            AMPLITUDE,
            DAMPING,
            amplitudes,
            damping,
        )
        storage = [one.storage for one in self.known]
        keep(
            run,
            name,
            f"Vertical stiffness K' over amplitude, {load.name}",
            AMPLITUDE,
            STORAGE,
            amplitudes,
            storage,
        )

    def at(self, amplitude: float) -> Sine:
        """Return the readings at one of the amplitudes (m)."""
        return self.sines[SWINGS.index(amplitude)]

    def drop_from_peak(self, run: Run) -> Measured:
        """Return the relative distance of c below its maximum at the nearer end of the amplitudes."""
        peak = int(np.argmax([K.damping for K in self.found]))

        def evaluate(found: list[Stiffness]) -> float:
            first, last, highest = (K.damping for K in found)
            return 1 - max(first, last) / highest

        sines = [self.sines[place] for place in (0, -1, peak)]
        return measure_sines(run, sines, vertical_stiffness, evaluate)


def damping_over_ratio(run: Run, load: Load, plate: float) -> DampingByRatio:
    """Measure with the plate that is fitted, under the load that is carried."""
    found = DampingByRatio()
    go_home(run)
    run.bench.wait(COOL)
    steps.lock_the_air(run)
    found.measure(run)
    found.keep(run, load, plate)
    return found


def check_damping(run: Run, load: Load, found: Mapping[float, DampingByRatio]) -> None:
    """Check that damping falls from plate to plate, and has its maximum between the ends of the amplitudes."""
    fitted = load.limits.band("plate_damping")
    following = run.specimen.limits.band("damping_next_plate")
    drop = run.specimen.limits.band("damping_beside_peak")
    sines = {plate: one.at(AT) for plate, one in found.items()}
    c = measure_sines(run, [sines[PLATE]], vertical_stiffness, lambda found: found[0].damping)
    run.check(FITTED, c, "kN*s/m", low=fitted.low, high=fitted.high)
    for smaller, larger in pairwise(sorted(sines)):
        name = NEXT_PLATE.of(larger=larger / mm, smaller=smaller / mm)
        of_both = [sines[larger], sines[smaller]]
        less = measure_sines(
            run, of_both, vertical_stiffness, lambda found: found[0].damping / found[1].damping
        )
        run.check(name, less, "1", low=following.low, high=following.high)
    for plate in (min(sines), PLATE):
        name = BESIDE_PEAK.of(plate=plate / mm)
        run.check(name, found[plate].drop_from_peak(run), "%", low=drop.low, high=drop.high)
