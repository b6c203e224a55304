"""Differential pressure valve: where it opens, where it closes again, and whether it is tight in between."""

from collections.abc import Mapping
from functools import partial
from typing import Annotated, Final

import numpy as np

from bench_protocol.units import mm, s
from test_plans import steps
from test_plans.analysis import Samples
from test_plans.check_names import CheckName
from test_plans.loads import AW3
from test_plans.parameters import Range
from test_plans.plan import plan
from test_plans.preconditions import on_the_bench
from test_plans.run import Run
from test_plans.steps.fittings import leave_connected
from test_plans.steps.poses import COOL, Home, go_home
from test_plans.steps.shaking import SAMPLE_RATE, check_band

PRESSURES: Final = ("left.auxiliary_pressure", "right.auxiliary_pressure")
OPENS: Final = CheckName(
    "opens, {higher} higher",
    "The difference at which the valve between the springs opens: if too high, a car with one burst spring would tip.",
)
CLOSES: Final = CheckName(
    "closes again, {higher} higher",
    "The difference at which the valve closes again: if it closes late, the car leans for longer than necessary.",
)
#: Slow compared with the valve, which reduces the difference by 0.4 bar/s when it opens. One millimetre changes the
#: pressure difference by 41 mbar.
ROLL_RATE: Final = 2.5 * mm / s
BACK_RATE: Final = 10 * mm / s
#: Travel to either side. Half of it gives a pressure difference of 0.7 bar, at which an intact valve is shut.
HALF: Final = 17 * mm
#: Time in which the compressed gas cools, before its mass is measured.
SETTLE: Final = 8 * s
#: Part of the highest opening pressure that counts as an opening.
OPENED: Final = 0.97
#: Samples for averaging the noise of a transducer: 0.05 s, in which an open valve changes the difference by 20 mbar.
SMOOTH: Final = 10


@plan(
    setup=steps.carry(AW3),
    needs=(*steps.CARRYING, *PRESSURES, "air.dpv"),
    teardown=leave_connected,
    lasts=165 * s,
    requires=on_the_bench(AW3),
    checks=(steps.TIGHT, OPENS, CLOSES),
)
def differential_pressure_valve(
    run: Run, *, hold: Annotated[float, Range(10 * s, 300 * s, "s")] = 15 * s
) -> None:
    """Differential pressure valve: opening, reclosing and tightness, to both sides.

    Both springs carry the full car. All valves are shut except the differential pressure valve, which connects the
    springs. A slow roll of the bolster compresses one spring and relieves the other, until the valve must have opened
    several times. The valve opens at the largest pressure difference, and closes at the smallest difference after that.
    Before the valve opens, the roll stops at a difference at which a sound valve is shut. There the air of both springs
    is weighed before and after a time `hold`. The same sequence follows to the other side.

    The valve passes if it opens and closes within the limits of the specimen's file, and if the air loss is within its
    limit. A valve that is stuck open holds no pressure difference. A valve that is stuck shut exceeds the opening
    pressure. A leaking valve lets air pass from one spring to the other.
    """
    load, limits = run.specimen.load(AW3), run.specimen.limits
    opening, reclosing = limits.band("dpv_opening"), limits.band("dpv_reclosing")
    home = go_home(run)
    run.bench.wait(COOL)
    steps.lock_the_air(run)
    run.bench.air.connect_dpv()
    rest = run.bench.averages(*PRESSURES, over=steps.AVERAGE_OVER)
    for way, higher in ((-1.0, "left"), (1.0, "right")):
        run.hold_point(f"before the {higher} side is higher")
        with run.phase(f"{higher} higher"):
            _roll(run, home, way * HALF, ROLL_RATE)
            run.bench.wait(SETTLE)
            before = steps.weigh_the_air(run)
            run.bench.wait(hold)
            steps.check_tightness(run, load, before, at=f", {higher} higher")
            with run.bench.capture(*PRESSURES) as capture:
                _roll(run, home, way * 2.2 * HALF, ROLL_RATE)
            _, values = capture.aligned(SAMPLE_RATE)
            opens, closes = run.measure(partial(_extremes, way), rest, values)
            check_band(run, OPENS.of(higher=higher), opens, "bar", opening)
            check_band(run, CLOSES.of(higher=higher), closes, "bar", reclosing)
            _roll(run, home, 0.0, BACK_RATE)


def _extremes(way: float, rest: Mapping[str, float], values: Mapping[str, Samples]) -> tuple[float, float]:
    """Return the largest pressure difference (Pa), and the smallest one after the valve has opened, both relative to
    the value at rest.
    """
    zero = rest[PRESSURES[0]] - rest[PRESSURES[1]]
    parted = _smooth(-way * (values[PRESSURES[0]] - values[PRESSURES[1]] - zero))
    highest = float(parted.max())
    # The valve opens several times, and noise chooses the highest: the last one may have no time to close.
    opened = int(np.argmax(parted > OPENED * highest))
    return highest, float(parted[opened:].min())


def _roll(run: Run, home: Home, z: float, rate: float) -> None:
    """Lift the left side by ``z`` (m) and lower the right side by the same distance."""
    run.bench.vertical.move_to(home.left + z, home.right - z, rate=rate)


def _smooth(values: Samples) -> Samples:
    """Return running means of the readings over `SMOOTH` samples, without missing samples."""
    received = values[np.isfinite(values)]
    return np.convolve(received, np.full(SMOOTH, 1 / SMOOTH), mode="valid")
