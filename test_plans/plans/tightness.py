"""Tightness: whether the springs keep their air, at the pressures of the empty and of the full car."""

from typing import Annotated, Final

from bench_protocol.units import minutes, s
from test_plans import steps
from test_plans.loads import AW0, AW3
from test_plans.parameters import Range
from test_plans.plan import plan
from test_plans.preconditions import on_the_bench
from test_plans.run import Run

#: The gas of a fast filling cools with a time constant of 13 s; meanwhile pressure and temperature are not steady.
COOL: Final = 20 * s


def lift(run: Run) -> None:
    """Lift the bolster to design height and fill both springs to the pressure of the empty car."""
    load = run.specimen.load(AW0)
    steps.shim(run, load)
    steps.power_up(run)
    steps.raise_the_air(run, load)


@plan(
    setup=lift,
    needs=steps.CARRYING,
    requires=on_the_bench(AW0, AW3),
    lasts=140 * s,
    checks=[steps.TIGHT],
)
def tightness(run: Run, *, hold: Annotated[float, Range(20 * s, 30 * minutes, "s")] = 30 * s) -> None:
    """Tightness: fill the springs to two pressures, shut every valve, and weigh the air before and after.

    The bolster is held at design height. Both springs are filled to the pressure of the empty car, all valves are shut,
    and the air is weighed, m = pV/(RT) summed over bellows and auxiliary chamber, before and after a time `hold`; then
    the same at the pressure of the full car. What the pressure loses as the gas cools is no leak: the mass must stay.
    A seat that closes under pressure leaks at the lower one, a crack that opens at the higher one.

    Good is what the specimen's file allows to be lost in a minute, at either pressure. The longer the hold, the smaller
    the leak that shows: over half a minute the bench resolves 0.05 % a minute.
    """
    empty = run.specimen.load(AW0)
    for name in (AW0, AW3):
        load = run.specimen.load(name)
        run.hold_point(f"before the pressure of {name}")
        with run.phase(f"pressure of {name}"):
            if load is not empty:
                steps.raise_the_air(run, load)
            steps.lock_the_air(run)
            with run.phase("cool"):
                run.bench.wait(COOL)
            before = steps.weigh_the_air(run)
            with run.phase("hold"):
                run.bench.wait(hold)
            # The height is that on the shims of the empty car at both pressures.
            steps.check_tightness(run, empty, before, at=f" at {name}")
