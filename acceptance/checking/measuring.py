"""What motion tells of dimensions, without air: places, the bolster's mass, frames and lags, beside what is stated."""

from __future__ import annotations

from cmath import phase
from collections.abc import Callable, Mapping
from dataclasses import replace
from math import sqrt, tau
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from acceptance.checking.report import MoveLine, Plausibility
from bench_protocol.dimensions import DIMENSIONS, NAMES, UNKNOWN, across, lag
from bench_protocol.units import Hz, kN, mm, mrad, s
from bench_protocol.words import SIDES
from test_plans.analysis import Samples, first_harmonic, without_inertia
from test_plans.analysis.cells import CELLS, ahead_of, bearing, cell_moment, described, unseen, upward_force
from test_plans.analysis.geometry import actuator_moment, roll_of
from test_plans.analysis.readings import GENERATOR, HEIGHTS, harmonic
from test_plans.analysis.uncertainty import Captured, Measured, measured
from test_plans.description import Description
from test_plans.instruments import UNKNOWN as NO_INSTRUMENTS
from test_plans.steps.carrying import FREE_SIDEWAYS, LATERAL_RATE
from test_plans.steps.cell_loads import CENTRED
from test_plans.steps.shaking import generator_cycles

if TYPE_CHECKING:
    from drivers.bench import Bench

FORCES: Final = tuple(f"vertical_{side}.force" for side in SIDES)
PISTONS: Final = tuple(f"vertical_{side}.displacement" for side in SIDES)
#: Pressed on its stops the bolster is shaken about this force on each side, upright and in roll.
PRESSED: Final = 12 * kN
PRESS_RATE: Final = 10 * kN / s
SWING: Final = 1 * mm
TILT: Final = 1 * mrad
SLOW: Final = 0.5 * Hz
FAST: Final = 2 * Hz
#: Off its stops: what the actuators give is the bolster's inertia.
HANGING: Final = 2 * mm
HANGING_FREQUENCY: Final = 3 * Hz
LEAD: Final = 1
CYCLES: Final = 4
RATE: Final = 200 * Hz
#: What is not in the instruments: the stops' own friction and the frame's damping.
METHOD: Final = 0.004
#: And sideways: a bolster that is held there while it rolls pulls at springs and cells.
HELD: Final = 0.025
#: What frame and oil lose at each frequency, beside their stiffness.
OIL: Final = 0.05
#: Of a rig whose instruments nobody has described.
UNSURE: Final = 0.07
UNSURE_LAG: Final = 1e-3 * s

Find = Callable[..., float]


class Measuring:
    """Measures dimensions of a ``bench`` that is armed and without air, and compares them with what is stated."""

    def __init__(self, bench: Bench, lines: list[MoveLine]) -> None:
        self._bench, self._lines = bench, lines
        #: What is stated, and the same with what was measured in the place of what it contradicts.
        self._stated = Description(bench.wiring.rig, bench.dimensions or UNKNOWN)
        self._rig = self._stated

    def hanging(self) -> None:
        """Shake the bolster off its stops: the balance of forces is its mass times its acceleration."""
        cells = bearing(self._rig)
        needs = (*FORCES, *cells, *HEIGHTS)
        if not self._has("bolster_mass", needs, (*map(lag, needs), *CELLS)):
            return
        times, values = self._shake("vertical", HANGING, HANGING_FREQUENCY, needs)

        def mass(rig: Mapping[str, float], read: Mapping[str, Samples]) -> float:
            of = self._harmonics(times, HANGING_FREQUENCY, rig, read)
            down = -0.5 * sum(of(name) for name in HEIGHTS)
            borne = upward_force({cell: of(cell) for cell in cells}, rig)
            left_over = complex(borne) - sum(of(force) for force in FORCES)
            return float((left_over / ((tau * HANGING_FREQUENCY) ** 2 * down)).real)

        self._compare("bolster_mass", "by its inertia", mass, values)

    def tilted(self, before: Captured, after: Captured) -> None:
        """Compare where the lasers stand with what they saw when the platform rolled and the bolster stayed."""
        for side in SIDES:
            height = f"{side}.height"
            if not self._has(across(height), (height, "platform.roll"), ()):
                continue

            def place(_: Mapping[str, float], one: Captured, other: Captured, name: str = height) -> float:
                return -(other[name] - one[name]) / (other["platform.roll"] - one["platform.roll"])

            self._compare(across(height), "by the roll of the platform", place, before, after)

    def lifted(self, side: str, before: Captured, after: Captured) -> None:
        """Compare where the other actuator stands: it stayed where it was when this one lifted its side."""
        other = f"vertical_{SIDES[1 - SIDES.index(side)]}"
        if not self._has(across(other), HEIGHTS, tuple(map(across, HEIGHTS))):
            return

        def place(rig: Mapping[str, float], one: Captured, two: Captured) -> float:
            way = {name: np.asarray(two[name] - one[name]) for name in HEIGHTS}
            turned = float(roll_of(way, rig))
            return rig[across(f"{side}.height")] - float(way[f"{side}.height"]) / turned

        self._compare(across(other), f"by lifting the {side} side", place, before, after)

    def pressed(self) -> None:
        """Shake the bolster on its stops: springs that are alike tell how far from the middle they stand."""
        needs = (*FORCES, *bearing(self._rig), *HEIGHTS, *PISTONS)
        places = (*map(across, HEIGHTS), *(across(f"vertical_{side}") for side in SIDES))
        if not self._has("spring_half_spacing", (*FORCES, *HEIGHTS), places):
            return
        self._bench.vertical.preload(PRESSED, PRESSED, rate=PRESS_RATE, within=10 * s)
        self._bench.vertical.hold_position()
        free = self._bench.has(*FREE_SIDEWAYS)
        if free:
            self._bench.lateral.push(0.0, rate=LATERAL_RATE)
        seen = tuple(name for name in needs if self._bench.has(name))
        upright = self._shake("vertical", SWING, SLOW, seen)
        rolled = self._shake("roll", TILT, SLOW, seen)
        if free:
            self._bench.lateral.hold_position()
        more = METHOD if free else HELD
        self._spacing(upright, rolled, more)
        if all(name in seen for name in needs):
            self._cells(rolled, more)
            self._ahead(upright)
            if self._has("bolster_mass", needs, tuple(map(lag, (*FORCES, *PISTONS)))):
                self._late(*self._shake("vertical", SWING, FAST, needs))

    # -- inside ----------------------------------------------------------------------------------------------------

    def _spacing(self, upright: tuple[Samples, Any], rolled: tuple[Samples, Any], more: float) -> None:
        """b² = K_roll / K_z of two stops that are alike: 2 k b² over 2 k."""
        (times, flat), (later, turned) = upright, rolled

        def spacing(
            rig: Mapping[str, float], flat: Mapping[str, Samples], turned: Mapping[str, Samples]
        ) -> float:
            down = -first_harmonic(times, 0.5 * (flat["left.height"] + flat["right.height"]), SLOW)
            force = first_harmonic(times, flat[FORCES[0]] + flat[FORCES[1]], SLOW)
            moment = actuator_moment(turned, rig)
            angle = first_harmonic(later, roll_of(turned, rig), SLOW)
            return sqrt(abs(first_harmonic(later, moment, SLOW) / angle) / abs(force / down))

        self._compare("spring_half_spacing", "by rolling on the stops", spacing, flat, turned, more=more)

    def _cells(self, rolled: tuple[Samples, Any], more: float) -> None:
        """The moment in the upright cells is that of the actuators: else the cells stand elsewhere."""
        times, values = rolled
        if self._rig.lacks(*CELLS):
            return
        self._tell_unseen()

        def ratio(rig: Mapping[str, float], read: Mapping[str, Samples]) -> float:
            moment = actuator_moment(read, rig)
            cells = first_harmonic(times, cell_moment(read, rig), SLOW)
            return abs(first_harmonic(times, moment, SLOW) / cells)

        one = self._measured(ratio, values)
        u = self._sure(one) + more
        places = [across(cell) for cell in bearing(self._rig)]
        stated = np.mean([abs(self._rig[name]) for name in places])
        known = max(self._off(name) for name in places) / stated
        self._note(
            "places of the load cells, by the moment of the actuators",
            bool(abs(one.value - 1.0) <= u + known),
            f"{one.value * stated:.4g} ± {u * stated:.2g} m from the middle",
            f"{stated:.4g} m",
        )

    def _ahead(self, upright: tuple[Samples, Any]) -> None:
        """Where the springs' force acts lengthwise: seats or actuators that are off there show in no sum of cells."""
        times, values = upright
        cells = [cell for cell in described(self._rig) if cell in values]
        if self._rig.lacks(*CELLS) or {"force upward", "pitch moment"} & set(unseen(self._rig, cells)):
            return

        def place(rig: Mapping[str, float], read: Mapping[str, Samples]) -> float:
            both = ahead_of({cell: read[cell] for cell in cells}, rig, "force upward")
            force, moment = (first_harmonic(times, one, SLOW) for one in both)
            return float((moment / force).real)

        one = self._measured(place, values)
        u = one.expanded if one.expanded is not None else UNSURE * abs(one.value)
        verdict = Plausibility.FINE if abs(one.value) <= u + CENTRED else Plausibility.DOUBTFUL
        more = (
            ""
            if verdict is Plausibility.FINE
            else ": a seat or an actuator stands off the middle, or a cell elsewhere"
        )
        self._lines.append(
            MoveLine(
                what="springs' force, ahead of the middle",
                verdict=verdict,
                found=f"{one.value / mm:.1f} ± {u / mm:.2g} mm{more}",
                right=f"0 ± {CENTRED / mm:g} mm",
            )
        )

    def _tell_unseen(self) -> None:
        """Say which forces and moments the load cells do not tell, as they stand: loads and roll are needed."""
        cells = [cell for cell in described(self._rig) if self._bench.has(cell)]
        blind = unseen(self._rig, cells)
        self._lines.append(
            MoveLine(
                what="forces and moments that the load cells tell",
                verdict=Plausibility.DOUBTFUL
                if {"force upward", "roll moment"} & set(blind)
                else Plausibility.FINE,
                found=f"all but {', '.join(blind)}" if blind else "all six",
                right="force upward and roll moment at least",
            )
        )

    def _late(self, times: Samples, values: Mapping[str, Samples]) -> None:
        """Lags by a sine on the stops: lasers beside the pistons, cells beside the forces, and the frame between."""
        for side, piston, height in zip(SIDES, PISTONS, HEIGHTS, strict=True):

            def late(
                rig: Mapping[str, float], read: Mapping[str, Samples], at: str = piston, seen: str = height
            ) -> float:
                laser, moved = (first_harmonic(times, read[one], FAST) for one in (seen, at))
                return float(rig[lag(at)] - phase(laser / moved) / (tau * FAST))

            def frame(
                rig: Mapping[str, float],
                read: Mapping[str, Samples],
                at: str = piston,
                seen: str = height,
                force: str = f"vertical_{side}.force",
            ) -> float:
                of = self._harmonics(times, FAST, rig, read)
                return abs(of(force)) / abs(of(at) - of(seen))

            self._compare(lag(height), "beside its piston, by a sine", late, values)
            if not self._rig.lacks(lag(height)):
                self._compare(
                    "vertical_frame_stiffness", f"on the {side}, by a sine", frame, values, more=OIL
                )
        for cell in bearing(self._rig):

            def behind(rig: Mapping[str, float], read: Mapping[str, Samples], cell: str = cell) -> float:
                of = self._harmonics(times, FAST, rig, read)
                down = -0.5 * sum(of(piston) for piston in PISTONS)
                force = without_inertia(sum(of(one) for one in FORCES), down, rig["bolster_mass"], FAST)
                return -phase(first_harmonic(times, read[cell], FAST) / force) / (tau * FAST)

            self._compare(lag(cell), "beside the forces, by a sine", behind, values)

    def _shake(
        self, axis: Any, amplitude: float, frequency: float, names: tuple[str, ...]
    ) -> tuple[Samples, dict[str, Samples]]:
        bench = self._bench
        size = {"roll_amplitude" if axis == "roll" else "amplitude": amplitude}
        with bench.capture(*names, *GENERATOR) as capture:
            bench.generator.run(axis, "sine", frequency=frequency, cycles=LEAD + CYCLES + 1, **size)
        times, values = capture.aligned(RATE)
        steady = generator_cycles(times, values, LEAD, CYCLES, frequency)
        return times[steady], {name: series[steady] for name, series in values.items()}

    @staticmethod
    def _harmonics(
        times: Samples, frequency: float, rig: Mapping[str, float], read: Mapping[str, Samples]
    ) -> Callable[[str], complex]:
        """Return how to ask for the amplitude of a signal, free of its stated lag."""
        return lambda name: harmonic(rig, times, read[name], frequency, name)

    def _has(self, name: str, signals: tuple[str, ...], dimensions: tuple[str, ...]) -> bool:
        lacking = self._bench.lacks(*signals) or self._rig.lacks(*dimensions)
        if lacking:
            self._lines.append(
                MoveLine(
                    what=_words(name), verdict=Plausibility.UNTOLD, found=f"cannot be measured: {lacking}"
                )
            )
        return not lacking

    def _measured(self, find: Find, *captures: Captured) -> Measured:
        instruments = self._bench.instruments or NO_INSTRUMENTS
        came = self._bench.receiver.rates
        (one,) = measured(find, self._rig, *captures, instruments=instruments, came=came, averaged=20)
        return one

    def _sure(self, one: Measured, si: str = "1") -> float:
        """Return how far off a value may be: by its instruments, or as far as those of nobody knows whom."""
        if one.expanded is not None:
            return one.expanded
        return UNSURE_LAG if si == "s" else UNSURE * abs(one.value)

    def _off(self, name: str) -> float:
        stated = self._rig.stated(name)
        return stated.uncertainty if stated else 0.0

    def _compare(self, name: str, how: str, find: Find, *captures: Captured, more: float = METHOD) -> None:
        """Note what was found of a dimension beside what is stated, with the uncertainties of both."""
        one, si = self._measured(find, *captures), NAMES[name]
        u = self._sure(one, si) + (0.0 if si == "s" else more * abs(one.value))
        found = _shown(one.value, u, si)
        stated = self._stated.stated(name)
        if stated is None:
            self._lines.append(
                MoveLine(
                    what=f"{_words(name)}, {how}",
                    verdict=Plausibility.UNTOLD,
                    found=found,
                    right="not stated",
                )
            )
            return
        good = abs(one.value - stated.value) <= u + stated.uncertainty
        if not good:
            known = {**self._rig.dimensions.known, name: replace(stated, value=one.value, uncertainty=u)}
            self._rig = Description(self._rig.rig, replace(self._rig.dimensions, known=known))
        self._note(f"{_words(name)}, {how}", good, found, _shown(stated.value, stated.uncertainty, si))

    def _note(self, what: str, good: bool, found: str, right: str) -> None:
        verdict = Plausibility.FINE if good else Plausibility.DOUBTFUL
        more = "" if good else ": what is stated is wrong"
        self._lines.append(MoveLine(what=what, verdict=verdict, found=found + more, right=right))


def _words(name: str) -> str:
    return name.replace("_", " ") if name in DIMENSIONS else name


def _shown(value: float, u: float, si: str) -> str:
    unit, factor = {"s": ("ms", 1e-3), "N/m": ("MN/m", 1e6)}.get(si, (si, 1.0))
    return f"{value / factor:.4g} ± {u / factor:.2g} {unit}"
