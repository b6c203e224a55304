"""Checks of measured columns before they are used: they find values that look valid but are not measurements.

Each check examines one column over its whole record. `CHECKS` describes findings and consequences, and the reference
page of the checks is generated from it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

from bench_records.tables.reading import Series

if TYPE_CHECKING:
    import numpy.typing as npt

    Numbers = npt.NDArray[np.float64]
    Mask = npt.NDArray[np.bool_]

#: Codes: largest number of different values, largest fraction of the samples, and smallest distance from the other
#: values, in ranges of these.
CODES, CODE_SHARE, FAR = 3, 0.25, 3.0
#: With few other values, as in a constant column, a code is larger than all of them by the factor LARGER. A magnitude
#: above HUGE is always a code.
LARGER, HUGE = 1000.0, 1e30
#: Smallest jumps to and from a code, in usual steps: for a value that recurs, and for one that occurs once.
JUMP, JUMP_ONCE = 10.0, 25.0
#: A step over more than this number of usual sampling intervals is not a jump.
GAP = 3.0
#: Quantile of all steps that is the usual step; number of neighbouring steps that are also compared.
USUAL, AROUND = 0.85, 6
#: Smallest length of equal readings: in usual lengths and in samples. The probability of such a length by chance is
#: below CHANCE.
CONSTANT = 20
CHANCE = 1e-6
#: A column is coarse if it stays constant over samples at more than this fraction of its distinct values.
HELD_LEVELS = 0.05
#: Plateaus at a rail: smallest number of samples, of plateaus, and fraction of all samples; largest fraction of equal
#: neighbours elsewhere.
PLATEAU, PLATEAUS, RAIL_SHARE, SELDOM = 3, 3, 0.003, 0.3
#: Another column moves if its change is at least MOVING times its average change, and ABOVE_NOISE times its noise.
MOVING, ABOVE_NOISE = 0.3, 3.0
#: A column is noisy if its third differences change sign more often than this, and scatter by more than this number of
#: steps. They change sign in 77 of 100 cases for white noise, and hardly ever for a smooth signal; rounding scatters by
#: a third of a step.
TURNS, ABOVE_STEP = 0.6, 0.7
#: A plateau without noise is entered at speed: it lasts this number of times as long as the neighbouring readings.
AT_SPEED = 8
#: A column with fewer steps over the whole range is coarse.
COARSE = 64
#: A column with fewer different values is a switch or constant; held values are then no finding.
LEVELS = 10
#: Shorter columns are not examined.
LEAST = 30


class Check(NamedTuple):
    """One check: its name, what it finds, the consequence for outputs and for inputs of a simulation, and whether the
    finding is uncertain.
    """

    name: str
    finds: str
    output: str
    input: str
    doubt: bool


LEFT_OUT: Final = "this part is not used"
STRAIGHT: Final = f"{LEFT_OUT}, and the simulation uses a straight line there"
KEPT: Final = "the values are kept"
CHECKS: Final = {
    check.name: check
    for check in (
        Check("declared code", "values that `null` of the column names", LEFT_OUT, STRAIGHT, False),
        Check(
            "undeclared code",
            f"up to {CODES} different values in at most {100 * CODE_SHARE:g} % of the samples, at least {FAR:g} times "
            "the range of all others away from these "
            f"(with few others: {LARGER:g} times as large; always beyond {HUGE:g}). Or a value that begins and ends "
            f"with a jump of {JUMP:g} usual steps ({JUMP_ONCE:g} if it comes once)",
            LEFT_OUT,
            STRAIGHT,
            True,
        ),
        Check(
            "saturation",
            "the lowest or highest reading stays exactly constant while other columns move: "
            f"for {CONSTANT} samples, or {PLATEAUS} times for {PLATEAU} samples. The noise of the column disappears",
            LEFT_OUT,
            KEPT,
            True,
        ),
        Check(
            "stuck",
            f"another reading stays exactly constant for {CONSTANT} samples (of a held signal: {CONSTANT} times as "
            "long as usual) while other columns move. The noise of the column disappears, or the constant part ends "
            f"with a jump of {JUMP:g} usual steps",
            LEFT_OUT,
            KEPT,
            True,
        ),
        Check(
            "coarse steps",
            f"fewer than {COARSE} steps over the whole range, larger than the noise",
            f"{KEPT}, but nothing smaller than a step is resolved",
            f"{KEPT}, but nothing smaller than a step is resolved",
            False,
        ),
        Check(
            "missing", "stretches without samples, longer than `time.longest_gap`", LEFT_OUT, STRAIGHT, False
        ),
    )
}


@dataclass(frozen=True)
class Remark:
    """A finding of a check in a column: ``count`` of ``samples`` values have it, and ``first`` is the place of the
    first one in the file.
    """

    file: str
    column: str
    check: str
    count: int
    samples: int
    first: str
    found: str
    consequence: str
    doubt: bool

    def sentence(self) -> str:
        """Return the remark as a sentence."""
        return (
            f"{self.file}, {self.column} ({self.check}, {self.count} of {self.samples} samples, first at "
            f"{self.first}): {self.found}; {self.consequence}"
        )


#: Declared codes by column; an empty list means no codes, None means not declared.
Nulls = Mapping[str, Sequence[float] | None]


def examine(
    file: str, columns: Mapping[str, Series], nulls: Nulls, inputs: Sequence[str] = ()
) -> tuple[dict[str, Series], list[Remark]]:
    """Replace values that are not measurements by NaN. Return the columns of a file, and remarks on these values.

    ``inputs`` are columns that drive a simulation. In these columns, readings at a limit or stuck by a sensor fault are
    kept.
    """
    found, remarks = without_codes(file, columns, nulls, inputs)
    signals = {name: _Signal.of(one) for name, one in found.items()}
    for name, signal in signals.items():
        if signal is None:
            continue
        others = [one for key, one in signals.items() if key != name and one is not None]
        rail, stuck = (signal.in_column(mask) for mask in _held(signal, others, name not in inputs))
        for check, mask in (("saturation", rail), ("stuck", stuck)):
            held = _values(found[name].values[mask])
            what = f"the readings are exactly {held} while other columns move"
            _apply(found, remarks, file, name, check, mask, what, inputs)
        if signal.steps < COARSE and not signal.noisy and len(signal.levels) > CODES + 1:
            what = f"it is read in steps of {signal.step:.3g}, {signal.steps} in all"
            _apply(found, remarks, file, name, "coarse steps", signal.in_column(), what, inputs)
    return found, remarks


def without_codes(
    file: str, columns: Mapping[str, Series], nulls: Nulls, inputs: Sequence[str] = ()
) -> tuple[dict[str, Series], list[Remark]]:
    """Replace codes for missing values by NaN. Return the columns of a file, and remarks.

    Declared codes are those of ``nulls``. Undeclared codes are found from the values, except in columns whose list in
    ``nulls`` is empty. ``inputs`` are the columns that drive a simulation; only their remarks differ.
    """
    found, remarks = dict(columns), list[Remark]()
    for name, series in columns.items():
        declared = nulls.get(name)
        mask = _is_one_of(series.values, declared or ())
        what = f"{_values(series.values[mask])} is no measurement"
        _apply(found, remarks, file, name, "declared code", mask, what, inputs)
        if declared is not None and not declared:
            continue
        mask = _codes_in(found[name])
        codes = _values(found[name].values[mask])
        what = f"{codes} may be codes for missing values (add null = [{codes}] to the column, or null = [] if measured)"
        _apply(found, remarks, file, name, "undeclared code", mask, what, inputs)
    return found, remarks


def measured(series: Series) -> Series:
    """Return a series without its missing values."""
    known = np.isfinite(series.values)
    return series._replace(times=series.times[known], values=series.values[known], rows=None)


def _apply(
    found: dict[str, Series],
    remarks: list[Remark],
    file: str,
    name: str,
    check: str,
    mask: Mask,
    what: str,
    inputs: Sequence[str],
) -> None:
    """If ``mask`` selects samples, add a remark of the check. Replace the samples by NaN if this is the consequence of
    the check.
    """
    series, one = found[name], CHECKS[check]
    if not mask.any():
        return
    consequence = one.input if name in inputs else one.output
    samples, at = int(np.isfinite(series.values).sum()), series.at(int(np.argmax(mask)))
    remarks.append(Remark(file, name, check, int(mask.sum()), samples, at, what, consequence, one.doubt))
    if consequence.startswith(LEFT_OUT):
        found[name] = series._replace(values=np.where(mask, np.nan, series.values))


def _values(values: Numbers) -> str:
    known = np.unique(values)
    return ", ".join(f"{one:.9g}" for one in known[:CODES]) + (", …" if len(known) > CODES else "")


def _is_one_of(values: Numbers, codes: Sequence[float]) -> Mask:
    """Return a mask of the values that equal one of the ``codes`` within single precision."""
    mask = np.zeros(len(values), np.bool_)
    for code in codes:
        mask |= np.isclose(values, code, rtol=1e-6, atol=0.0)
    return mask


def _codes_in(series: Series) -> Mask:
    """Return a mask of the values that are far from all others, or that begin and end with a jump."""
    known = np.isfinite(series.values)
    values, times = series.values[known], series.times[known]
    mask = abs(values) > HUGE
    for check in (_far, _jumps):
        rest = np.flatnonzero(~mask)
        if len(rest) >= LEAST:
            mask[rest] = check(values[rest], times[rest])
    known[known] = mask
    return known


def _far(values: Numbers, _times: Numbers) -> Mask:
    levels, counts = np.unique(values, return_counts=True)
    mask = np.zeros(len(values), np.bool_)
    for low, high in sorted(np.ndindex(CODES + 1, CODES + 1), key=sum):
        bulk = levels[low : len(levels) - high]
        if not low + high or not len(bulk):
            continue
        reach = FAR * (bulk[-1] - bulk[0])
        if len(bulk) <= CODES + 1:
            reach = LARGER * abs(bulk).max() or np.inf
        below = low == 0 or bulk[0] - levels[low - 1] > reach
        above = high == 0 or levels[len(levels) - high] - bulk[-1] > reach
        outside = int(counts[:low].sum() + counts[len(levels) - high :].sum())
        if below and above and outside <= CODE_SHARE * len(values):
            mask = (values < bulk[0]) | (values > bulk[-1])
    return mask


def _jumps(values: Numbers, times: Numbers) -> Mask:
    starts = np.flatnonzero(np.diff(values, prepend=np.nan) != 0.0)
    levels = values[starts]
    mask = np.zeros(len(values), np.bool_)
    if len(levels) < LEAST:
        return mask
    steps = np.diff(levels)
    # A step over a gap in time may have any size.
    gaps = np.diff(times)[starts[1:] - 1] > GAP * np.median(np.diff(times))
    before, after = np.where(gaps, 0.0, steps)[:-1], np.where(gaps, 0.0, steps)[1:]
    heights = np.where(before * after < 0.0, np.minimum(abs(before), abs(after)), 0.0)
    usual = float(np.quantile(abs(steps), USUAL))
    lengths = np.diff(np.append(starts, len(values)))
    places: dict[float, list[int]] = {}
    for k in np.flatnonzero(heights > JUMP * usual):
        around = np.concatenate((steps[max(k - AROUND, 0) : k], steps[k + 2 : k + 2 + AROUND]))
        if heights[k] > JUMP * np.median(abs(around)):
            places.setdefault(float(levels[k + 1]), []).append(int(k) + 1)
    for level, runs in places.items():
        at = np.flatnonzero(levels == level)
        # A value that is reached and left without a jump as often is a measurement there.
        smooth = sum(
            0 < run < len(steps) and abs(steps[run - 1 : run + 1]).max() <= JUMP * usual for run in at
        )
        codes = at if len(runs) > smooth else np.array(runs)
        if lengths[codes].sum() < 2 and not heights[runs[0] - 1] > JUMP_ONCE * usual:
            continue
        for run in codes:
            mask[starts[run] : starts[run] + lengths[run]] = True
    return mask


@dataclass(frozen=True)
class _Signal:
    """A column without missing values, with its noise and the size of its steps."""

    rows: npt.NDArray[np.intp]  #: of the samples in the column
    times: Numbers
    values: Numbers
    levels: Numbers  #: the different values, in order
    step: float  #: between the nearest two of them
    noise: float
    noisy: bool  #: its noise moves it from step to step
    size: int  #: of the column

    @staticmethod
    def of(series: Series) -> _Signal | None:
        rows = np.flatnonzero(np.isfinite(series.values))
        values = series.values[rows]
        levels = np.unique(values)
        if len(values) < LEAST or len(levels) < 2:
            return None
        gaps = np.diff(levels)
        step = float(gaps[gaps > 1e-9 * (levels[-1] - levels[0])].min())
        third = np.diff(values, 3)
        third = third[third != 0.0]
        noise = 1.4826 * float(np.median(abs(third))) / 20**0.5 if len(third) else 0.0
        turns = float(np.mean(third[1:] * third[:-1] < 0.0)) if len(third) > LEAST else 0.0
        noisy = turns > TURNS and noise > ABOVE_STEP * step
        return _Signal(rows, series.times[rows], values, levels, step, noise, noisy, len(series.values))

    def in_column(self, mask: Mask | None = None) -> Mask:
        """Return the mask for all rows of the column. Without ``mask``, it selects all known samples."""
        whole = np.zeros(int(self.size), np.bool_)
        whole[self.rows if mask is None else self.rows[mask]] = True
        return whole

    @property
    def steps(self) -> int:
        """Return the range of the values as a number of steps."""
        return round((self.levels[-1] - self.levels[0]) / self.step)

    def runs(self) -> tuple[npt.NDArray[np.intp], npt.NDArray[np.intp]]:
        """Return the first index, and the index after the last one, of each series of equal values."""
        starts = np.flatnonzero(np.diff(self.values, prepend=np.nan) != 0.0)
        return starts, np.append(starts[1:], len(self.values))

    def moves(self, spans: Sequence[tuple[float, float]]) -> bool:
        """Return whether the signal changes in these time spans as much as elsewhere."""
        lasts = 0.25 * float(np.mean([end - start for start, end in spans]))
        usual = self._moved(np.linspace(self.times[0], self.times[-1] - lasts, 500), lasts)
        if not lasts > 0.0 or usual <= ABOVE_NOISE * self.noise:
            return False
        quarters = [np.linspace(start, end - lasts, 4) for start, end in spans]
        return self._moved(np.concatenate(quarters), lasts) > MOVING * usual

    def _moved(self, times: Numbers, lasts: float) -> float:
        first, last = (np.interp(one, self.times, self.values) for one in (times, times + lasts))
        return float(np.mean(abs(last - first)))


def _held(signal: _Signal, others: Sequence[_Signal], output: bool) -> tuple[Mask, Mask]:
    """Return two masks (n,) of readings that stay constant while other columns move: at the lowest or highest value,
    and at other values.
    """
    rail, stuck = np.zeros((2, len(signal.values)), np.bool_)
    if len(signal.levels) < LEVELS:
        return rail, stuck
    starts, ends = signal.runs()
    lengths, held = ends - starts, signal.values[starts]
    long = lengths >= CONSTANT * max(float(np.median(lengths)), 1.0)
    # The probability of equal readings by chance is estimated from the equal neighbours elsewhere.
    equal = 1.0 - float((~long).sum()) / max(float(lengths[~long].sum()), 1.0)
    if long.any():
        long &= lengths * np.log(max(equal, 1e-3)) < np.log(CHANCE / len(signal.values))
    if len(np.unique(held[long])) > max(CODES, HELD_LEVELS * len(signal.levels)):
        long[:] = False  # held at many values: it is rounded more coarsely than it moves
    neighbours = np.maximum(np.append(lengths[1:], 1), np.append(1, lengths[:-1]))
    extremes = (signal.levels[0], signal.levels[-1])

    def moving(chosen: Mask, all_of: bool = False) -> bool:
        spans = [
            (float(signal.times[a]), float(signal.times[b - 1]))
            for a, b in zip(starts[chosen], ends[chosen], strict=True)
        ]
        moved = [one.moves(spans) for one in others]
        return bool(spans) and bool(moved) and (all(moved) if all_of else any(moved))

    for extreme in extremes:
        at = held == extreme
        if signal.noisy:
            flat = at & (lengths >= PLATEAU)
            often = (
                equal < SELDOM
                and flat.sum() >= PLATEAUS
                and lengths[flat].sum() >= max(RAIL_SHARE * len(signal.values), PLATEAU * PLATEAUS)
            )
            clipped = (often or (at & long).any()) and moving(flat)
        else:
            # Without noise a plateau of the motion itself looks the same, but then not all other columns move.
            flat = at & long & (lengths >= AT_SPEED * neighbours)
            clipped = output and flat.sum() >= 2 and len(others) > 1 and moving(flat, all_of=True)
        if clipped:
            rail |= signal.values == extreme
    usual = float(np.quantile(abs(np.diff(held)), USUAL))
    for run in np.flatnonzero(
        long & ~np.isin(held, [one for one in extremes if rail[signal.values == one].any()])
    ):
        alone = np.arange(len(held)) == run
        jumps = [abs(held[k + 1] - held[k]) for k in (run - 1, run) if 0 <= k < len(held) - 1]
        torn = max(jumps, default=0.0) > JUMP * usual
        if (signal.noisy or torn) and moving(alone):
            stuck[starts[run] : ends[run]] = True
    return rail, stuck
