"""Step 8, warnings before the verdict: base parameters that are far from their priors.

If a parameter is ten standard deviations from its prior, the prior is wrong, or the data have another unit, sign or
dimension than assumed. A cause that is named together with such a parameter is not valid.

A base parameter that is far from its prior without the causes, and near to it with them, imitates the causes. The base
model may then predict as well as the extended one, and only the prior supports the causes.
"""

from __future__ import annotations

from diagnosis.engine.config import CONTRADICTED_PRIOR, PRIORS_SHOWN, STRAINED_PRIOR
from diagnosis.engine.fitting.fit import FittedModel
from diagnosis.engine.fitting.point import Coordinate
from diagnosis.estimates import Z95, with_unit
from diagnosis.finding import Imitation


def contradicted(model: FittedModel) -> list[str]:
    """Return a sentence for each base parameter of a fitted model that is far from its prior, for at most three."""
    pairs = zip(model.point.coordinates, model.point.numbers, strict=True)
    far = [(abs(float(u)), c) for c, u in pairs if c.weight and not c.owner and abs(u) > CONTRADICTED_PRIOR]
    sentences = []
    for sigmas, coordinate in sorted(far, key=lambda pair: -pair[0])[:PRIORS_SHOWN]:
        parameter = coordinate.parameter
        value, nominal, spread = _believed(coordinate, model)
        unit = parameter.display or parameter.unit
        fitted, half = with_unit(value, unit, 4), with_unit(Z95 * spread, unit, 2)
        sentences.append(
            f"{coordinate.in_words({})} was fitted as {fitted}, but its expected value is {nominal:.4g} ± {half} "
            f"(95 %). The distance is {sigmas:.0f} standard deviations. Check the units, signs and settings of the data"
        )
    return sentences


def imitations(base: FittedModel, extended: FittedModel) -> list[Imitation]:
    """Return the base parameters that imitate the causes: far from their priors in ``base``, but not in ``extended``.
    Largest deviation first.
    """
    found = []
    for coordinate, number in zip(base.point.coordinates, base.point.numbers, strict=True):
        with_causes = float(extended.point.numbers[extended.point.place(coordinate)])
        if not coordinate.weight or not abs(number) > STRAINED_PRIOR >= abs(with_causes):
            continue
        parameter = coordinate.parameter
        before, expected, sd = _believed(coordinate, base)
        found.append(
            Imitation(
                name=parameter.name,
                unit=parameter.display or parameter.unit,
                before=before,
                after=_believed(coordinate, extended)[0],
                expected=expected,
                sd=sd,
                sigmas=abs(float(number)),
                sigmas_after=abs(with_causes),
                run=coordinate.record,
            )
        )
    return sorted(found, key=lambda one: -one.sigmas)


def _believed(coordinate: Coordinate, model: FittedModel) -> tuple[float, float, float]:
    """Return three values in display units: the fitted value of a coordinate, and the nominal value and standard
    deviation of its prior.
    """
    parameter, number = coordinate.parameter, model.point.numbers[model.point.place(coordinate)]
    value, nominal, spread = (
        float(one) / parameter.scale
        for one in (coordinate.to_value(number), parameter.nominal, parameter.spread)
    )
    return value, nominal, spread
