"""The map file: which column of a foreign file holds which signal, in which unit, and the role of each run."""

from __future__ import annotations

import fnmatch
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final, Literal

import msgspec

from bench_protocol.account import Account
from bench_protocol.dimensions import DimensionsError, read_dimensions
from bench_protocol.input_limits import read_toml
from bench_protocol.misfit import Misfits, converted
from bench_protocol.os_errors import file_errors
from bench_protocol.suggestion import did_you_mean
from bench_records.layout import RecordError
from bench_records.tables import reading
from bench_records.tables.keys import ColumnName, FileKeys, Source, TimeSource
from bench_records.tables.reading import Series
from bench_sim.parameters import ParameterError, load
from bench_sim.parameters.dimensions import described
from bench_sim.parameters.model_file import read_changes, with_changes
from diagnosis.contracts import Channel, DiagnosisError, Role
from diagnosis.systems.chamber import CHAMBER
from diagnosis.systems.fmu.keys import FmuKeys
from diagnosis.systems.fmu.system import fmu_system
from diagnosis.systems.own_simulator import load_system
from diagnosis.systems.piston import PISTON
from diagnosis.systems.system import (
    Errors,
    System,
    SystemSetting,
    SystemSignal,
    conversion,
    difference,
    quantity,
)

_BUILT_IN: Final = (PISTON, CHAMBER)
_SYSTEMS: Final = ", ".join(("air_spring", *(system.name for system in _BUILT_IN)))


class TimeColumn(TimeSource, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """``[time]``: the column of the clock, the grid of the replay, and the part of each file that is used."""

    step: str | None = None
    longest_gap: str | None = None
    start: str | None = None
    end: str | None = None


class Column(Source, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """``[columns.NAME]``: how to read a column. SI = sign · factor of the unit · value + offset."""

    unit: str | None = None  #: else the head of the column states it
    reading: Literal["gauge", "absolute"] | None = None
    sign: Literal[1, -1] = 1
    offset: str | None = None
    noise: str | None = None
    resolution: str | None = None
    hold: bool | None = (
        None  #: an input keeps its value until the next sample; else it moves on straight lines
    )


class RoleRule(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """``[[runs.role]]``: a role for matching files and runs. The first rule that matches is used."""

    role: Role
    files: str = "*"
    runs: list[int] | None = None


class Runs(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """``[runs]``: how a file is cut into runs, which part of each run is not scored, and the role of each run."""

    cut: Literal["file", "strokes", "time"] = "file"
    signal: str | None = None
    reversal: str | None = None
    strokes: int = 2
    length: str | None = None
    skip: int = 0
    lead: str | None = None
    role: list[RoleRule] = []


class FileRule(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """``[[file_settings]]``: settings for matching files; a later rule overrides an earlier one."""

    files: str
    settings: dict[str, str]


class FrameKeys(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """``[frames]``: how to decode logs of CAN frames; their columns are called ``MESSAGE.SIGNAL``."""

    dbc: str | None = None  #: next to the map; without it the messages are those of this bench
    charset: str | None = None
    channel: str | None = None
    stamps: Literal["absolute", "delta"] | None = None


class Map(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """All keys of a map file."""

    system: str | None = None
    simulator: str | None = None  #: custom simulator, "package.module:factory", which may lie next to the map
    parameters: str = "astb"  #: set of the air springs: a name, or a file next to the map
    dimensions: str = ""  #: of the rig that was measured on: a name, or a file next to the map
    change: dict[str, Any] = {}  #: changed values of this set, as in a model file
    columns: dict[str, Column]
    time: TimeColumn = TimeColumn()
    file: FileKeys = FileKeys()
    frames: FrameKeys = FrameKeys()
    settings: dict[str, str] = {}
    file_settings: list[FileRule] = []
    runs: Runs = Runs()
    fmu: FmuKeys | None = None  #: assumptions on an FMU, if the simulator is one


def read_map(map_path: Path, simulator: str | None = None) -> tuple[Map, System]:
    """Read a map file, and return the map and its system. ``simulator`` is the user's own, if the map names none."""
    with file_errors(map_path, DiagnosisError):
        content = read_toml(map_path)
    try:
        mapping = converted(content, Map)
    except Misfits as found:
        raise DiagnosisError("\n".join(f"{map_path}: {text}" for text in found.texts)) from None
    _check_one_system(mapping, map_path, simulator)
    own = simulator or mapping.simulator
    folder = map_path.parent if simulator is None else Path.cwd()
    if own is not None and own.lower().endswith(".fmu"):
        units = {name: column.unit or "" for name, column in mapping.columns.items()}
        holds = {name: column.hold for name, column in mapping.columns.items()}
        return mapping, fmu_system(folder / own, mapping.fmu or FmuKeys(), units, holds, map_path)
    if mapping.fmu is not None:
        raise DiagnosisError(
            f'{map_path}: fmu: {own or mapping.system} is not an FMU; write it as simulator = "my.fmu"'
        )
    return mapping, _system(mapping, map_path) if own is None else load_system(own, folder)


def _check_one_system(mapping: Map, map_path: Path, simulator: str | None) -> None:
    """Raise DiagnosisError if map and option ``simulator`` together do not state exactly one system."""
    given = {
        "system": mapping.system,
        "simulator": mapping.simulator,
        "--simulator": simulator,
    }
    named = [f'{key} = "{name}"' for key, name in given.items() if name is not None]
    if not named:
        raise DiagnosisError(
            f"{map_path}: the map has no system; add system = one of {_SYSTEMS}, or name your own simulator"
        )
    if len(named) > 1:
        raise DiagnosisError(f"{map_path}: {' and '.join(named)} exclude each other; keep only one")


def plain_map(first: Path, simulator: str) -> tuple[Map, System]:
    """Return a map for files without a map. Their columns have the names of the signals of ``simulator``, in SI, and
    ``time`` in s.

    Outputs that the ``first`` file does not have count as not measured.
    """
    if simulator.lower().endswith(".fmu"):
        raise DiagnosisError(
            f"{simulator}: an FMU needs --map MAP, which states the columns of its variables, the priors of its "
            "parameters and the possible effects"
        )
    system = load_system(simulator, Path.cwd())
    there = column_names(first, ["time", *system.signals])
    columns = {
        signal.name: Column(column=signal.name, unit=signal.unit, reading=_reading(signal))
        for signal in system.signals.values()
        if signal.required or signal.name in there
    }
    return Map(simulator=simulator, columns=columns), system


def _reading(signal: SystemSignal) -> Literal["gauge", "absolute"] | None:
    if signal.unit != "Pa":
        return None
    return "gauge" if signal.gauge else "absolute"


def _system(mapping: Map, where: Path) -> System:
    known = {system.name: system for system in _BUILT_IN}
    if mapping.system == "air_spring":
        # Loading the model of the bench takes a second, which the other systems are spared.
        from diagnosis.systems.air_spring.files import air_spring_system

        name = mapping.parameters
        try:
            parameters = load(where.parent / name if name.endswith(".toml") else name)
        except ParameterError as error:
            raise DiagnosisError(f"{where}: parameters: {error}") from None
        if mapping.dimensions:
            try:
                parameters = described(parameters, read_dimensions(mapping.dimensions, where.parent))
            except (DimensionsError, ParameterError) as error:
                raise DiagnosisError(f"{where}: {error}") from None
        try:
            return air_spring_system(with_changes(parameters, read_changes(mapping.change)))
        except ParameterError as error:
            raise DiagnosisError(f"{where}: change: {error}") from None
    for key in ("change", "dimensions"):
        if getattr(mapping, key):
            raise DiagnosisError(
                f"{where}: {key}: only air_spring has a set of parameters; for {mapping.system}, use settings"
            )
    if mapping.system not in known:
        raise DiagnosisError(f'{where}: system = "{mapping.system}" is unknown; use one of {_SYSTEMS}')
    return known[mapping.system]


def settings_of(mapping: Map, system: System, where: Path, file: Path | None = None) -> dict[str, float]:
    """Return every setting of the system in SI, from the map or by default, for one ``file`` or for all.

    Raises one DiagnosisError for all settings that are wrong or missing.
    """
    errors = Errors()
    known = {setting.name: setting for setting in system.settings}
    own = [rule.settings for rule in mapping.file_settings if file and fnmatch.fnmatch(file.name, rule.files)]
    for name in dict.fromkeys(name for rule in mapping.file_settings for name in rule.settings):
        if name in known and not known[name].per_file:
            able = ", ".join(one for one, setting in known.items() if setting.per_file)
            errors.note(
                f"{where}: file_settings: {name} of {system.name} must be equal in all files; move it to settings "
                f"(settings that may differ: {able or 'none'})"
            )
    given = {name: text for rule in (mapping.settings, *own) for name, text in rule.items()}
    for name in (*mapping.settings, *(name for rule in mapping.file_settings for name in rule.settings)):
        if name not in known:
            errors.note(
                f"{where}: settings.{name} is not a setting of {system.name}; "
                + did_you_mean(name, known, "it has none, so remove this line")
            )
    values: dict[str, float] = {}
    for name, setting in known.items():
        text = given.get(name)
        if text is None:
            if setting.default is None:
                errors.note(
                    f"{where}: settings.{name} is missing; add the {setting.title}, in {setting.unit}"
                )
            else:
                values[name] = setting.default
            continue
        with errors.noted():
            values[name] = _setting(text, setting, system, f"{where}: settings.{name}")
    errors.report()
    return values


def _setting(text: str, setting: SystemSetting, system: System, where: str) -> float:
    value = quantity(text, setting.unit, where, system.units, relative=setting.relative)
    if not setting.low <= value <= setting.high:
        raise DiagnosisError(
            f"{where} = {text} is outside the range; use {setting.low:g} to {setting.high:g} {setting.unit}"
        )
    return value


def held_inputs(mapping: Map, system: System) -> frozenset[str]:
    """Return the inputs that keep their values between samples. The map decides; without its key the system decides."""
    given = {name: column.hold for name, column in mapping.columns.items() if column.hold is not None}
    return frozenset(one.name for one in system.inputs if given.get(one.name, one.held))


def channels_of(mapping: Map, system: System, where: Path, errors: Errors) -> tuple[Channel, ...]:
    """Return the outputs that the map has columns for, and add the errors of these columns to ``errors``."""
    signals = system.signals
    known = set(system.errors)
    for name, column in mapping.columns.items():
        signal, key = signals.get(name), f"{where}: columns.{name}"
        if signal is None:
            if f"columns.{name}" not in known:
                errors.note(f"{key} is not a signal of {system.name}; {did_you_mean(name, signals)}")
            continue
        if column.unit is not None:
            with errors.noted():
                conversion(column.unit, signal.unit, f"{key}.unit", system.units)
        if (signal.unit == "Pa") != (column.reading is not None):
            right = (
                'give "gauge" or "absolute"'
                if signal.unit == "Pa"
                else f"{name} is not a pressure; omit reading"
            )
            errors.note(f"{key}.reading = {column.reading}; {right}")
        if column.hold is not None and signal not in system.inputs:
            errors.note(f"{key}.hold: {name} is an output, and only inputs can be held; omit hold")
    for name, signal in signals.items():
        if signal.required and name not in mapping.columns:
            errors.note(f"{where}: columns.{name} is missing; add the column of the {signal.title}")
    channels = []
    for signal in system.outputs:
        if signal.name in mapping.columns:
            column = mapping.columns[signal.name]
            key = f"{where}: columns.{signal.name}"
            noise, resolution = 0.0, 0.0
            with errors.noted():
                noise, resolution = (
                    0.0 if text is None else difference(text, signal.unit, f"{key}.{name}", system.units)
                    for name, text in (("noise", column.noise), ("resolution", column.resolution))
                )
            channels.append(signal.channel(noise, resolution))
    if not channels:
        errors.note(
            f"{where}: no column holds an output of {system.name}; give at least one of "
            + ", ".join(signal.name for signal in system.outputs)
        )
    return tuple(channels)


def read_columns(
    path: Path, keys: FileKeys, time: TimeSource, wanted: Mapping[str, Source], account: Account
) -> dict[str, Series]:
    """Read the ``wanted`` columns of a file. Return them by their names in the map, each with its own times.

    ``account`` receives notes on how the file was read and which rows were skipped. Raises DiagnosisError with the
    file, the key, the column, and the existing columns.
    """
    try:
        return reading.read_series(path, keys, time, wanted, account)
    except RecordError as error:
        raise DiagnosisError(str(error)) from None


def column_names(path: Path, wanted: Sequence[ColumnName]) -> list[str]:
    """Return the names of all columns of a file whose header contains some of the ``wanted`` names; otherwise raise
    DiagnosisError.
    """
    try:
        return reading.column_names(path, FileKeys(), Account(), wanted)
    except RecordError as error:
        raise DiagnosisError(str(error)) from None
