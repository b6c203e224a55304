"""The stored rows of a campaign: a directory of Parquet parts; no part is ever incomplete."""

import contextlib
import os
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any, Final

from bench_protocol.os_errors import reason
from bench_protocol.runtime.file_locks import hold
from bench_records.disk import disk_reason
from bench_records.layout import whole

if TYPE_CHECKING:
    import pyarrow as pa

#: Number of small parts that are joined into one.
PARTS: Final = 100
_LOCK: Final = ".lock"


class KeptError(ValueError):
    """A directory is not a data set of a campaign, or is in use by another campaign."""


class KeptFailed(KeptError):
    """The disk cannot store the rows of a campaign."""


class KeptRows:
    """Rows by their ``key``, in a directory that one campaign at a time writes to.

    A part gets its name when it is complete and on the disk. Parts are joined from time to time. An interrupted join
    can leave a row in two parts; `read_rows` and the next opening remove duplicates.
    """

    def __init__(self, directory: Path, *, without_errors: bool = False) -> None:
        """Open or create ``directory``; ``without_errors`` drops the rows of failed cases.

        Raises KeptError if it cannot be used.
        """
        self.directory = directory
        self._lock = _locked(directory)
        try:
            self._take_over(without_errors)
        except BaseException:
            self._lock.close()
            raise

    def _take_over(self, without_errors: bool) -> None:
        """Read the stored rows, remove parts that a crash left incomplete, and join all parts into one."""
        table = read_table(self.directory)
        for left in self.directory.glob(".part-*"):
            left.unlink()
        if without_errors and "error" in table.column_names:
            import pyarrow.compute as pc

            table = table.filter(pc.equal(table["error"], ""))
        numbers = (int(path.stem.removeprefix("part-")) for path in _part_files(self.directory))
        self._count = max(numbers, default=-1) + 1
        self._replace_all(table)
        self._schema = table.schema
        self.keys = set(table["key"].to_pylist())

    def __enter__(self) -> "KeptRows":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def add(self, row: Mapping[str, Any]) -> None:
        """Store a row; it is on the disk when this returns.

        Raises ValueError if it does not fit into a table with the earlier rows.
        """
        table = _table(row)
        schema = _unified(self._schema, table.schema)
        _write(table, self._next_part())
        self._schema = schema
        self.keys.add(row["key"])
        self._parts += 1
        if self._parts > PARTS:
            self._replace_all(read_table(self.directory))

    def close(self) -> None:
        """Join all parts, and unlock the directory."""
        if self._parts > 1:
            self._replace_all(read_table(self.directory))
        self._lock.close()

    def _next_part(self) -> Path:
        path = self.directory / f"part-{self._count:06}.parquet"
        self._count += 1
        return path

    def _replace_all(self, table: "pa.Table") -> None:
        """Replace all parts by one with ``table``."""
        old = _part_files(self.directory)
        if table.num_rows:
            _write(table, self._next_part())
        for path in old:
            path.unlink()
        self._parts = 1


def read_table(directory: Path) -> "pa.Table":
    """Return all rows in ``directory``, each key once, in the order in which they were stored.

    Raises KeptError if it has other contents.
    """
    import numpy as np
    import pyarrow as pa
    import pyarrow.parquet as pq

    try:
        parts = [pq.read_table(path, partitioning=None) for path in _part_files(directory)]
        if not parts:
            return pa.table({"key": pa.array([], pa.string())})
        whole = pa.concat_tables(parts, promote_options="permissive")
    except (OSError, pa.ArrowException) as error:
        raise KeptError(
            f"{directory} cannot be read as the rows of a campaign ({error}); choose another directory"
        ) from None
    if any("key" not in one.column_names for one in parts):
        raise KeptError(f"{directory} holds tables that are not rows of a campaign; choose another directory")
    _, first = np.unique(whole["key"].to_numpy(), return_index=True)
    return whole if first.size == whole.num_rows else whole.take(np.sort(first))


def read_rows(directory: Path) -> list[dict[str, Any]]:
    """Return all rows in ``directory``, as `read_table` does."""
    rows: list[dict[str, Any]] = read_table(directory).to_pylist()
    return rows


def _part_files(directory: Path) -> list[Path]:
    found = directory.glob("part-*.parquet")
    return sorted(path for path in found if path.stem.removeprefix("part-").isdigit())


def _locked(directory: Path) -> IO[str]:
    try:
        directory.mkdir(parents=True, exist_ok=True)
        lock = (directory / _LOCK).open("w", encoding="utf-8")
    except OSError as error:
        raise KeptError(f"rows cannot be written to {directory}: {reason(error)}") from None
    if not hold(lock):
        lock.close()
        raise KeptError(
            f"another campaign is running in {directory}; wait for its end, or choose another directory"
        )
    return lock


def _table(row: Mapping[str, Any]) -> "pa.Table":
    import pyarrow as pa

    try:
        return pa.Table.from_pylist([_bare(dict(row))])
    except (pa.ArrowException, TypeError) as error:
        raise ValueError(f"the row cannot be stored in a table ({error}); return texts and numbers") from None


def _unified(*schemas: "pa.Schema") -> "pa.Schema":
    import pyarrow as pa

    try:
        return pa.unify_schemas(schemas, promote_options="permissive")
    except pa.ArrowException as error:
        raise ValueError(
            f"the row has other types than the rows before ({error}); return the same types"
        ) from None


def _bare(value: Any) -> Any:
    """Return ``value`` without empty dictionaries, which Parquet cannot store."""
    if isinstance(value, dict):
        return {name: _bare(one) for name, one in value.items()} or None
    return [_bare(one) for one in value] if isinstance(value, list | tuple) else value


def _write(table: "pa.Table", path: Path) -> None:
    """Write a part under a temporary name, and rename it when it is complete on the disk.

    Raises KeptFailed if this fails.
    """
    import pyarrow.parquet as pq

    hidden = path.with_name(f".{path.name}")
    try:
        with whole(hidden, path), hidden.open("wb") as file:
            pq.write_table(table, file)
            file.flush()
            os.fsync(file.fileno())
        with _opened(path.parent) as folder:
            os.fsync(folder)
    except OSError as error:
        raise KeptFailed(
            f"no more rows can be written to {path.parent}: {disk_reason(error)}; then run the same command again"
        ) from None


@contextlib.contextmanager
def _opened(folder: Path) -> Iterator[int]:
    number = os.open(folder, os.O_RDONLY)
    try:
        yield number
    finally:
        os.close(number)
