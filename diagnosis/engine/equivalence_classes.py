"""Step 8, laws of one phenomenon: find other laws of a cause's phenomenon that these runs do not distinguish from it.

Theory of operation
-------------------
A catalogue may hold several laws of one phenomenon: friction of rubber with one breakaway travel or several, one
relaxation time or two. BIC selects the simplest sufficient law, because it penalises each parameter. This is right for
predictions, but does not identify the true law: a richer law includes the poorer one and never fits worse, and the data
cannot separate two similar travels. So for a cause, all laws of its phenomenon are listed that the data do not
contradict: their penalised χ² (without a penalty for the number of parameters) or their BIC is not larger by more than
the gap of a verdict, or by the error of the cause's equation. Then the phenomenon is named, and no law.

A richer law is not listed in one case: all its shapes are resolved, and the interval of one of them ends at the limit
of its range. Then it has become the poorer law, for example friction with a growth of 0 with pressure.

The tested laws are those fitted instead of the cause (`rivals.py`). A law without a fit, or with an unphysical one,
counts as distinguished from the cause.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from diagnosis.contracts import Hypothesis
from diagnosis.engine.config import IDENTIFIED
from diagnosis.engine.fitting.point import Coordinate
from diagnosis.engine.search_state import SearchResult, Trial
from diagnosis.estimates import Z95


def alike_laws(hypotheses: Mapping[str, Hypothesis], name: str) -> list[str]:
    """Return the other laws of the same phenomenon as an effect."""
    phenomenon = hypotheses[name].phenomenon
    return [n for n, one in hypotheses.items() if phenomenon and one.phenomenon == phenomenon and n != name]


def indistinguishable_laws(
    found: SearchResult, hypotheses: Mapping[str, Hypothesis], gap: float, rough: float
) -> dict[str, list[Trial]]:
    """Return for each accepted effect the fits of other laws of its phenomenon that the data do not distinguish from
    it, best first.

    ``gap`` is the gap of χ² that a verdict requires. ``rough`` is the error of an equation as a part of λ.
    """
    return {
        one.effect: [
            trial
            for trial in one.rivals
            if trial.effect in alike_laws(hypotheses, one.effect)
            and not _became(hypotheses[trial.effect], trial, hypotheses[one.effect])
            and (
                trial.penalised_chi2 - found.model.penalised_chi2 < max(gap, (rough * one.lambda_) ** 2)
                or trial.bic - found.model.bic < gap
            )
        ]
        for one in found.accepted
    }


def _became(richer: Hypothesis, trial: Trial, poorer: Hypothesis) -> bool:
    """Return whether the fit of a richer law equals the poorer one, because one of its shapes is at the end of the
    range.
    """
    if len(richer.shapes) <= len(poorer.shapes):
        return False
    places = [trial.point.place(Coordinate(shape, richer.name)) for shape in richer.shapes]
    deviations = np.sqrt(np.diagonal(trial.covariance)[places])
    numbers = trial.point.numbers[places]
    low, high = np.array([trial.point.coordinates[place].range for place in places]).T
    at_an_end = (numbers - Z95 * deviations <= low) | (numbers + Z95 * deviations >= high)
    return bool(np.all(deviations < IDENTIFIED) and np.any(at_an_end))
