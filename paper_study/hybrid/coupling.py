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
from test_plans.analysis.geometry import ACTUATORS, LASERS, PLACING, STOP_ROOM, Rig
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
#: Without a force for so long nobody knows what the springs do.
SILENT: Final = 50 * ms
#: What has to be known of the rig.
COUPLED: Final = (
    *SHEAR_CELLS,
    *VERTICAL_CELLS,
    *HEIGHTS,
    "lateral.displacement_setpoint",
    "platform.roll_setpoint",
    "actuator_frequency",
    "actuator_damping",
    *PLACING,
    *CELLS,
    *CELLS_ACROSS,
    *ACTUATORS,
    *LASERS,
    *lags((*SHEAR_CELLS, *VERTICAL_CELLS)),
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


def setpoints_of(place: Place, home: Home, rig: Rig) -> dict[str, float]:
    """Return where bolster and platform have to be for the springs to stand so, by the names of the set-points."""
    share = (rig["stop_gap"] - STOP_ROOM) / SHEAR_MAX
    platform = ((1.0 - share) * place.shear - rig["centre_height"] * place.roll) / (
        rig["centre_height"] + rig["column_height"]
    )
    bolster = platform + place.roll
    lifts = dict(zip(SIDES, (home.left, home.right), strict=True))
    return {
        "lateral.displacement_setpoint": share * place.shear - rig["lateral_actuator_height"] * bolster,
        "platform.roll_setpoint": platform,
        **{
            f"vertical_{side}.displacement_setpoint": lift
            + place.height
            + rig[across(f"vertical_{side}")] * bolster
            for side, lift in lifts.items()
        },
    }


@dataclass(slots=True)
class Course:
    """What came of a ride, row by row of the car's integration, and of the host's step (SI)."""

    time: list[float] = field(default_factory=list)
    acceleration: list[float] = field(default_factory=list)  #: of the floor, lateral
    bump_stop: list[float] = field(default_factory=list)
    lateral: list[float] = field(default_factory=list)
    roll: list[float] = field(default_factory=list)
    bounce: list[float] = field(
        default_factory=list
    )  #: how the springs should be lengthened, each host's step
    bounced: list[float] = field(default_factory=list)  #: and were, by the lasers

    def keep(self, ride: Ride) -> None:
        """Keep where a ride is now."""
        self.time.append(ride.time)
        self.acceleration.append(ride.floor_acceleration)
        self.bump_stop.append(ride.stop_force)
        self.lateral.append(ride.place[0])
        self.roll.append(ride.place[2])

    def of(self, name: str, since: float, until: float) -> Floats:
        """Return one column between two times (s)."""
        step = HOST_STEP if name.startswith("bounce") else STEP
        return np.array(getattr(self, name)[round(since / step) : round(until / step)])


def ride_on(run: Run, ride: Ride, home: Home, duration: float) -> Course:
    """Let the car ride for ``duration`` s on the springs of the bench; it begins where they stand now.

    LinkLost without forces; whatever ends it leaves the set-points where they are.
    """
    bench, rig = run.bench, run.rig
    names = (*SHEAR_CELLS, *VERTICAL_CELLS, *HEIGHTS)
    rest = bench.averages(*names, over=1 * s)
    late = path_of(rig).delay
    course, held, silent = Course(), Springs(0.0, 0.0, 0.0), 0.0
    start = bench.commander.value("lateral.displacement_setpoint")
    steps, begun = round(HOST_STEP / STEP), run.now
    for k in range(round(duration / HOST_STEP)):
        read = {name: bench.readings.value(name) - rest[name] for name in names}
        if all(map(isfinite, read.values())):
            held, silent = springs_of(read, rig), 0.0
        elif (silent := silent + HOST_STEP) > SILENT:
            raise LinkLost(
                f"no force of the springs for {silent / ms:.0f} ms: the car has nothing to ride on"
            )
        course.bounce.append(ride.place_at(0.0).height)
        course.bounced.append(0.5 * (read["left.height"] + read["right.height"]))
        to_beat = (bench.commander.next_cycle() - run.now) / NS
        if to_beat <= HOST_STEP:
            goal = setpoints_of(ride.place_at(late + to_beat), home, rig)
            goal["lateral.displacement_setpoint"] += start
            table = setpoints_of(ride.place_at(late - TABLE_SOONER + to_beat), home, rig)
            goal["platform.roll_setpoint"] = table["platform.roll_setpoint"]
            bench.commander.set_all(goal)
        for _ in range(steps):
            ride.step(held)
            course.keep(ride)
        bench.wait(max(begun + (k + 1) * HOST_STEP * NS - run.now, 0.0) / NS)
    return course
