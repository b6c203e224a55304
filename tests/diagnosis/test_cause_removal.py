"""Doubt: a cause is not named if the model error is so large that its effect may be zero."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from astb_studies.oscillator import REACH, SURFACE_SHAPE, coefficients_of
from diagnosis.engine.cause_removal import no_clearer, vague
from diagnosis.engine.config import CLEAR_OF_FORM, Config
from diagnosis.engine.diagnose import diagnose
from diagnosis.engine.fitting.fit import fit
from diagnosis.engine.fitting.point import base_point, effect_coordinates
from diagnosis.engine.fitting.replay import Replay
from diagnosis.engine.footprints import candidates, footprints, with_surfaces
from diagnosis.engine.model_error import widened
from diagnosis.engine.noise import white
from diagnosis.engine.screening import fit_and_screen

#: A damper (N) that acts in one direction only.
ONE_WAY = np.maximum(np.linspace(-REACH[1], REACH[1], SURFACE_SHAPE[1]), 0.0) * np.ones((SURFACE_SHAPE[0], 1))
QUADRATIC = {"quadratic": {"amplitude": 1500.0}}


def named_quadratic(laboratory, force_surface, hidden):
    """Fit a quadratic spring to the hidden effect, and test the surface with it."""
    lab = laboratory()
    replay = Replay(replace(lab.simulator, surfaces=(force_surface,)), lab.measure(3, hidden).of("fit"), 1)
    quadratic = lab.simulator.catalogue["quadratic"]
    start = base_point(lab.simulator.nuisances, replay.names).extended(effect_coordinates(quadratic), (0.0,))
    near = fit(replay, white([c.noise for c in lab.simulator.channels]), start)
    others = candidates([one for one in lab.simulator.catalogue.values() if one is not quadratic])
    around = with_surfaces(replay, footprints(replay, near.point, others))
    return fit_and_screen(replay, around, alpha=0.01, seed=0)


@pytest.mark.parametrize(
    ("hidden", "unsure"),
    [
        (QUADRATIC, ()),
        ({"force": coefficients_of(0.5 * ONE_WAY)}, ("quadratic",)),
        (QUADRATIC | {"force": coefficients_of(0.01 * ONE_WAY)}, ()),
    ],
)
def test_a_name_is_vague_where_the_surface_shows_an_error_of_its_size(
    laboratory, force_surface, hidden, unsure
):
    found = named_quadratic(laboratory, force_surface, hidden)
    accepted = [SimpleNamespace(effect="quadratic", lambda_=np.inf)]
    place = found.model.point.place_of_amplitude("quadratic")
    sure = abs(found.model.point.numbers[place]) / np.sqrt(found.model.covariance()[place, place])
    assert sure > 5.0  # noise alone leaves no doubt
    assert vague(found.model, found.tests, accepted) == unsure


@pytest.mark.parametrize("surfaces", [0, pytest.param(1, marks=pytest.mark.slow)])
def test_a_cause_within_the_repeatability_is_not_named(laboratory, oscillator, force_surface, surfaces):
    # Three specimens, one of them with the opposite sign: their mean predicts the validation run well.
    lab = laboratory(samples=600)
    runs = [
        replace(run, experiment=replace(run.experiment, name=f"{run.experiment.name} of {size}"))
        for size in (-1.2e5, 3.6e5, 8.8e5)
        for run in lab.measure(3, {"cubic": {"amplitude": size}}).of("fit")
    ]
    rest = lab.measure(3, {"cubic": {"amplitude": 4e5}})
    data = replace(rest, runs=(*runs, *rest.of("select"), *rest.of("report")))
    config = Config(workers=1, with_panel=False, effects=("cubic", "drift"))
    finding = diagnose(data, oscillator(surfaces=(force_surface,) * surfaces), config)
    assert not finding.causes
    assert not [why for one in finding.suspects if "zero" not in (why := one.why)]
    assert all(one.parameters[0].low < 0.0 < one.parameters[0].high for one in finding.suspects)


def test_the_form_widens_no_amplitude_by_more_than_the_select_runs_leave(laboratory, force_surface):
    found = named_quadratic(laboratory, force_surface, QUADRATIC | {"force": coefficients_of(0.3 * ONE_WAY)})
    model = found.model
    place = model.point.place_of_amplitude("quadratic")
    size, plain = abs(model.point.numbers[place]), model.covariance()[place, place]
    free, bound, none = (
        widened(model, found.tests, left)[place, place] - plain
        for left in (None, lambda _model, _effect: 0.01, lambda _model, _effect: np.inf)
    )
    assert free > 4.0 * (0.01 * size) ** 2  # or there were nothing to limit
    assert bound == pytest.approx((0.01 * size) ** 2)
    assert none == pytest.approx(free)
    accepted = [SimpleNamespace(effect="quadratic", lambda_=1.0)]
    assert vague(model, found.tests, accepted) == ("quadratic",)  # χ² hardly rises at 0


@pytest.mark.parametrize("effect", ["quadratic", "lag"])
def test_a_cause_that_a_surface_imitates_needs_a_clearer_gain(laboratory, force_surface, effect):
    """A surface of a force over displacement and speed could be a quadratic spring, and not what delays a reading."""
    lab = laboratory()
    hidden = {"force": coefficients_of(0.3 * ONE_WAY)}
    replay = Replay(replace(lab.simulator, surfaces=(force_surface,)), lab.measure(3, hidden).of("fit"), 1)
    one = lab.simulator.catalogue[effect]
    start = base_point(lab.simulator.nuisances, replay.names).extended(effect_coordinates(one), (0.0,))
    near = fit(replay, white([c.noise for c in lab.simulator.channels]), start)
    others = candidates([other for other in lab.simulator.catalogue.values() if other is not one])
    around = with_surfaces(replay, footprints(replay, near.point, others))
    found = fit_and_screen(replay, around, alpha=0.01, seed=0)
    (test,) = found.tests
    assert test.excess > 100.0
    limit = CLEAR_OF_FORM**2 * test.excess
    small, large = (SimpleNamespace(effect=effect, explained=part * limit) for part in (0.99, 1.01))
    assert no_clearer(found.model, [test], [small, large]) == ((effect,) if effect == "quadratic" else ())
    assert no_clearer(found.model, [], [small]) == ()
