"""A log of CAN frames of any form that is known: the ending says which, and its clock must be one."""

from __future__ import annotations

from collections.abc import Callable
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Final

import numpy as np

from bench_protocol.account import Account
from drivers.can_files.asc import read_asc
from drivers.can_files.candump import Stamps, read_candump
from drivers.can_files.frames import CanLogError, Frames
from drivers.can_files.text import UNKNOWN, lines_of
from drivers.can_files.trc import read_trc

ENDINGS: Final = (".blf", ".asc", ".log", ".trc")
#: What may hold frames beside columns.
MDF_ENDINGS: Final = (".mf4", ".mdf")
_PACKED: Final = ".gz"
#: What is said of those that are not read.
OTHER_FORMS: Final = f"known are {', '.join(ENDINGS)}, which the programs that write others can often export"
_OTHERS: Final = {
    "***BUSMASTER": "a log of BUSMASTER",
    "Time Stamp,ID,Extended": "a log of SavvyCAN",
    "timestamp,arbitration_id,": "a log of python-can as CSV",
    "date ": "in the form of ASC",
    ";$FILEVERSION": "in the form of .trc",
}
_SECOND: Final = 10**9
_DISORDER: Final = 10 * 10**6  #: ns by which interfaces that are read in turn may be out of order
_LEAP: Final = 86_400 * _SECOND
_PAUSE: Final = 50  #: usual intervals without a frame that are told, if they take a second
_UNIX: Final = 10**17  #: ns; earlier times count from the beginning of something


def ending_of(path: Path) -> str:
    """Return the ending that says the form, in small letters; that of what is packed."""
    ending = path.suffix.lower()
    return Path(path.stem).suffix.lower() if ending == _PACKED else ending


def read_log(path: Path, account: Account, stamps: Stamps | None = None) -> Frames:
    """Return the data frames of a log, in the order of their times; all else is counted in ``account``.

    ``stamps`` says how those of a candump are meant, where the file does not. CanLogError for what is no log, for one
    without a frame, and for a clock that goes back or leaps.
    """
    ending = ending_of(path)
    if ending not in (*ENDINGS, *MDF_ENDINGS):
        raise CanLogError(
            f"{path} ends in {ending or 'nothing'}; files of CAN frames end in {', '.join(ENDINGS)}, or these and .gz"
        )
    if ending == ".blf":
        from drivers.can_files.blf import read_blf  # it imports python-can

        frames = read_blf(path, account)
    elif ending in MDF_ENDINGS:
        from drivers.can_files.mdf import read_mdf_frames

        frames = read_mdf_frames(path, account)
    elif ending == ".log":
        frames = read_candump(path, account, stamps)
    else:
        reader: Callable[[Path, Account], Frames] = read_asc if ending == ".asc" else read_trc
        frames = reader(path, account)
    if not len(frames):
        raise CanLogError(_without(path, ending, account))
    _check_clock(path, frames, account)
    return frames


def _without(path: Path, ending: str, account: Account) -> str:
    """Return why a file gave no frame."""
    if UNKNOWN not in account.counts:
        told = f" ({account.left_out})" if account.counts else ""
        return f"{path} holds no data frame{told}"
    if what := log_of_others(path):
        return f"{path} is {what}, not of {ending}; {OTHER_FORMS}"
    return f"{path} is not a file of CAN frames as its ending says: {account.first[UNKNOWN]}; {OTHER_FORMS}"


def log_of_others(path: Path) -> str:
    """Return which form of a log that is not read, or not under this ending, a file begins as; empty for any other."""
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
                f"{path}: in {at(worst)} the clock goes back from {shown(worst)} to {shown(worst + 1)}; what lies "
                "before and behind would be mixed up, and a file for each would be right"
            )
        if steps[longest] > _LEAP:
            leap = timedelta(microseconds=int(steps[longest]) // 1000)
            raise CanLogError(
                f"{path}: in {at(longest)} the clock leaps by {leap}, from {shown(longest)} to {shown(longest + 1)}; a "
                "file for each part would be right"
            )
        if steps[worst] < 0:
            _put_in_order(path, frames, times, account)
        usual = float(np.median(np.maximum(steps, 0)))
        if steps[longest] > max(_PAUSE * usual, _SECOND):
            account.take(f"nothing came for {steps[longest] / _SECOND:.6g} s before {at(longest)}")
    if times[0] >= _UNIX:
        began = datetime.fromtimestamp(0, UTC) + timedelta(microseconds=int(times[0]) // 1000)
        account.take(f"the times are of the day; the record begins {began:%Y-%m-%d %H:%M:%S} UTC")


def _put_in_order(path: Path, frames: Frames, times: np.ndarray, account: Account) -> None:
    """Sort frames of which some were written a little late: never those of one identifier."""
    which = np.frombuffer(frames.which, np.dtype("l"))
    order = np.argsort(which, kind="stable")
    same = np.diff(which[order]) == 0
    falls = np.flatnonzero(same & (np.diff(times[order]) < 0))
    if len(falls):
        place = int(order[falls[0] + 1])
        raise CanLogError(
            f"{path}: in {frames.unit} {frames.places[place]} the clock goes back between two frames of one identifier"
        )
    steps = np.diff(times)
    count, late = int((steps < 0).sum()), -int(steps.min()) / 1e6
    account.take(
        f"{count} frames stand up to {late:.3g} ms behind later ones; they are put in the order of their times"
    )
    frames.sort()
