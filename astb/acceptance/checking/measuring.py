"""Motions of a rig without air, and a fit of all its dimensions to them, which are compared with the stated values."""

from __future__ import annotations

from collections.abc import Mapping
from math import ceil, hypot, inf, pi, sqrt, tau
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from astb.acceptance.checking.report import MoveLine, Plausibility
from astb.acceptance.checking.rigid_body import (
    ACCELEROMETER,
    CELLS_ACROSS,
    FORCES,
    LASERS,
    LATERAL,
    LATERAL_FORCE,
    PISTONS,
    ROLL,
    UNSEEN,
    WANTED,
    Estimate,
    Motion,
    RigidBody,
)
from bench_protocol.dimensions import DIMENSIONS, NAMES, UNKNOWN, across, place
from bench_protocol.units import Hz, kN, mm, mrad, s
from bench_protocol.words import SIDES
from test_plans.analysis import GENERATOR, SHEAR_CELLS, VERTICAL_CELLS, Samples, first_harmonic
from test_plans.analysis.cells import CELLS, ahead_of, described, unseen
from test_plans.analysis.uncertainty import STEP, measured
from test_plans.description import Description, stamps_of
from test_plans.instruments import UNKNOWN as NO_INSTRUMENTS
from test_plans.steps.cell_loads import CENTRED
from test_plans.steps.shaking import generator_cycles

if TYPE_CHECKING:
    from drivers.bench import Bench

#: Height of the hanging bolster above its position of rest, and its height before one side is lowered.
HIGH: Final = 12 * mm
LOW: Final = 6 * mm
RATE: Final = 10 * mm / s
#: One spring at a time is pressed in steps, up to this force above that of the hanging bolster. It carries from
#: `CONTACT` on.
PRESSED: Final = 20 * kN
CONTACT: Final = 3 * kN
PRESS_STEP: Final = 0.5 * mm
PRESS_RATE: Final = 2 * mm / s
PRESS_WAY: Final = 25 * mm
STEP_FORCE: Final = 5 * kN
BOTH: Final = 12 * kN
SETTLE: Final = 0.5 * s
REST: Final = 1 * s
SLOW: Final = 0.5 * Hz
LEAD: Final = 1
CYCLES: Final = 6
LEAST: Final = 5 * s
#: Duration of the slow lateral motion, which determines heights from a small force, if instruments are described.
#: `CLEAR` is the share of the gap to the bump stop that the motion uses.
SIDEWAYS: Final = 48 * s
CLEAR: Final = 0.6
#: Maximum share of the available force of the lateral actuator.
PART: Final = 0.5
ALIGNED: Final = 200 * Hz
#: Sines of the hanging bolster: axis, amplitude (m or rad), frequency.
HANGING: Final = (
    ("vertical", 5 * mm, SLOW),
    ("vertical", 3 * mm, 3 * Hz),
    ("roll", 5 * mrad, SLOW),
    ("roll", 2 * mrad, 3 * Hz),
    ("lateral", 16 * mm, SLOW),
    ("lateral", 3 * mm, 4 * Hz),
    ("lateral", 1 * mm, 12 * Hz),
    ("platform_roll", 5 * mrad, SLOW),
)
#: The same for the bolster while it is pressed on both stops.
ON_THE_STOPS: Final = (("vertical", 1 * mm, SLOW), ("roll", 1 * mrad, SLOW), ("vertical", 1 * mm, 2 * Hz))
#: Highest frequency of a wave that the bench streams, and the number of samples needed for each cycle.
STREAMED: Final = 4 * Hz
SAMPLES: Final = 5
#: Rate of the set-points of a streamed wave. Straight lines between them cause a relative error of (πf/rate)²/3.
STREAM: Final = 50 * Hz
READ: Final = (
    *LASERS,
    *PISTONS,
    *FORCES,
    *VERTICAL_CELLS,
    *SHEAR_CELLS,
    LATERAL,
    LATERAL_FORCE,
    ACCELEROMETER,
    ROLL,
)
_SETPOINT: Final = {"platform_roll": "platform.roll_setpoint", "lateral": "lateral.displacement_setpoint"}


class Measuring:
    """Moves an armed ``bench`` whose springs are without air, measures its dimensions, and compares them with the
    stated ones.
    """

    def __init__(self, bench: Bench, lines: list[MoveLine]) -> None:
        self._bench, self._lines = bench, lines
        self._rig = Description(bench.wiring.rig, bench.dimensions or UNKNOWN)
        self._instruments = bench.instruments or NO_INSTRUMENTS
        self._motions: list[Motion] = []
        self._names = tuple(name for name in READ if bench.has(name))
        #: Positions of the pistons while the bolster rests on its stops.
        self._resting = dict[str, float]()

    def resting(self) -> None:
        """Record the positions of the pistons while the bolster rests on its stops."""
        self._resting = {name: self._bench.average(name, over=REST) for name in PISTONS}

    def hanging(self) -> None:
        """Move the bolster, and the platform below it, with sines while the bolster hangs on the actuators."""
        self._move_pistons(HIGH, HIGH)
        for axis, amplitude, frequency in HANGING:
            setpoint = _SETPOINT.get(axis)
            if setpoint is None or self._bench.has(setpoint):
                self._shake(axis, amplitude, frequency)

    def one_by_one(self) -> None:
        """Press each spring while the other one is free.

        The moment of the load cells divided by their force is the spring's position.
        """
        for side in SIDES:
            self._move_pistons(LOW, LOW)
            before = self._readings_at_rest()
            self._tilt(side, HIGH)
            self._store_change(before, side)
            self._move_pistons(LOW, LOW)
            self._press(side)
        self._move_pistons(LOW, LOW)

    def pressed(self) -> None:
        """Move the bolster with sines while it is pressed on both stops."""
        self._bench.vertical.preload(BOTH, BOTH, within=10 * s)
        self._bench.vertical.hold_position()
        for axis, amplitude, frequency in ON_THE_STOPS:
            times, values = self._shake(axis, amplitude, frequency)
            if (axis, frequency) == ("vertical", SLOW):
                self._ahead(times, values)
        self._report_undetermined()

    def compare(self) -> None:
        """Fit all dimensions at once, and record each of them next to its stated value."""
        lacking = self._bench.lacks(*LASERS, *PISTONS, *FORCES)
        if lacking or not self._motions:
            self._lines.append(_untold("dimensions", f"cannot be measured: {lacking or 'nothing moved'}"))
            return
        late = {name: one.within for name, one in stamps_of(self._bench).items()}
        fit = RigidBody(self._rig.dimensions.known, self._motions, self._instruments, late)
        found = fit.estimates()
        seen = [one for one in found if one.contradicted or one.unresolved != UNSEEN]
        for one in seen:
            self._note(one)
        names = {one.name for one in seen}
        if others := [name for name in self._rig.dimensions.known if name not in names]:
            self._lines.append(_untold(", ".join(others), UNSEEN))

    # -- motions -----------------------------------------------------------------------------------------------------

    def _move_pistons(self, left: float, right: float, rate: float = RATE) -> None:
        """Move the pistons to the heights ``left`` and ``right`` above their positions of rest (m), at ``rate`` (m/s),
        and wait.
        """
        resting = [self._resting[name] for name in PISTONS]
        self._bench.vertical.move_to(resting[0] + left, resting[1] + right, rate=rate)
        self._bench.wait(SETTLE)

    def _tilt(self, side: str, up: float) -> None:
        """Move the piston of ``side`` to ``up`` m above its position of rest.

        The bolster turns about the spring of the other side.
        """
        names = ("spring_half_spacing", across(f"vertical_{side}"))
        spring, piston = (1.0, 1.0) if self._rig.lacks(*names) else (abs(self._rig[name]) for name in names)
        other = LOW + (up - LOW) * (spring - piston) / (spring + piston)
        left, right = (up if one == side else other for one in SIDES)
        self._move_pistons(left, right, PRESS_RATE)

    def _store_change(self, before: Mapping[str, tuple[float, float]], side: str) -> None:
        """Store the change of all readings since ``before``. Only the spring of ``side`` has moved since then."""
        after = self._readings_at_rest()
        change = {name: complex(after[name][0] - before[name][0]) for name in self._names}
        noise = {name: hypot(after[name][1], before[name][1]) for name in self._names}
        self._motions.append(Motion(0.0, change, noise, side))

    def _shake(self, axis: Any, amplitude: float, frequency: float) -> tuple[Samples, dict[str, Samples]]:
        """Move ``axis`` with a sine and store the amplitudes of all readings that are sampled often enough.

        A lateral ``amplitude`` is limited by the gap of the bump stop and by the actuator's force. Return times (s) and
        readings of the steady cycles, all at the same times. Both are empty if the rig cannot do this motion.
        """
        bench = self._bench
        names = [name for name in self._names if bench.receiver.rates.get(name, inf) >= SAMPLES * frequency]
        streamed = not bench.wiring.capabilities.generator
        if (streamed and frequency > STREAMED) or not {*LASERS, *PISTONS, *FORCES} <= {*names}:
            return np.zeros(0), {}
        heights = axis == "lateral" and frequency == SLOW and bool(self._instruments.pieces)
        cycles = max(CYCLES, ceil((SIDEWAYS if heights else LEAST) * frequency))
        if axis == "lateral" and not self._rig.lacks("stop_gap"):
            amplitude = min(amplitude, CLEAR * self._rig["stop_gap"])
        if axis == "lateral" and not self._rig.lacks("lateral_force_max", "bolster_mass"):
            heaviest = self._rig["bolster_mass"] * (tau * frequency) ** 2
            amplitude = min(amplitude, PART * self._rig["lateral_force_max"] / heaviest)
        size = {"roll_amplitude" if "roll" in axis else "amplitude": amplitude}
        with bench.capture(*names, *GENERATOR) as capture:
            bench.generator.run(axis, "sine", frequency=frequency, cycles=LEAD + cycles + 1, **size)
        times, values = capture.aligned(ALIGNED)
        steady = generator_cycles(times, values, LEAD, cycles, frequency)
        begin, end = times[steady][0], times[steady][-1]
        amplitudes, noise = dict[str, complex](), dict[str, float]()
        for name in names:
            at, read = capture.times(name), capture.values(name)
            inside = (at >= begin) & (at <= end) & np.isfinite(read)
            found = _sine(at[inside], read[inside], frequency)
            amplitudes[name], noise[name] = (
                found[0],
                hypot(found[1], self._step(name) * sqrt(2 / inside.sum())),
            )
        pace = min(STREAM, *(bench.receiver.rates[name] for name in names))
        rough = (pi * frequency / pace) ** 2 / 3 if streamed else 0.0
        self._motions.append(Motion(frequency, amplitudes, noise, rough=rough))
        return times[steady], {name: series[steady] for name, series in values.items()}

    def _press(self, side: str) -> None:
        """Lower one side in steps until its spring carries the force `PRESSED`.

        Store the change of all readings since it carried `CONTACT`.
        """
        bench, force = self._bench, FORCES[SIDES.index(side)]
        hanging = bench.average(force, over=SETTLE)
        low, step, before, carried = 1 * mm, PRESS_STEP, None, 0.0
        while low > -PRESS_WAY:
            self._tilt(side, low)
            carries = bench.average(force, over=SETTLE) - hanging
            if carries >= PRESSED:
                break
            if carries >= CONTACT and before is None:
                before = self._readings_at_rest()
            if carries > carried + 0.1 * kN and carries > CONTACT:
                stiffness = (carries - carried) / step
                step = min(step, STEP_FORCE / stiffness)
            carried = carries
            low -= step
        if before is not None:
            self._store_change(before, side)

    def _readings_at_rest(self) -> dict[str, tuple[float, float]]:
        """Return the mean of each reading at rest, and the standard deviation of this mean, by name."""
        with self._bench.capture(*self._names) as capture:
            self._bench.wait(REST)
        found = {}
        for name in self._names:
            values = capture.values(name)
            values = values[np.isfinite(values)]
            scatter, step = float(np.std(values)), self._step(name)
            found[name] = (
                float(np.mean(values)),
                hypot(scatter / sqrt(values.size), step if 2 * scatter < step else 0.0),
            )
        return found

    def _step(self, name: str) -> float:
        """Return the standard deviation that the resolution of the converter causes in a reading."""
        piece = self._instruments.pieces.get(name)
        return STEP * (piece.instrument.resolution if piece else self._bench.table[name].step)

    def _ahead(self, times: Samples, values: Mapping[str, Samples]) -> None:
        """Measure the longitudinal position of the springs' force with the load cells, and record it.

        If the seat of a spring or an actuator is mounted too far forward or back, the sums of the load cells do not
        show it.
        """
        cells = [cell for cell in described(self._rig) if cell in values]
        if self._rig.lacks(*CELLS) or {"force upward", "pitch moment"} & set(unseen(self._rig, cells)):
            return

        def place(rig: Mapping[str, float], read: Mapping[str, Samples]) -> float:
            both = ahead_of({cell: read[cell] for cell in cells}, rig, "force upward")
            force, moment = (first_harmonic(times, one, SLOW) for one in both)
            return float((moment / force).real)

        (one,) = measured(
            place,
            self._rig,
            values,
            instruments=self._instruments,
            came=self._bench.receiver.rates,
            averaged=20,
        )
        u = one.expanded if one.expanded is not None else 0.07 * abs(one.value)
        verdict = Plausibility.FINE if abs(one.value) <= u + CENTRED else Plausibility.DOUBTFUL
        more = (
            ""
            if verdict is Plausibility.FINE
            else ": a seat, an actuator or a load cell is not at its stated position"
        )
        self._lines.append(
            MoveLine(
                what="springs' force, ahead of the middle",
                verdict=verdict,
                found=f"{one.value / mm:.1f} ± {u / mm:.2g} mm{more}",
                right=f"0 ± {CENTRED / mm:g} mm",
            )
        )

    def _report_undetermined(self) -> None:
        """Record which of the six forces and moments the load cells cannot measure.

        The upward force and the roll moment are required.
        """
        if self._rig.lacks(*CELLS):
            return
        cells = [cell for cell in described(self._rig) if self._bench.has(cell)]
        blind = unseen(self._rig, cells)
        self._lines.append(
            MoveLine(
                what="forces and moments that the load cells measure",
                verdict=Plausibility.DOUBTFUL
                if {"force upward", "roll moment"} & set(blind)
                else Plausibility.FINE,
                found=f"all but {', '.join(blind)}" if blind else "all six",
                right="force upward and roll moment at least",
            )
        )

    def _note(self, one: Estimate) -> None:
        """Record an estimate with its stated value."""
        stated = self._rig.stated(one.name)
        if one.name == CELLS_ACROSS:
            known = [
                abs(self._rig[place(cell)[1]]) for cell in described(self._rig) if cell in VERTICAL_CELLS
            ]
            mean = float(np.mean(known))
            value, u, si, right = one.value * mean, one.uncertainty * mean, "m", f"{mean:.4g} m"
        else:
            value, u, si = one.value, one.uncertainty, NAMES[one.name]
            right = _with_uncertainty(stated.value, stated.uncertainty, si) if stated else "not stated"
        verdict, found = Plausibility.FINE, _with_uncertainty(value, u, si)
        if one.contradicted:
            verdict = Plausibility.DOUBTFUL
            found += ": the stated values are wrong"
            if one.rivals:
                found += f", or that of {' or '.join(map(_words, one.rivals))}"
        elif one.unresolved:
            verdict = Plausibility.UNTOLD
            shown = f"{found}, which is not" if np.isfinite(u) else "not"
            found = f"{shown} known to {WANTED:.0%}: {one.unresolved}"
        elif stated is None and one.name != CELLS_ACROSS:
            verdict = Plausibility.UNTOLD
        elif stated and stated.value and si != "s":
            off = value / stated.value - 1
            if abs(off) > WANTED and abs(value - stated.value) > u:
                found += f", {off:+.1%} from the stated values"
        self._lines.append(
            MoveLine(
                what=_words(one.name), verdict=verdict, found=found, right=right, value=value, uncertainty=u
            )
        )


def _sine(times: Samples, values: Samples, frequency: float) -> tuple[complex, float]:
    """Return the complex amplitude of a sine with a slow drift, and the standard deviation of its real and of its
    imaginary part.
    """
    turn = tau * frequency * times
    columns = np.column_stack([np.cos(turn), -np.sin(turn), np.ones_like(times), times - times.mean()])
    solved, *_ = np.linalg.lstsq(columns, values, rcond=None)
    scatter = float(np.std(values - columns @ solved))
    return complex(solved[0], solved[1]), scatter * sqrt(2 / times.size)


def _untold(what: str, why: str) -> MoveLine:
    return MoveLine(what=what, verdict=Plausibility.UNTOLD, found=why)


def _words(name: str) -> str:
    return name.replace("_", " ") if name in DIMENSIONS else name


def _with_uncertainty(value: float, u: float, si: str) -> str:
    unit, factor = {"s": ("ms", 1e-3), "N/m": ("MN/m", 1e6), "1": ("", 1.0)}.get(si, (si, 1.0))
    return f"{value / factor:.4g} ± {u / factor:.2g} {unit}".rstrip()
