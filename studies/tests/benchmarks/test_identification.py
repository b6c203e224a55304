"""How often intervals of an identification hold is counted over pairs of springs, whose errors go together."""

import json

import numpy as np

from astb_studies.benchmarks.identification.__main__ import COUNTED, FURTHEST, coverage, drawn
from bench_sim.parameters import load
from diagnosis.systems.air_spring.identified import ASKED


def pairs(spread, count=60, rows=30, together=0.0):
    """Pairs of springs whose values are off by normal numbers, some part of which a pair has in common."""
    chance = np.random.default_rng(3)
    for _ in range(count):
        away = spread * (
            np.sqrt(1 - together) * chance.normal(size=rows) + np.sqrt(together) * chance.normal()
        )
        yield {"rows": {str(k): [1.0, 1.0 + 0.1 * one, 0.1, 0.2] for k, one in enumerate(away)}}


def test_springs_are_drawn_as_they_are_believed_and_always_the_same():
    believed = load("astb")
    for seed in range(20):
        one = drawn(seed)
        for name, asked in ASKED.items():
            value, middle = (np.asarray(which.entries[name].value) for which in (one, believed))
            assert (np.abs(value / middle - 1.0) <= FURTHEST * asked.spread * (1 + 1e-9)).all(), name
            assert asked.each or value[0] == value[-1]
    assert drawn(7).digest() == drawn(7).digest() != drawn(8).digest()


def test_intervals_of_normal_errors_hold_as_often_as_their_own_interval_says():
    share, half = coverage(list(pairs(1.0)))
    assert abs(share - 0.95) < half < 0.02
    narrow, _ = coverage(list(pairs(1.5)))
    assert narrow < 0.85
    # Correlated errors leave as many intervals, with less information.
    assert coverage(list(pairs(1.0, together=0.8)))[1] > 2.0 * half


def test_what_was_counted_is_complete_and_of_springs_that_can_be_drawn_again():
    lines = [json.loads(line) for line in COUNTED.read_text().splitlines()]
    assert [one["seed"] for one in lines] == list(range(1, len(lines) + 1))
    for one in lines[:3]:
        springs = drawn(one["seed"])
        for name, (true, *_) in one["rows"].items():
            place = int(name.startswith("right."))
            value = float(np.asarray(springs.entries[name.rpartition(".")[2]].value)[place])
            np.testing.assert_allclose(true, value, rtol=1e-6)
