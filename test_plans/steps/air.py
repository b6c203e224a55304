"""What the air in the springs carries, and whether it stays there."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from bench_protocol.units import ATMOSPHERE, NS, minutes
from bench_protocol.words import SIDES
from test_plans.analysis import straight_line
from test_plans.loads import (
    AUXILIARY_VOLUME,
    BELLOWS_VOLUME,
    EFFECTIVE_AREA,
    EFFECTIVE_AREA_SLOPE,
    EMERGENCY_STIFFNESS,
    PRELOAD_TOLERANCE,
    REST_HEIGHT,
    Load,
)
from test_plans.readings import CELLS_UNDER, CHAMBERS, HEIGHTS, THERMOMETER_LAG, VERTICAL_CELLS
from test_plans.steps.carrying import AVERAGE_OVER
from test_plans.steps.shaking import check_band

if TYPE_CHECKING:
    from test_plans.run import Run

#: A tight spring keeps its air. Over half a minute transducers and thermometers resolve 0.05 %; the smallest leak that
#: matters (5e-11 m³/(s Pa)) loses 0.3 % a minute.
AIR_LOSS_MAX: Final = 0.002


def check_air(run: Run, load: Load) -> None:
    """Check load, height and pressure of each spring at rest on its leveling valve."""
    with run.phase("static pressure"):
        states = [f"{side}.{what}" for side in SIDES for what in ("height", "bellows_pressure")]
        mean = run.bench.averages(*VERTICAL_CELLS, *states, over=AVERAGE_OVER)
        for side in SIDES:
            carried = sum(mean[cell] for cell in CELLS_UNDER[side])
            low, high = load.preload - PRELOAD_TOLERANCE, load.preload + PRELOAD_TOLERANCE
            run.check(f"load on the {side} spring", carried, "kN", low=low, high=high)
            check_band(run, f"height of the {side} spring", mean[f"{side}.height"], "mm", REST_HEIGHT)
            check_band(
                run, f"pressure in the {side} bellows", mean[f"{side}.bellows_pressure"], "bar", load.pressure
            )


def weigh_the_air(run: Run) -> dict[str, float]:
    """Read what tells the mass of air in each spring; give it to `check_tightness` some time later.

    A thermometer that follows with first order reads what was: T = T_read + τ dT_read/dt.
    """
    with run.phase("weigh the air"):
        gas = [
            f"{side}.{part}_{what}"
            for side in SIDES
            for part in CHAMBERS
            for what in ("pressure", "temperature")
        ]
        with run.bench.capture(*gas, *HEIGHTS, *VERTICAL_CELLS) as capture:
            run.bench.wait(AVERAGE_OVER)
        state = {"time": run.now / NS}
        for name in capture.names:
            level, slope = straight_line(capture.times(name), capture.values(name))
            state[name] = level + THERMOMETER_LAG * slope if name.endswith("temperature") else level
        return state


def check_tightness(run: Run, load: Load, before: dict[str, float]) -> None:
    """Check that each spring kept its air since ``before``: m = Σ pV/(RT), whatever the temperature did meanwhile."""
    after = weigh_the_air(run)
    elapsed = after["time"] - before["time"]
    for side in SIDES:
        lost = 1 - _air(after, load, side) / _air(before, load, side)
        run.check(f"air lost per minute, {side} spring", lost * minutes / elapsed, "%", high=AIR_LOSS_MAX)


def _air(state: dict[str, float], load: Load, side: str) -> float:
    """Mass of air in both chambers of a spring, times R.

    The bellows is higher than the stack of both by what the emergency spring gives way beyond the preload.
    """
    carried = sum(state[cell] for cell in CELLS_UNDER[side])
    height = state[f"{side}.height"] + (carried - load.preload) / EMERGENCY_STIFFNESS
    bellows = BELLOWS_VOLUME + EFFECTIVE_AREA * height + 0.5 * EFFECTIVE_AREA_SLOPE * height**2
    return sum(
        (state[f"{side}.{part}_pressure"] + ATMOSPHERE) * volume / state[f"{side}.{part}_temperature"]
        for part, volume in zip(CHAMBERS, (bellows, AUXILIARY_VOLUME), strict=True)
    )
