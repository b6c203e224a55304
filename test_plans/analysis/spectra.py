"""Transfer functions of sampled random motions, with their uncertainty."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt
from numpy.lib.stride_tricks import sliding_window_view

from test_plans.analysis import NotMeasured, Samples

#: Half width of the 95 % interval of a normal distribution, in standard deviations.
SIGMAS_OF_95: Final = 1.96


@dataclass(frozen=True, slots=True)
class Transfer:
    """A transfer function y/x at one frequency or over a band, with its coherence."""

    frequency: float  #: Hz, the middle
    value: complex
    coherence: float  #: γ²
    averages: float  #: independent spectra that went into it

    @property
    def uncertainty(self) -> float:
        """The standard uncertainty of real and imaginary part, in the unit of the value.

        |H| √((1 − γ²)/(2 n γ²)): the incoherent part counts as noise (Bendat and Piersol, Random Data, 9.2).
        """
        return float(
            abs(self.value) * np.sqrt((1.0 - self.coherence) / (2.0 * self.averages * self.coherence))
        )


@dataclass(frozen=True, slots=True, eq=False)
class Spectra:
    """One-sided cross and power spectra of two signals, each of shape (n,)."""

    frequency: Samples  #: Hz
    xx: Samples
    yy: Samples
    xy: npt.NDArray[np.complex128]
    averages: float

    def rms(self, low: float, high: float) -> float:
        """Return the root mean square of x in the band from ``low`` to ``high`` (Hz)."""
        lines = (self.frequency >= low) & (self.frequency <= high)
        return float(np.sqrt(self.xx[lines].sum() * self.frequency[1]))

    def between(self, low: float, high: float) -> Transfer:
        """Return y/x in a band (Hz): least squares over all lines of the spectrum in the band, H = Σ S_xy / Σ S_xx."""
        lines = (self.frequency >= low) & (self.frequency <= high)
        xx, yy, xy = self.xx[lines].sum(), self.yy[lines].sum(), self.xy[lines].sum()
        if not (xx > 0.0 and yy > 0.0):
            raise NotMeasured(f"nothing moved between {low:g} and {high:g} Hz")
        coherence = min(abs(xy) ** 2 / (xx * yy), 1.0)
        # A Hann window spreads a line over one and a half.
        count = self.averages * max(np.count_nonzero(lines) / 1.5, 1.0)
        return Transfer(0.5 * (low + high), complex(xy / xx), float(coherence), float(count))


def spectra(
    x: Samples, y: Samples, rate: float, *, segment: float, x_lag: float = 0.0, y_lag: float = 0.0
) -> Spectra:
    """Return the spectra of ``x`` and ``y``, both of shape (n,), sampled at ``rate`` (Hz), by Welch's method.

    ``segment`` (s) sets the resolution; segments overlap by half. ``x_lag`` and ``y_lag`` (s) are the lags of
    first-order transducers. Raises NotMeasured for gaps, or if there are less than two segments.
    """
    from scipy.signal import detrend, get_window

    if x.shape != y.shape:
        raise NotMeasured(f"{x.size} and {y.size} samples do not match, so there are no spectra")
    if missing := int((~np.isfinite(x)).sum() + (~np.isfinite(y)).sum()):
        raise NotMeasured(f"{missing} of {x.size + y.size} samples are missing, so there are no spectra")
    length = round(segment * rate)
    if x.size < 2 * length:
        raise NotMeasured(
            f"the samples last {x.size / rate:.3g} s, but two segments of {segment:g} s are needed"
        )
    window = get_window("hann", length)
    # All segments at once: scipy's own csd processes one segment after the other, which takes fifteen times as long.
    X, Y = (
        np.fft.rfft(window * detrend(sliding_window_view(series, length)[:: length - length // 2]))
        for series in (x, y)
    )
    f = np.asarray(np.fft.rfftfreq(length, 1 / rate), float)
    both_sides = np.where((f > 0.0) & (f < 0.5 * rate), 2.0, 1.0)  # but for 0 and half the rate
    scale = both_sides / (len(X) * rate * np.sum(window**2))
    xx, yy, xy = (scale * np.sum(A.conj() * B, axis=0) for A, B in ((X, X), (Y, Y), (X, Y)))
    turn = 2j * np.pi * f
    forward, backward = 1.0 + turn * y_lag, 1.0 + turn * x_lag
    count = len(X)
    # Overlap by half, with a Hann window: neighbours share a sixth of their information.
    return Spectra(
        f,
        xx.real * np.abs(backward) ** 2,
        yy.real * np.abs(forward) ** 2,
        xy * forward * np.conj(backward),
        count / (1 + 2 / 36 * (count - 1) / count),
    )
