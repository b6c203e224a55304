"""Two sets of effects that each look better under the other's noise: the likelihood with all constants decides."""

from math import log
from types import SimpleNamespace

import numpy as np
import pytest

from diagnosis.engine.rivals import _settled
from diagnosis.engine.search_state import CurrentModel, SearchState, Trial

SAMPLES = 100


def state(effect, bic, noise, rival, rival_bic):
    run = SimpleNamespace(counted=np.ones((SAMPLES, 1), bool))
    model = SimpleNamespace(
        effects=(effect,),
        bic=bic,
        replay=SimpleNamespace(runs=(run,)),
        noise=SimpleNamespace(dispersion=1.0, channels=(SimpleNamespace(innovation=noise),)),
    )
    trial = Trial(rival, SimpleNamespace(owners=(rival,)), np.eye(1), rival_bic, rival_bic, 0.0)
    return SearchState(CurrentModel(model, None, None, None), np.ones(1), rivals={effect: (trial,)})


@pytest.mark.parametrize("last", ["friction", "branch"])
def test_a_swap_ends_on_the_better_set_and_its_rival_is_behind(last):
    # Under the noise of either, the other one looks better by 50; the noise of the branch is twice as large.
    visited = {
        frozenset({"friction"}): state("friction", 100.0, 1.0, "branch", 50.0),
        frozenset({"branch"}): state("branch", 60.0, 2.0, "friction", 10.0),
    }
    settled = _settled(visited, visited[frozenset({last})])
    assert settled.current.effects == ("friction",)
    (rival,) = settled.rivals["friction"]
    assert rival.effect == "branch"
    assert rival.bic - settled.current.model.bic == pytest.approx(60.0 - 100.0 + SAMPLES * log(4.0))


def test_a_worse_rival_keeps_its_bic():
    only = state("friction", 100.0, 1.0, "lag", 130.0)
    settled = _settled({frozenset({"friction"}): only}, only)
    assert [trial.bic for trial in settled.rivals["friction"]] == [130.0]
