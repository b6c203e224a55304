"""What a wiring's description comes to: where each signal comes from, where it goes to, and what it means."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Final

from bench_protocol.wires import Table
from drivers.wiring.contract import Capabilities, Order, Sequences
from drivers.wiring.conversion import Conversion
from drivers.wiring.expression import Combine

#: What the host plays where the rig has no function generator; these are no lines of a description then.
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
    """Where a measurement, status or contact comes from."""

    points: tuple[str, ...]
    combine: Combine | None  #: None: the first point is it
    conversion: Conversion

    def si(self, values: Sequence[float]) -> float:
        """Return the SI value for the numbers of the points; NaN if one of them is no number, or infinite."""
        if not all(map(math.isfinite, values)):
            return math.nan
        return self.conversion.si(values[0] if self.combine is None else self.combine(values))


@dataclass(frozen=True, slots=True)
class Target:
    """Where a set-point goes."""

    point: str
    conversion: Conversion
    given: str = ""  #: the point that tells its value when the bench connects


@dataclass(frozen=True, slots=True)
class Greetings:
    """What the wiring itself says, points and actions, when it has connected, parts, and has written settings."""

    open: tuple[Order, ...]
    close: tuple[Order, ...]
    apply: tuple[Order, ...]


@dataclass(frozen=True, slots=True)
class SettingTarget:
    """Where a setting goes and where it is read back; ``fixed`` settings go nowhere."""

    point: str
    read: str  #: "": remembered
    conversion: Conversion
    within: float  #: s that the rig may take until ``read`` tells it
    tolerance: float  #: SI, by which what is read may differ from what was written
    fixed: float | None
    initial: float  #: NaN: unknown


@dataclass(frozen=True, slots=True)
class PlayerLimits:
    """How far a roll lifts an actuator (m/rad), and how steep a wave may be (SI per second)."""

    lever: float
    speed: float
    roll_rate: float
    force_rate: float


@dataclass(frozen=True)
class Description:
    """What a wiring file says, checked as far as it can be without its transports."""

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
    actions: Mapping[
        str, tuple[str, tuple[float, ...]]
    ]  #: point, and what is written to it, one after the other
    absent: Mapping[str, str]
    points: tuple[
        tuple[str, str, bool], ...
    ]  #: every point that is named: its key, itself, whether it is written
    direct: str = ""  #: the transport of kind astb, if there is one
    carried: frozenset[str] = frozenset()  #: the signals that it carries: all that no line is for

    @cached_property
    def played(self) -> frozenset[str]:
        """The signals that the bench itself answers for, because the rig has no generator."""
        return frozenset(
            signal.name
            for signal in self.table.signals
            if self.player is not None and signal.name.startswith(PLAYED)
        )

    @cached_property
    def remembered(self) -> tuple[str, ...]:
        """The settings that no point tells."""
        return tuple(name for name, one in self.settings.items() if one.fixed is None and not one.read)
