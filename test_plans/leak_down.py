"""Leak-down: whether the springs keep their air."""

from typing import Final

from bench_protocol.units import s
from test_plans import steps
from test_plans.loads import AW3
from test_plans.plan import Run, plan

#: The gas of a fast filling cools with 13 s; the first of it would look like a leak to late thermometers.
COOL: Final = 15 * s
HOLD: Final = 30 * s


@plan(lasts=100 * s)
def leak_down(run: Run) -> None:
    """Leak-down: fill the springs, shut every valve, weigh the air before and after.

    The bolster is held at design height and both springs are filled to the pressure of the full car. What the gas loses
    by cooling is no leak: the mass of air in each spring, m = pV/(RT) of bellows and auxiliary chamber, must stay.
    """
    steps.raise_the_air(run, AW3)
    steps.lock_the_air(run)
    with run.phase("cool"):
        run.bench.wait(COOL)
    before = steps.weigh_the_air(run)
    with run.phase("hold"):
        run.bench.wait(HOLD)
    steps.check_tightness(run, before)
