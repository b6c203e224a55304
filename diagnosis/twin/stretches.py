"""Stretches: the parts of a run in which the model can be judged. A stretch begins at a rest, or at the end of the
stretch before it. It lasts while the air is known and the motion is measured.

The processor time of a look grows with the length of its stretch. So a stretch ends at the first rest after a minute.
If no rest follows, it ends after 90 s, and the next stretch begins in the motion.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final, NamedTuple

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from bench_protocol.signals import Group
from bench_protocol.table_signals import BY_GROUP
from bench_protocol.words import SIDES, BenchState
from bench_records.record import Record
from diagnosis.contracts import Array
from diagnosis.systems.motion import SENSORS, binned, scatter
from diagnosis.systems.records import SettingsOfRecord

#: Step (s) in which a run is processed.
STEP: Final = 0.1
#: Slower than this (m/s, rad/s) over `_STILL` s counts as rest. A stretch begins after a rest of `REST` s.
_SPEED: Final = 0.05e-3
_STILL: Final = 0.5
#: At rest the samples of half a second must also scatter by less than this (m, rad; including noise). Otherwise an
#: oscillation of 2 Hz, whose mean is constant, would count as rest.
_SCATTER: Final = 0.1e-3
REST: Final = 1.0
#: After this length (s), a stretch ends at the next rest, and a new one begins there.
LONG: Final = 60.0
#: After this length (s), a stretch ends even in a motion, and a new one begins there.
LONGEST: Final = 90.0
#: A stretch that begins in a motion is replayed from this many s earlier. By its start, dash-pots and friction no
#: longer depend on the start of the replay.
SETTLES: Final = 5.0
#: If a thermometer of the gas changes faster than this (K/s), the temperature of the walls is unknown.
_WARMING: Final = 2.0
_NEAR: Final = 2.0
#: Longest gap in the samples of a motion that is bridged, in steps before and after it.
_BRIDGED: Final = 1
#: The result at a step depends on samples up to this time (s) before and after it.
_SURE: Final = 5.0
#: Least length (s) of a stretch.
LEAST: Final = 2.0
#: States in which the valves of the chambers follow the settings.
_KNOWN: Final = (BenchState.AIR_HIGH, BenchState.HOLD, BenchState.ACTIVE)

#: Reasons why the model cannot be judged in a part of a run.
AIR: Final = "air valves filled, vented or controlled the springs, and their opening is not measured"
LOST: Final = "the motion was not received"
LEVELING: Final = (
    "a leveling valve was connected; its air flow is unknown, because 0.1 mm at its lever changes it"
)
STATE: Final = "the bench was not under pressure"
MOVING: Final = "the bench was not at rest, so the initial state of the model is unknown"
NOTHING: Final = "no reading was received that the model predicts"
WARM: Final = "the gas temperature was not steady, so the initial state of the model is unknown"


class Stretch(NamedTuple):
    """A part of a run from ``start`` to ``end`` (s). ``why`` states why it cannot be judged; "" if it can. An ``open``
    part may still grow.
    """

    start: float
    end: float
    why: str = ""
    open: bool = False
    moving: bool = False  #: it begins in a motion

    @property
    def judged(self) -> bool:
        """Whether the model can be judged in this part."""
        return not self.why and self.end > self.start

    @property
    def sure(self) -> bool:
        """Whether the part is so long that later samples cannot change its start."""
        return self.end - self.start > _SURE


#: The part of a run before the first sample.
BEGINNING: Final = Stretch(0.0, 0.0)


def stretches(record: Record, *, ended: bool = True, since: Stretch = BEGINNING) -> list[Stretch]:
    """Return the parts of a run in order, from its beginning to the last received sample.

    The last part is open if the run has not ``ended``. ``since`` is a part from an earlier look; it comes first, and
    parts before it are skipped.
    """
    begin = round(since.start / STEP)
    before = max(begin - round(_SURE / STEP), 0)
    grid: Array = STEP * np.arange(before, int(record.duration / STEP + 1e-6), dtype=np.float64)
    begin -= before
    if len(grid) <= begin:
        return []
    why = _reasons_to_skip(record, grid)
    ready = _Ready(record, grid, ended=ended)
    found: list[Stretch] = []
    for first, last in _equal_sequences(why, begin):
        if why[first]:
            found.append(_stretch(grid, first, last, why[first]))
        else:
            continues = first == begin and since.judged
            found += ready.cut(first, last, since if continues else None)
    found[-1] = found[-1]._replace(open=not ended)
    return found


def _stretch(grid: Array, first: int, last: int, why: str = "", *, moving: bool = False) -> Stretch:
    return Stretch(float(grid[first]), float(grid[last - 1]) + STEP, why, moving=moving)


class _Ready:
    """Finds where a stretch can begin: the bench must be at rest, and its gas must have settled."""

    def __init__(self, record: Record, grid: Array, *, ended: bool) -> None:
        self._grid = grid
        self._warm = _warming(record, grid)
        still = resting(record, grid)
        if not ended:  # a motion may follow
            still[-round(_STILL / STEP) :] = False
        self._still = still & ~self._warm

    def cut(self, first: int, last: int, since: Stretch | None = None) -> Iterator[Stretch]:
        """Yield the stretches from grid index ``first`` to ``last``. The first judged one begins at the first rest;
        long ones are cut at later rests.

        ``since`` is the stretch of an earlier call that begins at ``first``, if there is one.
        """
        rest = round(REST / STEP)
        if last - first < rest:
            starts = np.empty(0, np.intp)
        else:
            full = np.convolve(self._still[first:last], np.ones(rest), "valid") > rest - 0.5
            starts = np.flatnonzero(full) + first
        if since is None and not len(starts):
            yield _stretch(self._grid, first, last, self._reason(first, last))
            return
        start, moving = (int(starts[0]), False) if since is None else (first, since.moving)
        if start > first:
            yield _stretch(self._grid, first, start, self._reason(first, start))
        while True:
            longest = start + round(LONGEST / STEP)
            rest = int(np.searchsorted(starts, start + round(LONG / STEP)))
            if rest < len(starts) and starts[rest] <= longest:
                end, ends_moving = int(starts[rest]), False
            elif last - longest >= round((REST + 2.0 * _STILL) / STEP):  # a rest shows when it has lasted
                end, ends_moving = longest, True
            else:
                break
            yield _stretch(self._grid, start, end, moving=moving)
            start, moving = end, ends_moving
        yield _stretch(self._grid, start, last, moving=moving)

    def _reason(self, first: int, last: int) -> str:
        return WARM if self._warm[first:last].mean() > 0.5 else MOVING


def _reasons_to_skip(record: Record, grid: Array) -> list[str]:
    """Return for each step why the model cannot be judged there; "" if it can."""
    settings = SettingsOfRecord(record)
    valves = settings.valves(grid)
    leveled = np.any([valves[f"{side}.leveling"] > 0.0 for side in SIDES], axis=0)
    received = np.ones(len(grid), np.bool_)
    for side in SIDES:
        samples, _ = _sums(record, f"{side}.height", grid)
        received &= _nearby(samples > 0, _BRIDGED)
    pressurised = np.ones(len(grid), np.bool_)
    if "rig.state" in record.signals:
        times, states = record.series("rig.state")
        if len(times):
            state = states[np.clip(np.searchsorted(times, grid, "right") - 1, 0, None)]
            pressurised = np.isin(state, _KNOWN)
    # A sample's stamp may lie a little before the step that it belongs to: one more step on both sides is not known.
    open_air, leveled = _nearby(~settings.air_known(grid), 1), _nearby(leveled, 1)
    return [
        STATE if not p else LOST if not r else AIR if a else LEVELING if v else ""
        for p, r, a, v in zip(pressurised, received, open_air, leveled, strict=True)
    ]


def _samples(record: Record, name: str, grid: Array) -> tuple[Array, Array, Array]:
    """Return the samples of a signal within a grid, without NaN: times (m,), values (m,), and the edges of the grid
    steps.
    """
    edges = np.append(grid, grid[-1] + STEP)
    times, values = record.series(name) if name in record.signals else (np.empty(0), np.empty(0))
    inside = slice(*np.searchsorted(times, edges[[0, -1]]))
    times, values = times[inside], values[inside]
    good = np.isfinite(values)
    return times[good], values[good], edges


def _sums(record: Record, name: str, grid: Array) -> tuple[Array, Array]:
    """Return for each step of the grid (n,) the number of samples of a signal, and their sum."""
    return binned(*_samples(record, name, grid))


def resting(record: Record, grid: Array) -> NDArray[np.bool_]:
    """Return a mask (n,): True where no displacement moves or oscillates within half a second before and after."""
    reach = round(_STILL / STEP)
    still = np.ones(len(grid), np.bool_)
    for name in SENSORS:
        mean = _mean(record, name, grid)
        if mean is None or len(mean) <= reach:
            continue
        # Means over half a second: a slow rig has few samples, and their noise is not motion.
        mean = sliding_window_view(
            np.pad(mean, (reach // 2, reach - 1 - reach // 2), mode="edge"), reach
        ).mean(axis=1)
        moved = np.abs(mean[reach:] - mean[:-reach]) > _SPEED * _STILL
        steps = np.flatnonzero(moved)
        for k in range(reach + 1):
            still[steps + k] = False
        still &= _scatter(record, name, grid, reach) <= _SCATTER
    return still


def _scatter(record: Record, name: str, grid: Array, reach: int) -> Array:
    """Return the standard deviation (n,) of a signal's samples within ``reach`` steps of each step; 0 without
    samples.
    """
    times, values, edges = _samples(record, name, grid)
    values = values - values.mean()
    count, total = binned(times, values, edges)
    return scatter(count, total, binned(times, values**2, edges)[1], reach)


def _warming(record: Record, grid: Array) -> NDArray[np.bool_]:
    """Return a mask (n,): True where the gas is far from thermal equilibrium, and shortly before and after."""
    reach = round(REST / STEP)
    going = np.zeros(len(grid), np.bool_)
    for name in BY_GROUP[Group.TEMPERATURE]:
        mean = _mean(record, name, grid)
        if mean is not None and len(mean) > reach:
            going[:-reach] |= np.abs(mean[reach:] - mean[:-reach]) > _WARMING * REST
    return _nearby(going, round(_NEAR / STEP))  # a temperature that turns is at rest for a moment


def _nearby(flags: NDArray[np.bool_], reach: int) -> NDArray[np.bool_]:
    """Return a mask (n,): True where a flag is set at most ``reach`` steps away."""
    return np.asarray(sliding_window_view(np.pad(flags, reach), 2 * reach + 1).any(axis=1))


def _mean(record: Record, name: str, grid: Array) -> Array | None:
    """Return the mean (n,) of a signal in each step, interpolated in steps without samples; None without any sample."""
    count, total = _sums(record, name, grid)
    seen = count > 0
    return np.interp(grid, grid[seen], total[seen] / count[seen]) if seen.any() else None


def _equal_sequences(words: list[str], first: int) -> Iterator[tuple[int, int]]:
    """Yield start and stop index of each sequence of equal words, from index ``first`` on."""
    for k in range(first + 1, len(words) + 1):
        if k == len(words) or words[k] != words[first]:
            yield first, k
            first = k
