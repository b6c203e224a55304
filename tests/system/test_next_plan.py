"""Whatever was lost before: the next plan runs, or is blocked by a reason that is true and says what to do."""

import random

import pytest

from test_plans.discovery import plans
from tests.system.next_plan.losses import LOSSES, Loss
from tests.system.next_plan.matrix import beginnings, cells
from tests.system.next_plan.stand import DELAYS
from tests.system.next_plan.truth import untruths

#: `python -m tests.system.next_plan` goes over all of them.
SEED = 1
#: Losses and beginnings that nobody has gone over yet, and beginnings that the page tells of.
NOT_YET = (
    "limit of the height",
    "overload",
    "pressure transducer dead, and stays",
    "height laser dead, 3 s",
    "height laser dead, and stays",
    "wrong checksums, 3 s",
    "wrong checksums, and stays",
    "rig restarted",
)
TRIED = ("aw0", "aw3", "axial_stiffness", "leveling", "measuring_chain", "safety")


def test_every_plan_of_the_catalogue_begins_as_one_that_is_tried() -> None:
    assert sorted(name for names in beginnings().values() for name in names) == sorted(plans())


@pytest.mark.slow
@pytest.mark.timeout(300)
@pytest.mark.parametrize(
    "loss", [loss for loss in LOSSES if loss.name not in NOT_YET], ids=lambda loss: loss.name
)
def test_the_next_plan_runs_or_says_truly_why_not(loss: Loss) -> None:
    chance = random.Random(f"{loss.name} {SEED}")
    name, delay = chance.choice(TRIED), chance.choice(DELAYS)
    (cell,) = cells(loss, [name], (delay,), SEED)
    assert not cell.wrong, f"{name}, {delay:g} s after {loss.name}: {cell.reason}"


def test_the_checker_finds_what_is_not_so(make_untrue) -> None:
    rig = make_untrue
    for reason, wrong in (
        ("the rig: something", "no known cause is named"),
        ("the rig: the emergency stop is pressed: release the button, then reset", "it is not so"),
        ("the rig: the mains are off", "nobody is told to switch them on"),
        (
            "keep away from the springs: they hold pressure (3.10 bar on the left and 0.00 bar on the right)",
            "3.10 bar",
        ),
        ("stopped; keep away from the springs", "does not come first"),
        ("the bench, in DISABLED, keeps its valves shut", "does otherwise"),
    ):
        assert any(wrong in one for one in untruths(reason, rig)), reason


@pytest.fixture
def make_untrue():
    """A rig of which nothing is lost, at rest."""
    from bench_sim.parameters import load
    from bench_sim.rig.rig import Rig

    rig = Rig(load("astb"), seed=1)
    rig.run(500)
    return rig
