"""Springs at lateral offsets: tangent, secant, effective area and volume (figures 7 and 9)."""

from astb_studies.paper.sweeps.offset import OFFSET_CHECKS, lateral_offsets
from bench_protocol.units import s
from test_plans import steps
from test_plans.loads import AW0, AW3
from test_plans.plan import plan
from test_plans.preconditions import on_the_bench
from test_plans.run import Run
from test_plans.steps.fittings import CONNECTIONS, leave_connected, put_down
from test_plans.steps.poses import POSING
from test_plans.steps.waves import SLOW_LATERAL_WAVES


@plan(
    setup=steps.carry(AW0),
    teardown=leave_connected,
    lasts=375 * s,
    needs=(*steps.CARRYING, *POSING, *SLOW_LATERAL_WAVES, *CONNECTIONS),
    requires=on_the_bench(AW0, AW3),
    checks=OFFSET_CHECKS,
)
def lateral_offset(run: Run) -> None:
    """Lateral offset: stiffness, effective area and volume at 0, ±20, ±40 and ±60 mm.

    The springs are at design height, under the empty and under the full car. A bump stop would touch the centre of the
    bolster at 25 mm. So beyond 18 mm, bolster and platform are tilted together, which shears the springs further. At
    each offset, the lateral actuator adds a sine of 1 mm at 2 Hz; values are of the first harmonic, per spring.

    Then the auxiliary chambers are shut off, and the springs pass the same offsets in steps, out and back. Only the gas
    in the bellows acts, and its mass is constant: V(y)/V(0) = (T/p)/(T_0/p_0), A_e(y) = F_z/p. Four steps of height
    measure the volume itself. The secant stiffness is from the same steps.

    A good spring becomes softer with offset, and loses a little area and a little volume, as its membrane predicts.
    """
    for load in (AW0, AW3):
        if load is not AW0:
            run.hold_point(f"before {load}")
            put_down(run)
            steps.carry(load)(run)
        lateral_offsets(run, run.specimen.load(load))
