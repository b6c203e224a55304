"""Steps that measure the load of the springs, and the tightness of their air."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

from bench_protocol.units import ATMOSPHERE, NS, minutes
from bench_protocol.words import SIDES
from test_plans.analysis import CHAMBERS, HEIGHTS, VERTICAL_CELLS, Samples, level_of, straight_line
from test_plans.analysis.cells import CELLS, bearing, cells_under, described, load_on, unseen
from test_plans.analysis.geometry import LASERS, Rig, height_of_spring
from test_plans.analysis.uncertainty import EVEN, Measured
from test_plans.check_names import CheckName
from test_plans.description import lag_of, lags
from test_plans.loads import Load
from test_plans.steps.carrying import AVERAGE_OVER
from test_plans.steps.shaking import Values, check_band

if TYPE_CHECKING:
    from test_plans.run import Run
    from test_plans.specimen import Specimen


LOAD: Final = CheckName(
    "load on the {side} spring",
    "The load on the spring, measured by the cells below it: all following results hold for this load only.",
)
REST_HEIGHT: Final = CheckName(
    "height of the {side} spring",
    "The height of the spring on its leveling valve: it determines whether the car is level and within its clearance.",
)
PRESSURE: Final = CheckName(
    "pressure in the {side} bellows",
    "The pressure that carries the load: a wrong one means a wrong effective area, from a wrong bellows or piston.",
)
#: Checks of `check_air`.
AIR: Final = (LOAD, REST_HEIGHT, PRESSURE)
TIGHT: Final = CheckName(
    "air lost per minute, {side} spring",
    "The share of its air that a closed spring loses per minute: with a leak it rests on its stops the next morning.",
)

#: Signals and dimensions that determine the mass of air in the springs.
_GAS: Final = tuple(
    f"{side}.{part}_{what}" for side in SIDES for part in CHAMBERS for what in ("pressure", "temperature")
)
_THERMOMETERS: Final = tuple(name for name in _GAS if name.endswith("temperature"))
_READ: Final = (*_GAS, *HEIGHTS)
WEIGHED_BY: Final = (*_READ, *VERTICAL_CELLS, *CELLS, *LASERS, *lags(_THERMOMETERS))
#: Averaging time in lags of the thermometers: over one lag, a step of 0.1 K is an air loss of 0.1 % per minute.
LAGS: Final = 5
#: Smallest number of samples of a mean over a second.
AVERAGED: Final = 10
_OTHER: Final = {"left": "right", "right": "left"}


class Weighing(NamedTuple):
    """Readings that determine the mass of air: the ``time`` of reading (s), and the samples and their times by
    signal.
    """

    time: float
    values: Values
    times: Values

    @property
    def rates(self) -> dict[str, float]:
        """Number of samples per second of each reading."""
        return {
            name: (times.size - 1) / (times[-1] - times[0])
            for name, times in self.times.items()
            if times.size > 1
        }


def check_air(run: Run, load: Load) -> None:
    """Check load, height and pressure of each spring at rest on its leveling valve."""
    with run.phase("static pressure"):
        states = [f"{side}.{what}" for side in SIDES for what in ("height", "bellows_pressure")]
        cells = [cell for cell in bearing(run.rig) if run.bench.has(cell)]
        if run.bench.has("lateral.force"):
            states.append("lateral.force")
        mean = run.bench.averages(*cells, *states, over=AVERAGE_OVER)
        for side in SIDES:
            name = LOAD.of(side=side)
            if run.can(name, needs=(*cells_under(run.rig, side), *CELLS)):
                carried = run.measured(partial(load_on, side=side), mean, run.rig, averaged=AVERAGED)
                carried = carried.with_uncertainty(
                    "force sideways that no load cell sees", _unseen(run, mean), even=True
                )
                check_band(run, name, carried, "kN", load.limits.band("carried"))
            rest = run.specimen.limits.band("rest_height")
            check_band(run, REST_HEIGHT.of(side=side), _read(run, mean, f"{side}.height"), "mm", rest)
            found = _read(run, mean, f"{side}.bellows_pressure")
            check_band(run, PRESSURE.of(side=side), found, "bar", load.limits.band("pressure"))


def _unseen(run: Run, mean: Mapping[str, float]) -> float:
    """Return the standard uncertainty (N) of a load due to a lateral force that its cells do not measure.

    The moment of the force depends on its height, which is unknown: anywhere between platform and top plates. Without
    force of the lateral actuator it is zero.
    """
    cells = [cell for cell in described(run.rig) if run.bench.has(cell)]
    if "force sideways" not in unseen(run.rig, cells):
        return 0.0
    moment = abs(mean.get("lateral.force", 0.0)) * run.rig["column_height"]
    return EVEN * moment / (2 * run.rig["spring_half_spacing"])


def _read(run: Run, mean: Mapping[str, float], name: str) -> Measured:
    """Return the mean of one reading with its uncertainty."""
    return run.measured(lambda read: read[name], mean, averaged=AVERAGED)


def weigh_the_air(run: Run) -> Weighing:
    """Read the signals that give the mass of air in each spring. Later, pass the result to `check_tightness`.

    If the rig lacks one of these signals, nothing is read, and the result is empty.
    """
    if run.lacks(*WEIGHED_BY):
        return Weighing(0.0, {}, {})
    with run.phase("weigh the air"):
        names = (*_READ, *bearing(run.rig))
        with run.bench.capture(*names) as capture:
            run.bench.wait(max(AVERAGE_OVER, *(LAGS * lag_of(run.rig, name) for name in _THERMOMETERS)))
        values, times = ({name: of(name) for name in names} for of in (capture.values, capture.times))
        return Weighing(run.now / NS, values, times)


def check_tightness(run: Run, load: Load, before: Weighing, at: str = "") -> None:
    """Check that each spring kept its air since ``before``. The mass m = Σ pV/(RT) does not depend on the temperature.

    ``load`` is the load for which the springs are shimmed. ``at`` is the end of the names of the checks.
    """
    names = {side: TIGHT.of(at, side=side) for side in SIDES}
    if not run.can(*names.values(), needs=WEIGHED_BY):
        return
    after = weigh_the_air(run)
    elapsed = after.time - before.time
    for side in SIDES:

        def lost(rig: Rig, earlier: Values, later: Values, side: str = side) -> float:
            was = _air(run.specimen, rig, earlier, before.times, load, side)
            return (1 - _air(run.specimen, rig, later, after.times, load, side) / was) * minutes / elapsed

        found = run.measured(lost, run.rig, before.values, after.values, rate=after.rates)
        limit = run.specimen.limits.band("air_loss_per_minute")
        run.check(names[side], found, "%", low=limit.low, high=limit.high, since=round(before.time * NS))


def _air(specimen: Specimen, rig: Rig, values: Values, times: Values, load: Load, side: str) -> float:
    """Return the mass of air in both chambers of a spring, multiplied by the gas constant R (J/K).

    Heights are relative to design height. If the load exceeds the preload, the emergency spring is compressed further,
    and at the same height of the spring its bellows is higher by this compression.
    """
    used = [name for name in values if not name.startswith(_OTHER[side]) or name in HEIGHTS]
    state = {name: np.asarray(_settled(rig, name, times[name], values[name])) for name in used}
    beyond = load_on(state, rig, side) - load.preload
    height = float(height_of_spring(state, rig, side) + beyond / specimen.emergency_stiffness_vertical)
    area, slope = specimen.effective_area, specimen.effective_area_slope
    bellows = specimen.bellows_volume + area * height + 0.5 * slope * height**2
    return sum(
        float(state[f"{side}.{part}_pressure"] + ATMOSPHERE)
        * volume
        / float(state[f"{side}.{part}_temperature"])
        for part, volume in zip(CHAMBERS, (bellows, specimen.auxiliary_volume), strict=True)
    )


def _settled(rig: Rig, name: str, times: Samples, values: Samples) -> float:
    """Return the mean of a reading, for a thermometer corrected for its first-order lag: T = T_read + τ dT_read/dt."""
    if not name.endswith("temperature"):
        return level_of(values)
    level, slope = straight_line(times, values)
    return level + lag_of(rig, name) * slope
