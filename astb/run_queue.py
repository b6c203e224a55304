"""The queue of runs on one rig: a folder of tickets, each locked by the process that waits or runs.

A lock ends with its process, so a ticket without a lock is void. The folder belongs to one user of this machine, like
the control socket of a run (`astb.live.door`). The rig still decides who commands it: the queue only orders the runs.
"""

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Final, TypeVar

import msgspec
from msgspec.structs import replace

from astb.live.door import door_path
from bench_protocol.clock import RealClock
from bench_protocol.runtime.file_locks import hold
from bench_protocol.runtime.own_folder import own_directory
from bench_protocol.units import NS, s

T = TypeVar("T")
#: Interval between two checks of the tickets and reservations.
_LOOK: Final = 1 * s


class Ticket(msgspec.Struct, frozen=True):
    """A run that waits, or that has the rig since ``since``; ``lasts`` is the stated time of its plans (s)."""

    by: str
    plans: list[str]
    lasts: float
    since: datetime

    def __str__(self) -> str:
        end = self.since + timedelta(seconds=self.lasts)
        about = f", until about {end.astimezone():%H:%M}" if self.lasts else ""
        return f"{self.by} with {', '.join(self.plans)} since {self.since.astimezone():%H:%M}{about}"


def queue_path(rig_file: Path) -> Path:
    """Return the folder with the tickets of the rig of this file."""
    return door_path(rig_file).with_suffix(".queue")


@contextmanager
def queued(
    rig_file: Path, plans: list[str], lasts: float, by: str, told: Callable[[list[Ticket]], None] | None
) -> Iterator[None]:
    """Keep a ticket for the rig while the block lasts.

    With ``told``, wait first until no ticket precedes it; ``told`` gets the earlier tickets at each change.
    """
    folder = queue_path(rig_file)
    mine = folder / f"{datetime.now(UTC):%Y%m%dT%H%M%S.%f}-{os.getpid()}"
    ticket = Ticket(by, plans, lasts, datetime.now(UTC))
    try:
        own_directory(folder.parent)
        own_directory(folder)
        # The lock of the folder prevents that another process sees the ticket before it is locked and complete.
        with locked(folder):
            file = mine.open("xb")
            hold(file)
            mine.write_bytes(msgspec.json.encode(ticket))
    except OSError:
        if told:
            raise
        yield  # a run without --wait needs no place
        return
    with file:
        try:
            if told:
                wait_while(lambda: _tickets_before(folder, mine), told)
            with locked(folder):
                mine.write_bytes(msgspec.json.encode(replace(ticket, since=datetime.now(UTC))))
            yield
        finally:
            mine.unlink(missing_ok=True)


def _tickets_before(folder: Path, mine: Path) -> list[Ticket]:
    """Return the valid tickets before ``mine``; the first one has the rig. Remove tickets without a lock."""
    found = []
    with locked(folder):
        for path in sorted(one for one in folder.glob("[0-9]*") if one.name < mine.name):
            # The run may end, and remove its ticket, after the folder was listed.
            with suppress(FileNotFoundError), path.open("rb") as file:
                if hold(file):
                    path.unlink(missing_ok=True)
                else:
                    found.append(msgspec.json.decode(file.read(), type=Ticket))
    return found


def wait_while(look: Callable[[], list[T]], told: Callable[[list[T]], None]) -> None:
    """Wait until ``look`` returns an empty list. ``told`` gets each result that differs from the one before."""
    clock, before = RealClock(), list[T]()
    while now := look():
        if now != before:
            told(before := now)
        clock.sleep_until(clock.now() + int(_LOOK * NS))


@contextmanager
def locked(folder: Path) -> Iterator[None]:
    """Lock the folder of a queue during the block."""
    with (folder / ".lock").open("w") as guard:
        hold(guard, wait=True)
        yield
