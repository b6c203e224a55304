"""The content of a wiring's description: source, target and meaning of each signal."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any, Final

from bench_protocol.wires import Table
from drivers.wiring.astb.keys import KIND
from drivers.wiring.contract import Capabilities, Order, Sequences
from drivers.wiring.conversion import Conversion
from drivers.wiring.expression import Combine

#: Signals that the host simulates if the rig has no function generator; a description then has no lines for them.
PLAYED: Final = (
    "generator.",
    "action.program_run",
    "action.program_hold",
    "action.program_stop",
    "action.program_add",
    "rig.program",
    "rig.generator_cycle",
)


@dataclass(frozen=True, slots=True)
class Source:
    """The points of a measurement, status or contact, and the calculation of its SI value from them."""

    points: tuple[str, ...]
    combine: Combine | None  #: None: the first point is the value
    conversion: Conversion

    def si(self, values: Sequence[float]) -> float:
        """Return the SI value for the raw values of ``points``, in their order; NaN if one is NaN or infinite."""
        if not all(map(math.isfinite, values)):
            return math.nan
        return self.conversion.si(values[0] if self.combine is None else self.combine(values))


@dataclass(frozen=True, slots=True)
class Target:
    """The target of a set-point."""

    point: str
    conversion: Conversion
    given: str = ""  #: the point with its value when the bench connects


@dataclass(frozen=True, slots=True)
class Greetings:
    """Values that the wiring itself writes: after connecting, before disconnecting, and after writing settings."""

    open: tuple[Order, ...]
    close: tuple[Order, ...]
    apply: tuple[Order, ...]


@dataclass(frozen=True, slots=True)
class SettingTarget:
    """The target of a setting and the point that reads it back; ``fixed`` settings are not written."""

    point: str
    read: str  #: "": remembered
    conversion: Conversion
    within: float  #: s, time limit until ``read`` has the new value
    tolerance: float  #: SI, permitted difference between the written and the read value
    fixed: float | None
    initial: float  #: NaN: unknown


@dataclass(frozen=True, slots=True)
class PlayerLimits:
    """The lift of an actuator by a roll (m/rad), and the limits for the slope of a wave (SI per second)."""

    lever: float
    speed: float
    roll_rate: float
    force_rate: float


@dataclass(frozen=True)
class Description:
    """The content of a wiring file, checked as far as possible without its transports."""

    where: Path
    digest: str  #: SHA-256 of the keys and of the user's functions
    table: Table
    text: str
    transports: Mapping[str, Mapping[str, Any]]
    capabilities: Capabilities
    sequences: Sequences
    greetings: Greetings
    player: PlayerLimits | None  #: None where the rig has a generator
    identity: Mapping[str, float]
    functions: Path | None
    sources: Mapping[str, Source]
    setpoints: Mapping[str, Target]
    settings: Mapping[str, SettingTarget]
    actions: Mapping[str, tuple[str, tuple[float, ...]]]  #: point, and the values written to it in order
    absent: Mapping[str, str]
    points: tuple[tuple[str, str, bool], ...]  #: every named point: its key, its name, whether it is written
    carrier: str = ""  #: the transport of kind astb, if there is one
    carried: frozenset[str] = frozenset()  #: the signals that it carries: all without a line

    @cached_property
    def played(self) -> frozenset[str]:
        """Signals that the bench simulates because the rig has no generator."""
        return frozenset(
            signal.name
            for signal in self.table.signals
            if self.player is not None and signal.name.startswith(PLAYED)
        )

    @cached_property
    def remembered(self) -> tuple[str, ...]:
        """Settings that no point reports."""
        return tuple(name for name, one in self.settings.items() if one.fixed is None and not one.read)


def listening(description: Description) -> Description:
    """Return ``description`` for a client that only listens: without heartbeats, streamed messages and orders.

    Such a client never becomes the commander of a rig that has a lease. For a user's own transport, only the keys
    ``alive`` and ``every`` are removed.
    """
    transports = {name: _silent(table) for name, table in description.transports.items()}
    return replace(description, transports=transports, greetings=Greetings((), (), ()))


def _silent(table: Mapping[str, Any]) -> dict[str, Any]:
    if table.get("kind") == KIND:
        return {**table, "commands": False}
    kept = {key: value for key, value in table.items() if key != "alive"}
    messages = kept.get("messages")
    if isinstance(messages, Mapping):
        kept["messages"] = {
            name: {key: value for key, value in one.items() if key != "every"}
            if isinstance(one, Mapping)
            else one
            for name, one in messages.items()
        }
    return kept
