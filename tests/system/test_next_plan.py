"""After any loss the next plan runs, or is blocked by a correct reason with a possible action."""

import random

import pytest

from test_plans.discovery import plans
from tests.system.next_plan.__main__ import PAGE
from tests.system.next_plan.losses import LOSSES, Loss
from tests.system.next_plan.matrix import SEED, asked, beginnings, cells
from tests.system.next_plan.truth import untruths

KINDS = list(dict.fromkeys(loss.of for loss in LOSSES))


def _drawn(what: str, losses: list[Loss]) -> tuple[Loss, str, float]:
    """Draw a loss, a plan before which the page lists it, and the delay after it."""
    chance = random.Random(f"{what} {SEED}")
    loss = chance.choice(losses)
    name = chance.choice([name for name in beginnings() if loss in asked(name)])
    return loss, name, chance.choice(asked(name)[loss])


def test_the_page_tells_of_every_loss_and_every_plan_of_the_catalogue() -> None:
    page = PAGE.read_text()
    told = [f"| {loss.of} | {loss.name} |" for loss in LOSSES] + [f"`{name}`" for name in plans()]
    assert not [one for one in told if one not in page]
    assert "not gone over yet |" not in page


@pytest.mark.slow
@pytest.mark.timeout(300)
@pytest.mark.parametrize("kind", KINDS)
def test_the_next_plan_runs_or_says_truly_why_not(kind: str) -> None:
    loss, name, delay = _drawn(kind, [loss for loss in LOSSES if loss.of == kind])
    (cell,) = cells(loss, {name: (delay,)})
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
