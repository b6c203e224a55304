"""Tables as other programs write them: what went out in any dialect comes back equal, or is refused."""

from __future__ import annotations

import csv
import io
import random
from collections.abc import Callable
from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from bench_protocol.account import Account
from bench_records.importing import import_keys, read_table
from bench_records.layout import RecordError, SignalInfo
from bench_records.record import read
from bench_records.tables.keys import FileKeys, Source, TimeSource
from bench_records.tables.reading import read_series
from tests.refusals import refuses

SIGNALS = {
    "left.height": SignalInfo("left.height", "mm", 1e-3),
    "left.bellows_pressure": SignalInfo("left.bellows_pressure", "bar", 1e5),
    "left.force": SignalInfo("left.force", "N", 1.0),
}
START = datetime(2026, 3, 19, 23, 59, 59, 500_000, tzinfo=UTC)


def record(seed: int, rows: int = 120) -> pd.DataFrame:
    """Times in ms from 0 and three signals: small and large numbers, both signs, and cells that are empty."""
    rng = np.random.default_rng(seed)
    table = pd.DataFrame(
        {
            "time_s": np.arange(rows) / 100.0,
            "left.height [mm]": np.round(rng.normal(0.0, 30.0, rows), 4),
            "left.bellows_pressure [bar]": np.round(rng.uniform(0.0, 8.0, rows), 3),
            "left.force [N]": np.round(rng.uniform(-250_000.0, 250_000.0, rows), 2),
        }
    )
    table.loc[rng.random(rows) < 0.1, "left.bellows_pressure [bar]"] = np.nan
    return table


def grouped(text: str, thousands: str, decimal: str) -> str:
    whole, point, part = text.partition(".")
    sign, digits = ("-", whole[1:]) if whole.startswith("-") else ("", whole)
    if thousands and len(digits) > 3:
        digits = f"{int(digits):,}".replace(",", thousands)
    return f"{sign}{digits}{decimal if point else ''}{part}"


CLOCKS: dict[str, Callable[[float], str]] = {
    "seconds": lambda t: f"{t:.3f}",
    "unix": lambda t: f"{START.timestamp() + t:.3f}",
    "iso": lambda t: (START + timedelta(seconds=t)).strftime("%Y-%m-%d %H:%M:%S.%f"),
    "iso zone": lambda t: (START + timedelta(seconds=t)).isoformat(timespec="microseconds"),
    "german": lambda t: (START + timedelta(seconds=t)).strftime("%d.%m.%Y %H:%M:%S,%f"),
    "of day": lambda t: (START + timedelta(seconds=t)).strftime("%H:%M:%S.%f"),
    "half": lambda t: (START + timedelta(seconds=t)).strftime("%I:%M:%S.%f %p"),
    "american": lambda t: (START + timedelta(seconds=t)).strftime("%m/%d/%Y %I:%M:%S.%f %p"),
    "two": lambda t: (START + timedelta(seconds=t)).strftime("%d.%m.%Y|%H:%M:%S.%f"),
    "matlab": lambda t: (START + timedelta(seconds=t)).strftime("%d-%b-%Y %H:%M:%S.%f"),
}


def dialect(table: pd.DataFrame, random_: random.Random) -> tuple[bytes, str]:
    """The table as a program may write it, and the chosen options."""
    pick = random_.choice
    delimiter, decimal = pick([(",", "."), (";", ","), (";", "."), ("\t", "."), ("\t", ","), ("|", ",")])
    thousands = pick(["", "", "." if decimal == "," else ",", "'"])
    thousands = "" if thousands == delimiter else thousands
    clock = pick(list(CLOCKS))
    if clock == "german" and delimiter == ",":
        clock = "iso"
    missing = pick(["", "", "NaN", "#N/A", "---"])
    names = list(table.columns)
    if clock == "two":
        names[:1] = ["Datum", "Uhrzeit"]
    spaces = pick([True, False])
    if units := pick([True, False]):
        names = [name.partition(" [")[0] for name in names]
    rows = [[f" {name} " if spaces else name for name in names]]
    if units:
        rows.append([*(["", ""] if clock == "two" else ["s"]), "mm", "bar", "N"])
    for row in table.itertuples(index=False):
        time = CLOCKS[clock](row[0])
        if clock in ("seconds", "unix"):
            time = time.replace(".", decimal)
        cells = [
            missing if np.isnan(one) else grouped(repr(float(one)), thousands, decimal) for one in row[1:]
        ]
        rows.append([*time.split("|"), *cells])
    above = pick([[], [], ["Measured by A. Müller", "Kanäle: 3"]])
    trailing = pick(["", "", delimiter, delimiter * 3])
    below = pick([[], [], [""], [delimiter * 3], ["End of file"]])
    text = io.StringIO()
    writer = csv.writer(text, delimiter=delimiter, lineterminator="\n")
    writer.writerows(rows)
    lines = [*above, *(line + trailing for line in text.getvalue().splitlines()), *below]
    encoding = pick(["utf-8", "utf-8-sig", "utf-16", "cp1252"])
    content = (pick(["\n", "\r\n"]).join(lines) + "\n").encode(encoding)
    words = [
        delimiter,
        decimal,
        thousands,
        clock,
        missing,
        spaces,
        units,
        bool(above),
        trailing,
        below,
        encoding,
    ]
    return content, repr(words)


def imported(path: Path, into: Path, *keys: str) -> tuple[dict[str, tuple[np.ndarray, np.ndarray]], Account]:
    account = Account()
    read_table(path, into, SIGNALS.get, {}, account, import_keys(keys))
    found = read(into)
    return {name: found.series(name) for name in found.signals}, account


def same(found: dict[str, tuple[np.ndarray, np.ndarray]], table: pd.DataFrame) -> None:
    for name, signal in SIGNALS.items():
        column = table[f"{name} [{signal.unit}]"]
        known = column.notna().to_numpy()
        times, values = found[name]
        np.testing.assert_allclose(values, column[known] * signal.scale, rtol=1e-12)
        np.testing.assert_allclose(times, table["time_s"][known], atol=1e-6)


def check_dialects(seeds: range, folder: Path) -> list[str]:
    """Read tables in the dialect of each seed; return the refused ones."""
    refused = []
    for seed in seeds:
        table = record(seed)
        content, words = dialect(table, random.Random(seed))
        path = folder / f"{seed}.csv"
        path.write_bytes(content)
        try:
            found, _ = imported(path, folder / str(seed))
        except RecordError as error:
            refused.append(f"{words}: {error}")
            continue
        try:
            same(found, table)
        except AssertionError as error:
            raise AssertionError(f"{seed} {words}: {error}") from None
    return refused


def test_in_any_dialect_a_record_comes_back_equal_or_is_refused(tmp_path) -> None:
    assert check_dialects(range(12), tmp_path) == []


@pytest.mark.slow
def test_in_many_dialects_a_record_comes_back_equal_or_is_refused(tmp_path) -> None:
    assert len(check_dialects(range(1000, 1080), tmp_path)) < 4


def columnar(table: pd.DataFrame, random_: random.Random, path: Path) -> None:
    """Write the table as some program may keep it in columns."""
    pick = random_.choice
    times = table["time_s"]
    start = pd.Timestamp(START) if pick([True, False]) else pd.Timestamp(START).tz_localize(None)
    stamps = pd.DatetimeIndex(start + pd.to_timedelta(times, unit="s")).as_unit(pick(["ns", "us", "ms"]))
    clock = pick([times.to_numpy(), times.astype("float32").to_numpy(), stamps, stamps - stamps[0]])
    changed = table.drop(columns="time_s").astype(pick(["float64", "float64", "string"]))
    if random_.random() < 0.2:
        days, of_day = stamps.date, stamps.time
        if pick([True, False]):
            days, of_day = stamps.strftime("%Y/%m/%d"), stamps.strftime("%H:%M:%S.%f")
        changed.insert(0, "Date", days)
        changed.insert(pick([0, 2]), "Time", of_day)
    elif pick([True, False]):
        changed = changed.set_index(pd.Index(clock, name=pick(["time_s", "time_s", None])))
        if changed.index.name is None and isinstance(changed.index[0], float | np.floating):
            changed.index.name = "time_s"
    else:
        changed.insert(random_.randrange(4), "time_s", clock)
    if path.suffix == ".parquet":
        changed.to_parquet(path)
        return
    import pyarrow as pa

    whole = pa.Table.from_pandas(changed)
    with pa.OSFile(str(path), "wb") as file:
        kind = pick([pa.ipc.new_file, pa.ipc.new_stream])
        with kind(file, whole.schema) as writer:
            writer.write_table(whole, max_chunksize=pick([7, 1000]))


@pytest.mark.parametrize("ending", ["parquet", "arrow"])
def test_columns_of_any_type_come_back_equal(ending: str, tmp_path) -> None:
    for seed in range(12):
        table = record(seed)
        path = tmp_path / f"{seed}.{ending}"
        columnar(table, random.Random(seed), path)
        same(imported(path, tmp_path / str(seed))[0], table)


def test_a_clock_of_its_own_and_a_unit_of_the_file_are_heeded(tmp_path) -> None:
    path = tmp_path / "a.csv"
    rows = [f"{0.1 * k:.1f};{k};{0.2 * k + 5:.1f};{2 * k}" for k in range(20)]
    path.write_text("t1;x [mm];t2;p\n" + "\n".join(rows) + "\n")
    wanted = {"x": Source(column="x [mm]"), "p": Source(column="p", time="t2")}
    found = read_series(path, FileKeys(), TimeSource(column="t1"), wanted, Account())
    np.testing.assert_allclose(found["x"].times, 0.1 * np.arange(20))
    np.testing.assert_allclose(found["p"].times, 5 + 0.2 * np.arange(20))
    assert (found["x"].unit, found["p"].unit) == ("mm", "")


@pytest.mark.parametrize(
    ("keys", "told"),
    [
        (["decimal=;"], "decimal"),
        (["colour=red"], "--table"),
        (["delimiter"], "KEY=VALUE"),
        (["skip_rows=-1"], "skip_rows"),
        (["time=t"], 'time "t" time_s'),
    ],
)
def test_invalid_keys_are_refused(keys: list[str], told: str, tmp_path) -> None:
    path = tmp_path / "a.csv"
    path.write_text("time_s,left.height [mm]\n0,1\n1,2\n")
    with refuses(RecordError, told):
        imported(path, tmp_path / "o", *keys)


def test_keys_say_what_a_file_leaves_open(tmp_path) -> None:
    path = tmp_path / "a.csv"
    path.write_text("t;left.force [N]\n0;1.250\n100;2.375\n")
    with refuses(RecordError, "time_s --table --table time_unit=s"):
        imported(path, tmp_path / "o")
    with refuses(RecordError, '"1.250" 2 thousand'):
        imported(path, tmp_path / "o", "time=t", "time_unit=ms")
    for keys, right in ((["decimal=."], [1.25, 2.375]), (["thousands=."], [1250.0, 2375.0])):
        found, _ = imported(path, tmp_path / keys[0], "time=t", "time_unit=ms", *keys)
        np.testing.assert_allclose(found["left.force"][1], right)
        np.testing.assert_allclose(found["left.force"][0], [0.0, 0.1])
