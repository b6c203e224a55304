"""AW3, the full car: the test instruction as a plan."""

from bench_protocol.units import s
from test_plans import steps
from test_plans.loads import AW3
from test_plans.plan import Run, plan


@plan(setup=steps.carry(AW3), lasts=115 * s)
def aw3(run: Run) -> None:
    """AW3: the full car, 145 kN on each spring.

    The bolster is lifted, the springs are filled, and the leveling valves bring them to their design height under the
    preload of the full car. Then the bench measures, as long as the gas still cools down with the valves at work:

    * pressure, height and load at rest;
    * lateral stiffness and damping of the pair at constant preload: a slow loop, then 0.5 to 3 Hz, 5 mm.

    With all valves shut and the height held:

    * vertical stiffness and damping of each spring: a slow loop, then 0.5 to 3 Hz, 5 mm;
    * the answer to a unilateral cosine of the track, 5 mm, under constant preload;
    * rolling by unequal preload on the two sides, below what opens the differential pressure valve;
    * the air lost meanwhile.

    The air is let off at the end, whatever happened before.
    """
    steps.check_air(run, AW3)
    steps.hold_the_height(run)
    steps.lateral_loop(run, AW3)
    steps.lateral_sweep(run, AW3)
    steps.lock_the_air(run)
    air = steps.weigh_the_air(run)
    steps.vertical_loop(run, AW3)
    steps.vertical_sweep(run, AW3)
    steps.free_the_bolster(run)
    steps.roll_by_unequal_preload(run, AW3)
    steps.track_excitation(run)
    steps.check_tightness(run, air)
