"""Reads MDF files: channels by name and group. Each channel has the clock of its group."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from bench_protocol.extras import lacking, no_destructor_errors
from bench_protocol.input_limits import COLUMNS, SAMPLES_BYTES, check_mdf, check_size
from bench_protocol.os_errors import file_errors
from bench_protocol.suggestion import did_you_mean
from bench_records.layout import SECOND, RecordError

if TYPE_CHECKING:
    import numpy as np
    import numpy.typing as npt

    from bench_protocol.account import Account
    from bench_records.tables.keys import ColumnName

    Numbers = npt.NDArray[np.float64]

#: Type code of a clock in time units; 0 if a file does not state the type.
_TIME: Final = (0, 1)
#: Type code of a channel with samples of variable length in another block.
_OF_ANY_LENGTH: Final = 1
#: Names of the channels of frames in the standard for raw bus logging.
_BUSES: Final = ("CAN_", "LIN_", "FLX_", "ETH_", "MOST_", "USB_")


@dataclass(frozen=True)
class ChannelPlace:
    """The position of a channel in the file."""

    group: int
    index: int
    name: str
    title: str  #: of the group, in words
    called: str  #: the name of its group


@contextmanager
def opened(path: Path) -> Iterator[Any]:
    """Open an MDF file for a ``with`` block. Raises RecordError if asammdf is not installed, or if the file is not
    MDF.
    """
    try:
        from asammdf import MDF
    except ImportError:
        raise RecordError(f"{path}: {lacking('mdf', 'MDF files')}") from None
    with file_errors(path, RecordError):
        check_size(path, SAMPLES_BYTES)
        with path.open("rb") as file:
            begins = file.read(3)
    if begins not in (b"MDF", b"UnF"):
        raise RecordError(
            f"{path} is not an MDF file: it does not begin with MDF; use the ending of its format"
        )
    with no_destructor_errors():
        mdf = _open_or_none(MDF, path)
    if mdf is None:
        raise RecordError(f"{path} is damaged, or asammdf cannot read this kind of MDF file; export it again")
    with mdf:
        with file_errors(path, RecordError):
            check_mdf(path, mdf.groups)
        yield mdf


def _open_or_none(kind: Any, path: Path) -> Any:
    try:
        return kind(path)
    except Exception:  # asammdf has its own exception and raises others, too
        return None


def places(path: Path, mdf: Any, account: Account) -> list[ChannelPlace]:
    """Return all channels except clocks and bus frames. Groups of bus frames are counted in ``account``."""
    if sum(len(group.channels) for group in mdf.groups) > COLUMNS:
        raise RecordError(f"{path} has more than {COLUMNS} channels; export fewer")
    found = []
    for number, group in enumerate(mdf.groups):
        if holds_frames(group):
            account.leave_out("group(s) of frames on a bus, which --dbc decodes", 1, f"group {number}")
            continue
        head = group.channel_group
        called = str(getattr(head, "acq_name", "") or getattr(head, "comment", "") or "").strip()
        title = f'group {number} ("{called}")' if called and len(called) < 60 else f"group {number}"
        found += [
            ChannelPlace(number, index, channel.name, title, called)
            for index, channel in enumerate(group.channels)
            if index != mdf.masters_db.get(number)
        ]
    return found


def holds_frames(group: Any) -> bool:
    """Return whether a group contains raw bus frames."""
    return any(channel.name.startswith(_BUSES) for channel in group.channels)


def find(known: list[ChannelPlace], column: ColumnName, group: ColumnName | None, where: str) -> ChannelPlace:
    """Return the only channel called ``column``. Raises RecordError, with the groups, if there are several or none."""
    if isinstance(column, int):
        raise RecordError(
            f"{where} = {column}: name the channel of an MDF file, because channels have no numbers"
        )
    named = [one for one in known if one.name == column]
    chosen = [one for one in named if group is None or group in (one.group, one.called)]
    if len(chosen) == 1:
        return chosen[0]
    if len(chosen) > 1:
        groups = ", ".join(one.title for one in chosen)
        raise RecordError(
            f'{where} = "{column}": there are {len(chosen)} such channels, in {groups}; '
            f"choose one by group, such as group = {chosen[0].group}"
        )
    if named:
        groups = ", ".join(one.title for one in named)
        raise RecordError(f'{where} = "{column}" is not in group {group!r}; its groups are {groups}')
    names = sorted({one.name for one in known})
    raise RecordError(f'{where} = "{column}" is not a channel of the file; {did_you_mean(column, names)}')


def samples(
    path: Path,
    mdf: Any,
    place: ChannelPlace,
    raw: bool,
    account: Account,
    texts: Mapping[str, int] | None = None,
) -> tuple[Numbers, Numbers, str]:
    """Return times (n,), values (n,) and unit of a channel. ``texts`` maps each text value to a number. With ``raw``,
    the values are those in the file, without their conversion.

    Raises RecordError, with file and group, if a value is not a number, or if the clock is not a time.
    """
    import numpy as np

    where = f"{path}: the channel {place.name} of {place.title}"
    group = mdf.groups[place.group]
    master = mdf.masters_db.get(place.group)
    if master is None or getattr(group.channels[master], "sync_type", 1) not in _TIME:
        raise RecordError(f"{where} has no clock in seconds; choose a channel of a group with one")
    if getattr(group.channels[place.index], "channel_type", 0) == _OF_ANY_LENGTH:
        raise RecordError(f"{where} has texts or bytes of variable length; choose a channel of numbers")
    try:
        signal = mdf.get(group=place.group, index=place.index, raw=raw)
    except Exception:  # asammdf has its own exception and raises others, too
        raise RecordError(
            f"{where} cannot be read; export the file again, or choose another channel"
        ) from None
    values, times = signal.samples, np.asarray(signal.timestamps, np.float64)
    lost = int(group.channel_group.cycles_nr) - len(times)
    account.leave_out("sample(s) that the file itself calls invalid", lost, f"{place.name}, {place.title}")
    if values.ndim != 1 or values.dtype.names:
        raise RecordError(f"{where} has more than one number per sample; choose a channel of single numbers")
    if values.dtype.kind in "iufb":
        return times, values.astype(np.float64), str(signal.unit or "")
    words = [_decoded(one) for one in values]
    if texts is not None and set(words) <= set(texts):
        return times, np.array([texts[one] for one in words], np.float64), ""
    some = ", ".join(f'"{one}"' for one in sorted(set(words))[:3])
    raise RecordError(
        f"{where} has texts, such as {some}; to read the raw numbers, give raw = true for this column"
    )


def _decoded(value: Any) -> str:
    return value.decode("utf-8", "replace").rstrip("\0") if isinstance(value, bytes) else str(value)


def start_of(mdf: Any) -> int | None:
    """Return the start time of the file (ns since 1970), or None if its header has no plausible time."""
    begin = getattr(mdf.header, "start_time", None)
    if begin is None or begin.year < 1980:
        return None
    return round(begin.timestamp() * 1e6) * (SECOND // 1_000_000)
