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
    """Set the zero of the heights, arm the bench, lift the bolster to design height, and fill both springs to the
    pressure of the empty car.
    """
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

    The bolster is held at design height. Both springs are filled to the pressure of the empty car, and all valves are
    shut. The air is weighed before and after a time `hold`: m = pV/(RT), summed over bellows and auxiliary chamber. The
    same follows at the pressure of the full car. When the gas cools, the pressure falls without a leak; only a loss of
    mass is a leak. A seat that closes under pressure leaks at the lower pressure; a crack that opens leaks at the
    higher pressure.

    A spring passes if the air loss per minute is within the limit of the specimen's file at both pressures. A longer
    hold detects smaller leaks: in half a minute, the bench resolves 0.05 % per minute.
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
