"""Ride comfort in a crosswind: five minutes of ride per wind speed, load and realisation of the gusts, and their table.

Frequency weighting and percentiles follow from a standard, so they are passed as a function.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from math import sqrt
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from scipy.stats import t

from astb_studies.paper.wind import Crosswind, wind_force
from bench_sim.model.car import Ride, RideChannel
from bench_sim.model.vehicle import Vehicle

#: Sampling of the wind in s: the car's length lets nothing through beyond a few Hz.
WIND_INTERVAL: Final = 0.01
#: How long leveling valves get to set up the car in the mean wind, s.
_LEVELING_TIME: Final = 600.0


def crosswind_ride(
    parameters: Any,
    car: Any,
    wind: Crosswind,
    mean_speed: float,
    seed: int,
    *,
    duration: float = 300.0,
    run_in: float = 20.0,
    every: int = 2,
    leveling: bool = False,
) -> Ride:
    """Ride through one realisation of the wind with the mean ``mean_speed`` m/s from the right.

    Starts leaning in the mean force and records after ``run_in`` s every so many milliseconds. The train's speed is the
    car's. With ``leveling`` the valves first set the car upright in the mean force.
    """
    step = WIND_INTERVAL
    time = step * np.arange(round((run_in + duration) / step) + 1, dtype=np.float64)
    force = 0.5 * wind_force(time, mean_speed, seed, replace(wind, train_speed=float(car.train_speed)))
    vehicle = Vehicle(parameters, car, leveling=leveling)
    mean = float(force.mean())
    vehicle.lean(mean)
    if leveling:
        vehicle.ride(mean, _LEVELING_TIME, every=1_000_000)
    start = vehicle.time
    return vehicle.ride(force, run_in + duration, interval=step, every=every).since(start + run_in)


@dataclass(frozen=True, slots=True)
class Response:
    """Summary of a ride (SI); displacements of the centre of gravity, accelerations on the floor.

    Peaks are the largest magnitudes. ``bump_stop_travel`` is that of the bump stop, ``bump_stop_time`` its share of
    the time in contact. ``weighted`` is the weighted acceleration that the standard's function gives back.
    """

    mean_lateral: float
    peak_lateral: float
    mean_roll: float
    peak_roll: float
    bump_stop_travel: float
    bump_stop_time: float
    acceleration: float  #: rms about the mean, lateral
    peak_acceleration: float
    weighted: float


#: Lateral acceleration in m/s² and its sampling rate in Hz -> one weighted acceleration in m/s².
Weighting = Callable[[NDArray[np.float64], float], float]


def response(ride: Ride, car: Any, weigh: Weighting, gravity: float = 0.0) -> Response:
    """Evaluate a ride; with ``gravity`` (m/s²) the floor's lean counts as acceleration too, as for a sensor on it."""
    y, roll = ride.of(RideChannel.LATERAL), ride.of(RideChannel.ROLL)
    a = ride.lateral_acceleration(float(car.floor_depth), gravity)
    travel = y + float(car.bump_stop_depth) * roll - ride.of(RideChannel.BOGIE_LATERAL)
    rate = (len(ride.time) - 1) / (ride.time[-1] - ride.time[0])
    return Response(
        mean_lateral=float(y.mean()),
        peak_lateral=float(np.abs(y).max()),
        mean_roll=float(roll.mean()),
        peak_roll=float(np.abs(roll).max()),
        bump_stop_travel=float(np.abs(travel).max()),
        bump_stop_time=float(np.mean(ride.of(RideChannel.BUMP_STOP) != 0.0)),
        acceleration=float(a.std()),
        peak_acceleration=float(np.abs(a - a.mean()).max()),
        weighted=float(weigh(a, float(rate))),
    )


@dataclass(frozen=True, slots=True)
class SampleMean:
    """A mean over realisations and the half width of its 95 % confidence interval (Student's t)."""

    mean: float
    half_width: float

    @classmethod
    def of(cls, values: Sequence[float]) -> "SampleMean":
        """From one value per realisation; a single one has no width (nan)."""
        n = len(values)
        mean = float(np.mean(values))
        if n < 2:
            return cls(mean, float("nan"))
        return cls(mean, float(t.ppf(0.975, n - 1)) * float(np.std(values, ddof=1)) / sqrt(n))


@dataclass(frozen=True, slots=True)
class Cell:
    """One wind speed (m/s) under one load case: every realisation, and each quantity of `Response` as an estimate."""

    load_case: str
    wind_speed: float
    responses: tuple[Response, ...]

    def estimate(self, quantity: str, factor: float = 1.0) -> SampleMean:
        """Return ``factor`` times one field of `Response`, as mean and confidence interval."""
        return SampleMean.of([factor * getattr(one, quantity) for one in self.responses])

    def estimates(self) -> dict[str, SampleMean]:
        """Return every field of `Response` by name."""
        return {one.name: self.estimate(one.name) for one in fields(Response)}


def ride_cell(
    load_case: str,
    parameters: Any,
    car: Any,
    wind: Crosswind,
    wind_speed: float,
    seeds: Iterable[int],
    weigh: Weighting,
    *,
    felt: bool = False,
    **options: Any,
) -> Cell:
    """One cell of the table: a ride (`crosswind_ride`, ``options``) per seed; ``felt`` counts the lean's gravity."""
    gravity = float(parameters.gravity) if felt else 0.0
    return Cell(
        load_case,
        wind_speed,
        tuple(
            response(crosswind_ride(parameters, car, wind, wind_speed, seed, **options), car, weigh, gravity)
            for seed in seeds
        ),
    )


def ride_table(
    loads: Mapping[str, Any],
    car: Any,
    wind: Crosswind,
    weigh: Weighting,
    *,
    wind_speeds: Sequence[float] = (10.0, 15.0, 20.0, 25.0),
    seeds: Sequence[int] = tuple(range(1, 11)),
    **options: Any,
) -> list[Cell]:
    """The table of wind speed × load case; ``loads`` maps names to parameter records.

    Every cell meets the same realisations (same seeds), so that most of the random error cancels in a difference.
    """
    return [
        ride_cell(name, record, car, wind, speed, seeds, weigh, **options)
        for name, record in loads.items()
        for speed in wind_speeds
    ]
