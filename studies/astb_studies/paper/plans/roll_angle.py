"""Lateral stiffness against roll angle (figure 10): a plan for each car."""

from typing import Final

from astb_studies.paper.sweeps.roll import ROLL_CHECKS, lateral_stiffness_over_roll
from bench_protocol.units import rad, s
from test_plans import steps
from test_plans.loads import AW0, AW3
from test_plans.plan import plan_under
from test_plans.preconditions import on_the_bench
from test_plans.run import Run
from test_plans.steps.fittings import CONNECTIONS, leave_connected
from test_plans.steps.poses import POSING
from test_plans.steps.waves import SLOW_LATERAL_WAVES

#: Beyond 0.06 rad the lower spring of the full car would take more than its actuator can give.
ANGLES: Final = {
    load: tuple(k * 0.01 * rad for k in range(1, 1 + count)) for load, count in ((AW0, 8), (AW3, 6))
}


def _roll_angle(run: Run, load: str) -> None:
    """Roll angle, {car} car: lateral stiffness at fixed rolls, in steps of 0.01 rad.

    Both springs stand at design height, 20 mm to the left, all valves shut. The vertical actuators roll the bolster,
    and the platform rolls against it, so that the bolster stays clear of its bump stop. At each angle, first with the
    left side up and then with the right side up, the lateral actuator moves by 5 mm at 1 Hz about the 20 mm. The mean
    force gives the secant F/y, and the motion gives the first harmonic, both per spring. The sequence is run with the
    differential pressure valve isolated, and then with the valve open. The pressure difference is recorded, too. The
    empty car is rolled by up to 0.08 rad, the full car by up to 0.06 rad. Beyond this, the lower spring would need
    more force than its actuator has.

    The coupling of a good spring agrees with the model of a sheared column: the force at y = +20 mm rises with the left
    side up by as much as it falls with the right side up. It changes little beyond 0.05 rad, and the first harmonic
    does not rise.
    """
    lateral_stiffness_over_roll(run, run.specimen.load(load), ANGLES[load])


roll_angle_aw0, roll_angle_aw3 = (
    plan_under(
        load,
        _roll_angle,
        name,
        setup=steps.carry(load),
        teardown=leave_connected,
        lasts=lasts,
        needs=(*steps.CARRYING, *POSING, *SLOW_LATERAL_WAVES, *CONNECTIONS),
        requires=on_the_bench(load),
        checks=ROLL_CHECKS,
    )
    for load, name, lasts in ((AW0, "roll_angle_aw0", 360 * s), (AW3, "roll_angle_aw3", 330 * s))
)
