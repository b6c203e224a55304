"""Step 8, what is said before the verdict: base parameters far from what is believed of them, whatever was named.

A prior that is contradicted by ten of its standard deviations is wrong, or the data are not what they are taken for: a
unit, a sign, a bore. What was named beside such a number is named for a system that nobody has.
"""

from __future__ import annotations

from diagnosis.engine.config import BELIEFS_TOLD, CONTRADICTED_PRIOR
from diagnosis.engine.fitting.fit import FittedModel


def contradicted(model: FittedModel) -> list[str]:
    """Return sentences on the base parameters of a fitted model that lie far outside of their priors."""
    pairs = zip(model.point.coordinates, model.point.numbers, strict=True)
    far = [(abs(float(u)), c) for c, u in pairs if c.weight and not c.owner and abs(u) > CONTRADICTED_PRIOR]
    sentences = []
    for sigmas, coordinate in sorted(far, key=lambda pair: -pair[0])[:BELIEFS_TOLD]:
        parameter = coordinate.parameter
        number = model.point.numbers[model.point.place(coordinate)]
        value, nominal, spread = (
            one / parameter.scale
            for one in (coordinate.to_value(number), parameter.nominal, parameter.spread)
        )
        sentences.append(
            f"{coordinate.label} was fitted as {value:.4g} {parameter.display or parameter.unit}, {sigmas:.0f} σ from "
            f"its expected value, {nominal:.4g} ± {spread:.2g}: check the units, signs and settings with which the "
            "data were read"
        )
    return sentences
