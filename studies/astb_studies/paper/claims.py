"""Claims, with the functions that check them on each layer and on the bench; each function declares its claim.

T1 = Claim("T1", "Lateral stiffness rises with the pressure.", "the paper, figure 6(a) and (b)")

@T1.on("plant", "strictly, six preloads")
def harmonic_over_pressure(subject: Subject) -> CheckOutcome: ...

@T1.on_the_bench("figure-06")
def stiffness_over_pressure(study: Study) -> BenchOutcome: ...
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Final, Literal

from astb_studies.paper.subject import Subject

#: plant: the energy-consistent model of the rig; paper: the closed forms; both: outside of the springs.
Layer = Literal["plant", "paper", "both"]


@dataclass(frozen=True, slots=True)
class CheckOutcome:
    """The result: in words with units, as numbers in SI by name, and whether it lies within the limits."""

    text: str
    holds: bool
    numbers: dict[str, float] = field(default_factory=dict)
    note: str = ""


@dataclass(frozen=True, slots=True)
class BenchOutcome:
    """The result of the bench as text, whether the claim holds there, and the deviation of the closed form."""

    text: str
    holds: bool
    deviation: str
    #: Result of the closed form, and whether it meets the claim (None: not applicable); by default that of its check.
    closed: tuple[str, bool | None] | None = None
    by: str = "bench"  #: the source of the result: the bench, or another if the bench is not applicable


Evaluate = Callable[[Subject], CheckOutcome]
Compare = Callable[[Any], BenchOutcome]  # of a `Study`


@dataclass(frozen=True, slots=True, eq=False)
class Claim:
    """A statement with its source: one of the paper (``id`` T1 to T11, or without one) or one of our own (A01 to A30).

    Every one is kept in `CLAIMS`. ValueError if the id is taken.
    """

    id: str
    text: str
    source: str
    checks: "dict[Layer, ClaimCheck]" = field(default_factory=dict, repr=False)
    by_figure: dict[str, Compare] = field(default_factory=dict, repr=False)

    def __post_init__(self) -> None:
        if self.id and any(one.id == self.id for one in CLAIMS):
            raise ValueError(f"there are two claims {self.id}; rename one of them")
        CLAIMS.append(self)

    def on(self, layer: Layer, limits: str, *, shares: str = "") -> Callable[[Evaluate], Evaluate]:
        """Declare that the decorated function checks the claim on one layer, against ``limits``.

        ``shares`` names the experiments that it has in common with other checks. ValueError if the claim has a check on
        this layer already.
        """

        def declare(evaluate: Evaluate) -> Evaluate:
            if layer in self.checks:
                raise ValueError(f"{self.id} has two checks on the layer {layer!r}")
            self.checks[layer] = ClaimCheck(self, layer, limits, evaluate, shares)
            return evaluate

        return declare

    def on_the_bench(self, figure: str) -> Callable[[Compare], Compare]:
        """Declare that the decorated function returns the result of the bench for the claim, shown with ``figure``."""

        def declare(compare: Compare) -> Compare:
            self.by_figure[figure] = compare
            return compare

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


#: Every claim whose file has been imported.
CLAIMS: Final[list[Claim]] = []
