"""Estimation of the refresh period of a reading that keeps its value between refreshes ("held").

Theory of operation
-------------------
A held reading is late by the time since its last refresh, a (t mod T). In addition to a mean delay, its error is

    −a dp/dt s(t),   s = (t mod T) − T/2 = −T/π Σ_k sin(2πk t/T)/k,

so the product of error and dp/dt has a line at 1/T, in the phase of the clock. Over the minutes of a record this line
is very narrow: a period wrong by 1 in 10 000 is out of phase at the end, so a grid of periods cannot find it. So T is
estimated from the data. The spectrum also contains model errors, which change slowly with the frequency: a line counts
if it is far above its surroundings. A long steady motion gives lines too, but these are also in |dp/dt|; if the
clearest line is one of them, nothing is reported. Around a line that counts, T is the period for which −dp/dt s
explains most of the square of the errors.
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from diagnosis.contracts import Array, Hypothesis, MeasuredRun

#: The distance of two frequencies is 1/(this number · duration), where the duration is that from the first to the last
#: sample.
_FINE: Final = 8
#: Largest number of samples of a spectrum. Samples after some forty minutes at 200 Hz are not used.
_LONGEST: Final = 1 << 22
#: Surroundings of a line, in Hz to either side. Nearer frequencies contain the line itself, because runs are short.
_NEAR, _FAR = 0.5, 2.0
#: Smallest ratio of the power of a line to that of its surroundings. Benches without held readings reach 20. A bench
#: with readings held for 25 ms and a thirtieth of their delay (λ = 22) reaches 48.
_CLEAR: Final = 30.0
#: If |dp/dt| has a line at the same frequency with at least this part of its largest amplitude, the motion may be the
#: cause.
_STEADY: Final = 0.03
#: A sample up to this time (s) before a refresh counts as after it, because the clock is rounded.
_AT_ONCE: Final = 1e-6
#: Relative uncertainty of a detected period, and its difference step as a part of this uncertainty.
_KNOWN: Final = 1e-5
_DIFFERENCE: Final = 0.3
#: Number of periods that are tried around a line, up to one frequency step of the spectrum on both sides.
_TRIED: Final = 201


class ChannelErrors(NamedTuple):
    """A channel in one run: clock (n,) of its samples, their errors (n,), and the predicted dp/dt (n,).

    Errors and rates are 0 where nothing was measured.
    """

    clock: Array
    errors: Array
    rates: Array

    @property
    def step(self) -> float:
        """Sampling interval in s."""
        return float(self.clock[1] - self.clock[0])

    def without_lateness(self) -> "ChannelErrors":
        """Return the channel minus the part of its errors that a constant delay explains, divided by the standard
        deviation of the rest.
        """
        late = float(self.errors @ self.rates) / max(float(self.rates @ self.rates), 1e-300)
        rest = self.errors - late * self.rates
        scale = max(float(np.std(rest)), 1e-300)
        return ChannelErrors(self.clock, rest / scale, self.rates / scale)


def errors_of(run: MeasuredRun, places: Sequence[int], expected: Array) -> Iterator[ChannelErrors]:
    """Yield for each channel at ``places`` the errors of a run: measured minus ``expected`` values (n, m). Skip
    unmeasured channels.
    """
    clock = run.experiment.settings.get("start", 0.0) + run.experiment.time
    for place, values in zip(places, expected.T, strict=True):
        counted = run.counted[:, place]
        if counted.any():
            errors = run.outputs[:, place] - values
            errors -= errors[counted].mean()
            rates = np.gradient(values, run.experiment.step)
            yield ChannelErrors(clock, np.where(counted, errors, 0.0), np.where(counted, rates, 0.0))


def of_period(held: Hypothesis, period: float) -> Hypothesis:
    """Return the hypothesis of held readings with a known ``period`` (s)."""
    (shape,) = held.shapes
    known = replace(shape, nominal=period, spread=_KNOWN * period, step=_DIFFERENCE * _KNOWN * period)
    return replace(held, shapes=(known,), grid=((period,),), imitated=())


def held_period(channels: Sequence[ChannelErrors], shortest: float, longest: float) -> float | None:
    """Return the refresh period T (s) of ``channels``, between two bounds; None if they are not held."""
    together = _together(channels)
    if not together:
        return None
    together = [one.without_lateness() for one in together]
    lines, motion = _spectra(together)
    inside = (lines.frequencies >= 1.0 / longest) & (lines.frequencies <= 1.0 / shortest)
    in_phase = np.where(inside, -lines.values.imag, 0.0)
    best = int(np.argmax(in_phase))
    clear = in_phase[best] ** 2 > _CLEAR * lines.around(best)
    moved = np.abs(motion.values[best]) > _STEADY * np.abs(motion.values).max()
    if moved or not clear:
        return None
    tried = 1.0 / (lines.frequencies[best] + lines.step * np.linspace(-1.0, 1.0, _TRIED))
    return max(tried.tolist(), key=lambda period: _taken(together, period))


def _together(channels: Sequence[ChannelErrors]) -> list[ChannelErrors]:
    """Return the channels that one spectrum can contain: with equal sampling, and ending not too long after the first
    start.
    """
    if not channels:
        return []
    first = min(channels, key=lambda one: float(one.clock[0]))
    span = _LONGEST * first.step / _FINE
    return [
        one
        for one in channels
        if abs(one.step - first.step) < 1e-6 * first.step and one.clock[-1] - first.clock[0] < span
    ]


class _Spectrum(NamedTuple):
    """Complex ``values`` (m,) at equidistant ``frequencies`` (m,), in the phase of the clock."""

    frequencies: Array
    values: NDArray[np.complex128]

    @property
    def step(self) -> float:
        """Distance of two frequencies, in Hz."""
        return float(self.frequencies[1])

    def around(self, place: int) -> float:
        """Return the mean power around a line. It is computed as the median divided by ln 2, as for noise."""
        near, far = (round(hertz / self.step) for hertz in (_NEAR, _FAR))
        power = np.abs(
            np.r_[self.values[max(place - far, 0) : place - near], self.values[place + near : place + far]]
        )
        return float(np.median(power**2)) / float(np.log(2.0)) if power.size else float("inf")


def _spectra(channels: Sequence[ChannelErrors]) -> tuple[_Spectrum, _Spectrum]:
    """Return two spectra: of error times rate, and of the size of the rate, which shows even orders of steady
    motions.
    """
    first = min(float(one.clock[0]) for one in channels)
    last = max(float(one.clock[-1]) for one in channels)
    step = channels[0].step
    signals = np.zeros((2, 1 << int(np.ceil(np.log2(_FINE * (last - first) / step)))))
    for clock, errors, rates in channels:
        place = round((float(clock[0]) - first) / step)
        product, size = errors * rates, np.abs(rates)
        part = signals[:, place : place + len(rates)]
        part[0] += product / max(float(np.std(product)), 1e-300)
        part[1] += np.hanning(len(size)) * (size - size.mean()) / max(float(np.std(size)), 1e-300)
    frequencies: Array = np.fft.rfftfreq(signals.shape[1], step).astype(np.float64)
    products, sizes = np.fft.rfft(signals) * np.exp(-2j * np.pi * frequencies * first)
    return _Spectrum(frequencies, products), _Spectrum(frequencies, sizes)


def _taken(channels: Sequence[ChannelErrors], period: float) -> float:
    """Return the decrease of the sum of squared errors if readings are held for ``period`` (s); negative for the wrong
    sign.
    """
    product, square = 0.0, 0.0
    for clock, errors, rates in channels:
        shape = -rates * ((clock + _AT_ONCE) % period - 0.5 * period)
        product += float(shape @ errors)
        square += float(shape @ shape)
    return product * abs(product) / max(square, 1e-300)
