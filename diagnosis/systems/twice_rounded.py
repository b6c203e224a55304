"""What readings say that were rounded twice: by their converter, and more coarsely by what travels on the wire.

Theory of operation
-------------------
Noise moves a reading about between the steps of one rounding, and their mean is right to a millionth where the noise is
as large as the steps. Two roundings beat. Of steps of 25 N over a converter of 8 N, one code in eight represents four
numbers of the converter and the others for three: the mean is up to 2.5 N wrong, the same as long as the force stays
within some 50 N of where it is. In a rest of eight seconds that is five times what the noise leaves.

So each code gets the number for which the mean is right at every force: with P(k|F), the chance of code k at the force
F, and b(F), what the mean of the codes is wrong by, Σ_k P(k|F) c_k = b(F) is solved for the corrections c. Codes repeat
where both grids meet.

The converter's step comes from a data sheet. The readings may say that it is another: the codes that represent more
numbers are met more often where the signal moves (the histogram test of a converter, IEEE 1241).
"""

from dataclasses import dataclass
from fractions import Fraction
from typing import Final

import numpy as np
from scipy.special import ndtr

from diagnosis.contracts import Array

#: The grids meet after at most so many codes, else one would have to know the steps better than anybody does.
_CODES: Final = 32
#: Noise of at least this part of a step of the wire moves readings about.
_MOVED: Final = 0.5
#: A signal moves where it goes by so many times its noise within so many samples.
_WAY, _WITHIN = 6.0, 40
#: Readings contradict it where they are e to so many times likelier with all codes alike.
_AGAINST: Final = 5.0
#: Corrections below this part of the noise are none.
_LEAST: Final = 1e-3
#: Corrections that the noise leaves less than this part of are not determined by a mean.
_SEEN: Final = 0.02
#: Signals for each code, and standard deviations of the noise around each, that are looked at.
_SIGNALS, _REACH = 8, 6.0


@dataclass(frozen=True, slots=True, eq=False)
class TwiceRounded:
    """Steps of the ``wire`` and what the mean of each code is wrong by: ``corrections`` (k,), which repeat."""

    wire: float
    corrections: Array

    def rounded_once(self, readings: Array) -> Array:
        """Return readings (n,) whose mean is right; NaN stays NaN."""
        code = np.round(np.nan_to_num(readings) / self.wire).astype(np.int64)
        return np.asarray(readings - self.corrections[code % len(self.corrections)])


def rounded_to(values: Array) -> float:
    """Return the smallest difference between readings (n,); 0 where they are all the same."""
    apart = np.diff(np.unique(values[np.isfinite(values)]))
    return float(apart.min()) if apart.size else 0.0


def twice_rounded(readings: Array, converter: float, noise: float) -> TwiceRounded | None:
    """Return how a signal with these readings (n,) of equal intervals was rounded twice; None if it was not.

    ``converter`` is the finer step, ``noise`` the standard deviation before both. None as well where the noise is too
    small for the mean to be of use, and where the readings contradict it.
    """
    readings = readings[np.isfinite(readings)]
    wire = rounded_to(readings)
    codes = _codes(converter, wire)
    if codes < 2 or noise < _MOVED * wire:
        return None
    chances, bias = _chances(converter, wire, noise, codes)
    seen = readings[::_WITHIN]  # far enough apart to be met each by chance
    met = np.round(seen[:-1][np.abs(np.diff(seen)) > _WAY * noise] / wire).astype(np.int64) % codes
    if np.bincount(met, minlength=codes) @ np.log(codes * chances.mean(axis=0)) < -_AGAINST:
        return None
    corrections: Array = np.linalg.lstsq(chances, bias, rcond=_SEEN)[0].astype(np.float64)
    return TwiceRounded(wire, corrections) if np.abs(corrections).max() > _LEAST * noise else None


def _codes(converter: float, wire: float) -> int:
    """After how many codes both grids meet; 1 where one is in the other, and where they do not meet soon.

    Also where numbers of the converter lie half-way between two codes: which of them they get no one knows.
    """
    if not 0.0 < converter < wire:
        return 1
    ratio = Fraction(wire / converter).limit_denominator(_CODES)
    known = ratio.numerator % 2 and abs(float(ratio) * converter - wire) < 1e-6 * converter
    return ratio.denominator if known else 1


def _chances(converter: float, wire: float, noise: float, codes: int) -> tuple[Array, Array]:
    """Return the chance of each code (f, codes) at signals (f,) over one period, and what their mean is wrong by."""
    signal = wire * np.arange(codes * _SIGNALS) / _SIGNALS
    reach = _REACH * noise + wire
    number = np.arange(np.floor(-reach / converter), np.ceil((codes * wire + reach) / converter) + 1)
    value = number * converter
    edges = np.append(value - 0.5 * converter, value[-1] + 0.5 * converter)
    chance = np.diff(ndtr((edges - signal[:, np.newaxis]) / noise), axis=1)
    code = np.round(value / wire)
    bias = chance @ (wire * code) - signal
    return chance @ (code[:, np.newaxis] % codes == np.arange(codes)), bias
