"""Step 8, laws of one phenomenon: other laws of a cause's phenomenon that these runs do not separate from it.

Theory of operation
-------------------
A catalogue may hold several laws of one phenomenon: friction of rubber that turns over one travel or over several, one
relaxation time or two. BIC takes the simplest that suffices, for each parameter has its price. That is right for a
model that has to predict, and gives no information on the true law: a richer law contains the poorer one, is then never
worse, and two travels that are near to each other *are* one in all data. So where a law is the cause, each other of its
phenomenon is next to it that the data themselves do not contradict: whose penalised χ², without any price for
parameters, is not larger by the gap that a verdict asks for, or by what the equation of the cause may be rough by; or
whose BIC is not. Then the phenomenon is named, and no law.

One case is left in which a richer law is distinguished from the poorer one that suffices: where all its shapes are
resolved, and the interval of one of them ends at the limit of its range. It has become the poorer law then, such as
friction that grows with the pressure by nothing.

The tried laws are those fitted instead of the cause (`rivals.py`). A law that was never worth a fit, or is not
physical, is distinguished from the cause.
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
    """Return the other laws of the phenomenon of an effect."""
    phenomenon = hypotheses[name].phenomenon
    return [n for n, one in hypotheses.items() if phenomenon and one.phenomenon == phenomenon and n != name]


def indistinguishable_laws(
    found: SearchResult, hypotheses: Mapping[str, Hypothesis], gap: float, rough: float
) -> dict[str, list[Trial]]:
    """Return the fits of other laws that each accepted effect is not distinguished from, by effect, best first.

    ``gap`` is that of χ² which a verdict asks for, ``rough`` the part of λ that an equation may be inexact by.
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
    """Return whether a richer law was fitted as the poorer one, by the end of the range of a shape."""
    if len(richer.shapes) <= len(poorer.shapes):
        return False
    places = [trial.point.place(Coordinate(shape, richer.name)) for shape in richer.shapes]
    deviations = np.sqrt(np.diagonal(trial.covariance)[places])
    numbers = trial.point.numbers[places]
    low, high = np.array([trial.point.coordinates[place].range for place in places]).T
    at_an_end = (numbers - Z95 * deviations <= low) | (numbers + Z95 * deviations >= high)
    return bool(np.all(deviations < IDENTIFIED) and np.any(at_an_end))
