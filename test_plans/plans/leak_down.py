"""Leak-down: whether the springs keep their air."""

from typing import Final

from bench_protocol.units import s
from test_plans import steps
from test_plans.loads import AW3
from test_plans.plan import plan
from test_plans.preconditions import on_the_bench
from test_plans.run import Run

#: The gas of a fast filling cools with a time constant of 13 s; meanwhile pressure and temperature are not steady.
COOL: Final = 15 * s
HOLD: Final = 30 * s


def fill(run: Run) -> None:
    """Set the zero of the heights, arm the bench, lift the bolster to design height, and fill both springs to the
    pressure of the full car.
    """
    load = run.specimen.load(AW3)
    steps.shim(run, load)
    steps.power_up(run)
    steps.raise_the_air(run, load)


@plan(
    setup=fill,
    lasts=70 * s,
    needs=(*steps.CARRYING, *steps.WEIGHED_BY),
    requires=on_the_bench(AW3),
    checks=[steps.TIGHT],
)
def leak_down(run: Run) -> None:
    """Leak-down: fill the springs, shut every valve, weigh the air before and after.

    The bolster is held at design height and both springs are filled to the pressure of the full car. The pressure also
    falls when the gas cools. Therefore the mass of air is compared: m = pV/(RT) of each spring, summed over bellows and
    auxiliary chamber. It must remain constant.
    """
    steps.lock_the_air(run)
    with run.phase("cool"):
        run.bench.wait(COOL)
    before = steps.weigh_the_air(run)
    with run.phase("hold"):
        run.bench.wait(HOLD)
    steps.check_tightness(run, run.specimen.load(AW3), before)
