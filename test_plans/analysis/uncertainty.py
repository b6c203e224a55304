"""What a computed value is uncertain by: the errors of the instruments, taken through the computation itself.

The law of propagation of JCGM 100 (GUM), 5.1.2, with sensitivities found by moving each reading as its instrument
may be wrong and computing again: u² = Σ (f(x + u_i) − f(x − u_i))²/4 + noise. One piece of an instrument is moved in
all captures at once, so that what it does to numerator and denominator, before and after, or to every repeat, is
correlated; pieces are independent of one another. Noise and resolution are drawn anew for every sample.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from math import hypot, isfinite, sqrt
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from bench_protocol.table import TABLE
from bench_protocol.units import Hz
from bench_records.conformity import coverage_factor
from drivers.wiring.contract import Stamp
from test_plans.description import Description
from test_plans.instruments import Instruments, Piece

Samples = npt.NDArray[np.float64]
#: What was captured, by signal: samples at an even rate, or means.
Captured = Mapping[str, Any]
Evaluation = Callable[..., Any]

#: An even distribution of half-width a has the standard deviation a/√3 (JCGM 100, 4.3.7), a step q has q/√12.
EVEN: Final = 1 / sqrt(3.0)
STEP: Final = 1 / sqrt(12.0)
#: So many draws tell the standard deviation of what noise does to 6 %.
NOISE_DRAWS: Final = 128
#: A sample that was lost here and there makes no slower signal.
SAME_RATE: Final = 1.2
#: Parts below this share of the variance are not told.
LEAST_SHARE: Final = 0.01
#: A cause that is no instrument's: what happens between two samples.
SAMPLING: Final = "time between samples"
#: Why a value has no uncertainty, where it needs none.
COUNTED: Final = "it was counted"
YES_OR_NO: Final = "it is yes or no"


@dataclass(frozen=True, slots=True)
class Measured:
    """A value (SI) with its standard uncertainty, and what that is made of: standard uncertainty by cause.

    ``u`` is None where there is none, and ``unknown`` says why: nobody knows how good the readings are, or what is told
    is no measurement (`Exact`).
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
        """The expanded uncertainty U = k u (SI)."""
        if self.u is None:
            return None
        return coverage_factor(self.even / self.u) * self.u if self.u else 0.0

    def beside(self, cause: str, u: float, *, even: bool = False) -> Measured:
        """Return it with another independent part of its uncertainty; unknown stays unknown."""
        if self.u is None:
            return self
        whole = hypot(self.u, u)
        parts = {**self.parts, cause: hypot(self.parts.get(cause, 0.0), u)}
        told = {one: part for one, part in parts.items() if part**2 > LEAST_SHARE * whole**2}
        return replace(self, u=whole, even=max(self.even, u) if even else self.even, parts=told)


@dataclass(frozen=True, slots=True)
class Exact(Measured):
    """A value that is no measurement and has no uncertainty: ``unknown`` says what it is."""


def counted(number: float) -> Exact:
    """Return a number of things that were counted, or a share of such numbers."""
    return Exact(float(number), unknown=COUNTED)


def yes_or_no(so: bool) -> Exact:
    """Return 1 if it is so and 0 if not."""
    return Exact(float(so), unknown=YES_OR_NO)


def timed(value: float, *steps: float) -> Measured:
    """Return a time (s) between two events, of each of which is known only in which of its ``steps`` (s) it was."""
    found = Measured(value, 0.0)
    for step in steps:
        found = found.beside(SAMPLING, 0.5 * EVEN * step, even=True)
    return found


class _Watched(Mapping[str, Any]):
    """Readings that know which of them were used, whichever way they were read."""

    def __init__(self, readings: Captured) -> None:
        self._readings = readings
        self.used: dict[str, None] = {}

    def __getitem__(self, name: str) -> Any:
        self.used[name] = None
        return self._readings[name]

    def __contains__(self, name: object) -> bool:  # who asks whether there is one has not used it
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
    """Return what ``evaluate(*captures)`` gives, a number or several, each with its uncertainty.

    ``captures`` are readings (SI) by signal: samples of shape (n,) at ``rate``, one or by signal, or means over
    ``averaged`` samples, of all or by signal. The `Description` of the rig is one, too: its dimensions are uncertain.
    ``came`` is how often (Hz) a signal came from the rig: what was slower than ``rate`` lies on lines between few
    samples, and so does its noise. ``stamps`` are of the clocks that say when signals came: those that share one are
    late together. Where the instruments ``themselves`` are what is measured, their errors are the value and not its
    uncertainty: what is left is noise and resolution, and what the dimensions may be off by.
    Readings without an instrument leave the value without an uncertainty, except statuses and choices, which have no
    error. A value that is no number has none either, nor one that was computed of none of the readings.
    """
    watched = [_Watched(one) for one in captures]
    best = np.atleast_1d(np.asarray(evaluate(*watched), float))
    asked = dict.fromkeys(name for one in watched for name in one.used)
    used = [name for name in asked if name in TABLE.index and _can_err(name)]
    lacking = [name for name in used if name not in instruments.pieces]
    if lacking or not any(name in TABLE.index for name in asked):
        why = (
            f"no instrument is known for {', '.join(lacking)}" if lacking else "it was computed of no reading"
        )
        return tuple(Measured(float(value), unknown=why) for value in best)
    rates = rate if isinstance(rate, Mapping) else dict.fromkeys(used, rate)
    parts: dict[str, Samples] = {}
    even = np.zeros_like(best)
    ways = () if themselves else _all_ways(used, instruments, rates, stamps or {})
    for key, moves in (*ways, *_dimensions(asked, captures)):
        up, down = (
            np.atleast_1d(np.asarray(evaluate(*_changed(captures, moves, way)), float)) for way in (1.0, -1.0)
        )
        # Half the difference, unless the value turns between both, as a size does near 0.
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
        return Measured(float(best[place]), unknown="the computation has no number beside this one")
    told = sorted(own, key=lambda cause: own[cause], reverse=True)
    largest = {cause: own[cause] for cause in told if own[cause] ** 2 > LEAST_SHARE * u**2}
    return Measured(float(best[place]), u, float(even[place]), largest)


def _can_err(name: str) -> bool:
    return TABLE[name].group is not None


Move = Callable[[Any], Any]


def _all_ways(
    used: Sequence[str], instruments: Instruments, rates: Mapping[str, float], stamps: Mapping[str, Stamp]
) -> Iterator[tuple[str, Mapping[str, Move]]]:
    """Yield each cause with how it moves the signals: a piece one of them, a stamp all that came with it."""
    for name in used:
        for cause, moved in _ways(instruments.pieces[name], rates.get(name, 1.0)):
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
    asked: Iterable[str], captures: Sequence[Captured]
) -> Iterator[tuple[str, Mapping[str, Move]]]:
    """Yield each dimension that was asked for, with how it moves."""
    for rig in captures:
        if not isinstance(rig, Description):
            continue
        for name in asked:
            one = rig.stated(name)
            if one and one.uncertainty:
                yield name.replace("_", " "), {name: partial(_off, one.uncertainty * EVEN)}


def _off(by: float, value: Any) -> Any:
    return by + 0.0 * value


def _late(by: float, rate: float) -> Move:
    """Return what one standard deviation of a time that may be off ``by`` so much (s) does to samples."""
    return lambda values: -by * EVEN * np.gradient(values) * rate if np.size(values) > 1 else 0.0


def _ways(piece: Piece, rate: float) -> Iterator[tuple[str, Move]]:
    """Yield in which ways one piece may be wrong: by one standard deviation each."""
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
    """Return what noise and resolution of single samples do, from draws that are always the same.

    ``apart`` is how many of its places a sample of a signal lies from the next.
    """
    generator = np.random.default_rng(1)
    away = np.zeros_like(best)
    noisy = [[*_noises(one, pieces, averaged, apart)] for one in captures]
    for _ in range(NOISE_DRAWS):
        drawn = [
            {
                **one,
                **{
                    name: values + sigma * _drawn(generator, values.shape, by)
                    for name, values, sigma, by in of
                },
            }
            if of
            else one
            for one, of in zip(captures, noisy, strict=True)
        ]
        away += (np.atleast_1d(np.asarray(evaluate(*drawn), float)) - best) ** 2
    return np.sqrt(away / NOISE_DRAWS)


def _noises(
    readings: Captured,
    pieces: Sequence[Piece],
    averaged: int | Mapping[str, int],
    apart: Mapping[str, float],
) -> Iterator[tuple[str, Samples, float, float]]:
    """Yield each signal of ``readings`` that has noise: values, standard deviation, how far apart its samples are."""
    if isinstance(readings, Description):
        return
    for piece in pieces:
        if piece.signal in readings:
            values = np.asarray(readings[piece.signal], float)
            count = averaged.get(piece.signal, 1) if isinstance(averaged, Mapping) else averaged
            yield piece.signal, values, _sigma(piece, values, count), apart.get(piece.signal, 1.0)


def _drawn(generator: np.random.Generator, shape: tuple[int, ...], apart: float) -> Samples:
    """Return normal numbers; those between two that are further ``apart`` than one place lie on the line between."""
    if not shape or apart < SAME_RATE:
        return generator.standard_normal(shape)
    places = np.arange(shape[0]) / apart
    drawn = generator.standard_normal(int(places[-1]) + 2 if places.size else 0)
    return np.interp(places, np.arange(drawn.size), drawn)


def _sigma(piece: Piece, values: Samples, averaged: int) -> float:
    """Standard deviation of one reading; means are better, but not better than their resolution lets them be."""
    noise, step = piece.instrument.noise, piece.instrument.resolution * STEP
    if values.ndim:
        return sqrt(noise**2 + step**2)
    if 2 * noise >= piece.instrument.resolution:  # so much noise lets means resolve more than a step
        return sqrt((noise**2 + step**2) / averaged)
    return sqrt(noise**2 / averaged + step**2)


def repeated(found: Sequence[Measured]) -> Measured:
    """Return the mean of several measurements of the same thing with the same instruments.

    What the instruments do is common to all and stays; what differs from one to the next is taken from their scatter:
    s/√n, times √((n−1)/(n−3)) for what so few tell of s (JCGM 101, 6.4.9.2). ValueError for less than four.
    """
    n = len(found)
    if n < 4:
        raise ValueError(f"{n} measurements do not tell their scatter; four or more would")
    values = np.array([one.value for one in found])
    scatter = float(values.std(ddof=1) / sqrt(n) * sqrt((n - 1) / (n - 3)))
    lacking = next((one for one in found if one.u is None), None)
    if lacking:
        return Measured(float(values.mean()), unknown=lacking.unknown)
    causes = dict.fromkeys(cause for one in found for cause in one.parts if cause != "noise")
    parts = {cause: float(np.mean([one.parts.get(cause, 0.0) for one in found])) for cause in causes}
    parts["repeats"] = scatter
    even = float(np.mean([one.even for one in found]))
    u = max(sqrt(sum(part**2 for part in parts.values())), even)  # which may be too small a part to be told
    return Measured(float(values.mean()), u, even, parts)
