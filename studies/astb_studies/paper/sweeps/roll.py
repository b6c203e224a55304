"""Lateral stiffness of rolled springs, with the differential pressure valve isolated and open (figure 10)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Final

from bench_protocol.units import rad
from test_plans import steps
from test_plans.check_names import CheckName
from test_plans.loads import Load
from test_plans.steps.poses import COOL, go_home
from test_plans.steps.rolled import ROLL_SHEAR, RollAngle

if TYPE_CHECKING:
    from test_plans.run import Run

RISE: Final = CheckName(
    "valve {valve}: secant, rise to 0.05 rad",
    "How much the lateral secant stiffness grows when the car leans: a sheared bellows that rolls pushes by itself.",
)
BEYOND: Final = CheckName(
    "valve {valve}: secant, change beyond over rise",
    "Whether the force keeps rising with the roll angle: it must not, or a leaning car would steer its bogie.",
)
ODD: Final = CheckName(
    "valve {valve}: odd part of the force at 0.05 rad",
    "The part of the force that changes sign with the roll angle: the coupling alone, without friction and offsets.",
)
OVER_LEVEL: Final = CheckName(
    "valve {valve}: first harmonic at 0.05 rad over level",
    "Whether a rolled spring is stiffer than a level one in small motion: the ride would be harder in curves.",
)
ROLL_CHECKS: Final = (RISE, BEYOND, ODD, OVER_LEVEL)


def _coupling(secants: list[float], storages: list[float]) -> tuple[float, float, float, float]:
    """Return rise of the secant to the knee and change beyond over the rise, odd force (N), and K' over level.

    The arguments are the values level, at the knee, at the largest roll, and at the knee to the other side.
    """
    level, knee, largest, other = secants
    rise = knee - level
    odd = 0.5 * ROLL_SHEAR * (knee - other)
    return rise / level, abs(largest - knee) / rise, odd, storages[1] / storages[0]


#: Beyond 0.05 rad the coupling is saturated: what follows is small next to what went before.
KNEE: Final = 0.05 * rad


def lateral_stiffness_over_roll(run: Run, load: Load, angles: Sequence[float]) -> None:
    """Measure under the load that is carried, first with the differential pressure valve isolated, then with it."""
    band = load.limits.band("coupling_force")
    rises = run.specimen.limits.band("coupling_rise")
    saturated = run.specimen.limits.band("coupling_saturated")
    home = go_home(run)
    run.bench.wait(COOL)
    steps.lock_the_air(run)
    for valve, change in (("isolated", run.bench.air.isolate_dpv), ("open", run.bench.air.connect_dpv)):
        if run.hold_point(f"before the angles with the valve {valve}"):
            home = steps.restore_state(run, load, go_home, COOL)
        change()
        found = RollAngle()
        with run.phase(f"valve {valve}"):
            found.measure(run, home, angles)
        found.keep(run, load, valve)

        rise, beyond, odd, ratio = found.judge(run, _coupling, 0.0, KNEE, max(angles), -KNEE)
        for name, value, limit in ((RISE, rise, rises), (BEYOND, beyond, saturated)):
            run.check(name.of(valve=valve), value, "%", low=limit.low, high=limit.high)
        run.check(ODD.of(valve=valve), odd, "kN", low=band.low, high=band.high)
        run.check(OVER_LEVEL.of(valve=valve), ratio, "1", high=1.0, margin=0.01)
