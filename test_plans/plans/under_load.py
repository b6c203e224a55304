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
    preload of the {car} car. When the gas temperature is steady, the bench measures:

    * load, height and pressure of each spring at rest on its leveling valve;
    * with height and pressure held: lateral stiffness and damping of the pair, a slow triangle and sines of 0.5 to
      3 Hz, 5 mm, first harmonic;
    * with all valves shut and the height held: vertical stiffness and damping of each spring, the same waves;
    * under constant preload: rolling by unequal preload on the two sides, too little to open the differential
      pressure valve, and the answer to the track, a unilateral cosine of 5 mm;
    * the air that the shut springs lost meanwhile.

    Good is a spring that agrees with its drawing: stiffness, damping and pressure within the limits of the
    specimen's file, and no leak. The springs are vented at the end in any case.
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
