"""A client that only listens to a rig: it receives readings, requests values, and sends no commands by itself."""

from types import TracebackType
from typing import TYPE_CHECKING, Self

from drivers.errors import LinkLost
from drivers.reading import Readings
from drivers.receiver import Receiver
from drivers.settings import Settings

if TYPE_CHECKING:
    from bench_protocol.clock import Clock
    from drivers.wiring.contract import Wiring


class Listening:
    """One connection to the rig of ``wiring``; it does not disturb the commander.

    In a ``with`` statement, it is open during the block. The end of the block raises an error if the connection was
    lost.
    """

    def __init__(self, wiring: "Wiring", clock: "Clock", within: float) -> None:
        self.wiring, self.clock, self._within = wiring.listening(), clock, within
        self.table = wiring.table
        self.lost = ""  #: why the connection is lost
        self.receiver = Receiver(self.wiring, clock)
        self.settings = Settings(self.wiring)
        self.readings = Readings(self.receiver, self.settings.reading)

    def open(self) -> Self:
        """Begin to listen.

        Raises LinkLost if no message arrives within the time limit, MapMismatch if the rig uses another signal map.
        """
        try:
            self.wiring.open(self.clock, self.receiver.receive, self._on_lost, within=self._within)
            self.readings.renew()
        except BaseException:
            self.close()
            raise
        return self

    def check(self) -> None:
        """Raise the error that occurred since the last check, if any."""
        if self.lost:
            raise LinkLost(self.lost)
        if self.wiring.failure is not None:
            raise self.wiring.failure

    def close(self) -> None:
        """Close the connection. Repeated calls have no effect."""
        self.wiring.close()

    def __enter__(self) -> Self:
        return self.open()

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        try:
            if kind is None:
                self.check()
        finally:
            self.close()

    def _on_lost(self, reason: str) -> None:
        self.lost = reason or "the connection is closed"
