"""The effects of a counted case begin on the rig at their times, and no others."""

import numpy as np
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from msgspec.structs import replace

from astb_studies.benchmarks.twin.cases import Case, faulty
from astb_studies.benchmarks.twin.rigs import begin, change
from bench_sim.parameters import load
from bench_sim.rig.rig import Rig

CASES = [case for case in faulty(200, 3) if not case.effect.startswith("pressure_drift")]


def with_effects(rig, *effects):
    record = rig.plant.parameter_array[0].copy()
    for effect, size in effects:
        change(record, effect, size)
    return record


def same(record, other) -> bool:
    return all(np.array_equal(record[name], other[name]) for name in other.dtype.names)


@settings(max_examples=15, deadline=None)
@given(first=st.sampled_from(CASES), second=st.sampled_from(CASES))
def test_effects_come_and_go_without_one_another(first, second):
    assume(first.effect != second.effect)
    one, two = (first.effect, first.size), (second.effect, second.size)
    rig = Rig(load("astb"), seed=1)
    sound, alone, both, last = (with_effects(rig, *some) for some in ((), (one,), (one, two), (two,)))
    case = Case("aw0", 1, effect=one[0], size=one[1], at=0.01, gone=0.03, second=two[0], second_size=two[1])
    begin(rig, replace(case, second_at=0.02))
    for ticks, expected in ((9, sound), (6, alone), (10, both), (10, last)):
        rig.run(ticks)
        assert same(rig.plant.parameters, expected)
