"""Lateral stiffness against roll angle under AW3 (figure 10b)."""

from typing import Final

from bench_protocol.units import rad, s
from test_plans import steps
from test_plans.by_roll import ROLL_CHECKS, lateral_stiffness_over_roll
from test_plans.fittings import CONNECTIONS, leave_connected
from test_plans.loads import AW3
from test_plans.plan import plan
from test_plans.poses import POSING
from test_plans.preconditions import on_the_bench
from test_plans.run import Run
from test_plans.waves import SLOW_LATERAL_WAVES

ANGLES: Final = tuple(k * 0.01 * rad for k in range(1, 7))


@plan(
    setup=steps.carry(AW3),
    teardown=leave_connected,
    lasts=330 * s,
    needs=(*steps.CARRYING, *POSING, *SLOW_LATERAL_WAVES, *CONNECTIONS),
    requires=on_the_bench(AW3),
    checks=ROLL_CHECKS,
)
def roll_angle_aw3(run: Run) -> None:
    """Roll angle, full car: lateral stiffness at fixed rolls of 0, ±0.01 … ±0.06 rad.

    Both springs stand at design height, 20 mm to the left, all valves shut. The vertical actuators roll the bolster,
    and the platform rolls against it, so that the bolster stays clear of its bump stop. At each angle, first with the
    left side up and then with the other, the lateral actuator moves by 5 mm at 1 Hz about the 20 mm: the mean force
    gives the secant F/y, the motion the first harmonic, both per spring. All of it first with the differential pressure
    valve isolated, then with it open; what parts the pressures is kept beside. Beyond
    0.06 rad the lower spring would take more than its actuator can give.

    Good is coupling as the sheared column predicts: the force at y = +20 mm grows with the left side up, by as much as
    it falls with the other, and changes little beyond 0.05 rad; the first harmonic does not grow.
    """
    lateral_stiffness_over_roll(run, run.specimen.load(AW3), ANGLES)
