"""What the air in the springs carries, and whether it stays there."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from bench_protocol.units import ATMOSPHERE, NS, minutes
from bench_protocol.words import SIDES
from test_plans.analysis import straight_line
from test_plans.loads import Load
from test_plans.readings import CELLS_UNDER, CHAMBERS, HEIGHTS, THERMOMETER_LAG, VERTICAL_CELLS
from test_plans.steps.carrying import AVERAGE_OVER
from test_plans.steps.shaking import check_band

if TYPE_CHECKING:
    from test_plans.run import Run
    from test_plans.specimen import Specimen


#: What tells the mass of air in the springs.
_GAS: Final = tuple(
    f"{side}.{part}_{what}" for side in SIDES for part in CHAMBERS for what in ("pressure", "temperature")
)
WEIGHED_BY: Final = (*_GAS, *HEIGHTS, *VERTICAL_CELLS)


def check_air(run: Run, load: Load) -> None:
    """Check load, height and pressure of each spring at rest on its leveling valve."""
    with run.phase("static pressure"):
        states = [f"{side}.{what}" for side in SIDES for what in ("height", "bellows_pressure")]
        cells = [cell for cell in VERTICAL_CELLS if run.bench.has(cell)]
        mean = run.bench.averages(*cells, *states, over=AVERAGE_OVER)
        for side in SIDES:
            name = f"load on the {side} spring"
            if run.can(name, needs=CELLS_UNDER[side]):
                carried = sum(mean[cell] for cell in CELLS_UNDER[side])
                check_band(run, name, carried, "kN", load.limits.band("carried"))
            rest = run.specimen.limits.band("rest_height")
            check_band(run, f"height of the {side} spring", mean[f"{side}.height"], "mm", rest)
            pressure = load.limits.band("pressure")
            check_band(
                run, f"pressure in the {side} bellows", mean[f"{side}.bellows_pressure"], "bar", pressure
            )


def weigh_the_air(run: Run) -> dict[str, float]:
    """Read what tells the mass of air in each spring; give it to `check_tightness` some time later.

    On a rig that cannot tell there is nothing to read. A thermometer that follows with first order reads what was:
    T = T_read + τ dT_read/dt.
    """
    if not run.bench.has(*WEIGHED_BY):
        return {}
    with run.phase("weigh the air"):
        with run.bench.capture(*WEIGHED_BY) as capture:
            run.bench.wait(AVERAGE_OVER)
        state = {"time": run.now / NS}
        for name in capture.names:
            level, slope = straight_line(capture.times(name), capture.values(name))
            state[name] = level + THERMOMETER_LAG * slope if name.endswith("temperature") else level
        return state


def check_tightness(run: Run, load: Load, before: dict[str, float], at: str = "") -> None:
    """Check that each spring kept its air since ``before``: m = Σ pV/(RT), whatever the temperature did meanwhile.

    ``load`` is that of the shims; ``at`` ends the names of the checks.
    """
    names = {side: f"air lost per minute, {side} spring{at}" for side in SIDES}
    if not run.can(*names.values(), needs=WEIGHED_BY):
        return
    after = weigh_the_air(run)
    elapsed = after["time"] - before["time"]
    for side in SIDES:
        lost = 1 - _air(run.specimen, after, load, side) / _air(run.specimen, before, load, side)
        limit = run.specimen.limits.band("air_loss_per_minute")
        check_band(run, names[side], lost * minutes / elapsed, "%", limit)


def _air(specimen: Specimen, state: dict[str, float], load: Load, side: str) -> float:
    """Mass of air in both chambers of a spring, times R.

    The bellows is higher than the stack of both by what the emergency spring gives way beyond the preload.
    """
    carried = sum(state[cell] for cell in CELLS_UNDER[side])
    height = state[f"{side}.height"] + (carried - load.preload) / specimen.emergency_stiffness_vertical
    area, slope = specimen.effective_area, specimen.effective_area_slope
    bellows = specimen.bellows_volume + area * height + 0.5 * slope * height**2
    return sum(
        (state[f"{side}.{part}_pressure"] + ATMOSPHERE) * volume / state[f"{side}.{part}_temperature"]
        for part, volume in zip(CHAMBERS, (bellows, specimen.auxiliary_volume), strict=True)
    )
