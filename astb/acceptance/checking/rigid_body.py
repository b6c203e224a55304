"""Least-squares fit of a bench as one rigid body: all dimensions at once, from motions without air, with covariance.

Bolster and actuators follow these equations, at each frequency ω and between any two rests (ω = 0):

    piston       q_s = z + a_s φ − F_s / (k + iωc)
    vertical     −m ω² z = F_z − Σ F_s
    roll         −J ω² φ = M + e F_y − h_a F_l − Σ a_s F_s
    lateral      −m ω² y = F_y + F_l,  y = q_l + h_a φ − F_l / (k_l + iωc_l)
    acceleration a_m = −ω² (y − h_m φ) + g φ
    one spring   M = ± b F_z − K_t φ   (the other spring hangs free)

z and φ come from the lasers, F_z, F_y and M (about the middle of the top plates) from the load cells. Unknown are the
dimensions, the gain and the lag of each transducer, J and K_t. The stated values are a prior with their uncertainty.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from math import hypot, inf, sqrt, tau
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np

from bench_protocol.arrays import Floats
from bench_protocol.dimensions import DIMENSIONS, LOAD_CELLS, NAMES, across, direction, lag, place
from bench_protocol.units import ms
from bench_protocol.words import SIDES
from test_plans.analysis.uncertainty import EVEN

if TYPE_CHECKING:
    from bench_protocol.dimensions import Dimension
    from test_plans.instruments import Instruments

Values = Mapping[str, float]

FORCES: Final = tuple(f"vertical_{side}.force" for side in SIDES)
PISTONS: Final = tuple(f"vertical_{side}.displacement" for side in SIDES)
LASERS: Final = tuple(f"{side}.height" for side in SIDES)
ROLL: Final = "platform.roll"
LATERAL_FORCE: Final = "lateral.force"
LATERAL: Final = "lateral.displacement"
ACCELEROMETER: Final = "lateral.acceleration"

#: Relative errors of the equations themselves: harmonics of friction, large angles, play.
METHOD: Final = 1e-3
GEOMETRY: Final = 3e-4
#: Change of the force of a spring without air at constant travel (N): it relaxes.
RELAXES: Final = 60.0
#: Prior of the gain and the lag of a transducer that no file describes.
UNSURE: Final = 0.02
UNSURE_LAG: Final = 20 * ms
#: Uncertainty of a dimension that is stated as exact.
EXACT: Final = 1e-4
#: Prior of a dimension that is not stated, or no longer assumed, relative to its scale.
UNKNOWN: Final = 1.0
#: Start values of dimensions that the file does not state.
START: Final[Values] = {
    "bolster_mass": 1500.0,
    "gravity": 9.81,
    "spring_half_spacing": 1.0,
    "vertical_frame_stiffness": 100e6,
    "vertical_frame_damping": 50e3,
    "lateral_frame_stiffness": 50e6,
    "lateral_frame_damping": 25e3,
    **{
        across(f"{one}{side}{two}"): sign
        for side, sign in zip(SIDES, (1.0, -1.0), strict=True)
        for one, two in (("", ".height"), ("vertical_", ""))
    },
}
#: Smallest scale of a dimension, by its unit, because a height or a position may be 0. For a direction it is the tilt.
SCALE: Final = {"m": 0.2, "1": 1.0, "s": 1 * ms}
#: Largest half-width of a value that is compared, relative to its scale.
WANTED: Final = 0.02
WANTED_LAG: Final = 0.5 * ms
#: Number of standard deviations from which a deviation contradicts the stated value.
SURE: Final = 3.0
#: Explanations of a contradiction cannot be distinguished if their χ² differ by less.
ALIKE: Final = 6.0
ITERATIONS: Final = 8
UNSEEN: Final = "no motion of this check depends on this dimension"
#: Number of the largest deviations that are tried as the cause of a contradiction.
TRIED: Final = 10
#: One factor on the lateral positions of all upright cells, for a wrong drawing of the platform.
CELLS_ACROSS: Final = "places of the load cells across"
_INERTIA: Final = "roll inertia"
_TORSION: Final = "torsion of a stop"


@dataclass(frozen=True, slots=True)
class Motion:
    """Complex amplitudes (SI) at one frequency, or changes between two rests (0 Hz), and their standard deviations."""

    frequency: float
    values: Mapping[str, complex]
    noise: Mapping[str, float]  #: of the real and of the imaginary part
    carrying: str = ""  #: the side whose spring alone carries more than before
    rough: float = 0.0  #: relative deviation of the motion from a sine


class _Estimate(NamedTuple):
    """Value and standard deviation of an unknown, from the motions and the priors of all other unknowns, without its
    own prior.
    """

    value: float
    u: float


@dataclass(frozen=True, slots=True)
class Estimate:
    """Estimate of one dimension from the motions, computed with the stated uncertainties of all other dimensions."""

    name: str
    value: float
    uncertainty: float  #: expanded uncertainty, k = 2
    contradicted: bool = False
    rivals: tuple[str, ...] = ()  #: dimensions that could also explain the contradiction
    unresolved: str = ""  #: reason why it is not known well enough to be compared


@dataclass(slots=True)
class _Unknown:
    """One unknown of the fit: its start value and the standard deviation of its prior."""

    start: float
    sigma: float
    scale: float
    stated: Dimension | None = None
    known: bool = True  #: a dimension that the caller requested


@dataclass(slots=True)
class RigidBody:
    """The fit of the ``motions`` of a rig whose dimensions are ``stated``."""

    stated: Mapping[str, Dimension]
    motions: list[Motion]
    instruments: Instruments
    late: Mapping[str, float] = field(default_factory=dict)  #: half-width (s) of the time stamps, by signal
    _unknowns: dict[str, _Unknown] = field(init=False)
    _weights: list[Floats] = field(init=False)

    def __post_init__(self) -> None:
        self._unknowns = self._all_unknowns()
        self._weights = self._all_weights()

    # -- unknowns ----------------------------------------------------------------------------------------------------

    def _all_unknowns(self) -> dict[str, _Unknown]:
        signals = dict.fromkeys(name for motion in self.motions for name in motion.values)
        cells = [cell for cell in LOAD_CELLS if cell in signals and self._described(cell)]
        names = [name for name in DIMENSIONS if name in _FITTED]
        names += [across(one) for one in (*LASERS, *(f"vertical_{side}" for side in SIDES))]
        found: dict[str, _Unknown] = {}
        for name in names:
            if (one := self._dimension(name)) is not None:
                found[name] = one
        for cell in cells:
            for name in (*place(cell)[1:], *direction(cell)[1:]):
                if name in place(cell) or abs(self.stated[name].value) < 0.5:
                    found[name] = self._stated(name)
        if cells:
            found[CELLS_ACROSS] = _Unknown(1.0, EXACT, 1.0)
        for signal in signals:
            piece = self.instruments.pieces.get(signal)
            gain = EVEN * piece.instrument.gain if piece else UNSURE
            found[f"{signal} gain"] = _Unknown(0.0, max(gain, EXACT), 1.0, known=False)
            name, own = lag(signal), piece.instrument.lag if piece else UNSURE_LAG
            own = EVEN * hypot(own, self.late.get(signal, 0.0))
            if name in NAMES and name in self.stated:
                one = self._stated(name)
                one.sigma, one.known = hypot(one.sigma, own), piece is not None
                found[name] = one
            else:
                found[name] = _Unknown(0.0, hypot(own, 2 * ms), 1 * ms, known=False)
        mass = found["bolster_mass"].start if "bolster_mass" in found else START["bolster_mass"]
        inertia = 0.75 * mass
        found[_INERTIA] = _Unknown(inertia, inertia, inertia, known=False)
        found[_TORSION] = _Unknown(0.0, 50e3, 50e3, known=False)
        return found

    def _described(self, cell: str) -> bool:
        return all(name in self.stated for name in (*place(cell), *direction(cell), "column_height"))

    def _dimension(self, name: str) -> _Unknown | None:
        if name in self.stated:
            return self._stated(name)
        if name not in START:
            return None
        start = START[name]
        return _Unknown(start, UNKNOWN * abs(start), abs(start))

    def _stated(self, name: str) -> _Unknown:
        one = self.stated[name]
        scale = max(abs(one.value), SCALE.get(NAMES[name], 0.0))
        return _Unknown(one.value, max(EVEN * one.uncertainty, EXACT * scale), scale, one)

    # -- equations ---------------------------------------------------------------------------------------------------

    def _rig(self, at: Mapping[str, Any]) -> dict[str, Any]:
        """Return all dimensions; those outside the fit have their stated values."""
        rig = {name: one.value for name, one in self.stated.items()} | dict(at)
        for cell in LOAD_CELLS if CELLS_ACROSS in at else ():
            if self._described(cell) and abs(self.stated[direction(cell)[2]].value) > 0.5:
                rig[place(cell)[1]] = rig[place(cell)[1]] * at[CELLS_ACROSS]
        return rig

    def _equations(
        self, motion: Motion, values: Mapping[str, Any], rig: Mapping[str, Any]
    ) -> Iterator[list[Any]]:
        """Yield the equations that the signals of ``motion`` allow, each as a list of terms whose sum should be 0."""
        w = tau * motion.frequency
        c = {
            name: value * (1 + 1j * w * rig[lag(name)]) * (1 - rig[f"{name} gain"])
            for name, value in values.items()
        }
        left, right = (rig[across(one)] for one in LASERS)
        turned = (c[LASERS[0]] - c[LASERS[1]]) / (left - right)
        up = c[LASERS[0]] - left * turned
        phi = turned + c.get(ROLL, 0.0)
        frame = rig["vertical_frame_stiffness"] + 1j * w * rig["vertical_frame_damping"]
        for side, piston, force in zip(SIDES, PISTONS, FORCES, strict=True):
            if piston in c and force in c:
                yield [c[piston], -up, -rig[across(f"vertical_{side}")] * phi, c[force] / frame]
        cells = [cell for cell in LOAD_CELLS if cell in c and self._described(cell)]
        if not cells or not all(force in c for force in FORCES):
            return
        columns = {cell: _column(rig, cell) for cell in cells}
        F_y, F_z, M = (sum(columns[cell][part] * c[cell] for cell in cells) for part in range(3))
        if "bolster_mass" in rig:
            yield [-rig["bolster_mass"] * w**2 * up, -F_z, *(c[force] for force in FORCES)]
        if motion.carrying:
            arm = rig["spring_half_spacing"] * (1.0 if motion.carrying == "left" else -1.0)
            yield [M, -arm * F_z, rig[_TORSION] * phi]
        heights = ("centre_height", "lateral_actuator_height", "lateral_frame_stiffness", "bolster_mass")
        if LATERAL not in c or not all(name in rig for name in heights):
            return
        m, h_a = rig["bolster_mass"], rig["lateral_actuator_height"]
        frame = rig["lateral_frame_stiffness"] + 1j * w * rig.get("lateral_frame_damping", 0.0)
        free = c[LATERAL] + h_a * phi
        F_l = c[LATERAL_FORCE] if LATERAL_FORCE in c else -(F_y + m * w**2 * free) / (1 - m * w**2 / frame)
        y = free - F_l / frame
        if LATERAL_FORCE in c:
            yield [-m * w**2 * y, -F_y, -F_l]
        yield [
            -rig[_INERTIA] * w**2 * phi,
            -M,
            -rig["centre_height"] * F_y,
            h_a * F_l,
            *(rig[across(f"vertical_{side}")] * c[force] for side, force in zip(SIDES, FORCES, strict=True)),
        ]
        if ACCELEROMETER in c and "accelerometer_height" in rig and w > 0.0:
            yield [
                c[ACCELEROMETER],
                w**2 * y,
                -rig["accelerometer_height"] * w**2 * phi,
                -rig.get("gravity", START["gravity"]) * phi,
            ]

    def _all_weights(self) -> list[Floats]:
        """Return the standard deviation of each equation of each motion: noise of the signals and `METHOD`."""
        rig, found = self._rig({name: one.start for name, one in self._unknowns.items()}), []
        for motion in self.motions:
            terms = [*self._equations(motion, motion.values, rig)]
            base = np.array([sum(one) for one in terms])
            pistons = sum(name in motion.values for name in PISTONS)
            method = [hypot(GEOMETRY if k < pistons else METHOD, motion.rough) for k in range(len(terms))]
            variance = np.array(
                [(part * max(map(abs, one))) ** 2 for part, one in zip(method, terms, strict=True)]
            )
            if motion.carrying and len(terms) > pistons:
                variance[pistons + 1] += (RELAXES * rig["spring_half_spacing"]) ** 2
            moves = zip(motion.noise, np.diag([*motion.noise.values()]), strict=True)
            moved = {name: motion.values[name] + one for name, one in moves}
            for k, one in enumerate(self._equations(motion, moved, rig)):
                variance[k] += np.sum(np.abs(sum(one) - base[k]) ** 2)
            found.append(np.sqrt(variance))
        return found

    def _residuals(self, at: Mapping[str, Floats]) -> Floats:
        """Return the residuals: each equation divided by its standard deviation, for all sets of unknowns in ``at``.

        Shape (n, sets).
        """
        rig, found = self._rig(at), list[Floats]()
        for motion, sigma in zip(self.motions, self._weights, strict=True):
            for terms, one in zip(self._equations(motion, motion.values, rig), sigma, strict=True):
                value = sum(terms) / one
                found += [value.real, value.imag] if motion.frequency else [value.real]
        return np.array(np.broadcast_arrays(*found))

    # -- least squares -----------------------------------------------------------------------------------------------

    def _solve(self, sigmas: Mapping[str, float]) -> tuple[Floats, Floats, float]:
        """Solve the least-squares problem by Gauss-Newton steps.

        Return the changes of the unknowns in units of ``sigmas``, their covariance, and χ² with the priors.
        """
        names = list(self._unknowns)
        size = np.array([sigmas[name] for name in names])
        start = np.array([self._unknowns[name].start for name in names])
        q, covariance = np.zeros(len(names)), np.eye(len(names))
        step = np.minimum(1e-3 * np.array([self._unknowns[name].scale for name in names]) / size, 1.0)

        def residuals(sets: Floats) -> Floats:
            return self._residuals(dict(zip(names, (start + size * sets).T, strict=True)))

        r = residuals(q[None])[:, 0]
        for _ in range(ITERATIONS):
            slope = (residuals(q + np.diag(step)) - residuals(q - np.diag(step))) / (2 * step)
            covariance = np.linalg.inv(slope.T @ slope + np.eye(q.size))
            change = -covariance @ (slope.T @ r + q)
            q = q + change
            r = residuals(q[None])[:, 0]
            if np.max(np.abs(change)) < 1e-3:
                break
        return q, covariance, float(r @ r + q @ q)

    def _sigmas(self, freed: set[str]) -> dict[str, float]:
        return {
            name: UNKNOWN * one.scale if name in freed else one.sigma for name, one in self._unknowns.items()
        }

    def _estimates_without_prior(self, sigmas: Mapping[str, float]) -> tuple[dict[str, _Estimate], float]:
        """Return value and standard deviation of each unknown without its own prior, and χ²."""
        q, covariance, chi = self._solve(sigmas)
        found = {}
        for k, (name, one) in enumerate(self._unknowns.items()):
            information = 1.0 / covariance[k, k] - 1.0
            u = inf if information < 1e-9 else 1.0 / sqrt(information)
            shift = 0.0 if u == inf else q[k] / covariance[k, k] * u**2
            found[name] = _Estimate(one.start + sigmas[name] * shift, sigmas[name] * u)
        return found, chi

    def estimates(self) -> list[Estimate]:
        """Return an estimate of each dimension.

        While a stated value is contradicted, the prior whose removal reduces χ² most is removed.
        """
        freed, rivals = set[str](), dict[str, tuple[str, ...]]()
        exact = {name: EXACT * one.scale if one.known else one.sigma for name, one in self._unknowns.items()}
        noise = {name: one.u for name, one in self._estimates_without_prior(exact)[0].items()}
        estimates, chi = self._estimates_without_prior(self._sigmas(freed))
        values = dict(estimates)
        while worst := self._contradicted(estimates, noise, freed):
            tried = {name: self._estimates_without_prior(self._sigmas(freed | {name})) for name in worst}
            best = min(tried, key=lambda name: tried[name][1])
            least = tried[best][1]
            if chi - least < SURE**2:
                break
            bound = least + min(ALIKE, 0.25 * (chi - least))
            alike = [name for name, (_, one) in tried.items() if one <= bound]
            freed.add(best)
            estimates, chi = tried[best]
            rivals |= {name: tuple(one for one in alike if one != name) for name in alike}
            values |= {name: tried[name][0][name] for name in alike}
            values |= {name: one for name, one in estimates.items() if name in freed or name not in rivals}
        surplus = max(1.0, sqrt(chi / self._count()))
        entangled = self._entangled(noise)
        found = []
        for name, one in self._unknowns.items():
            if one.known:
                value, u = values[name]
                u *= 2.0 * surplus
                wanted = WANTED_LAG if NAMES.get(name) == "s" else WANTED * one.scale
                why = "" if u <= wanted else entangled[name]
                found.append(Estimate(name, value, u, name in rivals, rivals.get(name, ()), why))
        return found

    def _count(self) -> int:
        """Return the number of real equations; a complex equation counts as two."""
        return len(self._residuals({name: np.array([one.start]) for name, one in self._unknowns.items()}))

    def _contradicted(
        self, estimates: Mapping[str, _Estimate], noise: Mapping[str, float], freed: set[str]
    ) -> list[str]:
        """Return the dimensions whose stated values may be wrong, the largest deviation first; none if no value is
        contradicted.

        A deviation contradicts a stated value if it exceeds the sum of the noise (`SURE`), the half-width of the stated
        value, and the effect of the half-widths of the others. A half-width is a hard bound, a = √3 σ. If one value is
        contradicted, every dimension with a stated value is a candidate.
        """
        found, contradicted = dict[str, float](), False
        for name, one in self._unknowns.items():
            if not one.known or name in freed or (one.stated is None and name != CELLS_ACROSS):
                continue
            value, u = estimates[name]
            if u == inf:
                continue
            off, random = abs(value - one.start), min(noise[name], u)
            claimed = one.stated.uncertainty if one.stated else 0.0
            others = sqrt(max(u**2 - random**2, 0.0)) / EVEN
            contradicted |= off > SURE * random + others + claimed + EXACT * one.scale
            found[name] = off / hypot(u, one.sigma)
        return sorted(found, key=lambda name: -found[name])[:TRIED] if contradicted else []

    def _entangled(self, noise: Mapping[str, float]) -> dict[str, str]:
        """Return, for each unknown, a text on why the motions alone do not determine it."""
        wide = {name: 0.3 * one.scale if one.known else one.sigma for name, one in self._unknowns.items()}
        _, covariance, _ = self._solve(wide)
        names, size = list(self._unknowns), np.sqrt(np.diag(covariance))
        correlation = np.abs(covariance / np.outer(size, size) - np.eye(size.size))
        found = {}
        for k, (name, one) in enumerate(self._unknowns.items()):
            other = names[int(np.argmax(correlation[k]))]
            if not noise[name] < one.scale:
                found[name] = UNSEEN
            elif noise[name] <= 0.5 * WANTED * one.scale:
                found[name] = (
                    f"these motions determine it only together with {other} "
                    f"(correlation {covariance[k, names.index(other)] / size[k] / size[names.index(other)]:.2f})"
                )
            else:
                found[name] = "these motions are too small for these transducers"
        return found


def _column(rig: Mapping[str, Any], cell: str) -> tuple[Any, Any, Any]:
    """Return force to the left, force upward and roll moment for one newton on ``cell``, as `places.column_of` does.

    The dimensions may be arrays.
    """
    d_x, d_y, d_z = (rig[name] for name in direction(cell))
    size = np.sqrt(d_x**2 + d_y**2 + d_z**2)
    _, y, z = (rig[name] for name in place(cell))
    return d_y / size, d_z / size, (y * d_z - (z - rig["column_height"]) * d_y) / size


#: Dimensions that are in the equations.
_FITTED: Final = (
    "bolster_mass",
    "gravity",
    "spring_half_spacing",
    "centre_height",
    "lateral_actuator_height",
    "accelerometer_height",
    "column_height",
    "vertical_frame_stiffness",
    "vertical_frame_damping",
    "lateral_frame_stiffness",
    "lateral_frame_damping",
)
