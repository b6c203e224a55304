"""Lateral and vertical stiffness and damping against frequency, with and without the connecting pipe (figure 11)."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from bench_protocol.units import MN, Hz, kN, m, mm
from bench_protocol.words import SIDES
from test_plans import steps
from test_plans.analysis import BELLOWS_TEMPERATURES, Stiffness, first_harmonic
from test_plans.analysis.geometry import drive
from test_plans.analysis.uncertainty import EVEN
from test_plans.check_names import CheckName
from test_plans.loads import Load
from test_plans.steps.fittings import fit_pipe, fit_plate, put_down
from test_plans.steps.poses import COOL, go_home
from test_plans.steps.tables import AMPLITUDE, DAMPING, FREQUENCY, MAGNITUDE, STORAGE, TEMPERATURE, keep
from test_plans.steps.waves import (
    Known,
    Sine,
    know,
    lateral_stiffness,
    measure_sines,
    shake,
    vertical_stiffness,
)

if TYPE_CHECKING:
    from test_plans.analysis.uncertainty import Measured
    from test_plans.run import Run

SWEEP_AMPLITUDE: Final = 5 * mm
PEAK_FREQUENCY: Final = CheckName(
    "frequency of the most vertical damping",
    "The frequency at which the orifice damps most: it must be near the bounce frequency, and depends on the bore.",
)
FAST_DAMPING: Final = CheckName(
    "vertical c at 10 Hz over its peak",
    "How little damping remains far above the natural frequency: damping there only transmits noise from the track.",
)
DIP: Final = CheckName(
    "with pipe: lowest |K| over that at 2 Hz",
    "How much the air oscillating in a pipe softens the spring: it depends on the length and bore of the pipe.",
)
OVERSHOOT: Final = CheckName(
    "with pipe: highest |K| over that at 25 Hz",
    "How much the air in a pipe stiffens the spring above its resonance: there, vibration would reach the car.",
)
SWEEP_CHECKS: Final = (PEAK_FREQUENCY, FAST_DAMPING, DIP, OVERSHOOT)
#: Below, heat lost to the walls makes c = K''/ω grow without end.
DAMPING_FROM: Final = 0.3 * Hz
ALL_FREQUENCIES: Final = (
    0.1,
    0.2,
    0.4,
    0.6,
    0.8,
    1.0,
    1.2,
    1.5,
    2.0,
    2.5,
    3.0,
    4.0,
    5.0,
    6.0,
    7.0,
    8.0,
    10.0,
    12.0,
    14.0,
    16.0,
    18.0,
    20.0,
    22.5,
    25.0,
)
LATERAL_FREQUENCIES: Final = (
    0.1,
    0.5,
    1.0,
    2.0,
    3.0,
    4.0,
    6.0,
    8.0,
    10.0,
    12.0,
    15.0,
    18.0,
    20.0,
    22.5,
    25.0,
)
PIPE_FREQUENCIES: Final = tuple(f for f in ALL_FREQUENCIES if f >= 0.6)
LATERAL_PIPE_FREQUENCIES: Final = (1.0, 3.0, 6.0, 8.0, 12.0, 15.0, 20.0, 25.0)
#: What the lateral actuator can do up to 25 Hz: shows frequency alone, where 5 mm becomes less and friction stiffer.
SMALL: Final = 0.9 * mm
SMALL_FREQUENCIES: Final = (1.0, 2.0, 4.0, 8.0, 12.0, 15.0, 20.0, 25.0)
#: The pipe takes the place of the plate: 30 mm throttle it no more. Surge shows where little air moves.
PIPE_PLATE: Final = 30 * mm
SURGE_AMPLITUDE: Final = 0.5 * mm
SURGE_FREQUENCIES: Final = (
    2.0,
    4.0,
    5.0,
    6.0,
    7.0,
    8.0,
    9.0,
    10.0,
    11.0,
    12.0,
    13.0,
    14.0,
    15.0,
    16.0,
    17.0,
    18.0,
    20.0,
    22.5,
    25.0,
)
#: Closed bellows, and what the surge of the pipe adds: bounds for the force that a vertical actuator needs.
CLOSED_STIFFNESS: Final = 2.4e6 / (145 * kN)
#: Of both springs sideways, a bound as well.
SHEAR_STIFFNESS: Final = 0.6 * MN / m


@dataclass(slots=True)
class FrequencySweep:
    """Complex stiffness over frequency, per spring, with the amplitude and the temperature of the gas."""

    vertical: list[Stiffness] = field(default_factory=list)
    lateral: list[Stiffness] = field(default_factory=list)
    lateral_small: list[Stiffness] = field(default_factory=list)
    temperatures: list[float] = field(default_factory=list)
    pressure_ratios: list[float] = field(default_factory=list)
    sines: dict[float, Sine] = field(default_factory=dict)  #: the vertical ones, by frequency
    known: dict[str, list[Known]] = field(default_factory=dict)  #: by the name of the curves

    def shake_laterally(self, run: Run, frequencies: Sequence[float]) -> None:
        """Sines of 5 mm, or of what the actuator can do, first harmonic."""
        for frequency in frequencies:
            self.lateral.append(self._shear(run, frequency, SWEEP_AMPLITUDE, "Lateral"))

    def shake_a_little(self, run: Run) -> None:
        """Lateral sines of one small amplitude at all frequencies."""
        for frequency in SMALL_FREQUENCIES:
            self.lateral_small.append(self._shear(run, frequency, SMALL, "Lateral, 0.9 mm:"))

    def _shear(self, run: Run, frequency: float, amplitude: float, name: str) -> Stiffness:
        with run.phase(f"lateral sine {frequency:g} Hz, {amplitude / mm:g} mm"):
            driven = drive(run.rig, "lateral", SHEAR_STIFFNESS)
            command = driven.command(amplitude, frequency, run.rig["lateral_force_max"])
            times, values = shake(run, "lateral", frequency, command)
        self._know(run, name, times, values, frequency, lateral_stiffness)
        return lateral_stiffness(times, run.rig, values, frequency)

    def shake_vertically(
        self, run: Run, load: Load, frequencies: Sequence[float], size: float = SWEEP_AMPLITUDE
    ) -> None:
        """Sines of ``size`` (m), or of what the actuators can do, first harmonic."""
        driven = drive(run.rig, "vertical", CLOSED_STIFFNESS * load.preload)
        left = run.rig["vertical_force_max"] - load.actuator_force(run.rig)
        for frequency in frequencies:
            amplitude = driven.command(size, frequency, left)
            with run.phase(f"vertical sine {frequency:g} Hz, {size / mm:g} mm"):
                times, values = shake(run, "vertical", frequency, amplitude)
            self.sines[frequency] = Sine(times, values, frequency)
            self._know(run, "Vertical", times, values, frequency, vertical_stiffness)
            self.vertical.append(vertical_stiffness(times, run.rig, values, frequency))
            self.temperatures.append(float(np.mean([values[name].mean() for name in BELLOWS_TEMPERATURES])))
            bellows, auxiliary = (
                sum(first_harmonic(times, values[f"{side}.{part}_pressure"], frequency) for side in SIDES)
                for part in ("bellows", "auxiliary")
            )
            self.pressure_ratios.append(abs(auxiliary / bellows))

    def _know(self, run: Run, name: str, *sine: Any) -> None:
        self.known.setdefault(name, []).append(know(run, *sine))

    def between(
        self, run: Run, one: float, other: float, evaluate: Callable[[list[Stiffness]], float]
    ) -> Measured:
        """Return the result of ``evaluate`` for the vertical stiffness at two frequencies (Hz)."""
        return measure_sines(run, [self.sines[one], self.sines[other]], vertical_stiffness, evaluate)

    def keep(self, run: Run, load: Load, pipe: str) -> None:
        """Keep |K|, K', c, the amplitude and the gas over frequency."""
        name = f"{load.name}, {pipe}"
        series = {"Lateral": self.lateral, "Vertical": self.vertical, "Lateral, 0.9 mm:": self.lateral_small}
        for direction, found in series.items():
            frequencies = [K.frequency for K in found]
            if not found:
                continue
            known = self.known[direction]
            for quantity, ys in (
                (MAGNITUDE, [one.size for one in known]),
                (STORAGE, [one.storage for one in known]),
                (DAMPING, [one.damping for one in known]),
                (AMPLITUDE, [K.amplitude for K in found]),
            ):
                keep(run, name, f"{direction} {quantity[0]} per spring", FREQUENCY, quantity, frequencies, ys)
        frequencies = [K.frequency for K in self.vertical]
        keep(run, name, "Gas in the bellows", FREQUENCY, TEMPERATURE, frequencies, self.temperatures)
        ratio = ("auxiliary over bellows pressure amplitude", "1")
        keep(run, name, "Pressure amplitudes", FREQUENCY, ratio, frequencies, self.pressure_ratios)


def frequency_sweep(run: Run, load: Load) -> None:
    """Measure under the load that is carried, then again with the pipe in place of the plates."""
    home_made = FrequencySweep()
    go_home(run)
    home_made.shake_laterally(run, LATERAL_FREQUENCIES)
    home_made.shake_a_little(run)
    steps.lock_the_air(run)
    home_made.shake_vertically(run, load, ALL_FREQUENCIES)
    home_made.keep(run, load, "orifice")

    run.hold_point("before the pipe is fitted")
    put_down(run)
    fit_pipe(run, "on")
    fit_plate(run, PIPE_PLATE)
    steps.carry(load)(run)
    go_home(run)
    piped, surge = FrequencySweep(), FrequencySweep()
    piped.shake_laterally(run, LATERAL_PIPE_FREQUENCIES)
    run.bench.wait(COOL)
    steps.lock_the_air(run)
    piped.shake_vertically(run, load, PIPE_FREQUENCIES)
    surge.shake_vertically(run, load, SURGE_FREQUENCIES, SURGE_AMPLITUDE)
    piped.keep(run, load, "pipe")
    surge.keep(run, load, "pipe, 0.5 mm")

    check_sweep(run, home_made, surge)


def check_sweep(run: Run, plain: FrequencySweep, surge: FrequencySweep) -> None:
    """Check the maximum of damping without the pipe, and minimum and overshoot of stiffness with it."""
    c = {K.frequency: K.damping for K in plain.vertical if K.frequency >= DAMPING_FROM}
    peak = max(c, key=lambda f: c[f])
    size = {K.frequency: abs(K.value) for K in surge.vertical}
    first, *_, last = size
    lowest = min(size, key=lambda f: size[f])
    highest = max((f for f in size if f >= lowest), key=lambda f: size[f])

    def over(found: list[Stiffness]) -> float:
        return abs(found[0].value) / abs(found[1].value)

    for name, value, unit, limit in (
        (PEAK_FREQUENCY, _peak(run, plain, c), "Hz", "damping_peak_frequency"),
        (
            FAST_DAMPING,
            plain.between(run, 10.0, peak, lambda found: found[0].damping / found[1].damping),
            "%",
            "high_frequency_damping",
        ),
        (
            DIP,
            surge.between(run, lowest, first, over),
            "1",
            "surge_dip",
        ),
        (
            OVERSHOOT,
            surge.between(run, highest, last, over),
            "1",
            "surge_peak",
        ),
    ):
        band = run.specimen.limits.band(limit)
        run.check(name, value, unit, low=band.low, high=band.high)


def _peak(run: Run, plain: FrequencySweep, damping: Mapping[float, float]) -> Measured:
    """Return at which of the frequencies damping is highest (Hz); the peak lies between its neighbours."""
    high = sorted(sorted(damping, key=lambda f: damping[f])[-3:])
    sines = [plain.sines[f] for f in high]
    found = measure_sines(run, sines, vertical_stiffness, lambda found: max(found, key=_damping).frequency)
    place = list(damping).index(found.value)
    around = list(damping)[max(place - 1, 0) : place + 2]
    return found.with_uncertainty("step of frequencies", 0.5 * EVEN * (around[-1] - around[0]), even=True)


def _damping(one: Stiffness) -> float:
    return one.damping
