"""With the verdict (step 8): effects that these runs cannot distinguish, and detection limits.

Theory of operation
-------------------
Both follow from the projected footprints of step 4 and do not depend on the measured outputs. λ is the expected score
of an effect (`screening.py`). If the footprints of two effects have a cosine ρ and one is fitted instead of the other,
their BIC differs by about λ²(1 − ρ²). If this is below 10, the pair is called inseparable (`confusability`).

For an effect that was not found, `unseen` adds it to the present residual in the linear model around the fit. There its
λ adds to its present score, of either sign. The sum must pass the gates of step 6: the threshold, the penalty of its
parameters by BIC, and the roughness of the accepted causes. It passes in 95 % of cases if λ exceeds the highest of
these limits by the 95 % quantile of a normal score, and by the present score if that has the opposite sign. This λ,
divided by λ per unit of amplitude, is the smallest detectable size. If the residual exceeds the noise, no size is
reported, because then the residual decides which effects pass.
"""

from __future__ import annotations

import math
from collections.abc import Collection
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from diagnosis.contracts import Array, Parameter
from diagnosis.engine.config import (
    DISTINGUISHED,
    FAR,
    FLOOR_SLACK,
    HIDDEN_FOOTPRINT,
    POWER95,
    WORTH_A_LINE,
    Config,
)
from diagnosis.engine.fitting.fit import FittedModel
from diagnosis.engine.screening import Screening
from diagnosis.estimates import in_words, number, numbers
from diagnosis.finding import Confusability, Pair, Unseen


def confusability(screening: Screening) -> Confusability:
    """Return the cosines between the footprints of all pairs of effects. For each pair, use the points of their grids
    with the largest cosine.

    The score λ of each effect is computed for an amplitude of one prior spread (`typical`). If one effect is fitted
    instead of the other, the predicted BIC gap is λ²(1 − cosine²), with the smaller λ of the two. If this gap is below
    10, the pair is called inseparable.
    """
    names = list(dict.fromkeys(c.effect.name for c in screening.candidates))
    places = {n: [i for i, c in enumerate(screening.candidates) if c.effect.name == n] for n in names}
    alike = np.abs(screening.projection.cosines)
    cosines = np.array([[float(alike[np.ix_(places[a], places[b])].max()) for b in names] for a in names])
    lambdas = [max(float(typical(screening)[i]) for i in places[n]) for n in names]
    pairs = []
    for a, b in combinations(range(len(names)), 2):
        gap = min(lambdas[a], lambdas[b]) ** 2 * max(0.0, 1.0 - cosines[a, b] ** 2)
        if cosines[a, b] > WORTH_A_LINE:
            pairs.append(
                Pair(
                    first=names[a],
                    second=names[b],
                    cosine=number(cosines[a, b]),
                    bic_gap=number(gap),
                    separable=bool(gap >= DISTINGUISHED),
                )
            )
    return Confusability(
        effects=names,
        cosines=[numbers(row, 4) for row in cosines],
        pairs=sorted(pairs, key=lambda pair: pair.bic_gap or 0.0),
    )


def typical(screening: Screening) -> Array:
    """Return λ (m,) of every candidate, for an amplitude as large as its prior spread."""
    return screening.root_information * np.array([c.effect.amplitude.spread for c in screening.candidates])


@dataclass(frozen=True, slots=True)
class Company:
    """The model to which a further effect is added: χ² explained by its causes, number of samples, ratio of error to
    noise.
    """

    explained: float
    samples: int
    noise_ratio: float
    config: Config

    @property
    def quiet(self) -> bool:
        """Whether the residual does not exceed the noise."""
        return not self.noise_ratio**2 > FLOOR_SLACK

    def gates(self, threshold: float, parameters: int) -> float:
        """Return the smallest λ that passes the gates of step 6, for an effect with this number of parameters."""
        rough = self.config.rough**2 * self.explained + threshold**2 if self.explained else 0.0
        return math.sqrt(max(threshold**2, parameters * math.log(self.samples), rough))


def unseen(
    screening: Screening, model: FittedModel, company: Company, found: Collection[str] = ()
) -> list[Unseen]:
    """Return for each effect that was not found the smallest size that would be found in 95 % of cases.

    The size is for the point of the grid where the effect is most visible. ``screening`` holds the scores after
    projection on ``model``.
    """
    names = [n for n in dict.fromkeys(c.effect.name for c in screening.candidates) if n not in found]
    result = []
    for name in names:
        mine = [i for i, c in enumerate(screening.candidates) if c.effect.name == name]
        best = max(mine, key=lambda i: float(screening.root_information[i]))
        result.append(_unseen(screening, model, company, best))
    return result


def _unseen(screening: Screening, model: FittedModel, company: Company, place: int) -> Unseen:
    candidate, per_unit = screening.candidates[place], float(screening.root_information[place])
    effect, amplitude = candidate.effect, candidate.effect.amplitude
    raw = float(screening.projection.raw[place])
    visible = float(screening.projection.norm[place]) / raw if raw > 0.0 else 0.0
    most = min(FAR * amplitude.spread, max(abs(amplitude.low), abs(amplitude.high)))
    score = float(screening.z[place])
    against = max(-score, 0.0) if effect.one_sided else abs(score)
    needed = company.gates(screening.threshold, len(effect.parameters)) + POWER95 + against
    smallest = needed / per_unit if per_unit > 0.0 else math.inf
    # What of the model imitates the footprint best, by the size of its part.
    parts = np.abs(screening.projection.regression[:, place]) * np.sqrt(
        np.diagonal(model.linearisation.information)
    )
    hidden_by = ""
    if visible < HIDDEN_FOOTPRINT and parts.size:
        hidden_by = model.point.coordinates[int(np.argmax(parts))].label
    unit = _unit(amplitude)
    if raw == 0.0:
        sentence = "it has no influence on these runs"
    elif smallest > most:
        sentence = (
            "a parameter of the model can imitate it in these runs"
            if hidden_by
            else "it is not visible in these runs"
        )
    elif not company.quiet:
        sentence = "the remaining error is larger than the noise"
    else:
        at = ", ".join(_with_unit(p, v) for p, v in zip(effect.shapes, candidate.shapes, strict=True))
        size = f"{smallest / amplitude.scale:.3g} {unit}".rstrip()
        sentence = f"{_named(amplitude)} from {size}"
        sentence += f" (for {at})" if at else ""
    return Unseen(
        effect=effect.name,
        title=effect.title,
        family=effect.family,
        unit=unit,
        smallest=number(smallest / amplitude.scale) if smallest <= most and company.quiet else None,
        visible=number(visible),
        hidden_by=hidden_by,
        sentence=sentence,
    )


def _named(parameter: Parameter) -> str:
    return parameter.title or in_words(parameter.name)


def _with_unit(parameter: Parameter, value: float) -> str:
    return f"{_named(parameter)} {value / parameter.scale:.3g} {_unit(parameter)}".rstrip()


def _unit(parameter: Parameter) -> str:
    """The display unit; "" for a pure number."""
    unit = parameter.display or parameter.unit
    return "" if unit == "1" else unit
