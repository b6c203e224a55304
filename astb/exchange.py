"""Records to and from the files of other programs: the ending of the file's name says which."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import chain
from pathlib import Path
from shutil import rmtree
from typing import TYPE_CHECKING, Any, Final

from bench_protocol.account import Account
from bench_records.checksums import FRAMES, sha256_of, write_sums
from bench_records.layout import RecordError
from drivers.can_log import ENDINGS as FRAME_ENDINGS
from drivers.can_log import CanLogError, read_frames, write_frames

if TYPE_CHECKING:
    from bench_protocol.frames import Block
    from bench_records.layout import SignalInfo

TABLE_ENDINGS: Final = (".csv", ".mf4")
#: What a signal of somebody's DBC may be called in a record: the table of signals has no message names.
_OF_DBC: Final = "{message}.{signal}"


def export_run(directory: Path, target: Path, rate: float, names: Sequence[str]) -> str:
    """Write the run in ``directory`` as ``target``; return in words what was written.

    CSV has ``rate`` rows a second; MDF 4 every sample; files of CAN frames those that the run kept, all of them.
    RecordError for what cannot be; OSError for a file that cannot be written.
    """
    ending = _known_ending(target)
    if ending in FRAME_ENDINGS:
        if names:
            raise RecordError("frames are exported as they were on the bus: --signal is for CSV and MDF")
        source = directory / FRAMES
        if not source.exists():
            raise RecordError(f"{directory} kept no CAN frames; `astb run --keep-frames` does")
        if target.exists() and target.samefile(source):
            raise RecordError(
                f"{target} is what the run kept itself, and stays as it is; choose another file"
            )
        return f"{write_frames(read_frames(source), target)} frames"
    from bench_records.exchange import write_csv, write_mdf
    from bench_records.record import read

    record = read(directory)
    if ending == ".csv":
        return f"{write_csv(record, target, rate, names)} rows"
    return f"{write_mdf(record, target, names)} samples"


def import_file(source: Path, directory: Path, dbc: Path | None = None) -> str:
    """Make a run of a file in the new ``directory``; return in words what came in and what was left out.

    A file of CAN frames is read with our own messages, or with those of a DBC: then its signals are called
    MESSAGE.SIGNAL, in the units of the DBC. RecordError for what cannot be.
    """
    ending = _known_ending(source)
    if not source.is_file():
        raise RecordError(f"{source} is no file")
    if dbc is not None and ending not in FRAME_ENDINGS:
        raise RecordError(f"--dbc is for files of CAN frames ({', '.join(FRAME_ENDINGS)}), not for {source}")
    if directory.exists() and any(directory.iterdir()):
        raise RecordError(f"{directory} is not empty; nothing there is overwritten")
    account = Account()
    meta = {"imported": {"file": source.name, "sha256": sha256_of(source)}}
    try:
        if ending in FRAME_ENDINGS:
            count = _import_frames(source, directory, dbc, meta, account)
        else:
            from bench_records.exchange import read_csv, read_mdf

            reader = read_csv if ending == ".csv" else read_mdf
            count = reader(source, directory, _known_signals().get, meta, account)
    except BaseException:
        rmtree(directory, ignore_errors=True)  # it was new or empty: half a record is none
        raise
    _conclude(source, directory, account)
    return "\n  ".join([f"{count} samples", *account.lines()])


def _conclude(source: Path, directory: Path, account: Account) -> None:
    """Write the result of a run that nobody judged here, so that report and index know it."""
    from bench_records.report import write_report
    from bench_records.result import conclude

    title = f"Imported from {source.name}"
    reason = "imported: nothing was judged here"
    conclude("imported", title, "", [], reason=reason, warnings=account.lines()).write(directory)
    write_sums(directory)
    write_report(directory)


def _import_frames(
    source: Path, directory: Path, dbc: Path | None, meta: dict[str, Any], account: Account
) -> int:
    from bench_records.recorder import Recorder

    try:
        blocks = read_frames(source)
        first = next(blocks, None)
        if first is None:
            raise RecordError(f"{source} holds no data frame")
        start = int(first["time"][0])
        signals, samples = _decoded(chain([first], blocks), dbc)
        with Recorder(directory, signals, meta, start_ns=start, in_background=False) as recorder:
            for times, rows, values in samples:
                recorder.append(times, rows, values)
            count = recorder.samples
            recorder.close(**account.as_meta())
    except CanLogError as error:
        raise RecordError(str(error)) from None
    if not count:
        whose = dbc or "the bench's own messages"
        raise RecordError(f"no frame of {source} is one of {whose}; --dbc names the messages of another rig")
    return count


def _decoded(
    blocks: Iterator[Block], dbc: Path | None
) -> tuple[list[SignalInfo], Iterator[tuple[Any, Any, Any]]]:
    if dbc is not None:
        return _decoded_by_dbc(blocks, dbc)
    import numpy as np

    from bench_protocol.can_codec import Decoder
    from bench_protocol.table import TABLE
    from test_plans.recording import recorded_signals

    known = recorded_signals(TABLE)
    column = np.full(len(TABLE.signals), -1, np.int16)
    column[list(known)] = np.arange(len(known))
    decoder = Decoder(TABLE, from_rig=True)

    def samples() -> Iterator[tuple[Any, Any, Any]]:
        for block in blocks:
            found = decoder.decode(block)
            rows = column[found.signals]
            yield found.times[rows >= 0], rows[rows >= 0], found.values[rows >= 0]

    return list(known.values()), samples()


def _decoded_by_dbc(
    blocks: Iterator[Block], dbc: Path
) -> tuple[list[SignalInfo], Iterator[tuple[Any, Any, Any]]]:
    import cantools
    import numpy as np

    from bench_protocol.socketcand import iterate
    from bench_records.layout import SignalInfo

    try:
        base = cantools.database.load_file(dbc)
    except (
        Exception
    ) as error:  # a file that is missing, or none that cantools reads: it has many names for it
        raise RecordError(f"{dbc} cannot be read as a DBC: {error}") from None
    if not isinstance(base, cantools.database.Database):
        raise RecordError(f"{dbc} describes diagnostics, not messages on a bus")
    signals: list[SignalInfo] = []
    index: dict[tuple[str, str], int] = {}
    for message in base.messages:
        for signal in message.signals:
            name = _OF_DBC.format(message=message.name, signal=signal.name)
            index[message.name, signal.name] = len(signals)
            words = {int(key): str(text) for key, text in (signal.choices or {}).items()}
            unit = signal.unit or ""
            quantity = "" if words else f"{message.name}, {unit or 'no unit'}"
            signals.append(SignalInfo(name, unit, 1.0, name, quantity, words))
    known = {(one.frame_id, bool(one.is_extended_frame)): one for one in base.messages}

    def samples() -> Iterator[tuple[Any, Any, Any]]:
        for block in blocks:
            rows = [
                (time, index[message.name, name], value)
                for time, identifier, extended, data in iterate(block)
                if (message := known.get((identifier, extended))) is not None
                for name, value in _values(message, data)
            ]
            if rows:
                yield tuple(np.array(column) for column in zip(*rows, strict=True))  # type: ignore[misc]

    return signals, samples()


def _values(message: Any, data: bytes) -> Iterator[tuple[str, float]]:
    """The numbers in a frame; one that is too short for its message has those that fit."""
    try:
        found = message.decode(data, decode_choices=False, allow_truncated=True)
    except Exception:  # a multiplexer that the DBC does not know: cantools has several names for it
        return
    for name, value in found.items():
        if isinstance(value, int | float):
            yield name, float(value)


def _known_signals() -> dict[str, SignalInfo]:
    from bench_protocol.table import TABLE
    from test_plans.recording import recorded_signals

    return {one.name: one for one in recorded_signals(TABLE).values()}


def _known_ending(path: Path) -> str:
    ending = path.suffix.lower()
    if ending not in (*TABLE_ENDINGS, *FRAME_ENDINGS):
        raise RecordError(
            f"{path} ends in {ending or 'nothing'}; known are {', '.join((*TABLE_ENDINGS, *FRAME_ENDINGS))}"
        )
    return ending
