"""Lateral stiffness against pressure around AW0 (figure 6a)."""

from typing import Final

from bench_protocol.units import s
from test_plans import steps
from test_plans.by_pressure import BY_PRESSURE, SOFTENING, carry_first, lateral_stiffness_over_pressure
from test_plans.loads import AW0
from test_plans.plan import plan
from test_plans.preconditions import on_the_bench
from test_plans.run import Run
from test_plans.waves import SLOW_LATERAL_WAVES

#: Of the empty car's preload.
PARTS: Final = (0.8, 0.9, 1.0, 1.1, 1.2)


@plan(
    setup=carry_first(AW0, PARTS),
    lasts=320 * s,
    needs=(*steps.CARRYING, *SLOW_LATERAL_WAVES, "rig.nominal_preload"),
    requires=on_the_bench(AW0),
    checks=(BY_PRESSURE, SOFTENING),
)
def lateral_pressure_aw0(run: Run) -> None:
    """Lateral stiffness against pressure, empty car.

    Five preloads around {AW0.preload}, each on shims of its own, so that bellows and emergency springs stand as
    designed. The leveling valves find the pressure that carries the load; with height and pressure held, the lateral
    actuator shears both springs at 0.5 Hz by 10, 5 and 2.5 mm. Stiffness and damping are first harmonics, half of the
    pair's.

    Good is a spring that grows stiffer with pressure by what its membrane predicts, and softer with amplitude by its
    friction.
    """
    lateral_stiffness_over_pressure(run, AW0, PARTS)
