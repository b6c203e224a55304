"""AW0 and AW3, the empty and the full car: one test instruction, a plan for each."""

from bench_protocol.units import s
from test_plans import steps
from test_plans.loads import AW0, AW3
from test_plans.plan import plan_under
from test_plans.preconditions import on_the_bench
from test_plans.run import Run


def _under_load(run: Run, load: str) -> None:
    """{load}: the {car} car, {preload} on each spring.

    The bolster is lifted, the springs are filled, and the leveling valves bring them to their design height under the
    preload of the {car} car. When the gas temperature is steady, the bench makes these measurements:

    * The leveling valve controls the height of each spring: the bench measures load, height and pressure.
    * Height and pressure are held: the bench measures lateral stiffness and damping of the pair. The motions are a slow
      triangle and sines of 0.5 to 3 Hz with an amplitude of 5 mm. Stiffness and damping are those of the first
      harmonic.
    * All valves are shut: the bench moves the springs vertically with the same waves. It measures stiffness and damping
      of each spring.
    * The total preload is constant: its distribution on the two sides is changed, which rolls the bolster. The roll is
      too small to open the differential pressure valve. Then the platform follows a unilateral cosine of 5 mm, as on a
      track.
    * At the end the bench measures the mass of air that each spring has lost while the valves were shut.

    A spring passes if stiffness, damping, pressure and air loss are within the limits of the specimen's file. The
    springs are vented at the end in any case.
    """
    stated = run.specimen.load(load)
    steps.check_air(run, stated)
    steps.hold_the_height(run)
    steps.lateral_loop(run, stated)
    steps.lateral_sweep(run, stated)
    steps.lock_the_air(run)
    air = steps.weigh_the_air(run)
    steps.vertical_loop(run, stated)
    steps.vertical_sweep(run, stated)
    steps.free_the_bolster(run)
    steps.roll_by_unequal_preload(run, stated)
    steps.track_excitation(run)
    steps.check_tightness(run, stated, air)


aw0, aw3 = (
    plan_under(
        load,
        _under_load,
        name,
        setup=steps.carry(load),
        needs=steps.CARRYING,
        lasts=lasts,
        requires=on_the_bench(load),
        checks=steps.UNDER_LOAD,
    )
    for load, name, lasts in ((AW0, "aw0", 100 * s), (AW3, "aw3", 110 * s))
)
