"""Index of the runs in a folder: a small database in that folder, which can always be rebuilt from the runs.

Before every query, the index reads the results that are new, changed or removed since the last query.
"""

from __future__ import annotations

import os
import sqlite3
from collections.abc import Iterator, Sequence
from contextlib import closing, contextmanager, suppress
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Final

import msgspec

from bench_records.layout import PARQUET, STREAM, RecordError
from bench_records.notes import NOTES, Note, notes_of
from bench_records.result import Check
from bench_records.run_folder import SIGNS, RunFolder, circumstances, facts_of, open_run
from bench_records.stream import is_held

INDEX: Final = "index.sqlite"
#: A database with another version of the tables is deleted and rebuilt.
VERSION: Final = 6
WAIT: Final = 10.0
_UNWRITABLE: Final = (
    sqlite3.SQLITE_CANTOPEN,
    sqlite3.SQLITE_READONLY,
    sqlite3.SQLITE_FULL,
    sqlite3.SQLITE_IOERR,
)

TABLES: Final = """
create table run (
    directory text primary key, stamp text not null, began text not null, plan text not null, title text not null,
    verdict text not null, reason text not null, rig text not null, operator text not null, specimen text not null,
    serial_number text not null, circumstances text not null, seed integer,
    duration real not null, parameters text not null, notes integer not null
);
create table note (
    directory text not null references run on delete cascade, place integer not null, at text not null,
    by text not null, text text not null, file text not null, sha256 text not null,
    primary key (directory, place)
);
create table judged (
    directory text not null references run on delete cascade, place integer not null, phase text not null,
    name text not null, value real, unit text not null, scale real not null, low real, high real, verdict text not null,
    expanded real, requirement text not null, primary key (directory, place)
);
create index judged_by_name on judged (name);
"""


class KeptRun(msgspec.Struct, frozen=True, kw_only=True):
    """One run in the index. ``began`` is the start (ISO 8601 in UTC). In virtual time it is the time at which the
    result was written.

    ``verdict`` is an Outcome, or ``interrupted`` or ``running`` if there is no result. ``reason`` explains it.
    """

    directory: str  #: relative to the folder of the index
    began: str
    plan: str
    title: str
    verdict: str
    reason: str
    rig: str
    operator: str
    specimen: str  #: its type
    serial_number: str
    circumstances: str  #: simulated, virtual time, effects and changes; empty for a real rig in real time
    seed: int | None
    duration: float  #: s; 0 for a run in progress
    parameters: dict[str, str]
    notes: int = 0  #: added afterwards

    @property
    def rig_as_text(self) -> str:
        """The rig, with a mark if it was simulated: a rehearsal of a real rig has the name of this rig."""
        return f"{self.rig} (simulated)" if self.circumstances.startswith("SIMULATED") else self.rig


class KeptCheck(msgspec.Struct, frozen=True, kw_only=True):
    """One check of one run. Value and limits are in SI, and ``scale`` is the SI value of one ``unit``."""

    run: KeptRun
    phase: str
    name: str
    value: float | None
    unit: str
    scale: float
    low: float | None
    high: float | None
    verdict: str
    expanded: float | None = None  #: expanded uncertainty
    requirement: str = ""


_RUN: Final = tuple(KeptRun.__struct_fields__)
_CHECK: Final = (
    "phase",
    "name",
    "value",
    "unit",
    "scale",
    "low",
    "high",
    "verdict",
    "expanded",
    "requirement",
)


class RunIndex:
    """The index of all runs in ``folder`` and its subfolders.

    If the index cannot be written, each query uses a database in memory. Raises RecordError if ``folder`` is not a
    folder, or if the index is locked for too long or damaged.
    """

    def __init__(self, folder: Path) -> None:
        if not folder.is_dir():
            raise RecordError(f"{folder} is not a folder with runs; `astb run --out FOLDER` makes one")
        self.folder = folder
        #: Results that cannot be read, with the reason.
        self.unreadable: dict[str, str] = {}

    def runs(self, **chosen: str | None) -> list[KeptRun]:
        """Return the runs, oldest first. ``chosen`` selects by columns such as ``plan`` or ``verdict``; None allows
        any value.
        """
        where, values = _where_clause(chosen)
        with self._fresh() as base:
            rows = base.execute(
                f"select {', '.join(_RUN)} from run {where} order by began, directory", values
            )
            return [_kept(row) for row in rows]

    def checks(self, name: str | None = None, **chosen: str | None) -> list[KeptCheck]:
        """Return the checks called ``name``, oldest first. ``chosen`` selects the runs as in `runs`.

        Without a name, return all checks that verify a requirement.
        """
        named = "judged.requirement <> ''" if name is None else "judged.name = ?"
        where, values = _where_clause(chosen, "run.")
        columns = ", ".join([f"judged.{one}" for one in _CHECK] + [f"run.{one}" for one in _RUN])
        with self._fresh() as base:
            rows = base.execute(
                f"select {columns} from judged join run using (directory) "
                f"{where or 'where true'} and {named} order by run.began, directory, place",
                values if name is None else (*values, name),
            )
            n = len(_CHECK)
            return [KeptCheck(run=_kept(row[n:]), **dict(zip(_CHECK, row[:n], strict=True))) for row in rows]

    def notes(self, directory: str) -> list[Note]:
        """Return the notes that were added to a finished run, oldest first."""
        columns = Note.__struct_fields__
        with self._fresh() as base:
            rows = base.execute(
                f"select {', '.join(columns)} from note where directory = ? order by place", (directory,)
            )
            return [Note(**dict(zip(columns, row, strict=True))) for row in rows]

    def names(self, column: str) -> list[str]:
        """Return the distinct values of a column of the runs. For the column ``check``, return the names of all
        checks.
        """
        table, column = ("judged", "name") if column == "check" else ("run", column)
        with self._fresh() as base:
            return [row[0] for row in base.execute(f"select distinct {column} from {table} order by 1")]

    def rebuild(self) -> int:
        """Delete the index and rebuild it from the folders. Return the number of runs."""
        (self.folder / INDEX).unlink(missing_ok=True)
        with self._fresh() as base:
            return int(base.execute("select count(*) from run").fetchone()[0])

    @contextmanager
    def _fresh(self) -> Iterator[sqlite3.Connection]:
        """Yield the database after it has been updated from the folders."""
        path = self.folder / INDEX
        try:
            with closing(self._caught_up(path)) as base:
                yield base
        except sqlite3.Error as error:
            busy = getattr(error, "sqlite_errorcode", 0) & 0xFF == sqlite3.SQLITE_BUSY
            remedy = (
                f"another program has locked this file for {WAIT:g} s; try again"
                if busy
                else "remove this file: it is made again from the folders of the runs"
            )
            raise RecordError(f"{path}: {error}; {remedy}") from None

    def _caught_up(self, path: Path) -> sqlite3.Connection:
        """Open and update the database. If it cannot be written to disk, a database in memory is used for
        this query.
        """
        for place in (path, None):
            base = _opened(path) if place else _connected(":memory:")
            try:
                with base:
                    self._catch_up(base)
                return base
            except sqlite3.OperationalError as error:
                base.close()
                if place is None or error.sqlite_errorcode & 0xFF not in _UNWRITABLE:
                    raise
            except BaseException:
                base.close()
                raise
        raise AssertionError("there is memory")

    def _catch_up(self, base: sqlite3.Connection) -> None:
        known = dict(base.execute("select directory, stamp from run"))
        there = {path.parent.relative_to(self.folder).as_posix(): path for path in _signs(self.folder)}
        self.unreadable = {}
        for directory in known.keys() - there.keys():
            base.execute("delete from run where directory = ?", (directory,))
        for directory, path in there.items():
            with suppress(FileNotFoundError):  # the file may be removed at the same time
                stamp = _stamp(path)
                if known.get(directory) == stamp:
                    continue
                base.execute("delete from run where directory = ?", (directory,))
                if path.name == PARQUET and not facts_of(path.parent).get("plan"):
                    continue  # third-party samples, not a run
                try:
                    _insert(base, directory, stamp, open_run(path.parent), path)
                except RecordError as error:
                    self.unreadable[directory] = str(error)


def _opened(path: Path) -> sqlite3.Connection:
    """Open the database. Rebuild it if it has another version or is not a database.

    If the folder cannot be written, as in an archive or on a full disk, use a database in memory.
    """
    try:
        base = _connected(path)
    except sqlite3.OperationalError as error:
        if error.sqlite_errorcode & 0xFF not in _UNWRITABLE:
            raise
        return _connected(":memory:")
    except sqlite3.DatabaseError:
        path.unlink(missing_ok=True)
        return _connected(path)
    return base


def _connected(path: Path | str) -> sqlite3.Connection:
    base = sqlite3.connect(path, timeout=WAIT)
    try:
        # A concurrent program waits here until the tables exist.
        base.execute("begin immediate")
        if base.execute("pragma user_version").fetchone()[0] != VERSION:
            tables = [name for (name,) in base.execute("select name from sqlite_master where type = 'table'")]
            drops = [f"drop table {name}" for name in reversed(tables)]
            for statement in (
                *drops,
                *filter(str.strip, TABLES.split(";")),
                f"pragma user_version = {VERSION}",
            ):
                base.execute(statement)
        base.commit()
        base.execute("pragma foreign_keys = on")
    except BaseException:
        base.close()
        raise
    return base


def _signs(folder: Path) -> Iterator[Path]:
    """Yield, for each run in ``folder`` and its subfolders, the file that identifies it."""
    for here, _, files in os.walk(folder):
        if sign := next((name for name in SIGNS if name in files), None):
            yield Path(here) / sign


def _stamp(path: Path) -> str:
    if path.name == STREAM and is_held(path.parent):
        return "running"
    status = path.stat()
    with suppress(OSError):  # most runs have no notes
        return f"{status.st_mtime_ns} {status.st_size} {(path.parent / NOTES).stat().st_mtime_ns}"
    return f"{status.st_mtime_ns} {status.st_size}"


def _insert(base: sqlite3.Connection, directory: str, stamp: str, found: RunFolder, path: Path) -> None:
    result, meta, verdict = found
    written = datetime.fromtimestamp(path.stat().st_mtime, UTC).strftime("%Y-%m-%dT%H:%M:%SZ")
    sample = result.specimen
    run = {
        "directory": directory,
        "stamp": stamp,
        "began": meta.get("date", written),
        "plan": result.plan,
        "title": result.title,
        "verdict": verdict,
        "reason": result.reason,
        "rig": result.rig,
        "operator": meta.get("operator", ""),
        "specimen": sample.type if sample else "",
        "serial_number": sample.serial_number if sample else "",
        "circumstances": " · ".join(circumstances(meta)),
        "seed": result.seed,
        "duration": result.duration,
        "parameters": msgspec.json.encode(result.parameters).decode(),
        "notes": len(notes := notes_of(path.parent)),
    }
    _store(base, "run", run)
    for place, one in enumerate(result.checks):
        _store(base, "judged", {"directory": directory, "place": place, **_figures(one)})
    for place, note in enumerate(notes):
        _store(base, "note", {"directory": directory, "place": place, **msgspec.structs.asdict(note)})


def _figures(one: Check) -> dict[str, Any]:
    found: dict[str, Any] = {name: getattr(one, name) for name in _CHECK}
    # SQLite stores NaN as NULL: there is no measured value.
    return found | {
        "verdict": one.verdict.value,
        "value": one.number,
        "requirement": one.requirement or "",
    }


def _store(base: sqlite3.Connection, table: str, row: dict[str, Any]) -> None:
    marks = ", ".join("?" * len(row))
    base.execute(f"insert into {table} ({', '.join(row)}) values ({marks})", tuple(row.values()))


def _where_clause(chosen: dict[str, str | None], prefix: str = "") -> tuple[str, tuple[str, ...]]:
    values = {name: value for name, value in chosen.items() if value is not None}
    unknown = values.keys() - set(_RUN)
    if unknown:
        raise ValueError(f"a run has no {', '.join(unknown)}; the columns of a run are {', '.join(_RUN)}")
    text = " and ".join(f"{prefix}{name} = ?" for name in values)
    return (f"where {text}" if text else ""), tuple(values.values())


def _kept(row: Sequence[Any]) -> KeptRun:
    columns = dict(zip(_RUN, row, strict=True))
    columns["parameters"] = msgspec.json.decode(columns["parameters"])
    return KeptRun(**columns)
