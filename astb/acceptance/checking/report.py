"""The result of a check of a rig: a line for each signal, one for each move, and the missing signals."""

from __future__ import annotations

from enum import StrEnum

import msgspec


class Plausibility(StrEnum):
    """Plausibility of a signal or of a move."""

    FINE = "fine"
    DOUBTFUL = "doubtful"
    ABSENT = "absent"  #: the wiring does not have it
    UNTOLD = "not told"  #: cannot be judged at rest: a signal that is only written, or has no plausible value there


class SignalLine(msgspec.Struct, frozen=True, kw_only=True):
    """One signal: its source, its value, and its plausibility."""

    name: str
    verdict: Plausibility
    source: str = ""
    shown: str = ""  #: the mean with its unit, as text
    value: float | None = None  #: the mean, SI
    rate: float | None = None  #: samples per second; None if it is only read on request
    age: float | None = None  #: age of the last sample, s
    remark: str = ""


class MoveLine(msgspec.Struct, frozen=True, kw_only=True):
    """One result of a move."""

    what: str
    verdict: Plausibility
    found: str
    right: str = ""
    value: float | None = None  #: estimate of a dimension, SI
    uncertainty: float | None = None  #: its expanded uncertainty, SI


class Missing(msgspec.Struct, frozen=True, kw_only=True):
    """Signals or dimensions that the same plans lack."""

    names: list[str]
    plans: list[str]


class ConnectionLine(msgspec.Struct, frozen=True, kw_only=True):
    """One observation about a connection to the rig."""

    name: str  #: name of the transport
    verdict: Plausibility  #: doubtful if readings are lost on it
    remark: str


class CheckReport(msgspec.Struct, frozen=True, kw_only=True):
    """All findings of a check."""

    rig: str
    identity: str
    state: str
    capabilities: list[str]
    signals: list[SignalLine]
    connections: list[ConnectionLine] = []  #: observations about the transports
    remembered: list[str] = []  #: settings that cannot be read back
    plans: int = 0  #: number of plans
    missing: list[Missing] = []  #: missing signals that block plans
    checks: dict[str, str] = {}  #: checks that aw0 and aw3 cannot measure, with their missing signals
    moves: list[MoveLine] = []

    @property
    def blocked(self) -> list[str]:
        """The plans that cannot run, by name."""
        return sorted({plan for one in self.missing for plan in one.plans})

    @property
    def summary(self) -> list[str]:
        """The main results in a few lines: plans that can run, their missing signals, doubtful readings."""
        lines = [f"{self.plans - len(self.blocked)} of {self.plans} plans can run"]
        for one in self.missing:
            everything = len(one.plans) == self.plans
            who = (
                f"all {self.plans} plans" if everything else f"{len(one.plans)} plans: {', '.join(one.plans)}"
            )
            lines.append(f"missing: {', '.join(one.names)} (needed by {who})")
        if self.doubtful:
            lines.append(f"{len(self.doubtful)} doubtful: {', '.join(self.doubtful)}")
        elif not self.missing:
            lines.append("all fine: each judged signal is received and plausible")
        return lines

    @property
    def doubtful(self) -> list[str]:
        """Names of doubtful signals and moves."""
        return [
            *(one.name for one in self.signals if one.verdict is Plausibility.DOUBTFUL),
            *(f"transport {one.name}" for one in self.connections if one.verdict is Plausibility.DOUBTFUL),
            *(one.what for one in self.moves if one.verdict is Plausibility.DOUBTFUL),
        ]

    def to_json(self) -> bytes:
        """Return the report as JSON, indented."""
        return msgspec.json.format(msgspec.json.encode(self), indent=2) + b"\n"
