"""Lateral stiffness against pressure (figure 6): a plan for each car."""

from typing import Final

from astb_studies.paper.sweeps.pressure import (
    BY_PRESSURE,
    SOFTENING,
    carry_first,
    lateral_stiffness_over_pressure,
)
from bench_protocol.units import s
from test_plans import steps
from test_plans.loads import AW0, AW3
from test_plans.plan import plan_under
from test_plans.preconditions import on_the_bench
from test_plans.run import Run
from test_plans.steps.waves import SLOW_LATERAL_WAVES

#: Of the car's preload: the shims end at 160 kN.
PARTS: Final = {AW0: (0.8, 0.9, 1.0, 1.1, 1.2), AW3: (0.897, 0.949, 1.0, 1.051, 1.103)}


def _lateral_pressure(run: Run, load: str) -> None:
    """Lateral stiffness against pressure, {car} car.

    There are five preloads around {preload}. Each has its own shims, so that bellows and emergency springs are at their
    design height. The leveling valves set the pressure that carries the load. Then height and pressure are held, and
    the lateral actuator shears both springs at 0.5 Hz by 10, 5 and 2.5 mm. Stiffness and damping are of the first
    harmonic, half of the values of the pair.

    A good spring becomes stiffer with pressure as its membrane predicts, and softer with amplitude because of its
    friction.
    """
    lateral_stiffness_over_pressure(run, load, PARTS[load])


lateral_pressure_aw0, lateral_pressure_aw3 = (
    plan_under(
        load,
        _lateral_pressure,
        name,
        setup=carry_first(load, PARTS[load]),
        lasts=lasts,
        needs=(*steps.CARRYING, *SLOW_LATERAL_WAVES, "rig.nominal_preload"),
        requires=on_the_bench(load),
        checks=(BY_PRESSURE, SOFTENING),
    )
    for load, name, lasts in ((AW0, "lateral_pressure_aw0", 320 * s), (AW3, "lateral_pressure_aw3", 370 * s))
)
