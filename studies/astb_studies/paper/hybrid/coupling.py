"""The host's part of a hybrid ride: forces in, the car a step on, set-points out, on the bench's clock."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from math import isfinite
from typing import TYPE_CHECKING, Final, Literal, Protocol

import numpy as np

from astb_studies.paper.hybrid.car import STEP, Ride
from astb_studies.paper.hybrid.loop import Path
from bench_protocol.arrays import Floats
from bench_protocol.places import STILL, Place, Springs, setpoints_of
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


#: The car's step, at which forces come.
HOST_STEP: Final = 1.0 / FAST_RATE
#: How late a set-point shows next to what joining and the actuator's loop take, and a force next to its transducer's
#: lag: dead time and frames, as the rides on the virtual bench measure it.
LATENCY: Final = 3 * ms
#: How much sooner than the pistons the platform is where it is told to be: 6 ms would pass for a fifth of the roll.
TABLE_SOONER: Final = 5.5 * ms
#: Without a force for so long no one knows what the springs do.
SILENT: Final = 50 * ms
FORCES: Final = (*SHEAR_CELLS, *VERTICAL_CELLS)
#: What identifies how the springs stand; what frames give way by, the load cells tell.
POSES: Final = (*HEIGHTS, "lateral.displacement", "platform.roll")
#: What has to be known of the rig.
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
    """How anyone who computes the car moves springs and feels them (s).

    How long set-points take to be joined, how late one shows next to that and the actuator's loop, and for how long a
    force is held.
    """

    joined: float
    latency: float
    hold: float


#: Who computes the car: the host with each of its steps, through the stream of set-points, or the rig in its tick, of
#: which the forces are those of the tick before.
BEATS: Final = {
    "host": Beat(1.0 / COMMAND_RATE, LATENCY, HOST_STEP),
    "rig": Beat(0.0, LATENCY, 2.0 * TICK),
}
By = Literal["host", "rig"]


@dataclass(frozen=True, slots=True)
class Delay:
    """How late pistons and platform show in what the car is told (s), for how long each reading is held, and by whom.

    By the dimensions of the rig, until a user has measured it.
    """

    pistons: float
    platform: float
    hold: float = HOST_STEP
    by: By = "host"

    @classmethod
    def foreseen(cls, rig: Rig, by: By = "host") -> Delay:
        """Return what the dimensions of a rig let expect that follows each set-point at once."""
        late = _path(rig, BEATS[by]).delay
        return cls(late, late - TABLE_SOONER, BEATS[by].hold, by)

    def after(self, roll: float, lift: float, hold: float, rig: Rig) -> Delay:
        """Return it where springs came so much later in ``roll`` and with a ``lift`` (s) than this delay made up for.

        A roll of the springs is one of the bolster less one of the platform, each by its share.
        """
        at = setpoints_of(Place(0.0, 0.0, 1.0), rig)
        share = -at["platform.roll_setpoint"]
        platform = (roll - (1.0 - share) * lift) / share
        return Delay(self.pistons + lift, self.platform + platform, hold, self.by)


def path_of(rig: Rig, delay: Delay | None = None, by: By = "host") -> Path:
    """Return what is between places and forces on this rig, by its dimensions or as its ``delay`` was measured."""
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
    """Return what the load cells say that both springs do to what is on them."""
    lateral, upward = sideways_force(read, rig), upward_force(read, rig)
    return Springs(float(lateral), float(upward), -float(cell_moment(read, rig)))


class Motion(Protocol):
    """What moves the springs: a car that rides on them, or a motion that is known beforehand."""

    def place_at(self, ahead: float) -> Place:
        """Return how the springs will stand ``ahead`` s from now."""

    def step(self, springs: Springs) -> None:
        """Go on by `STEP` under what the springs do."""


@dataclass(slots=True)
class Course:
    """What came of a motion, row by row of the car's integration, and of the host's step (SI)."""

    carried: float  #: what each spring carried before it began (N)
    step: float = STEP
    told_every: float = HOST_STEP  #: how often places and readings are told
    time: list[float] = field(default_factory=list)
    acceleration: list[float] = field(default_factory=list)  #: of the floor, lateral
    rising: list[float] = field(default_factory=list)  #: of the floor's middle, vertical acceleration
    bump_stop: list[float] = field(default_factory=list)
    lateral: list[float] = field(default_factory=list)
    roll: list[float] = field(default_factory=list)
    asked: list[Place] = field(default_factory=list)  #: how the springs should stand, each host's step
    read: list[list[float]] = field(
        default_factory=list
    )  #: and the readings that tell it, in `POSES`, and the force

    def keep(self, ride: Ride) -> None:
        """Keep where a ride is now."""
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
        """Return how the springs should stand between two times (s) and did, by their readings; (n, 3) each."""
        rows = rows_of(since, until, HOST_STEP)
        names = (*POSES, "lateral.force")
        read = {name: _between(one) for name, one in zip(names, np.array(self.read).T, strict=True)}
        return np.array(self.asked[rows]), standing(read, rig)[rows]

    def held(self, since: float, until: float) -> float:
        """Return for how long a reading stays until the next comes (s), by those of a height that moves."""
        rows = np.array(self.read)[rows_of(since, until, HOST_STEP), 0]
        came = np.flatnonzero(np.diff(rows))
        return float(HOST_STEP * np.median(np.diff(came))) if came.size > 1 else HOST_STEP


def standing(read: Mapping[str, Floats], rig: Rig) -> Floats:
    """Return how the springs stand by `POSES` and the lateral force, all of them beyond rest: (n, 3) of `Place`."""
    heights = [height_of_spring(read, rig, side) for side in SIDES]
    return np.column_stack([shear_of(read, rig), 0.5 * sum(heights), roll_of(read, rig)])


def rows_of(since: float, until: float, step: float) -> slice:
    """Return the rows between two times (s) of what has one every ``step`` s."""
    return slice(round(since / step), round(until / step))


def _between(held: Floats) -> Floats:
    """Return readings, each held until the next came, as straight lines between these."""
    fresh = np.flatnonzero(np.diff(held, prepend=np.nan) != 0.0)
    return np.interp(np.arange(held.size), fresh, held[fresh])


def move_on(run: Run, motion: Motion, delay: Delay, duration: float) -> Course:
    """Let the springs of the bench go through a motion for ``duration`` s; it begins where they stand now.

    LinkLost without forces; whatever ends it leaves the set-points where they are.
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
                f"no force of the springs for {silent / ms:.0f} ms: the car has nothing to ride on"
            )
        course.asked.append(motion.place_at(0.0))
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
