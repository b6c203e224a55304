"""Uncertainty of a computed value, propagated numerically from the errors of the instruments.

This is the law of propagation of JCGM 100 (GUM), 5.1.2. Each reading is shifted by the standard uncertainty of each
error of its instrument, and the value is computed again: u² = Σ (f(x + u_i) − f(x − u_i))²/4 + noise. The error of one
piece of an instrument is shifted in all captures at once, because its effects on numerator and denominator, before and
after, or on all repeats, are correlated. Different pieces are independent. Noise and resolution are drawn separately
for every sample.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from math import hypot, isfinite, sqrt
from typing import Any, Final, NamedTuple

import numpy as np
import numpy.typing as npt

from bench_protocol.table import TABLE
from bench_protocol.units import Hz
from bench_records.conformity import coverage_factor
from drivers.wiring.contract import Stamp
from test_plans.description import Description
from test_plans.instruments import Instruments, Piece

Samples = npt.NDArray[np.float64]
#: Captured data by signal: samples at a constant rate, or means.
Captured = Mapping[str, Any]
Evaluation = Callable[..., Any]

#: An even distribution of half-width a has the standard deviation a/√3 (JCGM 100, 4.3.7), a step q has q/√12.
EVEN: Final = 1 / sqrt(3.0)
STEP: Final = 1 / sqrt(12.0)
#: This number of draws gives the standard deviation of the effect of noise to 6 %.
NOISE_DRAWS: Final = 128
#: Random numbers drawn in one call, at most (0.8 MB), except for a single draw that needs more.
NUMBERS_AT_ONCE: Final = 100_000
#: Up to this ratio of the rates two signals count as equally fast, because single samples may be lost.
SAME_RATE: Final = 1.2
#: Parts below this share of the variance are not listed.
LEAST_SHARE: Final = 0.01
#: Cause of uncertainty that is not from an instrument: the time between two samples.
SAMPLING: Final = "time between samples"
#: Reasons why a value needs no uncertainty.
COUNTED: Final = "it was counted"
YES_OR_NO: Final = "it is yes or no"


@dataclass(frozen=True, slots=True)
class Measured:
    """A value (SI) with its standard uncertainty ``u``. ``parts`` are the contributions to ``u`` by cause, also
    standard uncertainties.

    ``u`` is None if the value has no uncertainty. ``unknown`` gives the reason: the errors of the readings are unknown,
    or the value is not a measurement (`Exact`).
    """

    value: float
    u: float | None = None
    even: float = 0.0  #: the largest of the evenly distributed parts
    parts: Mapping[str, float] = field(default_factory=dict)
    unknown: str = ""  #: why there is no uncertainty

    def __float__(self) -> float:
        return self.value

    @property
    def expanded(self) -> float | None:
        """The expanded uncertainty U = k u (SI); None if ``u`` is None."""
        if self.u is None:
            return None
        return coverage_factor(self.even / self.u) * self.u if self.u else 0.0

    def with_uncertainty(self, cause: str, u: float, *, even: bool = False) -> Measured:
        """Return the value with a further independent contribution ``u`` to its uncertainty. Without an uncertainty it
        is unchanged.
        """
        if self.u is None:
            return self
        whole = hypot(self.u, u)
        parts = {**self.parts, cause: hypot(self.parts.get(cause, 0.0), u)}
        content = {one: part for one, part in parts.items() if part**2 > LEAST_SHARE * whole**2}
        return replace(self, u=whole, even=max(self.even, u) if even else self.even, parts=content)


@dataclass(frozen=True, slots=True)
class Exact(Measured):
    """A value that is not a measurement and has no uncertainty; ``unknown`` gives the reason."""


def counted(number: float) -> Exact:
    """Return a count, or a ratio of counts, as an exact value."""
    return Exact(float(number), unknown=COUNTED)


def yes_or_no(so: bool) -> Exact:
    """Return 1 for True and 0 for False as an exact value."""
    return Exact(float(so), unknown=YES_OR_NO)


def timed(value: float, *steps: float) -> Measured:
    """Return a time (s) between two events. Its uncertainty is that of the sampling intervals ``steps`` (s) of the
    events.
    """
    found = Measured(value, 0.0)
    for step in steps:
        found = found.with_uncertainty(SAMPLING, 0.5 * EVEN * step, even=True)
    return found


class _Watched(Mapping[str, Any]):
    """A mapping of readings that records the names of the readings that were used."""

    def __init__(self, readings: Captured) -> None:
        self._readings = readings
        self.used: dict[str, None] = {}

    def __getitem__(self, name: str) -> Any:
        self.used[name] = None
        return self._readings[name]

    def __contains__(self, name: object) -> bool:  # a test for presence is not a use
        return name in self._readings

    def __iter__(self) -> Iterator[str]:
        return iter(self._readings)

    def __len__(self) -> int:
        return len(self._readings)


def measured(
    evaluate: Evaluation,
    *captures: Captured,
    instruments: Instruments,
    rate: float | Mapping[str, float] = 200 * Hz,
    averaged: int | Mapping[str, int] = 1,
    came: Mapping[str, float] | None = None,
    stamps: Mapping[str, Stamp] | None = None,
    themselves: bool = False,
) -> tuple[Measured, ...]:
    """Return the value or values of ``evaluate(*captures)``, each with its uncertainty.

    ``captures`` are readings (SI) by signal: samples of shape (n,) at ``rate`` (Hz), or means over ``averaged``
    samples; both are one number, or numbers by signal. A capture may also be the `Description` of the rig, because its
    dimensions are uncertain. ``came`` is the receive rate (Hz) of each signal: a signal slower than ``rate`` was
    interpolated, so its noise is correlated. ``stamps`` are the time stamps of signals: signals with a shared clock
    have a common delay. Set ``themselves`` if the errors of the instruments are the measured quantity; then only noise,
    resolution and dimensions contribute to the uncertainty.

    The value has no uncertainty if a used reading has no known instrument (statuses and choices have no error), if no
    reading was used, or if a computed value is not finite.
    """
    watched = [_Watched(one) for one in captures]
    best = np.atleast_1d(np.asarray(evaluate(*watched), float))
    names = dict.fromkeys(name for one in watched for name in one.used)
    used = [name for name in names if name in TABLE.index and _can_err(name)]
    lacking = [name for name in used if name not in instruments.pieces]
    if lacking or not any(name in TABLE.index for name in names):
        reason = (
            f"no instrument is known for {', '.join(lacking)}" if lacking else "it was computed of no reading"
        )
        return tuple(Measured(float(value), unknown=reason) for value in best)
    rates = rate if isinstance(rate, Mapping) else dict.fromkeys(used, rate)
    parts: dict[str, Samples] = {}
    even = np.zeros_like(best)
    ways = () if themselves else _all_ways(used, instruments, rates, stamps or {})
    for key, moves in (*ways, *_dimensions(names, captures)):
        up, down = (
            np.atleast_1d(np.asarray(evaluate(*_changed(captures, moves, way)), float)) for way in (1.0, -1.0)
        )
        # The mean of both absolute changes is correct also at an extremum, such as a magnitude near 0.
        part = 0.5 * (abs(up - best) + abs(best - down))
        parts[key] = np.hypot(parts.get(key, 0.0), part)
        even = np.maximum(even, part)
    pieces = [instruments.pieces[name] for name in used]
    apart = {
        name: max(rates.get(name, 1.0) / hertz, 1.0) for name, hertz in (came or {}).items() if hertz > 0.0
    }
    parts["noise"] = _noise(evaluate, captures, pieces, best, averaged, apart)
    return tuple(_composed(best, parts, even, place) for place in range(best.size))


def _composed(best: Samples, parts: Mapping[str, Samples], even: Samples, place: int) -> Measured:
    own = {cause: float(abs(part[place])) for cause, part in parts.items()}
    u = sqrt(sum(part**2 for part in own.values()))
    if not isfinite(u):
        return Measured(float(best[place]), unknown="the computation has no neighbouring value")
    causes = sorted(own, key=lambda cause: own[cause], reverse=True)
    largest = {cause: own[cause] for cause in causes if own[cause] ** 2 > LEAST_SHARE * u**2}
    return Measured(float(best[place]), u, float(even[place]), largest)


def _can_err(name: str) -> bool:
    return TABLE[name].group is not None


Move = Callable[[Any], Any]


def _all_ways(
    used: Sequence[str], instruments: Instruments, rates: Mapping[str, float], stamps: Mapping[str, Stamp]
) -> Iterator[tuple[str, Mapping[str, Move]]]:
    """Yield each cause of error, with a function for each affected signal that returns the shift of its samples.

    An instrument shifts one signal; a time stamp shifts all signals of its clock.
    """
    for name in used:
        for cause, moved in _instrument_shifts(instruments.pieces[name], rates.get(name, 1.0)):
            yield f"{instruments.pieces[name].instrument.name} {cause}", {name: moved}
    together: dict[str, list[str]] = {}
    for name in used:
        if name in stamps:
            together.setdefault(stamps[name].shared, []).append(name)
    for names in together.values():
        one = stamps[names[0]]
        late = {name: _late(one.within, rates.get(name, 1.0)) for name in names}
        yield f"time stamps by the {one.clock}", late


def _dimensions(
    names: Iterable[str], captures: Sequence[Captured]
) -> Iterator[tuple[str, Mapping[str, Move]]]:
    """Yield each used dimension that has an uncertainty, with a function that returns its shift by one standard
    deviation.
    """
    for rig in captures:
        if not isinstance(rig, Description):
            continue
        for name in names:
            one = rig.stated(name)
            if one and one.uncertainty:
                yield name.replace("_", " "), {name: partial(_constant_shift, one.uncertainty * EVEN)}


def _constant_shift(by: float, value: Any) -> Any:
    return by + 0.0 * value


def _late(by: float, rate: float) -> Move:
    """Return a function that shifts samples by one standard deviation of a delay. ``by`` (s) is the half-width of the
    delay.
    """
    return lambda values: -by * EVEN * np.gradient(values) * rate if np.size(values) > 1 else 0.0


def _instrument_shifts(piece: Piece, rate: float) -> Iterator[tuple[str, Move]]:
    """Yield each error of one instrument, with a function that returns the shift of samples by one standard
    deviation.
    """
    one, signal = piece.instrument, TABLE[piece.signal]
    middle, half = 0.5 * (signal.high + signal.low), 0.5 * (signal.high - signal.low)
    if one.offset:
        yield "offset", lambda values: one.offset * EVEN + 0.0 * values
    if one.gain:
        yield "gain", lambda values: one.gain * EVEN * values
    if one.nonlinearity:
        yield "nonlinearity", lambda values: one.nonlinearity * EVEN * (1 - ((values - middle) / half) ** 2)
    if one.lag:
        yield "lag", _late(one.lag, rate)


def _changed(captures: Sequence[Captured], moves: Mapping[str, Move], way: float) -> list[Captured]:
    changed: list[Captured] = []
    for one in captures:
        moved = {
            name: one[name] + way * move(np.asarray(one[name], float))
            for name, move in moves.items()
            if name in one
        }
        changed.append({**one, **moved} if moved else one)
    return changed


def _noise(
    evaluate: Evaluation,
    captures: Sequence[Captured],
    pieces: Sequence[Piece],
    best: Samples,
    averaged: int | Mapping[str, int],
    apart: Mapping[str, float],
) -> Samples:
    """Return the standard uncertainty due to noise and resolution of single samples. The draws have a fixed seed.

    ``apart`` gives for each signal the distance between received samples, in samples of the capture.
    """
    generator = np.random.default_rng(1)
    away = np.zeros_like(best)
    noisy = [[*_noises(one, pieces, averaged, apart)] for one in captures]
    for drawn in _draws(generator, [one for of in noisy for one in of]):
        changed = [
            {**one, **{noise.name: next(drawn) for noise in of}} if of else one
            for one, of in zip(captures, noisy, strict=True)
        ]
        away += (np.atleast_1d(np.asarray(evaluate(*changed), float)) - best) ** 2
    return np.sqrt(away / NOISE_DRAWS)


class _Noise(NamedTuple):
    """A signal with noise: its readings, the standard deviation ``sigma`` of one reading, and the distance ``apart``
    between received samples.
    """

    name: str
    values: Samples
    sigma: float
    apart: float

    @property
    def numbers(self) -> int:
        """How many random numbers one draw needs."""
        if not self.values.ndim or self.apart < SAME_RATE:
            return self.values.size
        return int((self.values.size - 1) / self.apart) + 2 if self.values.size else 0

    def readings(self, normal: Samples) -> Samples:
        """Return the readings with noise, one row per draw. ``normal`` are normal random numbers of shape (draws,
        `numbers`).
        """
        if not self.values.ndim:
            return self.values + self.sigma * normal[:, 0]
        if self.apart < SAME_RATE or not self.values.size:
            return self.values + self.sigma * normal
        # Samples between those that were received are interpolated linearly.
        places = np.arange(self.values.size) / self.apart
        before = places.astype(int)
        step = normal[:, before + 1] - normal[:, before]
        return self.values + self.sigma * (step * (places - before) + normal[:, before])


def _draws(generator: np.random.Generator, noisy: Sequence[_Noise]) -> Iterator[Iterator[Any]]:
    """Yield for each draw the readings of all ``noisy`` signals, in their order. The random numbers of many draws are
    made in one call.
    """
    ends = np.cumsum([0, *(one.numbers for one in noisy)])
    left = NOISE_DRAWS
    while left:
        rows = min(left, max(1, NUMBERS_AT_ONCE // max(int(ends[-1]), 1)))
        normal = generator.standard_normal((rows, int(ends[-1])))
        columns = [
            one.readings(normal[:, start:end])
            for one, start, end in zip(noisy, ends[:-1], ends[1:], strict=True)
        ]
        yield from (iter([of[row] for of in columns]) for row in range(rows))
        left -= rows


def _noises(
    readings: Captured,
    pieces: Sequence[Piece],
    averaged: int | Mapping[str, int],
    apart: Mapping[str, float],
) -> Iterator[_Noise]:
    """Yield each signal of ``readings`` with noise."""
    if isinstance(readings, Description):
        return
    for piece in pieces:
        if piece.signal in readings:
            values = np.asarray(readings[piece.signal], float)
            count = averaged.get(piece.signal, 1) if isinstance(averaged, Mapping) else averaged
            sigma = _sigma(piece, values, count)
            yield _Noise(piece.signal, values, sigma, apart.get(piece.signal, 1.0))


def _sigma(piece: Piece, values: Samples, averaged: int) -> float:
    """Return the standard deviation of one reading. Averaging reduces noise, but the effect of resolution only if noise
    is large.
    """
    noise, step = piece.instrument.noise, piece.instrument.resolution * STEP
    if values.ndim:
        return sqrt(noise**2 + step**2)
    if 2 * noise >= piece.instrument.resolution:  # with this noise (dither) a mean resolves less than a step
        return sqrt((noise**2 + step**2) / averaged)
    return sqrt(noise**2 / averaged + step**2)
