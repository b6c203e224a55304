"""Comparison of a claim of the paper with the result of the bench, and its text."""

from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from astb_studies.paper.claims import CLAIMS, Claim
from astb_studies.paper.study import Study
from bench_protocol.arrays import Floats

MINUS: Final = "\u2212"


@dataclass(frozen=True, slots=True)
class ClaimComparison:
    """One claim of the paper for a figure: ``bench`` and ``closed`` are the results, ``*_holds`` the verdicts."""

    id: str
    claim: str
    bench: str
    closed: str
    deviation: str
    bench_holds: bool
    closed_holds: bool | None  #: None where the closed forms have no say
    by: str = "bench"  #: the source of the result: the bench, or another if the bench is not applicable

    @property
    def verdict(self) -> str:
        """The layers in which the claim holds, as text."""
        if self.closed_holds is None:
            return "holds" if self.bench_holds else "does not hold"
        return {
            (True, True): "holds in both",
            (True, False): f"{self.by} only",
            (False, True): "closed form only",
            (False, False): "does not hold",
        }[self.bench_holds, self.closed_holds]


def comparisons_of(study: Study, figure: str) -> list[ClaimComparison]:
    """Return the comparisons of bench and closed forms for the claims of a figure, in the order of their numbers."""
    of_it = [claim for claim in CLAIMS if figure in claim.by_figure]
    return [compared(study, claim, figure) for claim in sorted(of_it, key=lambda one: int(one.id[1:] or 0))]


def compared(study: Study, claim: Claim, figure: str) -> ClaimComparison:
    """Return the comparison of bench and closed forms for one claim of a figure."""
    found = claim.by_figure[figure](study)
    if found.closed is None:
        check = entry_of(study, claim.id, "paper")
        closed, closed_holds = check["measured"], check["holds"]
    else:
        closed, closed_holds = found.closed
    return ClaimComparison(
        claim.id, claim.text, found.text, closed, found.deviation, found.holds, closed_holds, found.by
    )


def percent(share: float, digits: int = 1) -> str:
    """Write a share as a signed percentage with a proper minus."""
    return f"{100 * share:+.{digits}f} %".replace("-", MINUS)


def entry_of(study: Study, id_: str, layer: str) -> dict[str, Any]:
    """Return the result of the check of a claim on one layer."""
    return next(one for one in study.entries if (one["id"], one["layer"]) == (id_, layer))


def largest_deviation(model: Floats, measured: Floats) -> float:
    """Return the largest deviation along a curve, relative to the measured value."""
    off = model / measured - 1.0
    return float(off[np.argmax(np.abs(off))])
