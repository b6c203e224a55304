"""Axial stiffness: isobaric, with the auxiliary volume shut off, and with it open (the tests of EN 13597)."""

from collections.abc import Mapping
from functools import partial
from typing import Final, Literal

import numpy as np

from bench_protocol.units import mm, s
from bench_protocol.words import SIDES
from test_plans import steps
from test_plans.analysis import PRESSURES, VERTICAL_CELLS, straight_line
from test_plans.analysis.cells import CELLS, bearing, load_on
from test_plans.analysis.geometry import LASERS, Rig, height_of_spring
from test_plans.analysis.uncertainty import Measured
from test_plans.check_names import CheckName
from test_plans.plan import plan
from test_plans.preconditions import on_the_bench
from test_plans.run import Run
from test_plans.steps.air import AVERAGED
from test_plans.steps.fittings import leave_connected
from test_plans.steps.poses import COOL, Home, go_home, restore_the_air
from test_plans.steps.shaking import check_band

ISOBARIC: Final = CheckName(
    "{side} vertical stiffness, isobaric",
    "Force over displacement at constant pressure: the stiffness of "
    "bellows contour and rubber, without that of the air.",
)
#: Steps up, down and up again. Each height is reached from both directions, so that friction cancels in the mean.
STAIRS: Final = tuple(z * mm for z in (10, 20, 10, 0, -10, -20, -10, 0))
STAIR_RATE: Final = 10 * mm / s
#: Air that was let in or out reaches the temperature of the walls, and a little more of it is needed.
STAIR_WAIT: Final = 3 * s


@plan(
    setup=steps.carry_load,
    needs=(
        *steps.CARRYING,
        *VERTICAL_CELLS,
        *PRESSURES,
        "air.left_reservoir",
        "air.right_reservoir",
        *CELLS,
        *LASERS,
    ),
    teardown=leave_connected,
    lasts=140 * s,
    requires=on_the_bench("load"),
    checks=(ISOBARIC, steps.VERTICAL_SECANT["closed"], steps.VERTICAL_SECANT["open"]),
)
def axial_stiffness(run: Run, *, load: Literal["AW0", "AW3"] = "AW0") -> None:
    """Axial stiffness of each spring, in the three ways of EN 13597.

    The springs carry the `load` on their leveling valves at design height. Then the bench measures the stiffness in
    three ways:

    * Isobaric: the bolster moves up and down by 20 mm in steps of 10 mm. At each step, the pressure is brought back to
      its first value. This stiffness comes from the change of the area with height, and from the rubber.
    * Closed: the auxiliary volumes are shut off. A slow triangle of ± 5 mm compresses only the bellows.
    * Open: the same triangle compresses the whole volume of the spring.

    A spring passes if each stiffness is within the limits of the specimen's file. A wrong volume of the bellows changes
    the closed stiffness, a wrong auxiliary volume the open one, and a wrong contour the isobaric one.
    """
    case = run.specimen.load(load)
    isobaric = case.limits.band("vertical_isobaric")
    home = go_home(run)
    run.bench.wait(COOL)
    with run.phase("isobaric"):
        for side, stiffness in _isobaric(run, home).items():
            check_band(run, ISOBARIC.of(side=side), stiffness, "kN/m", isobaric)
    if run.hold_point("before the volumes are shut off"):
        steps.restore_state(run, case, go_home, COOL)
    steps.lock_the_air(run)
    run.bench.air.isolate_reservoirs()
    steps.vertical_loop(run, case, "closed")
    run.bench.air.connect_reservoirs()
    steps.vertical_loop(run, case, "open")


def _isobaric(run: Run, home: Home) -> dict[str, Measured]:
    """Measure the force at each step of height at constant pressure. Return by side the slope of force over compression
    (N/m).
    """
    names = [
        f"{side}.{what}" for side in SIDES for what in ("height", "bellows_pressure", "auxiliary_pressure")
    ]
    rest = run.bench.averages(*names, over=steps.AVERAGE_OVER)
    means = [rest]
    for stair in STAIRS:
        run.bench.vertical.move_to(home.left + stair, home.right + stair, rate=STAIR_RATE)
        run.bench.wait(STAIR_WAIT)
        restore_the_air(run, rest)
        means.append(run.bench.averages(*names, *bearing(run.rig), over=steps.AVERAGE_OVER))
    area = run.specimen.area_at(rest["left.bellows_pressure"])
    return {
        side: run.measured(partial(_slope, side, area), run.rig, *means, averaged=AVERAGED) for side in SIDES
    }


def _slope(
    side: str, area: float, rig: Rig, rest: Mapping[str, float], *stairs: Mapping[str, float]
) -> float:
    """Return the slope of force over compression (N/m) of a line through the mean readings at the steps."""
    # The valves bring the pressure back within some mbar: the force of the remaining difference is that on the area.
    away = [mean[f"{side}.bellows_pressure"] - rest[f"{side}.bellows_pressure"] for mean in stairs]
    means = [{name: np.asarray(value) for name, value in mean.items()} for mean in stairs]
    force = np.array([load_on(mean, rig, side) for mean in means]) - area * np.array(away)
    return straight_line(np.array([-height_of_spring(mean, rig, side) for mean in means]), force)[1]
