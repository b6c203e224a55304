"""A claim, and the checks that decide it: one for each layer, declared where its function stands.

@Claim("T1", "K_lat rises with pressure", "the paper, figure 6(a) and (b)").on("plant", "strictly, six preloads")
def harmonic_over_pressure(subject: Subject) -> CheckOutcome: ...
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Final, Literal

from paper_study.subject import Subject

#: plant: the energy-consistent model of the rig; paper: the closed forms; both: outside of the springs.
Layer = Literal["plant", "paper", "both"]


@dataclass(frozen=True, slots=True)
class CheckOutcome:
    """What came out: in words with units, as numbers in SI by name, and whether that lies within the limits."""

    text: str
    holds: bool
    numbers: dict[str, float] = field(default_factory=dict)
    note: str = ""


Evaluate = Callable[[Subject], CheckOutcome]


@dataclass(frozen=True, slots=True)
class Claim:
    """A statement with its source: one of the paper (``id`` T1 to T11) or one of our own (A01 to A30)."""

    id: str
    text: str
    source: str

    def on(self, layer: Layer, limits: str, *, shares: str = "") -> Callable[[Evaluate], Evaluate]:
        """Declare that the function below decides the claim on one layer: whether it keeps to ``limits``.

        ``shares`` names the experiments that it has in common with other checks. ValueError if the claim has a check on
        this layer already.
        """

        def declare(evaluate: Evaluate) -> Evaluate:
            if any((one.id, one.layer) == (self.id, layer) for one in DECLARED):
                raise ValueError(f"{self.id} has two checks on the layer {layer!r}")
            DECLARED.append(ClaimCheck(self, layer, limits, evaluate, shares))
            return evaluate

        return declare


@dataclass(frozen=True, slots=True)
class ClaimCheck:
    """A claim with the limits and the function that decide it on one layer."""

    claim: Claim
    layer: Layer
    limits: str
    evaluate: Evaluate
    shares: str

    @property
    def id(self) -> str:
        """The number of the claim, such as T1 or A30."""
        return self.claim.id


#: Every check whose file has been imported; `paper_study.checks.catalogue` imports them all.
DECLARED: Final[list[ClaimCheck]] = []
