"""A transport that carries the signals of a table themselves, in SI; and what stands in its place on other rigs."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from contextlib import AbstractContextManager
from typing import NoReturn, Protocol

from bench_protocol.clock import Clock
from drivers.errors import BenchError, NotAvailable
from drivers.wiring.contract import Capabilities, Ints, OnLost, OnSamples, Outlet


class Direct(Protocol):
    """One connection to a rig that speaks the table of signals, or much of it; names are those of signals."""

    @property
    def capabilities(self) -> Capabilities:
        """What the rig does by itself."""

    @property
    def freshness(self) -> Ints | None:
        """For each table row, after how many ns a sample is stale; None where nothing is carried."""

    @property
    def outlet(self) -> Outlet | None:
        """Where set-points go; None where they do not go this way."""

    @property
    def failure(self) -> BenchError | None:
        """Why commands no longer count."""

    @property
    def commands(self) -> bool:
        """Whether it is the rig's commander."""

    @property
    def given(self) -> Mapping[str, float]:
        """Set-points that the rig gives to its commander."""

    @property
    def absent(self) -> Mapping[str, str]:
        """Signals that the rig's own table has not, or has elsewhere, with the reasons; known once connected."""

    @property
    def differs(self) -> str:
        """In words, what the rig's own table has otherwise; "" if nothing."""

    def connect(self, clock: Clock, lost: OnLost) -> None:
        """Connect, and become the rig's commander unless it is only to listen. Who calls closes it if this raises."""

    def subscribe(self, receive: OnSamples, silent: Collection[str]) -> None:
        """Let samples come from now on, but for the signals ``silent``."""

    def close(self) -> None:
        """Let go of the rig. Harmless when repeated."""

    def write(self, values: Mapping[str, float]) -> None:
        """Bring settings to the rig, all or none."""

    def read(self, names: Sequence[str]) -> dict[str, float]:
        """Return settings in force, contacts and readings."""

    def act(self, name: str) -> None:
        """Trigger an action."""

    def is_own(self, port: int, token: float) -> bool: ...

    def silent(self) -> AbstractContextManager[None]: ...

    def read_file(self, file: int, record: int, count: int) -> list[int]: ...

    def identity(self) -> str:
        """Return in words what the rig was recognized by; "" where nothing is."""

    def source(self, name: str) -> str:
        """Return in words where a signal is on the wires."""


class Nothing:
    """What stands in the place of such a transport on a rig that speaks otherwise."""

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
        raise NotAvailable(f"{self._rig} is not known to notice that its commander is silent")

    def read_file(self, file: int, record: int, count: int) -> NoReturn:
        raise NotAvailable(f"{self._rig} is not known to keep files")

    def identity(self) -> str:
        return ""

    def source(self, name: str) -> str:
        return ""
