"""Comparison of a ride on measured springs with the same car alone: causes and uncertainty of the differences."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from math import copysign, hypot
from typing import TYPE_CHECKING, Final, Protocol

import numpy as np

from astb_studies.paper.hybrid.car import STEP, Ride
from astb_studies.paper.hybrid.coupling import FORCES, HOST_STEP, Course, springs_of
from bench_protocol.arrays import Floats
from bench_protocol.geometry import Springs
from bench_protocol.units import ms
from test_plans.analysis import HEIGHTS
from test_plans.description import lag_of

if TYPE_CHECKING:
    from test_plans.analysis.geometry import Rig
    from test_plans.instruments import Instruments

#: The three directions of motion of the springs, in the order of a `SpringPose`, with the readings of each.
SIDEWAYS, UP, ROLLED = "sideways", "up and down", "in roll"
WAYS: Final = {SIDEWAYS: ("lateral.displacement",), UP: HEIGHTS, ROLLED: HEIGHTS}
#: Standard uncertainties of the lags, and of the sum of six load cells.
LAGS_U: Final = 0.5 * ms
CELLS_U: Final = 0.003
#: Relative uncertainty of the load on the springs at rest: remaining friction, and the cells' zero, 0.4 % of 53 kN.
CARRIED_U: Final = 0.005
#: How much warmer than its walls the gas of one spring may be at the start of a ride (K): it cools, and the car leans.
WARM_U: Final = 0.05
WARM: Final = "warmth of the gas on one side"
CELLS_TELL: Final = "gain of the load cells"
NOISE: Final = "noise of the load cells"
PART, LATE = "how far the springs went", "how late the springs came"
SCATTER: Final = "finite time"
#: How much springs may differ from their drawing, by the limits of the specimen's file.
STIFFER_SIDEWAYS, STIFFER_UPWARD, DAMPED_MORE = (
    f"tolerance of the springs, {what}" for what in ("lateral stiffness", "vertical stiffness", "damping")
)
CARRIED: Final = "load on the springs"
#: Number of pieces from which the scatter of the difference between both rides is estimated.
PIECES: Final = 5
#: E_n compares a deviation with its expanded uncertainty.
COVERAGE: Final = 2.0


class RideResult(Protocol):
    """The results of a ride, a row for each ``step`` (s)."""

    @property
    def step(self) -> float:
        """The time between two rows."""

    def of(self, name: str, since: float, until: float) -> Floats:
        """Return one column between two times (s)."""


@dataclass(frozen=True, slots=True)
class Followed:
    """Motion of the springs relative to that of the car in one direction: gain (1) and delay (s)."""

    part: float
    late: float

    @property
    def unsure(self) -> float:
        """Possible lateness of the springs (s): the remaining delay, increased by the uncertainty of the lags."""
        return copysign(hypot(self.late, LAGS_U), self.late)


def followed(
    commanded: Floats, moved: Floats, hold: float, rig: Rig, step: float = HOST_STEP
) -> dict[str, Followed]:
    """Return for each direction how the motion ``moved`` followed ``commanded``, both (n, 3), with a ``step`` in s.

    moved = part · commanded − late · d(commanded)/dt, by least squares. The lateness is that of the forces that the car
    receives: it includes the lag of the load cells and a hold of ``hold`` s, instead of the lag of the displacement
    sensors.
    """
    found = {}
    force_delay = lag_of(rig, *FORCES) + 0.5 * hold
    for k, (way, readings) in enumerate(WAYS.items()):
        x, y = (one[:, k] - one[:, k].mean() for one in (commanded, moved))
        rates = np.column_stack([x, -np.gradient(x, step)])
        (part, late), *_ = np.linalg.lstsq(rates, y, rcond=None)
        found[way] = Followed(float(part), float(late) - lag_of(rig, *readings) + force_delay)
    return found


@dataclass(slots=True)
class LinearSprings:
    """Springs of stiffness and damping (3, by direction) with errors of gain and delay, and load cells with noise.

    The readings of the cells are held for ``hold`` s.
    """

    stiffness: Floats
    damping: Floats
    part: Floats = field(default_factory=lambda: np.ones(3))
    late: Floats = field(default_factory=lambda: np.zeros(3))
    noise: Iterator[Springs] | None = None
    hold: float = HOST_STEP

    def carry(self, ride: Ride, whole: float) -> Course:
        """Simulate the ride of a car on these springs for ``whole`` s."""
        course, before = Course(0.0), ride.place_at(0.0)
        ways = list(
            zip(
                self.part.tolist(),
                self.stiffness.tolist(),
                self.damping.tolist(),
                self.late.tolist(),
                strict=True,
            )
        )
        each = round(self.hold / STEP)
        more = Springs(0.0, 0.0, 0.0)
        for n in range(round(whole / STEP)):
            if self.noise and n % each == 0:
                more = next(self.noise)
            now = ride.place_at(0.0)
            force = [
                -part * (k * x + (c - k * late) * (x - y) / STEP) + extra
                for (part, k, c, late), x, y, extra in zip(ways, now, before, more, strict=True)
            ]
            ride.step(Springs(*force))
            course.keep(ride)
            before = now
        return course


def noise_of(instruments: Instruments, rig: Rig) -> Iterator[Springs] | None:
    """Yield the noise of the load cells in the forces, a draw for each step of the host; None if unknown."""
    if any(name not in instruments.pieces for name in FORCES):
        return None
    sigma = [instruments.pieces[name].instrument.noise for name in FORCES]

    def drawn() -> Iterator[Springs]:
        generator = np.random.default_rng(1)
        while True:
            for row in generator.standard_normal((1000, len(sigma))) * sigma:
                yield springs_of(dict(zip(FORCES, row.tolist(), strict=True)), rig)

    return drawn()


#: What a ride amounts to between two times (s), by check.
Amounts = Callable[[RideResult, float, float], Mapping[str, float]]


def of_the_loop(
    springs: tuple[Floats, Floats],
    ways: Mapping[str, Followed],
    noise: Iterator[Springs] | None,
    start: Callable[[], tuple[Ride, float]],
    amounts: Amounts,
    times: tuple[float, float],
    hold: float = HOST_STEP,
) -> dict[str, dict[str, float]]:
    """Return the parts of the standard uncertainty of the results of a ride, by check and cause.

    Each part is a change of the result of the same car in the same wind on linear ``springs`` (stiffness and damping).
    The causes are the gain and the noise of the load cells, and the measured gain and delay of the springs' motion.
    """

    def on(**otherwise: Floats | Iterator[Springs]) -> Mapping[str, float]:
        ride, whole = start()
        return amounts(LinearSprings(*springs, hold=hold, **otherwise).carry(ride, whole), *times)  # type: ignore[arg-type]

    as_it_is = on()
    changed = {CELLS_TELL: on(part=np.full(3, 1.0 + CELLS_U))}
    if noise is not None:
        changed[NOISE] = on(noise=noise)
    changed[PART] = on(part=np.array([one.part for one in ways.values()]))
    changed[LATE] = on(late=np.array([one.unsure for one in ways.values()]))
    return {
        name: {cause: abs(one[name] - value) for cause, one in changed.items()}
        for name, value in as_it_is.items()
    }


def of_the_springs(
    stated: tuple[Floats, Floats],
    otherwise: Mapping[str, tuple[Floats, Floats]],
    start: Callable[[], tuple[Ride, float]],
    amounts: Amounts,
    times: tuple[float, float],
    hold: float = HOST_STEP,
) -> dict[str, dict[str, float]]:
    """Return, by check and cause, the change of a ride from the ``stated`` linear springs to those in ``otherwise``.
    Springs are given by stiffness and damping in each direction.
    """

    def on(springs: tuple[Floats, Floats]) -> Mapping[str, float]:
        ride, whole = start()
        return amounts(LinearSprings(*springs, hold=hold).carry(ride, whole), *times)

    changed = {cause: on(springs) for cause, springs in otherwise.items()}
    return {
        name: {cause: abs(one[name] - value) for cause, one in changed.items()}
        for name, value in on(stated).items()
    }


def scatter(both: Sequence[RideResult], amounts: Amounts, times: tuple[float, float]) -> dict[str, float]:
    """Return, by check, the standard uncertainty of the difference between two rides, from its variation over time. It
    is s/√n of the differences in `PIECES` pieces.
    """
    edges = np.linspace(*times, PIECES + 1)
    found = [[amounts(one, a, b) for one in both] for a, b in pairwise(edges.tolist())]
    names = found[0][0]
    return {
        name: float(np.std([one[name] - other[name] for one, other in found], ddof=1)) / PIECES**0.5
        for name in names
    }


@dataclass(frozen=True, slots=True)
class Agreement:
    """A quantity of the ride on the bench and alone (SI), with the parts of the standard uncertainty of both."""

    bench: float
    alone: float
    parts: Mapping[str, float]

    @property
    def expanded(self) -> float:
        """The expanded uncertainty of their difference, U = 2u."""
        return COVERAGE * hypot(*self.parts.values())

    @property
    def normalised(self) -> float:
        """E_n: their difference over its expanded uncertainty (ISO/IEC 17043); beyond ±1 they do not agree."""
        return (self.bench - self.alone) / self.expanded
