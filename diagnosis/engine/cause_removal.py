"""Step 7, removal of causes: find named causes that a surface without a name makes superfluous.

Theory of operation
-------------------
A stop that is in no catalogue looks like a cubic spring, so the search names a cubic spring. A surface then explains
the residual of the spring. Three questions decide whether the spring is a cause or only similar to one:

* Can the surface imitate the effect? It can if the data contain hardly any information on the amplitude once the
  surface is in the model (`_imitable`). The surface may then be larger than its prior.
* Does the effect explain anything in addition to the surface? The model with the surface is fitted with and without the
  effects. A true cause keeps a large part of its gain, because it has a memory that no surface has, or also holds
  outside of the measured range.
* Does the surface explain the same as the effect? Many effects are surfaces themselves: dry friction is a function of
  the speed. A surface with many coefficients follows it on the fit runs. This is imitation and no reason for doubt. So
  the surface must predict the validation runs *as it was fitted*, without the named effects, and better than a model
  with neither.

Effects are doubtful and leave the model only if all three hold: a surface can imitate them, they gain hardly anything
in addition to it, and it predicts the validation runs itself. Otherwise the name stays, and a surface may explain the
remaining error.

Some errors of the equations are no surface either, such as a spring that softens with its load history. A cubic spring
imitates most of the error, and a surface a part of the remainder. None of the three questions finds that. But if a
surface can imitate a cause, and the cause is not clearly larger than the effect of that surface *in addition* to it,
one unknown term is more likely than two terms (`no_clearer`). Both are measured on fit runs and validation runs.

One more question applies to each name that stays: can its amplitude be 0 if the model is everywhere as wrong as the
surfaces show? The interval of the amplitude includes such an error (`model_error.py`). If it includes 0, the effect is
`vague`. There are two tests: by the standard deviation, and by λ², the increase of χ² at amplitude 0, compared with the
increase at the end of an equally wide interval. The latter does not apply to a cause that removes most of the error of
the validation runs, because its amplitude is clearly not 0. The former does not apply to a cause that was found at a
finite size and saturates. For example, the harder a stop is, the less its stiffness matters, so the curvature at the
fit gives no information about 0.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence

import numpy as np

from diagnosis.contracts import MeasuredRun
from diagnosis.engine.config import (
    CLEAR_OF_FORM,
    GAIN_WITH_SURFACE,
    IMITATED_INFORMATION,
    PREDICTED_SHARE,
    SATURATED,
    WIDER_SURFACE,
    Config,
)
from diagnosis.engine.fitting.fit import FittedModel, fit
from diagnosis.engine.fitting.linear import inverse
from diagnosis.engine.fitting.point import Point, surface_coordinates
from diagnosis.engine.fitting.predict import predict
from diagnosis.engine.model_error import widened
from diagnosis.engine.omnibus import Omnibus
from diagnosis.engine.prediction_share import ResidualBound
from diagnosis.engine.search_state import Accepted
from diagnosis.estimates import Z95


def doubtful(
    model: FittedModel,
    test: Omnibus,
    accepted: Sequence[Accepted],
    select: Sequence[MeasuredRun],
    config: Config,
) -> tuple[str, ...]:
    """Return the accepted effects of a fitted model that the surface of ``test`` makes superfluous."""
    likenesses = [one for one in accepted if _imitable(model, test, one.effect)]
    if likenesses and _superfluous(model, test, likenesses, select, config):
        return tuple(one.effect for one in likenesses)
    return ()


def no_clearer(model: FittedModel, clear: Sequence[Omnibus], accepted: Sequence[Accepted]) -> tuple[str, ...]:
    """Return the accepted effects that are not clearly larger than a surface of ``clear`` that can imitate them.

    The gain of the effect is compared with the excess of the surface test.
    """
    return tuple(
        one.effect
        for one in accepted
        if any(
            one.explained < CLEAR_OF_FORM**2 * test.excess and _imitable(model, test, one.effect)
            for test in clear
        )
    )


def vague(
    model: FittedModel,
    tests: Sequence[Omnibus],
    accepted: Sequence[Accepted],
    left: ResidualBound | None = None,
    finite: Collection[str] = (),
) -> tuple[str, ...]:
    """Return the least certain accepted effect, if its amplitude can be 0 within the error of the equations.

    ``left`` holds the residual on the validation runs per effect; ``finite`` are effects that were found at finite
    amplitudes.
    """
    variances = np.diagonal(widened(model, tests, left))
    plain = np.diagonal(model.covariance())
    certainty = {}
    for one in accepted:
        place = model.point.place_of_amplitude(one.effect)
        by_number = abs(model.point.numbers[place]) / float(np.sqrt(variances[place]))
        by_chi2 = one.lambda_ * float(np.sqrt(plain[place] / variances[place]))
        if by_chi2 < Z95 <= by_number and left is not None and left(model, one.effect) < PREDICTED_SHARE:
            by_chi2 = by_number
        if one.effect in finite and by_chi2 > SATURATED * by_number:
            by_number = by_chi2
        certainty[one.effect] = min(by_number, by_chi2)
    least = min(certainty, key=certainty.__getitem__)
    return (least,) if certainty[least] < Z95 else ()


def _imitable(model: FittedModel, test: Omnibus, effect: str) -> bool:
    """Return whether the surface of ``test`` removes most of the information of the data on an effect's amplitude."""
    linearisation = model.linearisation
    place = linearisation.point.place_of_amplitude(effect)
    variance = linearisation.covariance()[place, place]
    imitation = test.projection.regression[place]
    ridge = np.eye(len(test.start)) / WIDER_SURFACE**2
    more = imitation @ inverse(test.projection.information + ridge) @ imitation
    return bool(variance < (1.0 - IMITATED_INFORMATION) * (variance + more))


def _superfluous(
    model: FittedModel,
    test: Omnibus,
    accepted: Sequence[Accepted],
    select: Sequence[MeasuredRun],
    config: Config,
) -> bool:
    """Return whether a surface explains nearly as much without the effects as with them, also on the ``select``
    runs.
    """
    coefficients = surface_coordinates(test.surface)
    beside = model.point.extended(coefficients, [c.parameter.nominal for c in coefficients])
    alone = beside
    for one in accepted:
        alone = alone.without(one.effect)
    # Together with much that has no name, a small cause is a part of that sooner than of anything else.
    part = GAIN_WITH_SURFACE * max(1.0, test.statistic / sum(a.lambda_**2 for a in accepted))
    with_, without = (fit(model.replay, model.noise, p, model.linearisation) for p in (beside, alone))
    if not select:
        return without.bic - with_.bic < max(config.ambiguous, part * sum(a.bic_gain for a in accepted))
    lost = predict(with_, select).lpd - predict(without, select).lpd
    if lost >= max(0.5 * config.ambiguous, part * sum(a.lpd_gain for a in accepted)):
        return False
    return _predicts(without, alone.without(test.surface.name), select)


def _predicts(surface: FittedModel, neither: Point, select: Sequence[MeasuredRun]) -> bool:
    """Return whether a surface, with its fitted coefficients, predicts the validation runs better than the model
    ``neither`` without it.
    """
    nothing = fit(surface.replay, surface.noise, neither, surface.linearisation)
    return predict(surface, select, fixed=True).lpd > predict(nothing, select, fixed=True).lpd
