"""The loop of a hybrid simulation: the effect of delay and compensation on the springs, and the loop's stability."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import permutations
from math import pi
from typing import Final

import numpy as np
import numpy.typing as npt

from bench_protocol.arrays import Floats
from bench_protocol.units import Hz

Complex = npt.NDArray[np.complex128]

#: Frequencies of the loop's analysis: from below all modes of a car to the bandwidth of a stream of set-points.
FREQUENCIES: Final[Floats] = np.geomspace(0.1 * Hz, 25 * Hz, 2000)
#: The same without a stream: to far beyond the bandwidth of the actuators.
FURTHER: Final[Floats] = np.geomspace(0.1 * Hz, 200 * Hz, 2750)
#: The least margins for a ride. The phase margin comes only from the losses of the springs: springs without loss would
#: have none, even without delay.
LEAST_PHASE: Final = 3.0 * pi / 180.0
LEAST_GAIN: Final = 1.5


@dataclass(frozen=True, slots=True)
class Path:
    """The path from the car's place to the force of the springs (s, Hz): delays, actuator, lags.

    Set-points are sent every ``beat`` s and interpolated linearly; forces are held for ``hold`` s, the car's step.
    """

    beat: float
    latency: float  #: of the buses in both directions, without interpolation and hold
    hold: float
    actuator_frequency: float
    actuator_damping: float
    lag: float  #: of the load cells, first order

    @property
    def frequencies(self) -> Floats:
        """Frequencies of the analysis of a loop with this path (Hz)."""
        return FREQUENCIES if self.beat else FURTHER

    @property
    def delay(self) -> float:
        """Delay of a force that slow motions cause (s): this delay must be compensated."""
        actuator = self.actuator_damping / (pi * self.actuator_frequency)
        return self.beat + self.latency + 0.5 * self.hold + actuator + self.lag

    def response(self, f: Floats, compensated: float) -> Complex:
        """Return the ratio of forces (1) at ``f`` (Hz), for a prediction ``compensated`` s ahead; 1 is no delay."""
        s = 2j * pi * np.asarray(f)
        ahead = 1.0 + compensated * s + 0.5 * (compensated * s) ** 2
        joined = np.sinc(np.asarray(f) * self.beat) ** 2 * np.exp(-self.beat * s)
        held = np.sinc(np.asarray(f) * self.hold) * np.exp(-0.5 * self.hold * s)
        r = s / (2.0 * pi * self.actuator_frequency)
        actuator = 1.0 / (1.0 + 2.0 * self.actuator_damping * r + r**2)
        return np.asarray(ahead * joined * held * actuator * np.exp(-self.latency * s) / (1.0 + self.lag * s))


@dataclass(frozen=True, slots=True)
class Margins:
    """Stability margins of a loop: phase (rad) where its gain is 1, gain (1) where its phase is −180°."""

    phase: float
    gain: float
    phase_at: float  #: Hz
    gain_at: float

    @property
    def enough(self) -> bool:
        """Whether both margins are large enough for a ride."""
        return self.phase >= LEAST_PHASE and self.gain >= LEAST_GAIN

    def text(self) -> str:
        """Return both margins as text."""
        gain = f"a gain margin of {self.gain:.1f} at {self.gain_at:.1f} Hz" if np.isfinite(self.gain) else ""
        phase = f"a phase margin of {self.phase * 180 / pi:.1f}° at {self.phase_at:.2f} Hz"
        return " and ".join(filter(None, (phase, gain)))


def loci(
    f: Floats,
    of_car: tuple[Floats, Floats, Floats],
    stiffness: Floats,
    damping: Floats,
    response: Complex,
) -> Complex:
    """Return the characteristic loci (f, 3) of the loop that is cut at the springs' forces: eigenvalues of L(iω).

    L = H (K_c + iωC_c − ω²M)⁻¹ (K_s + iωC_s), with mass, damping and stiffness (3, 3) of the car, those of the springs,
    and the ``response`` H (f,) of the path between them.
    """
    M, C, K = of_car
    found = np.empty((f.size, 3), complex)
    for n, omega in enumerate(2.0 * pi * f):
        car = K + 1j * omega * C - omega**2 * M
        springs = stiffness + 1j * omega * damping
        found[n] = np.linalg.eigvals(response[n] * np.linalg.solve(car, springs))
    return found


def margins(f: Floats, eigenvalues: Complex) -> Margins:
    """Return the least margins of loci (f, k): their distance to −1 along the unit circle, and along the axis.

    Above its natural frequency, a car acts as a mass, and its loop has a phase of −180°. The losses of the springs turn
    it away from −1, and delay turns it toward −1. The gain margin is taken above the last frequency with a gain of 1.
    """
    least_phase, phase_at, least_gain, gain_at = np.inf, np.nan, np.inf, np.nan
    for one in _sorted(eigenvalues).T:
        size = np.abs(one)
        crossings = np.flatnonzero((size[:-1] >= 1.0) != (size[1:] >= 1.0))
        for k in crossings:
            part = (1.0 - size[k]) / (size[k + 1] - size[k])
            at = one[k] + part * (one[k + 1] - one[k])
            left = float(np.angle(-at))  # positive below the negative real axis
            left = left if abs(left) < 0.5 * pi else abs(left)
            if left < least_phase:
                least_phase, phase_at = left, float(f[k] + part * (f[k + 1] - f[k]))
        above = int(crossings[-1]) + 1 if crossings.size else 0
        for n in range(above, len(f) - 1):
            a, b = one[n], one[n + 1]
            if a.imag * b.imag < 0.0 and a.real < 0.0:
                real = a.real - a.imag * (b.real - a.real) / (b.imag - a.imag)
                if real < 0.0 and -1.0 / real < least_gain:
                    least_gain, gain_at = -1.0 / real, float(f[n])
    return Margins(float(least_phase), float(least_gain), phase_at, gain_at)


def _sorted(eigenvalues: Complex) -> Complex:
    """Return loci (f, k) whose columns are continuous over frequency (nearest neighbour)."""
    found = eigenvalues.copy()
    each = range(found.shape[1])
    orders = [list(order) for order in permutations(each)]
    for n in range(1, len(found)):
        far = np.abs(found[n - 1][:, None] - eigenvalues[n][None, :])
        ways = [float(far[each, order].sum()) for order in orders]
        found[n] = eigenvalues[n][orders[int(np.argmin(ways))]]
    return found
