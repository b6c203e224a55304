"""Doubt: a name is not told where the form of the model errs so much that its effect may be nothing."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from diagnosis.engine.doubt import vague
from diagnosis.engine.fitting.fit import fit
from diagnosis.engine.fitting.point import base_point, effect_coordinates
from diagnosis.engine.fitting.replay import Replay
from diagnosis.engine.footprints import candidates, footprints, with_surfaces
from diagnosis.engine.noise import white
from diagnosis.engine.screening import fit_and_screen
from diagnosis.systems.oscillator import REACH, SURFACE_SHAPE, coefficients_of

#: A damper (N) that acts in one direction only.
ONE_WAY = np.maximum(np.linspace(-REACH[1], REACH[1], SURFACE_SHAPE[1]), 0.0) * np.ones((SURFACE_SHAPE[0], 1))
QUADRATIC = {"quadratic": {"amplitude": 1500.0}}


def named_quadratic(laboratory, force_surface, hidden):
    """Fit a quadratic spring to what was hidden, and test the surface beside it."""
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
    accepted = [SimpleNamespace(effect="quadratic")]
    place = found.model.point.place_of_amplitude("quadratic")
    sure = abs(found.model.point.numbers[place]) / np.sqrt(found.model.covariance()[place, place])
    assert sure > 5.0  # noise alone leaves no doubt
    assert vague(found.model, found.tests, accepted) == unsure
