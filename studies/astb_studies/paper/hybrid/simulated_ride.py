"""The same car on the springs of a model, for comparison with a ride on measured springs."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from astb_studies.paper.hybrid.car import STEP, Car
from bench_protocol.arrays import Floats
from bench_sim.model.car import Ride, RideChannel
from bench_sim.model.layout import State
from bench_sim.model.vehicle import Vehicle
from bench_sim.parameters import ParameterError, load
from bench_sim.parameters.vehicle import load_vehicle

if TYPE_CHECKING:
    from test_plans.analysis.geometry import Rig


class NoModel(Exception):
    """The springs have no model for a simulated ride; the text gives the reason."""


@dataclass(frozen=True, slots=True, eq=False)
class SimulatedSprings:
    """The springs that a car rides on alone: parameter set, load case, what each carries as it rests (N), its gas."""

    model: str
    load: str
    carried: float
    rig: Rig
    warmer: float = 0.0  #: K above its walls is the gas of the left one as the ride begins


@dataclass(frozen=True, slots=True, eq=False)
class SimulatedRide:
    """The results of a ride on the model's springs, a row for each `STEP` (SI); same interface as `coupling.Course`."""

    columns: dict[str, Floats]
    step: float = STEP

    def of(self, name: str, since: float, until: float) -> Floats:
        """Return one column between two times (s)."""
        return self.columns[name][round(since / STEP) : round(until / STEP)]


def simulate_ride(
    car: Car, mass: float, springs: SimulatedSprings, wind: Floats, interval: float, share: Floats
) -> SimulatedRide:
    """Simulate the ride of the ``car`` of ``mass`` (kg) in a ``wind`` (N) on its track times ``share``.

    Both have a sample every ``interval`` s. The first wave of the track leaves an oscillation of the gas for a minute.
    Springs on the bench may carry less than the weight of the car; only their additional forces count. So the car has
    the weight that the springs carry, and the effect of the missing weight on a roll is subtracted from the anti-roll
    bar. NoModel if the set cannot be read, or has no such load case.
    """
    rig = springs.rig
    gravity = 2.0 * springs.carried / mass
    lighter = mass * (rig["gravity"] - gravity) * car.centre_height
    own: dict[str, Any] = {
        **asdict(car),
        "damper_rate_beyond": car.damper_rate,
        "anti_roll_stiffness": car.anti_roll_stiffness - lighter,
    }
    try:
        parameters = load(springs.model, springs.load).with_values(
            gravity=gravity,
            nominal_preload=springs.carried,
            spring_half_spacing=rig["spring_half_spacing"],
            column_height=rig["column_height"],
        )
        vehicle = Vehicle(parameters.record, load_vehicle().with_values(**own).record, dt=STEP)
    except (ParameterError, ValueError) as error:
        raise NoModel(str(error)) from None
    walls = parameters.record.ambient_temperature + parameters.record.wall_temperature_offset
    for place in (
        State.BELLOWS_MASS,
        State.AUXILIARY_MASS,
    ):  # of the left: at the same pressure, with the same energy
        vehicle.state[place] *= walls / (walls + springs.warmer)
    rode = _ridden(vehicle, car, wind, interval, share)
    columns = {
        "acceleration": rode.of(RideChannel.LATERAL_ACCELERATION)
        + car.floor_depth * rode.of(RideChannel.ROLL_ACCELERATION),
        "rising": rode.of(RideChannel.VERTICAL_ACCELERATION),
        "bump_stop": rode.of(RideChannel.BUMP_STOP),
        "lateral": rode.of(RideChannel.LATERAL),
        "roll": rode.of(RideChannel.ROLL),
    }
    return SimulatedRide(columns)


def _ridden(vehicle: Vehicle, car: Car, wind: Floats, interval: float, share: Floats) -> Ride:
    """Ride through all samples; while the track rises or fades, take one sample at a time."""
    edges = np.flatnonzero(np.diff(share) != 0.0)
    ends = np.unique(np.concatenate([edges, edges + 1, [0, len(wind) - 1]]))
    parts = []
    for start, end in pairwise(ends.tolist()):
        middle = 0.5 * (share[start] + share[end])
        vehicle.car.track_lateral = middle * car.track_lateral
        vehicle.car.track_vertical = middle * car.track_vertical
        parts.append(vehicle.ride(wind[start : end + 1], (end - start) * interval, interval=interval))
    return Ride(
        *(np.concatenate([getattr(one, name) for one in parts]) for name in ("time", "rows", "algebraic"))
    )
