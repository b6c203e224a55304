"""A ride in the rig's tick: the host sends the car's parameters and the wind, and reads the reported motion."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from math import ceil
from typing import TYPE_CHECKING, Final

import numpy as np

from astb_studies.paper.hybrid.agreement import ROLLED, UP, WAYS, followed
from astb_studies.paper.hybrid.car import Car
from astb_studies.paper.hybrid.coupling import FORCES, POSES, Delay, rows_of, standing
from astb_studies.paper.hybrid.shaking import FREQUENCY, SIZES
from bench_protocol.arrays import Floats
from bench_protocol.rates import COMMAND_RATE
from bench_protocol.units import s
from drivers.errors import LinkLost
from drivers.waveform import WIND
from test_plans.analysis.cells import upward_force

if TYPE_CHECKING:
    from test_plans.analysis.geometry import Rig
    from test_plans.run import Run


#: So often the rig reports of its car.
STEP: Final = 1.0 / COMMAND_RATE
#: By column of a course: what the rig calls it.
REPORTED: Final = {
    "shear": "car.shear",
    "height": "car.height",
    "roll": "car.roll",
    "acceleration": "car.acceleration",
    "rising": "car.rising",
    "bump_stop": "car.bump_stop",
    "wind": "car.wind",
}
#: Before a ride the rig reads its load cells for a second.
RESTS: Final = 2 * s
#: Mass (kg) of a car that no force moves, so that only the track moves the springs. They are moved for `SHAKES` waves,
#: of which the first and the last do not count.
IMMOVABLE: Final = 1e9
SHAKES: Final = 9
#: After its end, a ride returns to its start within a second.
BACK: Final = 2 * s


@dataclass(frozen=True, slots=True, eq=False)
class TickCourse:
    """The results of a ride in the tick, a row for each `STEP` (SI); same interface as `coupling.Course`."""

    carried: float  #: load of each spring before the ride (N)
    columns: dict[str, Floats]
    read: dict[str, Floats]  #: of `POSES` and the lateral force, beyond rest
    hold: float
    step: float = STEP
    period: float = STEP

    def of(self, name: str, since: float, until: float) -> Floats:
        """Return one column between two times (s)."""
        return self.columns[name][rows_of(since, until, self.step)]

    def places(self, rig: Rig, since: float, until: float) -> tuple[Floats, Floats]:
        """Return the commanded and the measured places of the springs between two times (s); (n, 3) each."""
        rows = rows_of(since, until, self.step)
        commanded = np.column_stack([self.columns[name] for name in ("shear", "height", "roll")])
        return commanded[rows], standing(self.read, rig)[rows]

    def held(self, since: float, until: float) -> float:
        """Return the time for which each force on the car was held (s)."""
        return self.hold


def settings_of(car: Car, mass: float, delay: Delay, waves: int) -> dict[str, float]:
    """Return the rig's settings of a ``car`` (SI, without ``car.``) with the lead of ``delay``, for some ``waves``."""
    own = {name: value for name, value in asdict(car).items() if isinstance(value, float)}
    for unknown in ("train_speed", "track_wavelength"):
        own.pop(unknown)
    for what in ("travel", "force"):
        table = getattr(car, f"bump_stop_{what}")
        own |= {f"stop_{what}_{k}": float(one) for k, one in enumerate(table, 1)}
    return own | {
        "mass": mass,
        "track_frequency": car.track_frequency,
        "track_waves": waves,
        "track_roll": 0.0,
        "piston_lead": delay.pistons,
        "platform_lead": delay.platform,
    }


def ride_in_tick(
    run: Run, settings: dict[str, float], delay: Delay, wind: tuple[Floats, Floats] | None = None
) -> TickCourse:
    """Run a car in the rig's tick to the end of its track; ``wind``: times (s) and force (N), which is 0 at both ends.

    LinkLost if the rig does not report the ride. A stop of the ride also stops the program.
    """
    bench = run.bench
    names = (*FORCES, *POSES, "lateral.force")
    rest = bench.averages(*names, over=1 * s)
    lasts = settings["track_waves"] / settings["track_frequency"]
    with bench.capture(*REPORTED.values(), *POSES, "lateral.force") as capture:
        try:
            bench.car.start(settings)
            bench.wait_for(
                lambda: np.isfinite(bench.car.shear), within=RESTS, what="news of the car in the loop"
            )
            if wind is not None:
                times, force = wind
                bench.waveform.start(times, {WIND: force})
            bench.car.wait_done(within=lasts + RESTS)
        except BaseException:
            bench.generator.stop()
            raise
    bench.wait(BACK)
    _, at = capture.aligned(COMMAND_RATE)
    there = np.isfinite(at[REPORTED["shear"]])
    first, last = int(np.argmax(there)), int(there.size - np.argmax(there[::-1]))
    if not there[first:last].all():
        raise LinkLost("the rig did not report its car at all times, so the ride cannot be judged")
    columns = {name: at[signal][first:last] for name, signal in REPORTED.items()}
    read = {name: at[name][first:last] - rest[name] for name in (*POSES, "lateral.force")}
    return TickCourse(0.5 * float(upward_force(rest, run.rig)), columns, read, delay.hold)


def shake_in_tick(run: Run) -> Delay:
    """Move the springs in each direction in the rig's tick, by a track under a fixed car; return their delay."""
    foreseen = Delay.foreseen(run.rig, "rig")
    # With the springs at the height of its centre of mass, a leaning car does not fall over.
    still = Car(
        centre_height=0.0, train_speed=FREQUENCY, track_wavelength=1.0, track_lateral=0.0, track_vertical=0.0
    )
    late: dict[str, float] = {}
    with run.phase("shake in the tick"):
        for name, way, size in zip(WAYS, ("lateral", "vertical", "roll"), SIZES, strict=True):
            track = {**settings_of(still, IMMOVABLE, foreseen, SHAKES), f"track_{way}": size}
            course = ride_in_tick(run, track, foreseen)
            places = course.places(run.rig, 1.0 / FREQUENCY, (SHAKES - 1) / FREQUENCY)
            late[name] = followed(*places, foreseen.hold, run.rig, STEP)[name].late
        found = foreseen.after(late[ROLLED], late[UP], foreseen.hold, run.rig)
        text = f"pistons are {1e3 * found.pistons:.1f} ms late, the platform {1e3 * found.platform:.1f} ms"
        run.say(f"in the rig's tick {text}")
    return found


def waves_for(car: Car, whole: float) -> int:
    """Return how many waves of the track last for ``whole`` s."""
    return ceil(whole * car.track_frequency)
