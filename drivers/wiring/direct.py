"""Interface of a transport that carries the signals of a table in SI, and a null object for other rigs."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from contextlib import AbstractContextManager
from typing import NoReturn, Protocol

from bench_protocol.arrays import Ints
from bench_protocol.clock import Clock
from drivers.errors import BenchError, NotAvailable
from drivers.wiring.contract import Capabilities, OnLost, OnSamples, Outlet


class Direct(Protocol):
    """One connection to a rig that implements the table of signals, or most of it. Names are those of signals."""

    @property
    def capabilities(self) -> Capabilities:
        """Functions that the rig provides."""

    @property
    def freshness(self) -> Ints | None:
        """Age (ns) above which a sample is stale, by table row; None if no signals are carried."""

    @property
    def outlet(self) -> Outlet | None:
        """The receiver of set-points; None if this transport carries none."""

    @property
    def failure(self) -> BenchError | None:
        """Why commands have no effect."""

    @property
    def commands(self) -> bool:
        """Whether this client is the rig's commander."""

    @property
    def given(self) -> Mapping[str, float]:
        """Set-points that the rig assigns to its commander."""

    @property
    def absent(self) -> Mapping[str, str]:
        """Signals that the rig's own table lacks or has elsewhere, with the reasons; known once connected."""

    @property
    def differs(self) -> str:
        """Differences of the rig's own table, as text; "" if there are none."""

    def connect(self, clock: Clock, lost: OnLost) -> None:
        """Connect, and become the rig's commander unless it only listens. The caller closes it after an error."""

    def subscribe(self, receive: OnSamples, silent: Collection[str]) -> None:
        """Start to receive samples, except of the signals ``silent``."""

    def close(self) -> None:
        """Disconnect from the rig. Repeated calls are harmless."""

    def write(self, values: Mapping[str, float]) -> None:
        """Write settings, all or none."""

    def read(self, names: Sequence[str]) -> dict[str, float]:
        """Return settings in force, contacts and readings."""

    def act(self, name: str) -> None:
        """Trigger an action."""

    def is_own(self, port: int, token: float) -> bool: ...

    def silent(self) -> AbstractContextManager[None]: ...

    def read_file(self, file: int, record: int, count: int) -> list[int]: ...

    def identity(self) -> str:
        """Return as text how the rig was identified; "" if it was not."""

    def source(self, name: str) -> str:
        """Return as text the frame or register of a signal."""


class NullTransport:
    """Null object for a rig without such a transport."""

    capabilities = Capabilities()
    freshness = outlet = failure = None
    commands = False
    differs = ""

    def __init__(self, rig: str) -> None:
        self._rig = rig
        self.given: Mapping[str, float] = {}
        self.absent: Mapping[str, str] = {}

    def connect(self, clock: Clock, lost: OnLost) -> None:
        pass

    def subscribe(self, receive: OnSamples, silent: Collection[str]) -> None:
        pass

    def close(self) -> None:
        pass

    def write(self, values: Mapping[str, float]) -> None:
        assert not values, "nothing is carried"

    def read(self, names: Sequence[str]) -> dict[str, float]:
        assert not names, "nothing is carried"
        return {}

    def act(self, name: str) -> NoReturn:
        raise NotAvailable(f"{self._rig} has no {name}")

    def is_own(self, port: int, token: float) -> bool:
        return False

    def silent(self) -> NoReturn:
        raise NotAvailable(
            f"the wiring of {self._rig} does not state that the rig detects a silent commander "
            "(capability watchdog)"
        )

    def read_file(self, file: int, record: int, count: int) -> NoReturn:
        raise NotAvailable(f"{self._rig}: its wiring has no access to files of the rig")

    def identity(self) -> str:
        return ""

    def source(self, name: str) -> str:
        return ""
