"""Step 6, the family rule: before a cause of a second family is accepted, richer members of the first family are
tested.

Theory of operation
-------------------
The equations of causes form families, in which some members include others: two Maxwell branches include one. If the
richer member is true, the poorer one enters first, because it explains nearly as much with fewer parameters. Its
residual looks like a cause of another family: rubber with two relaxation times looks like one branch and a friction.
Such a pair predicts well and is wrong about the cause; without this rule it was named in six of six cases.

The rule has two parts:

* Against the pair: the model with two causes must beat the model with one richer member in place of the first cause, by
  BIC *and* by log predictive density, each by the gap that a verdict requires. Otherwise the richer member enters, if
  its parameters improve the BIC (`richer_members` lists the candidates, `admission.py` decides).
* Against the richer member: no equation is exact, so a large effect always leaves a residual, which a richer member can
  explain. So a surcharge is added to the BIC of the richer member: the χ² that the effects have explained, times
  ``Config.rough``² (`richer_surcharge`).
"""

from __future__ import annotations

from diagnosis.engine.fitting.fit import FittedModel
from diagnosis.engine.search_state import CurrentModel, Problem


def richer_surcharge(problem: Problem, name: str, model: FittedModel, current: CurrentModel) -> float:
    """Return the χ² that a richer member of a family could gain only because the equation of the poorer member is
    inexact.

    The surcharge is added to the BIC of ``model``, which includes the effect ``name``. It is 0 if this effect is no
    richer member.
    """
    if not any(name in effect.richer for effect in problem.hypotheses.values()):
        return 0.0
    explained = current.explained_chi2 + current.model.penalised_chi2 - model.penalised_chi2
    return problem.config.rough**2 * max(explained, 0.0)


def richer_members(problem: Problem, old: str, inside: tuple[str, ...]) -> list[str]:
    """Return the effects not in the model that are richer forms of the accepted effect ``old`` or of one of its
    confusers.
    """
    relatives = [name for name in (old, *problem.hypotheses[old].confusers) if name in problem.hypotheses]
    richer = dict.fromkeys(name for relative in relatives for name in problem.hypotheses[relative].richer)
    return [name for name in richer if name not in inside]
