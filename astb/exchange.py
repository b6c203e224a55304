"""Conversion of records to and from the files of other programs, in all known formats."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import fields
from pathlib import Path
from shlex import quote
from shutil import rmtree
from typing import TYPE_CHECKING, Any, Final

from astb.frames_import import LogKeys, read_frames_of
from bench_protocol.account import Account
from bench_protocol.file_forms import FileForm, ending_of, endings, form_of
from bench_protocol.table import TABLE
from bench_records.checksums import FRAMES, sha256_of, write_sums
from bench_records.layout import RecordError
from bench_records.record import read
from bench_records.recorder import Recorder
from bench_records.report import write_report
from bench_records.result import conclude
from bench_records.tables import forms as tables
from bench_records.tables.keys import FileKeys
from drivers.can_files import reading
from drivers.can_log import read_frames, write_frames
from test_plans.recording import recorded_signals

if TYPE_CHECKING:
    from bench_records.layout import SignalInfo

#: All formats of files. Tables come first, because an MDF file is a table unless a DBC describes its frames.
FORMS: Final = (*tables.FORMS, *reading.FORMS)
#: A key of a map that is a key of `astb import --table`, too.
_KEY: Final = re.compile(rf"\bfile\.({'|'.join(FileKeys.__struct_fields__)})\b")
_SET_KEY: Final = re.compile(_KEY.pattern + r' = "([^"]*)"')


def export_run(directory: Path, target: Path, rate: float, names: Sequence[str]) -> str:
    """Write the run in ``directory`` as ``target``; return a summary as text.

    Tables have ``rate`` rows per second. MDF 4 has every sample. CAN logs have all frames that the run recorded. Raises
    RecordError for an impossible export. Raises OSError for a file that cannot be written.
    """
    form = _known_form(target, [one for one in FORMS if one.write is not None])
    if form in reading.FORMS:
        if names:
            raise RecordError(
                f"--signal does not apply to the CAN log {target}; omit it, or choose a table or MDF 4"
            )
        source = directory / FRAMES
        if not source.exists():
            raise RecordError(f"{directory} has no CAN frames; record them with `astb run --keep-frames`")
        if target.exists() and target.samefile(source):
            raise RecordError(
                f"{target} is the file of the run itself and is not overwritten; choose another file"
            )
        return f"{write_frames(read_frames(source), target)} frames"
    assert form.write is not None
    count = form.write(read(directory), target, rate, names)
    return f"{count} {'samples' if form.name == 'mdf' else 'rows'}"


def import_file(source: Path, directory: Path, keys: LogKeys | None = None, table: Sequence[str] = ()) -> str:
    """Convert a file to a run in the new ``directory``; return a summary of imported and skipped data as text.

    A CAN log is decoded with our own messages or with those of a DBC. With a DBC, the signals are called MESSAGE.SIGNAL
    and have its units. ``keys`` state how to read the log. ``table`` are keys for the reader of tables, as KEY=VALUE.
    Raises RecordError for an impossible import.
    """
    form = _known_form(source, [one for one in FORMS if one.read is not None])
    if not source.is_file():
        raise RecordError(f"{source} does not exist; check the path")
    keys = keys or LogKeys()
    as_table = any(text.partition("=")[0].strip() == "format" for text in table)
    frames = not as_table and reading.frames_form(source, keys.dbc is not None) is not None
    _refuse_idle_keys(source, keys, table, frames)
    if not frames and not as_table and (what := reading.log_of_others(source)):
        raise RecordError(f"{source} is {what}, not a table of samples; {reading.OTHER_FORMS}")
    if directory.exists() and any(directory.iterdir()):
        raise RecordError(f"{directory} is not empty; choose a new or empty folder")
    account = Account()
    meta = {"imported": {"file": source.name, "sha256": sha256_of(source)}}
    try:
        if frames:
            count = _import_frames(source, directory, keys, meta, account)
        else:
            from bench_records.importing import import_keys, read_mdf, read_table

            reader = read_mdf if form.name in ("mdf", "MDF") else read_table
            try:
                count = reader(source, directory, _known_signals().get, meta, account, import_keys(table))
            except RecordError as error:
                raise RecordError(_as_options(str(error))) from None
    except BaseException:
        rmtree(directory, ignore_errors=True)  # it was new or empty, and an incomplete record is useless
        raise
    _conclude(source, directory, account)
    return "\n  ".join([f"{count} samples", *account.lines()])


def _as_options(text: str) -> str:
    """Return an error message with the options of the import instead of the keys of a map."""
    text = _SET_KEY.sub(lambda found: f"--table {quote(f'{found[1]}={found[2]}')}", text)
    text = _KEY.sub(r"--table \1", text).replace(" or thousands", " or --table thousands")
    return text.replace("time.unit", "--table time_unit").replace(": time.column:", ":")


def _refuse_idle_keys(source: Path, keys: LogKeys, table: Sequence[str], frames: bool) -> None:
    """Raise RecordError for a key without effect on this kind of file."""
    if frames:
        idle = {
            "--table": (table, f"only for tables and MDF files, not for the frames in {source}"),
            "--charset": (keys.charset and keys.dbc is None, "only for a DBC; give --dbc, too"),
            "--stamps": (
                keys.stamps and ending_of(source) != ".log",
                f"only for logs of candump (.log); {source} defines its time stamps itself",
            ),
        }
    else:
        known = ", ".join(endings([one for one in reading.FORMS if one.write is not None]))
        where = f"only for files of CAN frames ({known}, or .mf4 with --dbc), not for {source}"
        idle = {f"--{one.name}": (getattr(keys, one.name) is not None, where) for one in fields(keys)}
    for option, (given, why) in idle.items():
        if given:
            raise RecordError(f"{option} is {why}")


def _conclude(source: Path, directory: Path, account: Account) -> None:
    """Write result, checksums and report of an imported run, so that it is listed like other runs.

    It has no verdict.
    """
    title = f"Imported from {source.name}"
    reason = "imported: nothing was judged here"
    conclude("imported", title, "", [], reason=reason, warnings=account.lines()).write(directory)
    write_sums(directory)
    write_report(directory)


def _import_frames(
    source: Path, directory: Path, keys: LogKeys, meta: dict[str, Any], account: Account
) -> int:
    log = read_frames_of(source, keys, account)
    with Recorder(directory, log.signals, meta, start_ns=log.start, in_background=False) as recorder:
        for times, rows, values in log.samples():
            recorder.receive(times, rows, values)
        count = recorder.samples
        recorder.close(**account.as_meta())
    if not count:
        dbc = keys.dbc or "the bench"
        raise RecordError(f"no frame of {source} has a value that {dbc} describes; give its DBC with --dbc")
    return count


def _known_signals() -> dict[str, SignalInfo]:
    return {one.name: one for one in recorded_signals(TABLE).values()}


def _known_form(path: Path, forms: Sequence[FileForm]) -> FileForm:
    form = form_of(path, forms)
    if form is None and path.is_file() and (how := tables.export_of(path)):
        raise RecordError(f"{path}: files of this format cannot be read; convert the file to a table: {how}")
    if form is None:
        known = ", ".join(endings(forms))
        raise RecordError(
            f"{path} has the ending {ending_of(path) or '(none)'}; the known endings are {known}"
        )
    return form
