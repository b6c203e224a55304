"""Reservations of a rig by name and time, in a file that outlives restarts of the machine."""

import os
from collections.abc import Callable
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Annotated, Final

import msgspec

from astb.live.door import door_path
from astb.run_queue import locked
from bench_protocol.runtime.own_folder import own_directory
from bench_records.layout import put
from drivers.errors import BenchError

_FILE: Final = "reservations.json"
_MOST: Final = 200
_TEXT_MAX: Final = 100  # characters
_AHEAD: Final = timedelta(days=366)

Moment = Annotated[datetime, msgspec.Meta(tz=True)]


class NotReserved(BenchError):
    """A reservation is impossible, or a reservation of another operator blocks a run. The text states the reason and
    the remedy.
    """


class Reservation(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """From ``start`` until ``end``, only runs of the operator ``by`` may begin."""

    start: Moment
    end: Moment
    by: str
    purpose: str = ""

    def __str__(self) -> str:
        start, end = self.start.astimezone(), self.end.astimezone()
        until = f"{end:%H:%M}" if start.date() == end.date() else f"{end:%Y-%m-%d %H:%M}"
        return f"the reservation of {self.by} from {start:%Y-%m-%d %H:%M} until {until}"

    def overlaps(self, start: datetime, end: datetime) -> bool:
        """Return whether the reservation overlaps the time from ``start`` until before ``end``."""
        return self.start < end and start < self.end


def reservations(rig_file: Path) -> list[Reservation]:
    """Return the present and future reservations of the rig of this file, in order.

    Raises NotReserved for an invalid file.
    """
    path = reservations_folder(rig_file) / _FILE
    try:
        found = msgspec.json.decode(path.read_bytes(), type=list[Reservation])
    except FileNotFoundError:
        return []
    except (OSError, ValueError) as error:
        raise NotReserved(f"reservations {path} cannot be read: {error}; delete this file") from None
    return [one for one in found if one.end > datetime.now(UTC)]


def reserve(rig_file: Path, new: Reservation) -> None:
    """Add a reservation. Raises NotReserved if its texts or times are invalid, or if it overlaps another one."""
    if not new.by.strip() or not all(
        len(text) <= _TEXT_MAX and text.isprintable() for text in (new.by, new.purpose)
    ):
        raise NotReserved(
            f"the name {new.by[:_TEXT_MAX]!r} or the purpose {new.purpose[:_TEXT_MAX]!r} is not valid; write a name, "
            f"and for each at most {_TEXT_MAX} characters in one line"
        )
    now = datetime.now(UTC)
    if not (now - _AHEAD < new.start < new.end < now + _AHEAD and now < new.end):
        raise NotReserved(
            f"a reservation from {new.start.isoformat()} until {new.end.isoformat()} is not possible; the end "
            f"must be after the start and after now, and both within {_AHEAD.days} days from now"
        )

    def added(known: list[Reservation]) -> list[Reservation]:
        for other in known:
            if other.overlaps(new.start, new.end):
                raise NotReserved(f"the time overlaps {other}; choose another time, or remove that one")
        if len(known) >= _MOST:
            raise NotReserved(f"the rig has {_MOST} reservations already; remove one")
        return sorted([*known, new], key=lambda one: one.start)

    _change(rig_file, added)


def cancel(rig_file: Path, start: datetime) -> None:
    """Remove the reservation that begins at ``start``, if there is one."""
    _change(rig_file, lambda known: [one for one in known if one.start != start])


def reserved_for_others(rig_file: Path, by: str, lasts: float) -> list[Reservation]:
    """Return the reservations of others that overlap a run of ``by`` that begins now and takes ``lasts`` s."""
    now = datetime.now(UTC)
    end = now + timedelta(seconds=max(lasts, 1.0))
    return [
        one
        for one in reservations(rig_file)
        if one.overlaps(now, end) and one.by.strip().casefold() != by.strip().casefold()
    ]


def reservations_folder(rig_file: Path) -> Path:
    """Return the folder with the reservations of the rig of this file."""
    state = Path(os.environ.get("XDG_STATE_HOME") or Path.home() / ".local" / "state")
    return state / "astb" / door_path(rig_file).with_suffix(".reservations").name


def _change(rig_file: Path, change: Callable[[list[Reservation]], list[Reservation]]) -> None:
    folder = reservations_folder(rig_file)
    try:
        folder.parent.mkdir(parents=True, exist_ok=True)
        own_directory(folder)
        with locked(folder):
            put(folder / _FILE, msgspec.json.encode(change(reservations(rig_file))))
    except OSError as error:
        raise NotReserved(f"reservations in {folder} cannot be written: {error}; check this folder") from None
