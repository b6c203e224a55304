"""Difference quotients of a simulator that jumps: what is not the derivative is not taken for it."""

from types import MappingProxyType

import numpy as np
import pytest

from diagnosis.contracts import Channel, Experiment, Hypothesis, MeasuredRun, Nuisance, Parameter
from diagnosis.engine.fitting.point import base_point
from diagnosis.engine.fitting.replay import Replay
from diagnosis.engine.footprints import candidates, confirmed, footprints

TIME = np.linspace(0.0, 1.0, 201)
LATE = TIME > 0.6
STEP = 0.1


class Turning:
    """y = a t + c sin 9 t; from 0.6 s on it is off by a ``jump`` where ``turns(a, c)``."""

    name = "turning"
    channels = (Channel("y", "1", noise=0.01),)
    nuisances = (Nuisance("a", "1", 0.0, 1.0, step=STEP),)
    catalogue = MappingProxyType(
        {"c": Hypothesis("c", "wave", "a wave", Parameter("c", "1", 0.0, 1.0, -10.0, 10.0, STEP))}
    )
    surfaces = ()

    def __init__(self, turns):
        self.turns = turns

    def run(self, experiment, parameters, effects):
        c = effects.get("c", {}).get("c", 0.0)
        wave = parameters["a"] * TIME + c * np.sin(9.0 * TIME)
        return (wave + 0.05 * LATE * self.turns(parameters["a"], c))[:, None]


def replay_of(turns):
    rng = np.random.default_rng(1)
    still = np.zeros(len(TIME), bool)
    run = MeasuredRun(Experiment("one", TIME, {}), 0.01 * rng.standard_normal((len(TIME), 1)), ~still, still)
    return Replay(Turning(turns), (run,), 1)


@pytest.mark.parametrize(
    "turns",
    [
        lambda a, c: a > 0.7 * STEP,
        lambda a, c: a > 0.3 * STEP,
        lambda a, c: a < -0.7 * STEP,
        lambda a, c: abs(a) > 0.7 * STEP,
        lambda a, c: a > 0.0,
    ],
    ids=["ahead", "half-way", "behind", "both sides", "at once"],
)
def test_a_jump_on_the_way_is_not_in_the_column_of_a_nuisance(turns):
    replay = replay_of(turns)
    point = base_point(Turning.nuisances, ["one"])
    predictions = replay.predictions(point)
    (columns,) = replay.sensitivities(point, predictions)
    assert columns.along(np.ones(1)) == pytest.approx(TIME, abs=1e-5)


@pytest.mark.parametrize(
    ("place", "sound"), [(0.7, True), (0.3, True), (3.0, True), (-0.3, True), (0.01, False)]
)
def test_a_footprint_that_exceeds_is_made_again_without_a_jump(place, sound):
    """Only one that no step escapes keeps it, whatever side it has; untouched footprints are not made again."""
    replay = replay_of(lambda a, c: c > place * STEP if place > 0.0 else c < place * STEP)
    if place == 0.01:
        replay = replay_of(lambda a, c: abs(c) > place * STEP)
    around = footprints(
        replay, base_point(Turning.nuisances, ["one"]), candidates([*Turning.catalogue.values()])
    )
    norm = np.linalg.norm(np.sin(9.0 * TIME)) / 0.01
    again = confirmed(replay, around, [0], np.array([norm]))
    assert confirmed(replay, around, [], np.array([norm])) is around
    true = np.allclose(again.candidate_columns[0].along(np.ones(1)), np.sin(9.0 * TIME), atol=1e-5)
    assert true == sound
    assert (again is around) == (place in (3.0, -0.3))
