"""The car as an FMU: what others simulate is the one law of the car, on a track, in wind, on springs of their own."""

from dataclasses import asdict

import numpy as np
import pytest

from bench_protocol.car import MovingCar, floor_acceleration, move_car, springs_ahead
from bench_sim.parameters import load
from bench_sim.parameters.vehicle import load_vehicle
from tests.fmu.test_spring_fmu import VERSIONS, equal

pytestmark = pytest.mark.slow

TICKS, TICK = 200, 1e-3
FORCES = (
    *("left.vertical_force", "right.vertical_force", "left.lateral_force", "right.lateral_force"),
    *("left.roll_moment", "right.roll_moment", "car.wind"),
)
TRACK = tuple(
    f"track.{way}{rate}"
    for rate in ("", "_speed", "_acceleration")
    for way in ("lateral", "vertical", "roll")
)
OUTPUTS = (
    *("left.height", "right.height", "springs.lateral"),
    *("left.height_speed", "right.height_speed", "springs.lateral_speed"),
    *("car.shear", "car.height", "car.roll", "car.acceleration", "car.rising", "car.bump_stop"),
    *("car.lateral", "car.vertical", "car.lean"),
)


def half_a_car() -> MovingCar:
    """The car of the files, made here from their values."""
    vehicle, bench = load_vehicle().record, load().record
    own = {
        name: np.asarray(vehicle[name]).tolist()
        for name in asdict(MovingCar())
        if name in vehicle.dtype.names
    }
    mass = float(bench.nominal_preload.sum() / bench.gravity)
    return MovingCar(mass, mass * float(vehicle.roll_gyration) ** 2, float(bench.gravity), **own)


def outputs(car: MovingCar, b: float) -> list[float]:
    """What the FMU has to say of this car, whose springs stand ``b`` m from its middle."""
    shear, height, roll = springs_ahead(car, 0.0, *car.track)
    rate = [car.speed[way] - car.track_rate[way] for way in range(3)]
    return [
        *(height + b * roll, height - b * roll, shear),
        *(rate[1] + b * rate[2], rate[1] - b * rate[2], rate[0] + car.centre_height * car.speed[2]),
        *(shear, height, roll, floor_acceleration(car), car.acceleration[1], car.bump_stop),
        *car.place,
    ]


def given(ticks: int) -> np.ndarray:
    """Forces and track (n, both) of so many ticks each; wind enough for the bump stop."""
    t = TICK * ticks * np.arange(TICKS // ticks)
    preload = float(load().record.nominal_preload[0])
    forces = [preload + 4e3 * np.sin(20 * t), preload - 3e3 * np.sin(31 * t), 2e3 * np.sin(9 * t), -1e3 * t]
    forces += [500.0 * np.sin(14 * t), 200.0 * np.cos(14 * t), 6e4 * t / 0.2]
    w = 2 * np.pi * 4.0
    track = [size * np.sin(w * t) for size in (5e-3, 4e-3, 2e-3)]
    track += [size * w * np.cos(w * t) for size in (5e-3, 4e-3, 2e-3)]
    track += [-size * w**2 * np.sin(w * t) for size in (5e-3, 4e-3, 2e-3)]
    return np.stack([*forces, *track], axis=1)


def by_the_law(rows: np.ndarray, ticks: int) -> np.ndarray:
    """Outputs (n, OUTPUTS) of a car that is moved by Python, tick by tick."""
    car, b = half_a_car(), float(load().record.spring_half_spacing)
    found = []
    for n, row in enumerate(rows):
        left, right, *sideways = row[:4]
        place, rate, bend = row[7:10], row[10:13], row[13:16]
        if n == 0:  # it begins on the track, and goes as the track does
            e = car.centre_height
            car.place[:] = [place[0] - e * place[2], place[1], place[2]]
            car.speed[:] = [rate[0] - e * rate[2], rate[1], rate[2]]
        car.springs[:] = [
            sum(sideways),
            left + right - car.mass * car.gravity,
            row[4] + row[5] + b * (left - right),
        ]
        car.wind = row[6]
        for k in range(ticks + 1):
            since = k * TICK
            car.track[:] = (place + since * (rate + 0.5 * since * bend)).tolist()
            car.track_rate[:] = (rate + since * bend).tolist()
            if k < ticks:
                move_car(car, TICK)
        found.append(outputs(car, b))
    return np.array(found)


@pytest.mark.parametrize("ticks", [1, 5, 20])
def test_the_car_fmu_equals_the_law(car_fmus, isolated, ticks):
    """Also when it is saved, and gone on with in another instance."""
    rows = given(ticks)
    right = by_the_law(rows, ticks)
    assert np.abs(right[:, OUTPUTS.index("car.bump_stop")]).max() > 100.0
    names = [*FORCES, *TRACK]
    begin = dict(zip(names, rows[0], strict=True))
    for version in VERSIONS if ticks == 5 else (3,):
        got = isolated(
            car_fmus[version],
            "motion",
            names=names,
            times=TICK * ticks * np.arange(TICKS // ticks + 1),
            motion=rows,
            outputs=OUTPUTS,
            begin=list(begin),
            begin_values=[*begin.values()],
        )
        assert got["outputs"] == got["again"]
        assert equal(np.array(got["outputs"]), right, 1e-12)


def test_a_hundred_cars_do_not_meet_and_parts_of_a_tick_are_kept(car_fmus, isolated):
    got = isolated(car_fmus[2], "cars")
    assert got["places"][63] == got["alone"]
    assert len(set(got["places"])) == 100
    assert got["parts"] == pytest.approx(got["whole"], rel=1e-12, abs=1e-15)


def test_invalid_values_give_a_status_and_a_message(car_fmus, isolated):
    got = isolated(car_fmus[3], "car_refusals")
    assert got["mass"] == ["mass = 0 kg is outside 1 to inf kg"]
    assert got["stop"] == ["bump_stop_travel[2] = 0.01 m does not exceed bump_stop_travel[1] = 0.025 m"]
    assert got["spacing"] == ["spring_half_spacing stays as it is once the simulation has begun"]
    assert got["far"] == ["left.height is not finite at 0.001 s: inputs and parameters do not fit"]
    assert got["kept"][0] == got["kept"][1], "a refused step leaves no trace"
