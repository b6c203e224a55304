"""Steps that move the springs to a pose (design height, sheared or rolled), and read their state in it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

from bench_protocol.units import mbar, mm, rad, s
from bench_protocol.words import SIDES
from test_plans import steps
from test_plans.analysis import BELLOWS_TEMPERATURES, PRESSURES, SHEAR_CELLS, VERTICAL_CELLS, straight_line
from test_plans.analysis.cells import CELLS, CELLS_ACROSS, sideways_force, upward_force
from test_plans.analysis.geometry import (
    PLACING,
    POSE_SIGNALS,
    Rig,
    lifted,
    pose,
    roll_of,
    shear_of,
    stop_travel_of,
)
from test_plans.description import lag_of, lags
from test_plans.steps.carrying import FILL_WITHIN, HELD_SIDEWAYS

if TYPE_CHECKING:
    from test_plans.run import Run

POSE_RATE: Final = 40 * mm / s
POSE_ROLL_RATE: Final = 0.04 * rad / s
POSE_SETTLE: Final = 0.5 * s
#: The gas of a filling cools down before the valves are shut.
COOL: Final = 20 * s
#: Valves and tolerance use different transducers, so the valves continue to control for a short time.
PRESSURE_BACK: Final = 100 * mbar
PRESSURE_STEADY: Final = 1.5 * s


@dataclass(frozen=True, slots=True)
class Home:
    """Set-points of the vertical actuators (m) at which both springs are at design height."""

    left: float
    right: float


def go_home(run: Run) -> Home:
    """Move both springs to design height, as measured by the lasers, in displacement control. Return the set-points.

    The valves keep the pressure of each side.
    """
    steps.hold_the_height(run)
    bench = run.bench
    with run.phase("design height"):
        heights = bench.averages("left.height", "right.height", over=steps.AVERAGE_OVER)
        commander = bench.commander
        left = commander.value("vertical_left.displacement_setpoint") - heights["left.height"]
        right = commander.value("vertical_right.displacement_setpoint") - heights["right.height"]
        bench.vertical.move_to(left, right)
    return Home(left, right)


def take_pose(run: Run, home: Home, *, shear: float = 0.0, roll: float = 0.0, height: float = 0.0) -> None:
    """Shear, roll and lift both springs (m, rad, m), by bolster and platform together. Wait until they arrive."""
    commander = run.bench.commander
    to = pose(run.rig, shear, roll)
    up = lifted(run.rig, to.bolster_roll)
    targets = {
        "vertical_left.displacement_setpoint": home.left + height + up["vertical_left"],
        "vertical_right.displacement_setpoint": home.right + height + up["vertical_right"],
        "lateral.displacement_setpoint": to.lateral,
        "platform.roll_setpoint": to.platform_roll,
    }
    ways = {name: abs(end - commander.value(name)) for name, end in targets.items()}
    pace = {name: POSE_ROLL_RATE if name.startswith("platform.roll") else POSE_RATE for name in ways}
    longest = max(way / pace[name] for name, way in ways.items())
    for name, way in ways.items():
        if way > 0.0:
            commander.ramp(name, targets[name], way / longest)
    run.bench.wait_for(
        lambda: not commander.moving(*targets),
        within=longest + 1 * s,
        what="bolster and platform in their pose",
    )
    run.bench.wait(POSE_SETTLE)


_READ: Final = (*POSE_SIGNALS, *VERTICAL_CELLS, *SHEAR_CELLS, *PRESSURES, *BELLOWS_TEMPERATURES)
#: Signals and dimensions for moving to a pose and reading it.
POSING: Final = (
    *_READ,
    *HELD_SIDEWAYS,
    "platform.roll_setpoint",
    *PLACING,
    *CELLS,
    *CELLS_ACROSS,
    *lags(BELLOWS_TEMPERATURES),
)
READ_OVER: Final = 2 * s
#: Smallest number of samples of such a mean.
POSE_SAMPLES: Final = 20


@dataclass(frozen=True, slots=True)
class PoseReading:
    """Readings in one pose (SI). They are means of both springs; forces are per spring."""

    shear: float
    height: float
    roll: float
    stop_travel: float  #: travel at the bump stop
    pressure: float  #: gauge, of the bellows
    temperature: float  #: of the gas in the bellows
    vertical: float  #: force on the spring, downward
    lateral: float  #: force that the spring opposes to its shear
    read: Mapping[str, float]  #: source of the results: means by signal, temperatures as read


def read_pose(run: Run, over: float = READ_OVER) -> PoseReading:
    """Measure pose and load of the springs for ``over`` s."""
    with run.bench.capture(*_READ) as capture:
        run.bench.wait(over)
    mean, slope = {}, {}
    for name in _READ:
        mean[name], slope[name] = straight_line(capture.times(name), capture.values(name))
    for name in BELLOWS_TEMPERATURES:  # corrected for the lag of the first-order thermometers
        mean[name] += lag_of(run.rig, name) * slope[name]
    return pose_of(mean, run.rig)


def pose_of(mean: Mapping[str, float], rig: Rig) -> PoseReading:
    """Return pose and load of the springs from the mean of each reading (SI)."""
    cells = {name: mean[name] for name in (*VERTICAL_CELLS, *SHEAR_CELLS)}

    def of_both(reading: str) -> float:
        return 0.5 * (mean[f"left.{reading}"] + mean[f"right.{reading}"])

    return PoseReading(
        shear=float(shear_of(mean, rig)),
        height=of_both("height"),
        roll=float(roll_of(mean, rig)),
        stop_travel=float(stop_travel_of(mean, rig)),
        pressure=of_both("bellows_pressure"),
        temperature=of_both("bellows_temperature"),
        vertical=0.5 * float(upward_force(cells, rig)),
        lateral=-0.5 * float(sideways_force(cells, rig)),
        read=mean,
    )


def restore_the_air(run: Run, pressures: Mapping[str, float]) -> None:
    """Bring the pressure of each side back to an earlier value (fill if too low, vent if too high), and shut the
    valves.
    """
    air = run.bench.air
    left, right = (pressures[f"{side}.auxiliary_pressure"] for side in SIDES)
    for change in (air.fill, air.vent):
        change(left=left, right=right, tolerance=PRESSURE_BACK, within=FILL_WITHIN)
        run.bench.wait(PRESSURE_STEADY)
    air.hold()
