"""Signs of a wrong map, reported before any conclusion from it.

Theory of operation
-------------------
A wrong sign, or a gauge pressure read as absolute, is an error that no candidate describes and that some imitate. Four
signs show it without a fit:

* A column without a number in one of the files.
* A pressure below the ambient pressure.
* *Loop work.* A passive body absorbs work over a closed path, ∮ F dx ≥ 0. With the wrong sign of F or x it delivers
  work in every cycle.
* *Another reading fits far better.* Even an incomplete base model at nominal values predicts the level and the
  direction of an output. Files are read again with one sign reversed, or with a pressure as gauge instead of absolute.
  A change is reported if it removes three quarters of the power of the error of an output; the error without its mean
  is used too if the model with the present map is worse than a constant. Of several changes the one that helps all
  outputs most is reported, and the search continues with it; no column is reported twice. The sign of an input at rest
  is not tested, because its reversal only changes the zero.

A doubt does not stop the diagnosis. It is reported with the finding.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from math import comb
from typing import Final, NamedTuple

import msgspec
import numpy as np
from numpy.typing import NDArray

from diagnosis.contracts import Array, Dataset, DiagnosisError, Job, MeasuredRun, Simulator
from diagnosis.engine.config import STILL_SHARE
from diagnosis.engine.simulation import simulate
from diagnosis.systems.cutting import pieces_by_reversals
from diagnosis.systems.map_file import Column, Map
from diagnosis.systems.system import System

#: Number of runs that are simulated with other readings of the columns.
_RUNS: Final = 3
#: Another reading is better if at most this part of the power of an error remains.
_BETTER: Final = 0.25
#: A pressure is doubtful if it is below the ambient pressure by this part of it, in more than one sample of a hundred.
_BELOW: Final = 0.05
#: A loop must cover at least this part of the whole travel in both directions.
_LOOP: Final = 0.2
#: Smallest number of loops, and the part of them that must deliver work.
_LOOPS, _GIVING = 3, 0.8
#: Relative differences of a displacement below this are rounding errors.
_ROUNDING: Final = 1e-9
#: Loops that deliver work are not due to chance if the probability of so many is below this.
_CHANCE: Final = 1e-3
#: A few loops deliver similar work if their scatter is below this part of the mean.
_ALIKE: Final = 0.2
#: Largest number of mistakes that are searched for one after the other.
_MISTAKES: Final = 3
#: Quantities whose sign depends on how the sensor was mounted.
_SIGNED: Final = ("N", "m", "rad", "m/s2")

#: (columns by signal, names of records) -> the runs of these records, as the columns read them.
ReadRuns = Callable[[Mapping[str, Column], Sequence[str]], Sequence[MeasuredRun]]


def map_doubts(
    mapping: Map, system: System, simulator: Simulator, dataset: Dataset, ambient: float, read: ReadRuns
) -> Iterator[str]:
    """Yield sentences on probable errors of a map, with the doubtful key.

    ``dataset`` are the mapped files, ``ambient`` the ambient pressure in Pa.
    """
    channels, runs = [channel.name for channel in dataset.channels], dataset.runs
    yield from _empty_columns(runs, channels)
    yield from _below_ambient(runs, system, channels, ambient)
    yield from _loop_work(runs, system, channels)
    few = [runs[i] for i in sorted({round(i) for i in np.linspace(0, len(runs) - 1, _RUNS)})]
    names = {run.experiment.name for run in few}
    records = list(dict.fromkeys(run.experiment.record for run in few))

    def errors(columns: Mapping[str, Column]) -> _Errors | None:
        """Return the errors of the nominal model if the files are read with ``columns``; None if no run can then be
        simulated.
        """
        try:
            found = read(columns, records)
            return _errors([run for run in found if run.experiment.name in names], simulator, channels)
        except DiagnosisError:
            return None

    columns, now = dict(mapping.columns), _errors(few, simulator, channels)
    settled = {one.name for one in system.inputs if one.unit in _SIGNED and _stands_still(few, one.name)}
    for _ in range(_MISTAKES):
        groups = [group for group in _groups(system, columns) if settled.isdisjoint(group)]
        readings = [(group, other) for group in groups if (other := errors(columns | group))]
        doubted = [(group, other) for group, other in readings if _clearly_nearer(now, other).any()]
        if not doubted:
            return
        group, other = min(doubted, key=lambda pair: float(np.nansum(np.log(pair[1].whole / now.whole))))
        yield _doubt(columns, group, now, other, channels)
        columns, now, settled = columns | group, other, settled | group.keys()


def nearer_unit(
    columns: Mapping[str, Column],
    name: str,
    stated: str,
    simulator: Simulator,
    dataset: Dataset,
    read: ReadRuns,
) -> str | None:
    """Return the unit of a column with which the nominal simulation is much nearer to the data: that of the map, or
    ``stated``.

    None if neither is much better, or if the simulation fails with one of them.
    """
    channels = [channel.name for channel in dataset.channels]
    other_columns = dict(columns) | {name: msgspec.structs.replace(columns[name], unit=stated)}
    try:
        runs = [read(one, [dataset.runs[0].experiment.record]) for one in (columns, other_columns)]
        own, other = (_errors(one, simulator, channels) for one in runs)
    except DiagnosisError:
        return None
    own_nearer, other_nearer = _clearly_nearer(other, own).any(), _clearly_nearer(own, other).any()
    if own_nearer == other_nearer:
        return None
    return columns[name].unit if own_nearer else stated


def _clearly_nearer(now: _Errors, other: _Errors) -> NDArray[np.bool_]:
    """Return a mask (c,): True for channels whose errors with the other reading are so much smaller that the present
    one is doubtful.
    """
    astray = (now.varied > 1.0) & (other.varied < _BETTER * now.varied)
    return astray | (other.whole < _BETTER * now.whole)


def _doubt(
    columns: Mapping[str, Column],
    group: Mapping[str, Column],
    now: _Errors,
    other: _Errors,
    channels: Sequence[str],
) -> str:
    name, changed = next(iter(group.items()))
    key = "sign" if changed.reading == columns[name].reading else "reading"
    keys = " and ".join(f"columns.{name}.{key}" for name in group)
    shares = np.where(_clearly_nearer(now, other), np.sqrt(other.whole / now.whole), np.inf)
    c = int(np.argmin(shares))
    text = [f'"{one.reading}"' if key == "reading" else f"{one.sign}" for one in (columns[name], changed)]
    return (
        f"{keys} = {text[0]} may be wrong: with {text[1]} the error of the simulation in "
        f"{channels[c]} would be {shares[c]:.2g} times the present one"
    )


def _empty_columns(runs: Sequence[MeasuredRun], channels: Sequence[str]) -> Iterator[str]:
    for c, name in enumerate(channels):
        empty = dict.fromkeys(
            run.experiment.record for run in runs if not np.isfinite(run.outputs[:, c]).any()
        )
        if empty:
            yield f"columns.{name} has no number in {', '.join(empty)}: the simulation is not compared with it there"


def _below_ambient(
    runs: Sequence[MeasuredRun], system: System, channels: Sequence[str], ambient: float
) -> Iterator[str]:
    for name, signal in system.signals.items():
        if signal.unit != "Pa":
            continue
        values = [_measured(run, name, channels) for run in runs]
        known = np.concatenate([one[np.isfinite(one)] for one in values if one is not None] or [np.empty(0)])
        if not known.size:
            continue
        lowest = float(np.quantile(known, 0.01)) + (0.0 if signal.gauge else -ambient)
        if lowest < -_BELOW * ambient:
            yield (
                f"columns.{name}.reading may be wrong: its lowest pressure lies {-lowest / 1e5:.3g} bar below the "
                f"ambient pressure, {ambient / 1e5:.4g} bar"
            )


def _loop_work(runs: Sequence[MeasuredRun], system: System, channels: Sequence[str]) -> Iterator[str]:
    for force, way in system.passive:
        loops: list[float] = []
        for run in runs:
            f, x = _measured(run, force, channels), _measured(run, way, channels)
            if f is not None and x is not None:
                loops += _loops(f[run.scored], x[run.scored])
        if len(loops) >= _LOOPS and np.mean(np.array(loops) < 0.0) >= _GIVING and _surely_negative(loops):
            yield (
                f"columns.{force}.sign or columns.{way}.sign may be wrong: a loop delivers {-np.mean(loops):.3g} J of "
                "work on average, but a passive system can only absorb work"
            )


def _loops(force: Array, way: Array) -> list[float]:
    """Return the work (J) of each pair of strokes, there and back; the loop is closed by a straight line."""
    known = np.isfinite(force)
    force, way = force[known], way[known]
    if len(way) < 2 or not np.ptp(way) > _ROUNDING * float(np.abs(way).max()):
        return []
    pieces = pieces_by_reversals(way, _LOOP * float(np.ptp(way)), 2) or [(0, len(way))]
    works = []
    for start, stop in pieces:
        f, x = np.append(force[start:stop], force[start]), np.append(way[start:stop], way[start])
        works.append(float(np.sum(0.5 * (f[1:] + f[:-1]) * np.diff(x))))
    return works


def _surely_negative(works: Sequence[float]) -> bool:
    """Return whether the works are negative not only by chance: significantly many are negative, or their mean is
    negative and all have a similar size.

    Loops from the noise of a column at rest have both signs.
    """
    values, count = np.array(works), len(works)
    negative = int(np.sum(values < 0.0))
    by_chance = sum(comb(count, k) for k in range(negative, count + 1)) / 2**count
    return by_chance < _CHANCE or bool(np.std(values) < _ALIKE * -np.mean(values))


def _stands_still(runs: Sequence[MeasuredRun], name: str) -> bool:
    """Return whether an input hardly moves in any run, relative to its size, so that its sign only changes its zero."""
    found = [
        values[np.isfinite(values)] for run in runs if (values := run.experiment.inputs.get(name)) is not None
    ]
    return bool(found) and all(np.ptp(one) <= STILL_SHARE * np.abs(one).max() for one in found if one.size)


def _measured(run: MeasuredRun, name: str, channels: Sequence[str]) -> Array | None:
    if name in channels:
        return run.outputs[:, list(channels).index(name)]
    return run.experiment.inputs.get(name)


class _Errors(NamedTuple):
    """Powers (c,) of the errors of the nominal model."""

    varied: Array  #: without their mean in each run, over the power of the signal
    whole: Array  #: in the unit of the channel, squared


def _errors(runs: Sequence[MeasuredRun], simulator: Simulator, channels: Sequence[str]) -> _Errors:
    nominal = {nuisance.name: nuisance.nominal for nuisance in simulator.nuisances}
    places = [[channel.name for channel in simulator.channels].index(name) for name in channels]
    powers = np.zeros((3, len(channels)))
    with np.errstate(all="ignore"):
        for run in runs:
            outputs = simulate(simulator, Job(run.experiment, nominal, {}))[:, places]
            for c, known in enumerate(run.counted.T):
                if known.any():
                    seen = run.outputs[known, c]
                    error = seen - outputs[known, c]
                    powers[:, c] += np.var(error), np.var(seen), np.mean(error**2)
        return _Errors(powers[0] / powers[1], powers[2])


def _groups(system: System, columns: Mapping[str, Column]) -> Iterator[dict[str, Column]]:
    """Yield changed columns to test: each column alone, all inputs or all outputs of one quantity, and both
    together.
    """
    groups: dict[tuple[str, ...], None] = {}
    for signals in (system.inputs, system.outputs, (*system.inputs, *system.outputs)):
        mapped = [one for one in signals if one.name in columns]
        for unit in (unit for unit in ("Pa", *_SIGNED) if any(one.unit == unit for one in mapped)):
            names = [one.name for one in mapped if one.unit == unit]
            groups |= dict.fromkeys([tuple(names), *((name,) for name in names)])
    for group in groups:
        pressure = columns[group[0]].reading is not None
        yield {name: (_swapped if pressure else _turned)(columns[name]) for name in group}


def _turned(column: Column) -> Column:
    return msgspec.structs.replace(column, sign=-1 if column.sign == 1 else 1)


def _swapped(column: Column) -> Column:
    return msgspec.structs.replace(column, reading="absolute" if column.reading == "gauge" else "gauge")
