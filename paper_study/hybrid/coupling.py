"""The host's part of a hybrid ride: forces in, the car a step on, set-points out, on the bench's clock."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from math import isfinite
from typing import TYPE_CHECKING, Final

import numpy as np
import numpy.typing as npt

from bench_protocol.dimensions import across
from bench_protocol.rates import COMMAND_RATE, FAST_RATE
from bench_protocol.units import NS, mm, ms, s
from bench_protocol.words import SIDES
from drivers.errors import LinkLost
from paper_study.hybrid.car import STEP, Place, Ride, Springs
from paper_study.hybrid.loop import Path
from test_plans.analysis.cells import CELLS, CELLS_ACROSS, cell_moment, sideways_force, upward_force
from test_plans.analysis.geometry import (
    ACTUATORS,
    LASERS,
    PLACING,
    POSE_SIGNALS,
    STOP_ROOM,
    Rig,
    height_of_spring,
    roll_of,
    shear_of,
)
from test_plans.analysis.readings import HEIGHTS, SHEAR_CELLS, VERTICAL_CELLS
from test_plans.description import lag_of, lags
from test_plans.steps.poses import Home

if TYPE_CHECKING:
    from test_plans.run import Run

Floats = npt.NDArray[np.float64]

#: The car's step, at which forces come.
HOST_STEP: Final = 1.0 / FAST_RATE
#: Shear up to which bolster and platform are moved so that the bench's own bump stop is not met: in proportion, so that
#: nothing has a corner.
SHEAR_MAX: Final = 80 * mm
#: How late a set-point shows beside what joining and the actuator's loop take, and a force beside its transducer's lag:
#: dead time and frames, as the rides on the virtual bench measure it.
LATENCY: Final = 3 * ms
#: How much sooner than the pistons the platform is where it is told to be: 6 ms would pass for a fifth of the roll.
TABLE_SOONER: Final = 5.5 * ms
#: What springs do that stand where they rest.
STILL: Final = Springs(0.0, 0.0, 0.0)
LEVEL: Final = Home(0.0, 0.0)
#: Without a force for so long nobody knows what the springs do.
SILENT: Final = 50 * ms
FORCES: Final = (*SHEAR_CELLS, *VERTICAL_CELLS)
#: What has to be known of the rig.
COUPLED: Final = (
    *FORCES,
    *POSE_SIGNALS,
    "lateral.displacement_setpoint",
    "platform.roll_setpoint",
    "actuator_frequency",
    "actuator_damping",
    "vertical_frame_stiffness",
    *PLACING,
    *CELLS,
    *CELLS_ACROSS,
    *ACTUATORS,
    *LASERS,
    *lags((*SHEAR_CELLS, *VERTICAL_CELLS, *HEIGHTS, "lateral.displacement")),
)


def path_of(rig: Rig) -> Path:
    """Return what is between places and forces on this rig, by its dimensions."""
    return Path(
        beat=1.0 / COMMAND_RATE,
        latency=LATENCY,
        hold=HOST_STEP,
        actuator_frequency=rig["actuator_frequency"],
        actuator_damping=rig["actuator_damping"],
        lag=lag_of(rig, *SHEAR_CELLS, *VERTICAL_CELLS),
    )


def springs_of(read: Mapping[str, float], rig: Rig) -> Springs:
    """Return what the load cells say that both springs do to what stands on them."""
    lateral, upward = sideways_force(read, rig), upward_force(read, rig)
    return Springs(float(lateral), float(upward), -float(cell_moment(read, rig)))


def setpoints_of(place: Place, home: Home, rig: Rig, springs: Springs = STILL) -> dict[str, float]:
    """Return where bolster and platform have to be for the springs to stand so, by the names of the set-points.

    Frame and oil between piston and bolster give way to what the ``springs`` do beyond where they rest.
    """
    share = (rig["stop_gap"] - STOP_ROOM) / SHEAR_MAX
    platform = ((1.0 - share) * place.shear - rig["centre_height"] * place.roll) / (
        rig["centre_height"] + rig["column_height"]
    )
    bolster = platform + place.roll
    lifts = dict(zip(SIDES, (home.left, home.right), strict=True))
    given = _given_way(springs, rig)
    return {
        "lateral.displacement_setpoint": share * place.shear
        - rig["lateral_actuator_height"] * bolster
        + given["lateral"],
        "platform.roll_setpoint": platform,
        **{
            f"vertical_{side}.displacement_setpoint": lift
            + place.height
            + rig[across(f"vertical_{side}")] * bolster
            + given[f"vertical_{side}"]
            for side, lift in lifts.items()
        },
    }


def _given_way(springs: Springs, rig: Rig) -> dict[str, float]:
    """Return by how much further each piston has to go (m), for what stands behind it gives way."""
    left, right = (rig[one] for one in ACTUATORS)
    above = rig["centre_height"] + rig["lateral_actuator_height"]
    moment = -springs.moment - above * springs.lateral
    up = (moment + right * springs.vertical) / (left - right)
    frame = rig["vertical_frame_stiffness"]
    return {
        "lateral": -springs.lateral / rig["lateral_frame_stiffness"],
        "vertical_left": up / frame,
        "vertical_right": (-springs.vertical - up) / frame,
    }


@dataclass(slots=True)
class Course:
    """What came of a ride, row by row of the car's integration, and of the host's step (SI)."""

    carried: float  #: what each spring carried before it began (N)
    time: list[float] = field(default_factory=list)
    acceleration: list[float] = field(default_factory=list)  #: of the floor, lateral
    rising: list[float] = field(default_factory=list)  #: of the floor's middle, vertical acceleration
    bump_stop: list[float] = field(default_factory=list)
    lateral: list[float] = field(default_factory=list)
    roll: list[float] = field(default_factory=list)
    asked: list[Place] = field(default_factory=list)  #: how the springs should stand, each host's step
    read: list[list[float]] = field(default_factory=list)  #: and the readings that tell it, in `POSE_SIGNALS`

    def keep(self, ride: Ride) -> None:
        """Keep where a ride is now."""
        self.time.append(ride.time)
        self.acceleration.append(ride.floor_acceleration)
        self.rising.append(ride.acceleration[1])
        self.bump_stop.append(ride.stop_force)
        self.lateral.append(ride.place[0])
        self.roll.append(ride.place[2])

    def of(self, name: str, since: float, until: float) -> Floats:
        """Return one column between two times (s)."""
        return np.array(getattr(self, name)[_rows(since, until, STEP)])

    def places(self, rig: Rig, since: float, until: float) -> tuple[Floats, Floats]:
        """Return how the springs should stand between two times (s) and did, by their readings; (n, 3) each."""
        rows = _rows(since, until, HOST_STEP)
        read = {name: _between(one) for name, one in zip(POSE_SIGNALS, np.array(self.read).T, strict=True)}
        heights = [height_of_spring(read, rig, side) for side in SIDES]
        moved = np.column_stack([shear_of(read, rig), 0.5 * sum(heights), roll_of(read, rig)])
        return np.array(self.asked[rows]), moved[rows]


def _rows(since: float, until: float, step: float) -> slice:
    return slice(round(since / step), round(until / step))


def _between(held: Floats) -> Floats:
    """Return readings, each held until the next came, as straight lines between these."""
    fresh = np.flatnonzero(np.diff(held, prepend=np.nan) != 0.0)
    return np.interp(np.arange(held.size), fresh, held[fresh])


def ride_on(run: Run, ride: Ride, duration: float) -> Course:
    """Let the car ride for ``duration`` s on the springs of the bench; it begins where they stand now.

    LinkLost without forces; whatever ends it leaves the set-points where they are.
    """
    bench, rig = run.bench, run.rig
    names = (*FORCES, *POSE_SIGNALS)
    rest = bench.averages(*names, over=1 * s)
    late = path_of(rig).delay
    course, held, silent = Course(0.5 * float(upward_force(rest, rig))), STILL, 0.0
    level = setpoints_of(ride.place_at(0.0), LEVEL, rig)
    start = {name: bench.commander.value(name) - one for name, one in level.items()}
    steps, begun = round(HOST_STEP / STEP), run.now
    for k in range(round(duration / HOST_STEP)):
        read = {name: bench.readings.value(name) - rest[name] for name in names}
        if all(isfinite(read[name]) for name in FORCES):
            held, silent = springs_of(read, rig), 0.0
        elif (silent := silent + HOST_STEP) > SILENT:
            raise LinkLost(
                f"no force of the springs for {silent / ms:.0f} ms: the car has nothing to ride on"
            )
        course.asked.append(ride.place_at(0.0))
        course.read.append([read[name] for name in POSE_SIGNALS])
        to_beat = (bench.commander.next_cycle() - run.now) / NS
        if to_beat <= HOST_STEP:
            goal = setpoints_of(ride.place_at(late + to_beat), LEVEL, rig, held)
            table = setpoints_of(ride.place_at(late - TABLE_SOONER + to_beat), LEVEL, rig)
            goal["platform.roll_setpoint"] = table["platform.roll_setpoint"]
            bench.commander.set_all({name: start[name] + one for name, one in goal.items()})
        for _ in range(steps):
            ride.step(held)
            course.keep(ride)
        bench.wait(max(begun + (k + 1) * HOST_STEP * NS - run.now, 0.0) / NS)
    return course
