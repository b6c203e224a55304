"""A sound rig that others have used before is not rejected: plans one after the other on one rig."""

import random

import pytest

from test_plans.discovery import plans
from test_plans.execution import execute
from tests.plans.conftest import explained

#: All plans that judge and need no manual work.
JUDGING = (
    "aw0",
    "aw3",
    "axial_stiffness",
    "differential_pressure_valve",
    "dynamic_stiffness",
    "lateral_pressure_aw0",
    "leak_down",
    "leveling_on",
    "measuring_chain",
    "orifice_plates",
    "roll_coupling",
)

pytestmark = pytest.mark.slow


def rejects(made, names, directory) -> list[str]:
    """Return what the plans ``names`` have against a sound rig, one after the other."""
    found = []
    for k, name in enumerate(names):
        result = explained(execute(plans()[name], made.bench, directory / f"{k}", rig="virtual", seed=0))
        found += [
            f"{name} after {', '.join(names[:k])}: {one.name}" for one in result.checks if not one.passed
        ]
        if not result.checks:
            found.append(f"{name} after {', '.join(names[:k])}: {result.reason}")
    return found


@pytest.mark.parametrize("seed", [0, 1, 3])
def test_the_measuring_chain_passes_as_often_as_it_is_run(bench_composed, tmp_path, seed):
    with bench_composed(seed) as made:
        assert rejects(made, ["measuring_chain"] * 5, tmp_path) == []


def test_plans_pass_after_one_another(bench_composed, tmp_path):
    chance = random.Random(35)
    with bench_composed(5) as made:
        assert rejects(made, chance.choices(JUDGING, k=10), tmp_path) == []
