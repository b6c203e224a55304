"""Correction of readings that were rounded twice: by their converter, and more coarsely by the bus.

Theory of operation
-------------------
With one rounding and noise as large as the steps, the mean of the readings is exact to 1 in 1 000 000. With two
roundings it is not. With steps of 25 N on the bus and 8 N of the converter, one code in eight represents four numbers
of the converter and the others three. With noise of 20 N, the error of the mean is up to 2.5 N. It depends on the
force, with a period of 200 N. So it does not average out at rest. After eight seconds it is five times the error
by noise.

So each code gets a correction that makes the mean exact at every force: with P(k|F), the probability of code k at the
force F, and b(F), the error of the mean of the codes, Σ_k P(k|F) c_k = b(F) is solved for the corrections c, which are
subtracted. They repeat with the common period of both grids.

The converter's step comes from a data sheet. Readings can contradict it: codes that represent more numbers occur more
often while the signal moves (the histogram test of a converter, IEEE 1241).
"""

from dataclasses import dataclass
from fractions import Fraction
from typing import Final

import numpy as np
from scipy.special import ndtr

from diagnosis.contracts import Array

#: Largest number of codes after which the two grids meet again. For a longer period the steps would have to be known
#: too exactly.
_CODES: Final = 32
#: The noise must be at least this part of a step of the bus. Then it changes the readings.
_MOVED: Final = 0.5
#: A signal moves if it changes by this many times its noise within this many samples.
_WAY, _WITHIN = 6.0, 40
#: Readings contradict the step of the converter if their log likelihood with equally frequent codes is larger by this.
_AGAINST: Final = 5.0
#: Corrections below this part of the noise are not used.
_LEAST: Final = 1e-3
#: If the noise reduces a correction to less than this part, the mean of the readings does not determine it.
_SEEN: Final = 0.02
#: Number of values of the signal per code, and range of the noise in standard deviations, in the computation.
_SIGNALS, _REACH = 8, 6.0


@dataclass(frozen=True, slots=True, eq=False)
class TwiceRounded:
    """The correction of a channel: the step of the bus (``wire``), and the error of the mean of each code,
    ``corrections`` (k,).

    The corrections repeat periodically over the codes.
    """

    wire: float
    corrections: Array

    def rounded_once(self, readings: Array) -> Array:
        """Return readings (n,) with a correct mean; NaN stays NaN."""
        code = np.round(np.nan_to_num(readings) / self.wire).astype(np.int64)
        return np.asarray(readings - self.corrections[code % len(self.corrections)])


def rounded_to(values: Array) -> float:
    """Return the smallest difference between readings (n,); 0 if they are all equal."""
    apart = np.diff(np.unique(values[np.isfinite(values)]))
    return float(apart.min()) if apart.size else 0.0


def twice_rounded(readings: Array, converter: float, noise: float) -> TwiceRounded | None:
    """Return the correction for readings (n,) that were rounded twice; None if they were not.

    ``converter`` is the finer step, ``noise`` the standard deviation before both roundings. The result is also None if
    the noise is too small for a useful mean, or if the readings contradict the step.
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
    """Return after how many codes of the bus the grids of bus and converter meet again.

    1 if one grid contains the other, if the period is too long, or if numbers of the converter are half-way between two
    codes, because their rounding is unknown.
    """
    if not 0.0 < converter < wire:
        return 1
    ratio = Fraction(wire / converter).limit_denominator(_CODES)
    known = ratio.numerator % 2 and abs(float(ratio) * converter - wire) < 1e-6 * converter
    return ratio.denominator if known else 1


def _chances(converter: float, wire: float, noise: float, codes: int) -> tuple[Array, Array]:
    """Return the probability of each code (f, codes) at f values of the signal over one period, and the error (f,) of
    the mean of the codes.
    """
    signal = wire * np.arange(codes * _SIGNALS) / _SIGNALS
    reach = _REACH * noise + wire
    number = np.arange(np.floor(-reach / converter), np.ceil((codes * wire + reach) / converter) + 1)
    value = number * converter
    edges = np.append(value - 0.5 * converter, value[-1] + 0.5 * converter)
    chance = np.diff(ndtr((edges - signal[:, np.newaxis]) / noise), axis=1)
    code = np.round(value / wire)
    bias = chance @ (wire * code) - signal
    return chance @ (code[:, np.newaxis] % codes == np.arange(codes)), bias
