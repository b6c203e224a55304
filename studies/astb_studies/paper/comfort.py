"""Ride comfort from sampled car-body accelerations: EN 12299 (ENV 12299), weighted with W_d across and W_b upward.

Both are a band from 0.4 to 100 Hz (Butterworth) and a transition from constant acceleration to constant velocity, W_d
above 2 Hz and W_b above 16 Hz; W_b also has a step upward from 2.5 to 4 Hz. A ride is judged in blocks of five minutes,
each by the 95th percentile of its sixty 5-s rms values.
"""

from dataclasses import dataclass
from math import pi, sqrt, tan
from typing import Final

import numpy as np
import numpy.typing as npt

Samples = npt.NDArray[np.float64]

#: Band of every weighting in Hz, and its quality factor.
BAND_LOW: Final = 0.4
BAND_HIGH: Final = 100.0
Q_BAND: Final = sqrt(0.5)


@dataclass(frozen=True, slots=True)
class Weighting:
    """A frequency weighting for whole-body vibration: band, transition, step upward and gain (ISO 8041-1, table 3)."""

    transition: float  #: Hz
    q_transition: float
    step: tuple[float, float, float, float] | None = None  #: zero (Hz) and its Q, pole (Hz) and its Q
    gain: float = 1.0  #: of the transition; with a step, the gain below it

    def sections(self) -> tuple[tuple[tuple[float, ...], tuple[float, ...], float], ...]:
        """Numerator and denominator in s, highest power first, and frequency in Hz of each second-order section."""
        low, high, corner = (2.0 * pi * f for f in (BAND_LOW, BAND_HIGH, self.transition))
        band_and_transition = (
            ((1.0, 0.0, 0.0), (1.0, low / Q_BAND, low * low), BAND_LOW),
            ((0.0, 0.0, high * high), (1.0, high / Q_BAND, high * high), BAND_HIGH),
            (
                (0.0, self.gain * corner, self.gain * corner * corner),
                (1.0, corner / self.q_transition, corner * corner),
                self.transition,
            ),
        )
        if self.step is None:
            return band_and_transition
        zero, q_zero, pole, q_pole = self.step
        a, b = 2.0 * pi * zero, 2.0 * pi * pole
        numerator = (b * b / (a * a), b * b / (q_zero * a), b * b)
        return *band_and_transition, (numerator, (1.0, b / q_pole, b * b), sqrt(zero * pole))


#: Horizontal acceleration: ISO 2631-1:1997, annex A.
W_D: Final = Weighting(2.0, 0.63)
#: Vertical acceleration in trains: BS 6841, ISO 2631-4, ISO 8041-1. Other programs take 0.63, 0.8 and 0.8 for its
#: quality factors, which is 2 % more at 1.2 Hz, 8 % less at 4 Hz and 13 % more at 16 Hz.
W_B: Final = Weighting(16.0, 0.55, (2.5, 0.9, 4.0, 0.95), 0.4)

#: Seconds in one rms value, and values in one block.
WINDOW: Final = 5.0
WINDOWS: Final = 60

#: Upper ends of the classes of N_MV (UIC 513, ENV 12299) and of the continuous C_Cy (EN 12299:2009), in words.
MEAN_COMFORT: Final = ((1.0, "very good"), (2.0, "good"), (4.0, "moderate"), (5.0, "poor"))
WORST_MEAN_COMFORT: Final = "very poor"
CONTINUOUS_COMFORT: Final = ((0.2, "very comfortable"), (0.3, "comfortable"), (0.4, "medium"))
WORST_CONTINUOUS_COMFORT: Final = "less comfortable"


class NotARide(ValueError):
    """The samples cannot give a comfort index."""


def weighting(f: npt.ArrayLike, by: Weighting = W_D) -> npt.NDArray[np.complex128]:
    """Return the exact complex frequency response of a weighting, for ``f`` in Hz ≥ 0 of any shape."""
    s = 2j * pi * np.asarray(f, dtype=np.float64)
    response = np.ones_like(s)
    for numerator, denominator, _ in by.sections():
        response = response * np.polyval(numerator, s) / np.polyval(denominator, s)
    return response


def sections(rate: float, by: Weighting = W_D) -> npt.NDArray[np.float64]:
    """Return a weighting as a digital filter for ``rate`` (Hz): second-order sections (n, 6) as in `scipy.signal`.

    Bilinear, each section exact at its own frequency: up to 16 Hz at 1 kHz within 0.1 % of W_d, and within 0.5 % of
    W_b. Raises NotARide if ``rate`` is not above 200 Hz.
    """
    from scipy.signal import bilinear

    if not rate > 2.0 * BAND_HIGH:
        raise NotARide(
            f"sampling rate = {rate:g} Hz; a band up to {BAND_HIGH:g} Hz needs more than {2 * BAND_HIGH:g} Hz"
        )
    rows = []
    for numerator, denominator, f in by.sections():
        b, a = bilinear(numerator, denominator, pi * f / tan(pi * f / rate))
        rows.append(np.concatenate([b, a]))
    return np.array(rows)


def weighted(acceleration: Samples, rate: float, by: Weighting = W_D) -> Samples:
    """Return ``acceleration`` (m/s², shape (n,)), sampled with ``rate`` (Hz), with a weighting; same shape.

    The filter starts as if the first value had always been there: a car that leans steadily does not ring. Raises
    NotARide for gaps (NaN) and for a ``rate`` that is too low.
    """
    from scipy.signal import sosfilt, sosfilt_zi

    values = np.asarray(acceleration, dtype=np.float64)
    if values.size == 0 or not np.isfinite(values).all():
        raise NotARide(
            f"acceleration has {np.count_nonzero(~np.isfinite(values))} gaps in {values.size} samples"
        )
    sos = sections(rate, by)
    result, _ = sosfilt(sos, values, zi=sosfilt_zi(sos) * values[0])
    return np.asarray(result)


def window_rms(values: Samples, rate: float, window: float = WINDOW) -> Samples:
    """Return the rms of each whole ``window`` (s) of ``values`` (n,) at ``rate`` (Hz), shape (⌊n/(rate·window)⌋,)."""
    length = round(rate * window)
    count = len(values) // length
    return np.sqrt(np.mean(np.square(values[: count * length].reshape(count, length)), axis=1))


def block_percentiles(rms: Samples) -> Samples:
    """Return the 95th percentile (linear between ranks) of each whole block of 60 ``rms`` values, shape (blocks,).

    NotARide for less than one block: five minutes.
    """
    blocks = len(rms) // WINDOWS
    if blocks == 0:
        raise NotARide(f"{len(rms)} windows of {WINDOW:g} s; one block has {WINDOWS}, {WINDOWS * WINDOW:g} s")
    return np.percentile(rms[: blocks * WINDOWS].reshape(blocks, WINDOWS), 95.0, axis=1)


def lateral_percentiles(acceleration: Samples, rate: float) -> Samples:
    """Return a_YP95 in m/s² of each five-minute block of a lateral ``acceleration`` (m/s², (n,)) at ``rate`` (Hz)."""
    return block_percentiles(window_rms(weighted(acceleration, rate), rate))


def mean_comfort(a_y: npt.ArrayLike, a_x: npt.ArrayLike = 0.0, a_z: npt.ArrayLike = 0.0) -> Samples:
    """Return N_MV = 6 √(a_x² + a_y² + a_z²) from weighted 95th percentiles in m/s², any shapes that broadcast.

    The simplified method of ENV/EN 12299: a_x and a_y with W_d, a_z with W_b. Lateral alone, with a_x = a_z = 0, it is
    a lower bound of N_MV, and what a study of crosswind alone can give.
    """
    return np.asarray(6.0 * np.sqrt(np.square(a_x) + np.square(a_y) + np.square(a_z)))


def describe_mean_comfort(n: float) -> str:
    """Return the class of N_MV in words; up to 2 counts as comfortable."""
    return next((word for end, word in MEAN_COMFORT if n < end), WORST_MEAN_COMFORT)


def describe_continuous_comfort(c: float) -> str:
    """Return the class of one 5-s rms value C_Cy (m/s²) in words."""
    return next((word for end, word in CONTINUOUS_COMFORT if c < end), WORST_CONTINUOUS_COMFORT)
