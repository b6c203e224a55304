"""The host's part of a hybrid ride: in each step it reads forces, integrates the car, and sends set-points."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from math import isfinite
from typing import TYPE_CHECKING, Final, Literal, Protocol

import numpy as np

from astb_studies.paper.hybrid.car import STEP, Ride
from astb_studies.paper.hybrid.loop import Path
from bench_protocol.arrays import Floats
from bench_protocol.geometry import STILL, SpringPose, Springs, setpoints_of
from bench_protocol.rates import COMMAND_RATE, FAST_RATE, TICK
from bench_protocol.units import NS, ms, s
from bench_protocol.words import SIDES
from drivers.errors import LinkLost
from test_plans.analysis import HEIGHTS, SHEAR_CELLS, VERTICAL_CELLS
from test_plans.analysis.cells import CELLS, CELLS_ACROSS, cell_moment, sideways_force, upward_force
from test_plans.analysis.geometry import (
    ACTUATORS,
    LASERS,
    PLACING,
    Rig,
    height_of_spring,
    roll_of,
    shear_of,
)
from test_plans.description import lag_of, lags

if TYPE_CHECKING:
    from test_plans.run import Run


#: The car's step, which is also the period of the forces.
HOST_STEP: Final = 1.0 / FAST_RATE
#: Latency of set-points and forces without the interpolation, the actuator's loop and the transducers' lag: dead time
#: and frames, as measured in rides on the virtual bench.
LATENCY: Final = 3 * ms
#: Lead of the platform over the pistons: an error of 6 ms would look like a fifth of the roll.
TABLE_SOONER: Final = 5.5 * ms
#: Without a force for this time, the state of the springs is unknown.
SILENT: Final = 50 * ms
FORCES: Final = (*SHEAR_CELLS, *VERTICAL_CELLS)
#: The readings of the pose of the springs; the deflection of the frames is computed from the load cells.
POSES: Final = (*HEIGHTS, "lateral.displacement", "platform.roll")
#: The dimensions of the rig that the ride needs.
COUPLED: Final = (
    *FORCES,
    *POSES,
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


@dataclass(frozen=True, slots=True)
class Beat:
    """Times (s) of the exchange between the car's model and the springs.

    ``joined`` is the time to interpolate set-points, ``latency`` the further delay without the actuator's loop, and
    ``hold`` the time for which a force is held.
    """

    joined: float
    latency: float
    hold: float


#: The computer of the car's model: the host in each of its steps, through the stream of set-points, or the rig in its
#: tick, with the forces of the previous tick.
BEATS: Final = {
    "host": Beat(1.0 / COMMAND_RATE, LATENCY, HOST_STEP),
    "rig": Beat(0.0, LATENCY, 2.0 * TICK),
}
By = Literal["host", "rig"]


@dataclass(frozen=True, slots=True)
class Delay:
    """Delay of pistons and platform in the readings that the car receives (s), the hold time, and the car's computer.

    It is computed from the dimensions of the rig until it has been measured.
    """

    pistons: float
    platform: float
    hold: float = HOST_STEP
    by: By = "host"

    @classmethod
    def foreseen(cls, rig: Rig, by: By = "host") -> Delay:
        """Return the delay that follows from the dimensions of a rig."""
        late = _path(rig, BEATS[by]).delay
        return cls(late, late - TABLE_SOONER, BEATS[by].hold, by)

    def after(self, roll: float, lift: float, hold: float, rig: Rig) -> Delay:
        """Return the delay corrected by the remaining lateness in ``roll`` and in ``lift`` (s).

        A roll of the springs is the roll of the bolster less that of the platform, each by its share.
        """
        at = setpoints_of(SpringPose(0.0, 0.0, 1.0), rig)
        share = -at["platform.roll_setpoint"]
        platform = (roll - (1.0 - share) * lift) / share
        return Delay(self.pistons + lift, self.platform + platform, hold, self.by)


def path_of(rig: Rig, delay: Delay | None = None, by: By = "host") -> Path:
    """Return the path from places to forces on this rig, from its dimensions or from its measured ``delay``."""
    if delay is None:
        return _path(rig, BEATS[by])
    beat = replace(BEATS[delay.by], latency=0.0, hold=delay.hold)
    return _path(rig, replace(beat, latency=delay.pistons - _path(rig, beat).delay))


def _path(rig: Rig, beat: Beat) -> Path:
    return Path(
        beat=beat.joined,
        latency=beat.latency,
        hold=beat.hold,
        actuator_frequency=rig["actuator_frequency"],
        actuator_damping=rig["actuator_damping"],
        lag=lag_of(rig, *FORCES),
    )


def springs_of(read: Mapping[str, float], rig: Rig) -> Springs:
    """Return the forces of both springs on their load, from the load cells."""
    lateral, upward = sideways_force(read, rig), upward_force(read, rig)
    return Springs(float(lateral), float(upward), -float(cell_moment(read, rig)))


class Motion(Protocol):
    """Source of the motion of the springs: a car on them, or a known motion."""

    def place_at(self, ahead: float) -> SpringPose:
        """Return the place of the springs ``ahead`` s from now."""

    def step(self, springs: Springs) -> None:
        """Integrate one `STEP` under the forces of the springs."""


@dataclass(slots=True)
class Course:
    """The results of a motion, with a row for each step of the car's integration and of the host (SI)."""

    carried: float  #: load of each spring before the motion (N)
    step: float = STEP
    period: float = HOST_STEP  #: period of places and readings (s)
    time: list[float] = field(default_factory=list)
    acceleration: list[float] = field(default_factory=list)  #: of the floor, lateral
    rising: list[float] = field(default_factory=list)  #: of the floor's middle, vertical acceleration
    bump_stop: list[float] = field(default_factory=list)
    lateral: list[float] = field(default_factory=list)
    roll: list[float] = field(default_factory=list)
    commanded: list[SpringPose] = field(
        default_factory=list
    )  #: the commanded place of the springs in each step of the host
    read: list[list[float]] = field(
        default_factory=list
    )  #: the readings of the place, in the order of `POSES`, and the force

    def keep(self, ride: Ride) -> None:
        """Store the present state of a ride."""
        self.time.append(ride.time)
        self.acceleration.append(ride.floor_acceleration)
        self.rising.append(ride.now.acceleration[1])
        self.bump_stop.append(ride.now.bump_stop)
        self.lateral.append(ride.now.place[0])
        self.roll.append(ride.now.place[2])

    def of(self, name: str, since: float, until: float) -> Floats:
        """Return one column between two times (s)."""
        return np.array(getattr(self, name)[rows_of(since, until, STEP)])

    def places(self, rig: Rig, since: float, until: float) -> tuple[Floats, Floats]:
        """Return the commanded and the measured poses of the springs between two times (s); (n, 3) each."""
        rows = rows_of(since, until, HOST_STEP)
        names = (*POSES, "lateral.force")
        read = {name: _between(one) for name, one in zip(names, np.array(self.read).T, strict=True)}
        return np.array(self.commanded[rows]), standing(read, rig)[rows]

    def held(self, since: float, until: float) -> float:
        """Return the hold time of a reading (s), from the readings of a moving height."""
        rows = np.array(self.read)[rows_of(since, until, HOST_STEP), 0]
        came = np.flatnonzero(np.diff(rows))
        return float(HOST_STEP * np.median(np.diff(came))) if came.size > 1 else HOST_STEP


def standing(read: Mapping[str, Floats], rig: Rig) -> Floats:
    """Return the change of the spring pose since rest, of readings (n, 3): shear, height and roll (`SpringPose`)."""
    heights = [height_of_spring(read, rig, side) for side in SIDES]
    return np.column_stack([shear_of(read, rig), 0.5 * sum(heights), roll_of(read, rig)])


def rows_of(since: float, until: float, step: float) -> slice:
    """Return the rows between two times (s) in a table with a row every ``step`` s."""
    return slice(round(since / step), round(until / step))


def _between(held: Floats) -> Floats:
    """Convert held readings to linear interpolation between them."""
    fresh = np.flatnonzero(np.diff(held, prepend=np.nan) != 0.0)
    return np.interp(np.arange(held.size), fresh, held[fresh])


def move_on(run: Run, motion: Motion, delay: Delay, duration: float) -> Course:
    """Move the springs of the bench through a motion for ``duration`` s, from their present position.

    LinkLost if no forces arrive. At the end, and after an error, the set-points keep their last values.
    """
    bench, rig = run.bench, run.rig
    names = (*FORCES, *POSES)
    rest = bench.averages(*names, over=1 * s)
    course, held, silent = Course(0.5 * float(upward_force(rest, rig))), STILL, 0.0
    level = setpoints_of(motion.place_at(0.0), rig)
    start = {name: bench.commander.value(name) - one for name, one in level.items()}
    steps, begun = round(HOST_STEP / STEP), run.now
    for k in range(round(duration / HOST_STEP)):
        read = {name: bench.readings.value(name) - rest[name] for name in names}
        if all(isfinite(read[name]) for name in FORCES):
            held, silent = springs_of(read, rig), 0.0
        elif (silent := silent + HOST_STEP) > SILENT:
            raise LinkLost(
                f"no force of the springs was received for {silent / ms:.0f} ms, so the car cannot be simulated"
            )
        course.commanded.append(motion.place_at(0.0))
        course.read.append([*(read[name] for name in POSES), -held.lateral])
        to_beat = (bench.commander.next_cycle() - run.now) / NS
        if to_beat <= HOST_STEP:
            goal = setpoints_of(motion.place_at(delay.pistons + to_beat), rig, held)
            table = setpoints_of(motion.place_at(delay.platform + to_beat), rig)
            goal["platform.roll_setpoint"] = table["platform.roll_setpoint"]
            bench.commander.set_all({name: start[name] + one for name, one in goal.items()})
        for _ in range(steps):
            motion.step(held)
            if isinstance(motion, Ride):
                course.keep(motion)
        bench.wait(max(begun + (k + 1) * HOST_STEP * NS - run.now, 0.0) / NS)
    return course
