"""The instruments file of the virtual bench. Missing entries are added from the table of sensor groups."""

import tomllib
from collections.abc import Mapping
from typing import Any, Final

from bench_protocol.named_files import ORDINARY_RIG, named_files
from bench_protocol.signals import Signal
from bench_protocol.table_groups import SensorRow
from bench_protocol.table_signals import MEASUREMENTS
from bench_protocol.units import in_unit

INSTRUMENTS_FILE: Final = named_files("instruments")[ORDINARY_RIG]
#: Part of a lag that remains after the plans have corrected it.
_LEFT_OF_LAG: Final = 0.1
_LIST: Final = "# Which piece gives which reading"


def instruments_file() -> str:
    """Return the text of the file, with missing instruments and signals added. Existing lines are not changed."""
    text = INSTRUMENTS_FILE.read_text(encoding="utf-8")
    known = tomllib.loads(text)
    tables = [_table(row) for row in _rows_without_table(known)]
    before, mark, after = text.partition(_LIST)
    assert mark, f"{INSTRUMENTS_FILE} has no line that begins with {_LIST!r}: put it before [signal]"
    lines = [_line(signal) for signal in MEASUREMENTS if signal.name not in known["signal"]]
    return "".join([before, *tables, mark, after, *lines])


def lacking_instruments() -> list[str]:
    """Return a message for each missing entry of the file, with its group of sensors."""
    known = tomllib.loads(INSTRUMENTS_FILE.read_text(encoding="utf-8"))
    lacks = [(f"instrument.{row.instrument}", row) for row in _rows_without_table(known)]
    lacks += [
        (f'signal."{signal.name}"', _row(signal))
        for signal in MEASUREMENTS
        if signal.name not in known["signal"]
    ]
    return [
        f"{INSTRUMENTS_FILE} lacks {key}: `make generate` takes it from the row {row.name} of "
        "bench_protocol/table_groups.py"
        for key, row in lacks
    ]


def _rows_without_table(known: Mapping[str, Any]) -> list[SensorRow]:
    rows = {row.instrument: row for row in map(_row, MEASUREMENTS)}
    return [row for name, row in rows.items() if name not in known["instrument"]]


def _row(signal: Signal) -> SensorRow:
    assert signal.group is not None, f"{signal.name} has no group"
    return signal.group.row


def _table(row: SensorRow) -> str:
    """Return the TOML table of an instrument."""
    of_plans = "a tenth of the lag that the plans take out"
    entries = {
        "offset": (row.accuracy, row.unit, "assumed", row.source),
        "gain": (row.gain, "%", "assumed", "what a yearly calibration leaves"),
        "lag": (row.lag * _LEFT_OF_LAG, "ms", "assumed", of_plans),
        "resolution": (row.resolution, row.unit, "assumed", "16-bit converter over its range"),
        "noise": (row.noise, row.unit, row.noise_provenance, row.noise_source),
    }
    lines = [
        f'{name} = {{ value = {in_unit(value, unit):.6g}, unit = "{unit}", provenance = "{provenance}", '
        f'source = "{source}" }}\n'
        for name, (value, unit, provenance, source) in entries.items()
    ]
    return f'[instrument.{row.instrument}]\ntype = "{row.type}"\n{"".join(lines)}\n'


def _line(signal: Signal) -> str:
    """Return the TOML line of a measured signal."""
    return (
        f'"{signal.name}" = {{ instrument = "{_row(signal).instrument}", serial_number = "virtual", '
        'certificate = "the virtual bench", due = 9999-12-31 }\n'
    )
