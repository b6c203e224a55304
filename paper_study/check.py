"""One check: a statement, what decides it, and how to measure it."""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Literal

from paper_study.subject import Subject

#: plant: the energy-consistent model of the rig; paper: the closed forms; both: outside of the springs.
Layer = Literal["plant", "paper", "both"]


@dataclass(frozen=True, slots=True)
class Measured:
    """What came out: in words with units, as numbers in SI by name, and whether that meets the criterion."""

    text: str
    holds: bool
    numbers: dict[str, float] = field(default_factory=dict)
    note: str = ""


@dataclass(frozen=True, slots=True)
class Check:
    """A statement on one layer. ``shares`` names the experiments that it has in common with other checks."""

    id: str
    claim: str
    layer: Layer
    criterion: str
    evaluate: Callable[[Subject], Measured]
    shares: str = ""
