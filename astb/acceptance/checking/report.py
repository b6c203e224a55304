"""What a check of a rig comes to: a line for each signal, one for each move, and what the rig lacks."""

from __future__ import annotations

from enum import StrEnum

import msgspec


class Plausibility(StrEnum):
    """What is to be thought of a signal or of a move."""

    FINE = "fine"
    DOUBTFUL = "doubtful"
    ABSENT = "absent"  #: no wiring gives it
    UNTOLD = "not told"  #: nothing that rest shows: what is only written, or of no plausible value


class SignalLine(msgspec.Struct, frozen=True, kw_only=True):
    """One signal: where it comes from, what it reads, and whether that can be."""

    name: str
    verdict: Plausibility
    source: str = ""
    shown: str = ""  #: its mean, as people read it
    value: float | None = None  #: the same, SI
    rate: float | None = None  #: samples per second; None for what is read when asked
    age: float | None = None  #: s, of the last sample
    remark: str = ""


class MoveLine(msgspec.Struct, frozen=True, kw_only=True):
    """One thing that a move has shown."""

    what: str
    verdict: Plausibility
    found: str
    right: str = ""
    value: float | None = None  #: of a dimension, SI
    uncertainty: float | None = None  #: the expanded one, SI


class Missing(msgspec.Struct, frozen=True, kw_only=True):
    """Signals or dimensions that the same plans lack."""

    names: list[str]
    plans: list[str]


class ConnectionLine(msgspec.Struct, frozen=True, kw_only=True):
    """One thing that was noticed of a connection to the rig."""

    name: str  #: of the transport
    verdict: Plausibility  #: doubtful where readings are lost by it
    remark: str


class CheckReport(msgspec.Struct, frozen=True, kw_only=True):
    """All that was found."""

    rig: str
    identity: str
    state: str
    capabilities: list[str]
    signals: list[SignalLine]
    connections: list[ConnectionLine] = []  #: what was noticed of the transports
    remembered: list[str] = []  #: settings that no point reads back
    plans: int = 0  #: how many plans there are
    missing: list[Missing] = []  #: what keeps plans from beginning
    checks: dict[str, str] = {}  #: what aw0 and aw3 then cannot measure, and what that lacks
    moves: list[MoveLine] = []

    @property
    def blocked(self) -> list[str]:
        """The plans that cannot run, by name."""
        return sorted({plan for one in self.missing for plan in one.plans})

    @property
    def summary(self) -> list[str]:
        """What matters most, in a few lines: plans that can run, what they lack, what is doubtful."""
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
            lines.append("all fine")
        return lines

    @property
    def doubtful(self) -> list[str]:
        """What is doubted, by name."""
        return [
            *(one.name for one in self.signals if one.verdict is Plausibility.DOUBTFUL),
            *(f"transport {one.name}" for one in self.connections if one.verdict is Plausibility.DOUBTFUL),
            *(one.what for one in self.moves if one.verdict is Plausibility.DOUBTFUL),
        ]

    def to_json(self) -> bytes:
        """Return the report as JSON, indented."""
        return msgspec.json.format(msgspec.json.encode(self), indent=2) + b"\n"
