"""Damping against pressure ratio and orifice (figure 6c)."""

from typing import Final

from astb_studies.paper.sweeps.ratio import PLATE_CHECKS, check_damping, damping_over_ratio
from bench_protocol.units import mm, s
from test_plans import steps
from test_plans.loads import AW0
from test_plans.plan import plan
from test_plans.preconditions import on_the_bench
from test_plans.run import Run
from test_plans.steps.fittings import PLATES_AND_PIPE, fit_plate, leave_as_built, put_down
from test_plans.steps.waves import VERTICAL_WAVES

PLATES: Final = tuple(d * mm for d in (10.0, 13.0, 16.0, 18.0))


def first_plate(run: Run) -> None:
    """Fit the smallest plates, then load the springs with the empty car."""
    fit_plate(run, PLATES[0])
    steps.carry(AW0)(run)


@plan(
    setup=first_plate,
    teardown=leave_as_built,
    lasts=360 * s,
    needs=(*steps.CARRYING, *VERTICAL_WAVES, *PLATES_AND_PIPE),
    requires=on_the_bench(AW0),
    checks=PLATE_CHECKS,
)
def damping_ratio(run: Run) -> None:
    """Damping against pressure ratio, for orifice plates of 10, 13, 16 and 18 mm.

    For each pair of plates, the springs carry the empty car. Then all valves are shut, and the bolster moves
    vertically at 1.2 Hz by 1 to 25 mm. A larger amplitude increases the pressure difference across the plate. The
    pressure ratio is the lowest one of a cycle. Damping is c = K''/ω of the first harmonic, per spring.

    With plates of 10 and 13 mm, the damping of a good spring rises with the pressure difference, passes a maximum and
    falls again. At 5 mm, it falls from plate to plate. The plates of 13 mm are fitted again at the end.
    """
    load, found = run.specimen.load(AW0), {}
    for plate in PLATES:
        if plate != PLATES[0]:
            run.hold_point(f"before the plates of {plate / mm:g} mm are fitted")
            put_down(run)
            fit_plate(run, plate)
            steps.carry(AW0)(run)
        found[plate] = damping_over_ratio(run, load, plate)
    check_damping(run, load, found)
