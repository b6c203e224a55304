"""Reads a user's own files as a dataset for a diagnosis: cuts, resamples and converts them to SI by a map file."""

from __future__ import annotations

import fnmatch
import hashlib
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Final

import numpy as np

from bench_protocol.account import Account
from bench_protocol.unit_names import UnknownUnit
from bench_protocol.units import Unit
from bench_records.tables.keys import Source
from bench_records.tables.quality import CHECKS, LEFT_OUT, Remark, examine
from bench_records.tables.reading import Series
from diagnosis.contracts import (
    Array,
    Channel,
    DataQuality,
    Dataset,
    DiagnosisError,
    Experiment,
    MeasuredRun,
    Role,
    Simulator,
)
from diagnosis.engine.contract_check import check_contract
from diagnosis.systems.cutting import (
    bridge,
    gaps_in,
    pieces_by_length,
    pieces_by_reversals,
    resample,
    resample_held,
)
from diagnosis.systems.map_doubts import map_doubts, nearer_unit
from diagnosis.systems.map_file import (
    Column,
    FrameKeys,
    Map,
    RoleRule,
    channels_of,
    held_inputs,
    plain_map,
    read_columns,
    read_map,
    settings_of,
)
from diagnosis.systems.system import (
    Errors,
    System,
    SystemSignal,
    conversion,
    difference,
    quantity,
    unit_of,
)

#: Reads the columns of a log of CAN frames, with its keys in a folder; None for any other file.
FrameReader = Callable[[Path, FrameKeys, Path, Mapping[str, Source], Account], dict[str, Series] | None]
#: Reference of gauge pressures if the system has no setting for it.
_STANDARD_ATMOSPHERE: Final = 101_325.0


def read_mapped(
    paths: Sequence[Path],
    map_path: Path | None,
    own: str | None = None,
    frames: FrameReader | None = None,
) -> tuple[Simulator, Dataset]:
    """Return the simulator and the runs in ``paths``, in SI on an equidistant grid.

    The simulator is named in the map, or by ``own`` as "package.module:factory". Without a map, the columns have the
    names of the simulator's signals. A user's own simulator is checked against its contract on the shortest run.
    Outputs that were not measured are no channels of the dataset. In a gap outputs are NaN and inputs are interpolated.
    ``frames`` reads logs of CAN frames. Raises DiagnosisError with the file, the key, the value with its unit, and the
    correct form.
    """
    if not paths:
        raise DiagnosisError(f"{map_path or own}: there are no data files; name at least one")
    where = map_path or paths[0]
    if map_path is not None:
        mapping, system = read_map(map_path, own)
    elif own is not None:
        mapping, system = plain_map(paths[0], own)
    else:
        raise DiagnosisError(
            f"{where}: neither a map nor a simulator states the meaning of its columns; give --map FILE"
        )
    errors = Errors(system.errors.values())
    given = channels_of(mapping, system, where, errors)
    settings: dict[str, float] = {}
    with errors.noted():
        settings = settings_of(mapping, system, where)
    errors.report()
    simulator = system.simulator(settings, given)
    accounts = {path: Account() for path in paths}
    held = held_inputs(mapping, system)
    reader = _Reader(mapping, system, _described(simulator, given, where), where, accounts, held)

    tables = [(path, reader.table(path, frames)) for path in paths]

    def read(columns: Mapping[str, Column], records: Sequence[str]) -> list[MeasuredRun]:
        wanted = [(path, table) for path, table in tables if path.stem in records]
        return [run for path, table in wanted for run in reader.runs(path, table, columns)]

    runs = tuple(read(mapping.columns, [path.stem for path in paths]))
    _refuse_empty(runs, reader.channels, where)
    simulator = system.sized(simulator, runs)
    if own is not None or mapping.simulator is not None:
        check_contract(simulator, min(runs, key=lambda run: len(run.outputs)).experiment)
    dataset = Dataset(
        reader.channels, runs, _digest(map_path, paths, system), tuple(str(path) for path in paths)
    )
    _settle_units(reader, mapping.columns, simulator, dataset, read)
    remarks = [*reader.remarks, *_not_left_out(reader.missing.values(), reader.remarks)]
    doubts = [
        *(one.sentence() for one in remarks if one.doubt),
        *map_doubts(mapping, system, simulator, dataset, reader.ambient(None), read),
        *system.doubts(simulator, runs),
    ]
    readings = tuple(f"{path.name}: {line}" for path, one in accounts.items() for line in one.lines())
    quality = tuple(DataQuality(**asdict(one)) for one in remarks)
    return simulator, replace(dataset, doubts=tuple(doubts), readings=readings, quality=quality)


def _digest(map_path: Path | None, paths: Sequence[Path], system: System) -> str:
    digest = hashlib.sha256(map_path.read_bytes() if map_path is not None else b"")
    for path in (*paths, *system.sources):
        digest.update(path.read_bytes())
    return digest.hexdigest()


def _not_left_out(missing: Iterable[Remark], remarks: Sequence[Remark]) -> list[Remark]:
    """Return the remarks on gaps. A remark on the gaps of an output is omitted if samples of its column were skipped,
    because another remark states this already.
    """
    left = {(one.file, one.column) for one in remarks if one.consequence.startswith(LEFT_OUT)}
    return [one for one in missing if one.consequence != LEFT_OUT or (one.file, one.column) not in left]


def _settle_units(
    reader: _Reader,
    columns: Mapping[str, Column],
    simulator: Simulator,
    dataset: Dataset,
    read: Callable[[Mapping[str, Column], Sequence[str]], Sequence[MeasuredRun]],
) -> None:
    """Decide on units for which map and column header disagree. Use the map's unit if the simulation is much nearer
    with it; otherwise raise DiagnosisError.
    """
    for name, (path, stated) in list(reader.contradicted.items()):
        unit = columns[name].unit
        if nearer_unit(columns, name, stated, simulator, dataset, read) == unit:
            reader.accounts[path].take(
                f"{name} is read in {unit}, as the map says, not in {stated} as the head of its column says: the "
                f"simulation is much nearer to it in {unit}"
            )
            continue
        raise DiagnosisError(
            f'{reader.where}: columns.{name}.unit = "{unit}", but by the head in {path}, "{columns[name].column}" is '
            f'in {stated}; give unit = "{stated}", or ignore_head_unit = true if the head is wrong'
        )


def _refuse_empty(runs: Sequence[MeasuredRun], channels: Sequence[Channel], where: Path) -> None:
    for c, channel in enumerate(channels):
        if not any(np.isfinite(run.outputs[:, c]).any() for run in runs):
            raise DiagnosisError(
                f"{where}: columns.{channel.name} holds no number in any run; omit it, or check its column, "
                "time.longest_gap and file.decimal"
            )


def _described(simulator: Simulator, given: Sequence[Channel], where: Path) -> tuple[Channel, ...]:
    """Return the measured channels of the simulator, with noise and resolution from the map where it states them."""
    known = {channel.name: channel for channel in simulator.channels}
    for channel in given:
        if channel.name not in known:
            raise DiagnosisError(
                f"{where}: {channel.name} is an output of {simulator.name}, but not one of its channels, which are "
                + ", ".join(known)
            )
    return tuple(
        replace(
            known[channel.name],
            noise=channel.noise or known[channel.name].noise,
            resolution=channel.resolution or known[channel.name].resolution,
        )
        for channel in given
    )


@dataclass(frozen=True, slots=True)
class _Reader:
    """Makes runs from the table of a file, by a map. Its methods accept columns that differ from those of the map."""

    mapping: Map
    system: System
    channels: tuple[Channel, ...]
    where: Path
    accounts: Mapping[Path, Account]
    held: frozenset[str]
    #: By column, in which file another known unit stands than the map gives, and that unit.
    contradicted: dict[str, tuple[Path, str]] = field(default_factory=dict)
    missing: dict[tuple[Path, str], Remark] = field(default_factory=dict)
    remarks: list[Remark] = field(default_factory=list)

    def table(self, path: Path, frames: FrameReader | None) -> dict[str, Series]:
        """Return the columns of a file without samples that fail data checks. The failures are added to the remarks."""
        mapping, account = self.mapping, self.accounts[path]
        found = None
        if frames is not None and mapping.file.format is None:
            found = frames(path, mapping.frames, self.where.parent, mapping.columns, account)
        if found is None:
            found = read_columns(path, mapping.file, mapping.time, mapping.columns, account)
        nulls = {name: column.codes for name, column in mapping.columns.items()}
        clean, remarks = examine(path.name, found, nulls, [one.name for one in self.system.inputs])
        self.remarks.extend(remarks)
        return clean

    def ambient(self, path: Path | None) -> float:
        """Return the ambient pressure in Pa, for one file or for all."""
        settings = settings_of(self.mapping, self.system, self.where, path)
        return settings.get("ambient_pressure", _STANDARD_ATMOSPHERE)

    def runs(
        self, path: Path, table: Mapping[str, Series], columns: Mapping[str, Column]
    ) -> list[MeasuredRun]:
        mapping, system, where = self.mapping, self.system, self.where
        grid, values = self._on_grid(path, table, columns)
        step = float(grid[1] - grid[0])
        driven = {one.name: bridge(values[one.name]) for one in system.inputs if one.name in values}
        measured = driven | {channel.name: values[channel.name] for channel in self.channels}
        inputs = system.prepare(step, grid - grid[0], measured)
        rest = system.rest(step, grid - grid[0], measured)
        outputs = np.column_stack([values[channel.name] for channel in self.channels])
        settings = settings_of(mapping, system, where, path)
        lead = _lead(mapping, system, where, step)
        runs = []
        for number, (start, stop) in enumerate(_pieces(mapping, system, driven, len(grid), step, where), 1):
            if number <= mapping.runs.skip:
                continue
            first = 0 if lead is None else max(start - lead, 0)
            part = slice(first, stop)
            scored = np.arange(first, stop) >= start
            experiment = Experiment(
                name=path.stem if mapping.runs.cut == "file" else f"{path.stem} {number}",
                time=grid[part] - grid[first],
                inputs={name: array[part] for name, array in inputs.items()},
                settings={**settings, **system.begin({name: one[part] for name, one in measured.items()})},
                minutes=(stop - first) * step / 60.0,
                source=path.stem,
                held=self.held,
            )
            role = _role(path, number, mapping.runs.role, where)
            runs.append(MeasuredRun(experiment, outputs[part], scored, rest[part] & scored, role))
        if not runs:
            raise DiagnosisError(
                f"{path}: no run was found in {grid[-1] - grid[0]:.3g} s; check runs.cut, runs.reversal, runs.length "
                f"and runs.skip = {mapping.runs.skip} in {where}"
            )
        return runs

    def _on_grid(
        self, path: Path, table: Mapping[str, Series], columns: Mapping[str, Column]
    ) -> tuple[Array, dict[str, Array]]:
        """Return equidistant times (n,), and every signal at these times in SI, with NaN in its gaps."""
        signals, ambient = self.system.signals, self.ambient(path)
        grid, gaps = _clock(path, table, self.mapping, self.where, self.held)
        values = {}
        for name, column in columns.items():
            series, key = table[name], f"{self.where}: columns.{name}"
            unit = self._unit(path, name, series, column)
            si = _in_si(series.values, column, unit, signals[name], ambient, key, self.system.units)
            values[name] = (
                resample_held(series.times, si, grid, whole=signals[name].whole)
                if name in self.held
                else resample(series.times, si, grid, gaps[name])
            )
            self._remark_missing(path, name, grid, values[name])
        for signal in self.system.inputs:
            if signal.name in values and not np.isfinite(values[signal.name]).any():
                raise DiagnosisError(
                    f"{path}: column {signal.name} has no numbers from time.start to time.end; change these times"
                )
        return grid, values

    def _remark_missing(self, path: Path, name: str, grid: Array, values: Array) -> None:
        holes = gaps_in(values)
        if not holes:
            return
        start, stop = max(holes, key=lambda hole: hole[1] - hole[0])
        check = CHECKS["missing"]
        driven = any(one.name == name for one in self.system.inputs)
        self.missing[path, name] = Remark(
            path.name,
            name,
            check.name,
            len(holes),
            len(grid),
            f"{grid[holes[0][0]]:.6g} s",
            f"the longest gap lasts {(stop - start) * (grid[1] - grid[0]):.3g} s and starts at {grid[start]:.6g} s",
            check.input if driven else check.output,
            check.doubt,
        )

    def _unit(self, path: Path, name: str, series: Series, column: Column) -> str:
        """Return the unit of a column: that of the map, otherwise that of the column header.

        If both state different units, the column is added to ``contradicted``, unless the map ignores the header.
        Raises DiagnosisError if no unit is stated, if one is not known, or if map and header state different references
        of a pressure.
        """
        key, stated = f"{self.where}: columns.{name}.unit", series.unit.strip().removeprefix("-")
        if stated in ("", column.unit):
            if column.unit is None:
                raise DiagnosisError(
                    f'{key} is missing, and the head of "{series.name}" in {path} has no unit; add this key to the map'
                )
            return column.unit
        if column.ignore_head_unit and column.unit is not None:
            self.accounts[path].take(
                f"{name} is read in {column.unit}, as the map says, not in {stated} as the head of its column says"
            )
            return column.unit
        try:
            found = unit_of(stated, self.system.units)
            expected = found if column.unit is None else unit_of(column.unit, self.system.units)
        except UnknownUnit as error:
            raise DiagnosisError(
                f'{key}: the head of "{series.name}" in {path}: {error}; write a known unit in the file, or give the '
                "unit in the map and ignore_head_unit = true"
            ) from None
        if found.reading and column.reading and found.reading != column.reading:
            raise DiagnosisError(
                f'{self.where}: columns.{name}.reading = "{column.reading}", but by the head in {path}, "{series.name}"'
                f' is in {stated}; give reading = "{found.reading}", or ignore_head_unit = true if the head is wrong'
            )
        if not found.same(expected):
            self.contradicted.setdefault(name, (path, stated))
        return column.unit or stated


def _lead(mapping: Map, system: System, where: Path, step: float) -> int | None:
    """Return how many samples before its run a replay begins; None if it begins at the start of the file."""
    lead = mapping.runs.lead
    if system.forgets:
        return 0 if lead is None else round(difference(lead, "s", f"{where}: runs.lead") / step)
    if lead is not None:
        raise DiagnosisError(
            f"{where}: runs.lead = {lead!r}: every run of {system.name} is replayed from the start of its file, so "
            "there is no lead; omit runs.lead"
        )
    return None


def _in_si(
    values: Array,
    column: Column,
    unit: str,
    signal: SystemSignal,
    ambient: float,
    where: str,
    units: Mapping[str, Unit],
) -> Array:
    factor, zero = conversion(unit, signal.unit, f"{where}.unit", units, relative=signal.relative)
    offset = (
        0.0 if column.offset is None else difference(column.offset, signal.unit, f"{where}.offset", units)
    )
    si = column.sign * (factor * values + zero) + offset
    if column.reading is None or (column.reading == "gauge") == signal.gauge:
        return si
    return si - ambient if signal.gauge else si + ambient


def _clock(
    path: Path, table: Mapping[str, Series], mapping: Map, where: Path, held: Collection[str]
) -> tuple[Array, dict[str, float]]:
    """Return the times (n,) on which all columns are sampled, and the longest permitted gap of each column, in s."""
    known = {name: one.times[np.isfinite(one.values)] for name, one in table.items()}
    rows = max(len(one.times) for one in table.values())
    if rows < 3:
        raise DiagnosisError(f"{path}: the file has only {rows} rows, which are too few; use a longer file")
    for one in table.values():
        _refuse_standing(path, one)
    # Every column has its own rhythm, as the channels of an MDF file have, or a table with empty cells.
    usual = {name: float(np.median(np.diff(times))) for name, times in known.items() if len(times) > 1}
    finest = min((one for name, one in usual.items() if name not in held), default=0.0)
    step = finest if mapping.time.step is None else quantity(mapping.time.step, "s", f"{where}: time.step")
    longest = mapping.time.longest_gap
    longest_gap = None if longest is None else quantity(longest, "s", f"{where}: time.longest_gap")
    gaps = {name: 3.0 * usual.get(name, finest) if longest_gap is None else longest_gap for name in table}
    begin = min(float(one.times[0]) for one in table.values() if len(one.times))
    there = [times for times in known.values() if len(times)]
    first = max((float(times[0]) for times in there), default=begin)
    moving = [times for name, times in known.items() if len(times) and name not in held]
    last = min((float(times[-1]) for times in moving), default=begin)
    if mapping.time.start is not None:
        first = max(first, begin + quantity(mapping.time.start, "s", f"{where}: time.start"))
    if mapping.time.end is not None:
        last = min(last, begin + quantity(mapping.time.end, "s", f"{where}: time.end"))
    if not step > 0.0 or last - first < 10.0 * step:
        raise DiagnosisError(
            f"{path}: from {first:.6g} to {last:.6g} s there are fewer than ten steps of {step:.6g} s; check "
            f"time.step, time.start and time.end in {where}"
        )
    grid: Array = first + step * np.arange(int((last - first) / step + 1e-9) + 1, dtype=np.float64)
    # Rounding must not carry the last time past the last sample.
    return np.minimum(grid, last), gaps


def _refuse_standing(path: Path, series: Series) -> None:
    stands = np.flatnonzero(~(np.diff(series.times) > 0.0))
    if len(stands):
        row = int(stands[0]) + 1
        raise DiagnosisError(
            f"{path}: {series.name}: sample {row + 1} has the time of the sample before, {series.times[row]:.9g} s; "
            "times must increase: the clock of the file may be too coarse, or time.unit wrong"
        )


def _pieces(
    mapping: Map, system: System, driven: Mapping[str, Array], samples: int, step: float, where: Path
) -> list[tuple[int, int]]:
    runs = mapping.runs
    if runs.cut == "file":
        return [(0, samples)]
    if runs.cut == "time":
        if runs.length is None:
            raise DiagnosisError(f'{where}: runs.cut = "time" needs runs.length, such as "10 s"')
        return pieces_by_length(
            samples, max(round(quantity(runs.length, "s", f"{where}: runs.length") / step), 2)
        )
    if runs.signal is None or runs.signal not in driven or runs.reversal is None or runs.strokes < 1:
        raise DiagnosisError(
            f'{where}: runs.cut = "strokes" needs runs.signal (one of {", ".join(driven)}), runs.reversal (the motion '
            f'that makes a reversal, such as "2 mm") and runs.strokes >= 1'
        )
    least = difference(
        runs.reversal, system.signals[runs.signal].unit, f"{where}: runs.reversal", system.units
    )
    return pieces_by_reversals(driven[runs.signal], least, runs.strokes)


def _role(path: Path, number: int, rules: Sequence[RoleRule], where: Path) -> Role:
    if not rules:
        return "fit"
    for rule in rules:
        if fnmatch.fnmatch(path.name, rule.files) and (rule.runs is None or number in rule.runs):
            return rule.role
    raise DiagnosisError(
        f"{where}: no [[runs.role]] matches run {number} of {path.name}; add a last rule for all runs"
    )
