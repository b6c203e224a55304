"""Wind, track and roll at once, as the figures show it: which runs there are, and where each stands."""

from types import SimpleNamespace

import numpy as np
import pytest

from astb_studies.paper.bench_results import BenchResults, NoBenchResult
from astb_studies.paper.combined import DAMPING, DEFAULT, PHASE, STIFFNESS, VARIED, cases, name_of, plan_of
from astb_studies.paper.subject import LOADS
from bench_protocol.units import bar, mrad
from test_plans.discovery import plans


def test_every_run_is_made_once_and_its_plan_takes_it():
    runs = list(cases())
    assert len({name for name, *_ in runs}) == len(runs)
    for _, plan, given in runs:
        assert plans()[plan].given(given).values
    for over, value in DEFAULT.items():
        assert all(plans()[plan].values[over] == value for plan in (plan_of(load) for load in LOADS))
    for name, plan, _ in runs:
        assert name.startswith(plan)
    wanted = {name_of(load, given) for load in LOADS for many in VARIED.values() for given in many}
    assert {name for name, *_ in runs} == wanted
    assert {STIFFNESS, DAMPING} <= {str(one) for one in plans()["crosswind_and_track_aw0"].checks}


def made():
    """A bench on which the stiffness of the pair is 300 kN/m with U = 6, at 2 bar more each run."""
    found, pressures = {}, {}
    for k, (name, *_) in enumerate(cases()):
        kept = SimpleNamespace(group=f"{STIFFNESS}, wind and track", ys=[300e3], expanded=[6e3])
        found[name] = SimpleNamespace(curves=[kept])
        pressures[name] = [("settle", 9 * bar), (PHASE, (2 + 0.1 * k) * bar)]
    return BenchResults({}, pressures, (np.zeros(2), np.zeros(2)), found)


def test_a_point_is_one_spring_s_half_of_the_pair_with_its_uncertainty():
    one = made().at_once("AW0", "pressure", STIFFNESS)
    np.testing.assert_allclose(one.x, [2 * bar, 2.1 * bar, 2.2 * bar])
    assert (one.y == 150e3).all()
    assert (one.low == 147e3).all()
    assert (one.high == 153e3).all()
    rolls = np.array([-5.0, 0.0, 5.0, 20.0, 35.0]) * mrad
    np.testing.assert_allclose(made().at_once("AW3", "roll", STIFFNESS).x, rolls, atol=1e-12)
    np.testing.assert_allclose(made().at_once("AW3", "frequency", STIFFNESS).x, [0.6, 1.2, 1.8])


def test_what_a_run_did_not_measure_is_named():
    with pytest.raises(NoBenchResult, match=r"aw0-pressure=0\.85 measured no lateral damping"):
        made().at_once("AW0", "pressure", DAMPING)
