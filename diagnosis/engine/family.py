"""Step 6, the family rule: before a second cause of another family is assumed, the first one's own family is tried.

Theory of operation
-------------------
Equations of causes come in families, of which some members contain others: two Maxwell branches contain one. Where the
truth is the richer member, the poorer one enters first, for it explains nearly as much with fewer parameters. What it
leaves looks like a cause of another family: rubber with two relaxation times looks like one branch and a friction. Such
a pair predicts well and lies about the cause; without this rule it was named in six of six cases.

The rule has two halves:

* Against the pair: two causes must beat one richer member instead of the first by BIC *and* by log predictive density,
  each by the gap that a verdict asks for. Else the richer member enters in its place, if it is worth its parameters
  (`richer_members` lists the candidates, `admission.py` decides).
* Against the richer member: no equation is exact, so of a poorer member in plain view a rest is always left, which the
  richer one can take up. It is charged what such a rest may be, a part ``Config.rough`` of λ (`richer_surcharge`).
"""

from __future__ import annotations

from diagnosis.engine.fitting.fit import FittedModel
from diagnosis.engine.search_state import CurrentModel, Problem


def richer_surcharge(problem: Problem, name: str, model: FittedModel, current: CurrentModel) -> float:
    """Return the χ² that an effect could gain over a poorer member of its family where that is only rough.

    0 for an effect that is no richer member of any. It is added to the BIC of ``model``, in which the effect is.
    """
    if not any(name in effect.richer for effect in problem.hypotheses.values()):
        return 0.0
    explained = current.explained_chi2 + current.model.penalised_chi2 - model.penalised_chi2
    return problem.config.rough**2 * max(explained, 0.0)


def richer_members(problem: Problem, old: str, inside: tuple[str, ...]) -> list[str]:
    """Return what contains an accepted effect, or what that is easily mistaken for, and is not in the model."""
    relatives = [name for name in (old, *problem.hypotheses[old].confusers) if name in problem.hypotheses]
    richer = dict.fromkeys(name for relative in relatives for name in problem.hypotheses[relative].richer)
    return [name for name in richer if name not in inside]
