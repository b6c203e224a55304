"""Step 8, suspects: if no cause is named, the best candidates, each with the test that it fails.

Theory of operation
-------------------
*Unresolved* means that no cause passes every test. A user at the rig still needs a first place to inspect. Suspects
fail only one test. They are causes that were removed because they may come from inexact equations, rivals that explain
the data nearly as well, and causes that leave most of the error. If no cause had entered, suspects are the trials that
improve the BIC.

No suspect is certain. A small error of the equations can make a sound part suspect, so each suspect is reported with
its reason.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Final, NamedTuple

from diagnosis.contracts import Hypothesis
from diagnosis.engine.fitting.fit import FittedModel
from diagnosis.engine.intervals import intervals
from diagnosis.engine.model_error import widened
from diagnosis.engine.search_state import Accepted, SearchResult, Trial
from diagnosis.engine.wording import estimates
from diagnosis.estimates import number
from diagnosis.finding import Cause, Estimate, Suspect

INSTEAD: Final = "{other} explains the data equally well"
MOST_LEFT: Final = "most of the error remains with it"


class Dismissed(NamedTuple):
    """A cause that was removed from the final model, the model that still contained it, and the reason for the
    removal.
    """

    accepted: Accepted
    model: FittedModel
    why: str


def suspects(
    dismissed: Sequence[Dismissed],
    found: SearchResult,
    left: Sequence[Cause],
    hypotheses: Mapping[str, Hypothesis],
    gap: float,
) -> list[Suspect]:
    """Return the suspects for a finding without a named cause, clearest first. Each effect is listed once.

    ``dismissed`` were removed from the final model, ``found`` is the result of the search, and ``left`` are causes that
    leave most of the error. Rivals whose BIC is within ``gap`` are included.
    """
    listed = [_suspect(hypotheses[c.effect], c.parameters, MOST_LEFT, c.strength) for c in left]
    for one in sorted(dismissed, key=lambda one: -one.accepted.lambda_):
        hypothesis = hypotheses[one.accepted.effect]
        numbers = intervals(hypothesis, one.model, widened(one.model, ()))
        listed.append(_suspect(hypothesis, numbers, one.why, number(one.accepted.lambda_)))
        listed += [
            _tried(hypotheses[trial.effect], trial, INSTEAD.format(other=hypothesis.title))
            for trial in one.accepted.near(one.model.bic, gap)
        ]
    if not listed:
        listed += [_tried(hypotheses[trial.effect], trial, trial.failed) for trial in _nearest(found, gap)]
    return list({suspect.effect: suspect for suspect in reversed(listed)}.values())[::-1]


def _nearest(found: SearchResult, gap: float) -> list[Trial]:
    """Return the trials of the last step that improve the BIC but failed a gate, best first; ``gap`` limits their BIC
    above the best one. Empty if the model was changed after this step.
    """
    last = found.steps[-1]
    if last.effects != found.model.effects:
        return []
    better = [t for t in last.trials if t.failed and t.physical and t.bic < found.model.bic]
    least = min((trial.bic for trial in better), default=0.0)
    return sorted((t for t in better if t.bic - least < gap), key=lambda trial: trial.bic)


def _tried(hypothesis: Hypothesis, trial: Trial, why: str) -> Suspect:
    return _suspect(hypothesis, estimates(hypothesis, trial.point, trial.covariance), why)


def _suspect(
    hypothesis: Hypothesis, numbers: list[Estimate], why: str, strength: float | None = None
) -> Suspect:
    return Suspect(
        effect=hypothesis.name,
        title=hypothesis.title,
        family=hypothesis.family,
        parameters=numbers,
        strength=strength,
        why=why,
    )
