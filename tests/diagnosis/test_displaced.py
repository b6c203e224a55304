"""A removed cause returns where it predicts better: more candidates do not worsen the model."""

from dataclasses import replace

import numpy as np
import pytest

from diagnosis.engine.backward import dismissed, weigh
from diagnosis.engine.config import Config
from diagnosis.engine.diagnose import diagnose
from diagnosis.engine.displaced import without_substitutes
from diagnosis.engine.fitting.point import effect_coordinates
from diagnosis.engine.fitting.replay import Replay
from diagnosis.engine.search import search
from diagnosis.engine.search_state import Problem
from diagnosis.engine.trials import current_model
from diagnosis.engine.verdict import judge

ONE = Config(workers=1, with_panel=False)
#: A cause, and what takes a part of it over where both are in the model.
SHARED = [
    ({"cubic": {"amplitude": 3e5}}, "quadratic"),
    pytest.param({"coulomb": {"amplitude": 0.5}}, "maxwell", marks=pytest.mark.slow),
    pytest.param({"maxwell": {"amplitude": 200.0, "tau": 0.1}}, "lag", marks=pytest.mark.slow),
]


def thrown_out(problem, cause, understudy):
    """Judge a search in which a cause was removed for its substitute, which was removed later."""
    found = search(problem)
    effect = problem.hypotheses[understudy]
    coordinates = effect_coordinates(effect)
    shapes = effect.grid[0] if effect.grid else ()
    point = found.model.point.extended(coordinates, (0.0, *shapes))
    state = replace(
        found.state,
        current=current_model(problem, point),
        alternatives={cause: (), understudy: ()},
    )
    state = dismissed(problem, state, {cause: "it explains too little"})
    if understudy in state.current.effects:
        state = dismissed(problem, state, {understudy: "it explains too little"})
    return judge(problem, weigh(problem, state))


@pytest.mark.parametrize(("hidden", "understudy"), SHARED, ids=str)
def test_causes_displaced_by_a_substitute_return(laboratory, hidden, understudy):
    lab = laboratory(samples=400)
    data = lab.measure(11, hidden)
    (cause,) = hidden
    problem = Problem(
        Replay(lab.simulator, data.of("fit"), 1), data.of("select"), lab.simulator.catalogue, ONE
    )
    first = thrown_out(problem, cause, understudy)
    assert not first.found.accepted
    again = without_substitutes(problem, first)
    assert [one.effect for one in again.found.accepted] == [cause]
    assert understudy in again.found.state.left
    # All candidates are among the scores again.
    scored = {one.effect.name for one in again.screened.screening.candidates}
    assert scored == set(lab.simulator.catalogue) - {cause}
    # What nothing displaced is left as it is.
    assert without_substitutes(problem, again) is again


@pytest.mark.slow
def test_a_narrower_catalogue_gives_no_better_model(laboratory):
    lab = laboratory(samples=400)
    names = sorted(lab.simulator.catalogue)
    chance = np.random.default_rng(39)
    for seed in range(6):
        hidden = {
            name: {
                "amplitude": 0.2 * lab.simulator.catalogue[name].amplitude.spread,
                **{p.name: p.nominal for p in lab.simulator.catalogue[name].shapes},
            }
            for name in chance.choice(names, 2, replace=False).tolist()
        }
        data = lab.measure(seed, hidden)
        some = tuple(chance.choice(names, int(chance.integers(1, 5)), replace=False).tolist())
        whole, narrow = (diagnose(data, lab.simulator, replace(ONE, effects=few)) for few in (None, some))
        left, least = (
            next(g.noise_ratio for g in one.gains if g.channel == "all") for one in (whole, narrow)
        )
        assert left < 1.02 * least, (seed, hidden, some)
