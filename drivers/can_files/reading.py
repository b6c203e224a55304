"""Reading of CAN logs in all supported formats. The file name ending selects the format."""

from __future__ import annotations

from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any, Final

import numpy as np

from bench_protocol.account import Account
from bench_protocol.file_forms import FileForm, ending_of, endings, form_of
from drivers.can_files.asc import read_asc
from drivers.can_files.candump import Stamps, read_candump
from drivers.can_files.frames import CanLogError, Frames
from drivers.can_files.gvret import is_gvret, read_gvret
from drivers.can_files.mdf import read_mdf_frames
from drivers.can_files.text import UNKNOWN, lines_of
from drivers.can_files.trc import read_trc


def _blf(path: Path, account: Account, _: Stamps | None) -> Frames:
    from drivers.can_files.blf import read_blf  # it imports python-can

    return read_blf(path, account)


def _writer(path: Path) -> Any:
    import can

    return can.Logger(path)


#: The reader returns frames; its arguments are a path, an account, and the meaning of the stamps of a candump. The
#: writer returns a writer of python-can. MDF files may hold frames in addition to columns.
FORMS: Final = (
    FileForm("BLF", (".blf",), _blf, _writer),
    FileForm("ASC", (".asc",), lambda path, account, _: read_asc(path, account), _writer),
    FileForm("candump", (".log",), read_candump, _writer),
    FileForm("TRC", (".trc",), lambda path, account, _: read_trc(path, account), _writer),
    FileForm("GVRET", (), lambda path, account, _: read_gvret(path, account), recognises=is_gvret),
    FileForm("MDF", (".mf4", ".mdf"), lambda path, account, _: read_mdf_frames(path, account)),
)
#: Text for logs of other formats.
_ENDINGS: Final = ", ".join(endings([one for one in FORMS if one.write is not None]))
OTHER_FORMS: Final = f"use one of {_ENDINGS}; most programs can export one of them"
_OTHERS: Final = {
    "***BUSMASTER": "a log of BUSMASTER",
    "timestamp,arbitration_id,": "a log of python-can as CSV",
    "date ": "in the form of ASC",
    ";$FILEVERSION": "in the form of .trc",
}
_SECOND: Final = 10**9
_DISORDER: Final = 10 * 10**6  #: ns by which frames may be out of order, because interfaces are read in turn
_LEAP: Final = 86_400 * _SECOND
_PAUSE: Final = (
    50  #: number of usual intervals without a frame that is reported as a gap, if it lasts a second
)
_UNIX: Final = 10**17  #: ns; earlier times do not count from 1970


def frames_form(path: Path, dbc: bool) -> FileForm | None:
    """Return the format of a log of CAN frames; None for any other file.

    An MDF file counts as a log only with a ``dbc``, because it may have columns instead of frames.
    """
    form = form_of(path, FORMS)
    return form if form is None or form.write is not None or form.recognises is not None or dbc else None


def read_log(path: Path, account: Account, stamps: Stamps | None = None) -> Frames:
    """Return the data frames of a log, in order of time; other entries are counted in ``account``.

    ``stamps`` gives the meaning of the stamps of a candump, if the file does not state it. Raises CanLogError for
    another format, for a log without a frame, and for time stamps that jump by more than a day, or decrease by more
    than 10 ms or between frames of one identifier.
    """
    form = form_of(path, FORMS)
    if form is None or form.read is None:
        raise CanLogError(
            f"{path} ends in {ending_of(path) or 'nothing'}; use a file of CAN frames with one of the "
            f"endings {_ENDINGS}, also with .gz"
        )
    frames: Frames = form.read(path, account, stamps)
    if not len(frames):
        raise CanLogError(_explain_no_frames(path, ending_of(path), account))
    _check_clock(path, frames, account)
    return frames


def _explain_no_frames(path: Path, ending: str, account: Account) -> str:
    """Return why a file has no frame, as text."""
    if UNKNOWN not in account.counts:
        skipped = f" ({account.left_out})" if account.counts else ""
        return f"{path} holds no data frame{skipped}"
    if what := log_of_others(path):
        return f"{path} is {what}, not of {ending}; {OTHER_FORMS}"
    return f"{path} is not a file of CAN frames as its ending says: {account.first[UNKNOWN]}; {OTHER_FORMS}"


def log_of_others(path: Path) -> str:
    """Return the format of an unsupported or wrongly named log, detected by its first bytes; "" if unknown."""
    try:
        first = next(lines_of(path, Account()), None)
    except CanLogError:
        return ""
    return next((what for begin, what in _OTHERS.items() if first and first.text.startswith(begin)), "")


def _check_clock(path: Path, frames: Frames, account: Account) -> None:
    times = np.frombuffer(frames.times, np.int64)
    steps = np.diff(times)

    def at(step: int) -> str:
        return f"{frames.unit} {frames.places[step + 1]}"

    def shown(index: int) -> str:
        return f"{times[index] / _SECOND:.6f} s"

    if len(steps):
        worst, longest = int(np.argmin(steps)), int(np.argmax(steps))
        if steps[worst] < -_DISORDER:
            raise CanLogError(
                f"{path}: in {at(worst)} the clock goes back from {shown(worst)} to {shown(worst + 1)}; "
                "split the file there, and read each part alone"
            )
        if steps[longest] > _LEAP:
            leap = timedelta(microseconds=int(steps[longest]) // 1000)
            raise CanLogError(
                f"{path}: in {at(longest)} the clock leaps by {leap}, from {shown(longest)} to "
                f"{shown(longest + 1)}; split the file there, and read each part alone"
            )
        if steps[worst] < 0:
            _put_in_order(path, frames, times, account)
        usual = float(np.median(np.maximum(steps, 0)))
        if steps[longest] > max(_PAUSE * usual, _SECOND):
            account.take(f"there are no frames for {steps[longest] / _SECOND:.6g} s before {at(longest)}")
    if times[0] >= _UNIX:
        began = datetime.fromtimestamp(0, UTC) + timedelta(microseconds=int(times[0]) // 1000)
        zone = (
            "by the clock of the computer that wrote the file, which names no zone" if frames.local else "UTC"
        )
        account.take(f"the times are of the day; the record begins {began:%Y-%m-%d %H:%M:%S} {zone}")


def _put_in_order(path: Path, frames: Frames, times: np.ndarray, account: Account) -> None:
    """Sort frames that were written slightly late. Raises CanLogError if frames of one identifier are out of order."""
    which = np.frombuffer(frames.which, np.dtype("l"))
    order = np.argsort(which, kind="stable")
    same = np.diff(which[order]) == 0
    falls = np.flatnonzero(same & (np.diff(times[order]) < 0))
    if len(falls):
        place = int(order[falls[0] + 1])
        raise CanLogError(
            f"{path}: in {frames.unit} {frames.places[place]} the clock goes back between two frames "
            "of one identifier; split the file there, and read each part alone"
        )
    steps = np.diff(times)
    count, late = int((steps < 0).sum()), -int(steps.min()) / 1e6
    account.take(f"{count} frames come up to {late:.3g} ms too late in the file; they are sorted by time")
    frames.sort()
