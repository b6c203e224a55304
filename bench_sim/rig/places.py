"""The connection slots of a server: some for all clients, and one that is reserved for the holder of the bench."""

from collections.abc import Callable, Iterator
from typing import Final, Generic, TypeVar

from bench_sim.rig.connection import Connection

Holds = Callable[[str], bool]

#: Grace period (s) for a client on trial to become the holder, and the interval (s) at which this is checked.
_TRIAL: Final = 2.0
_LOOK: Final = 0.05

C = TypeVar("C", bound=Connection)


class Places(Generic[C]):
    """The connections of one server: at most ``limit``, and one for the holder. ``holds(peer)`` identifies the
    holder.

    When all slots are in use, one more client at a time is admitted on trial. It is disconnected unless it becomes the
    holder within 2 s. So other clients cannot lock out the commander.
    """

    def __init__(self, limit: int, holds: Holds | None = None) -> None:
        self._limit, self._holds = limit, holds
        self._taken: dict[C, None] = {}

    def __iter__(self) -> Iterator[C]:
        return iter(list(self._taken))

    def __contains__(self, connection: object) -> bool:
        return connection in self._taken

    def admit(self, connection: C) -> bool:
        """Give ``connection`` a slot, on trial if necessary. Return whether there was one."""
        holds = self._holds
        others = sum(not (holds and holds(one.name)) for one in self._taken)
        if others > self._limit or (others == self._limit and holds is None):
            return False
        self._taken[connection] = None
        if holds is not None and others == self._limit:
            self._drop_unless_held(connection, holds, connection.loop.time() + _TRIAL)
        return True

    def leave(self, connection: C) -> bool:
        """Free the slot of ``connection``. Return whether it had one."""
        if connection not in self._taken:
            return False
        del self._taken[connection]
        return True

    def _drop_unless_held(self, connection: C, holds: Holds, deadline: float) -> None:
        if connection not in self._taken or holds(connection.name):
            return
        loop = connection.loop
        if loop.time() >= deadline:
            connection.drop()
        else:
            loop.call_later(_LOOK, self._drop_unless_held, connection, holds, deadline)
