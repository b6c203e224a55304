"""Half a car as an FMU: it stands on springs of another FMU, on a track and in wind."""

from collections.abc import Iterator
from math import inf
from typing import Any, Final

import numpy as np

from astb.fmu.kernels.car import (
    CAR,
    INPUTS,
    MOTIONS,
    NOTHING,
    OUTPUTS,
    ROWS,
    CarOutput,
    Force,
    advance,
    start,
)
from astb.fmu.models.springs import MOTIONS as STRETCH
from astb.fmu.models.springs import OF_SPRINGS
from astb.fmu.unit import Code, Kind, Unit, Variable, offset, parameters_of
from bench_protocol.car import STOP_POINTS
from bench_protocol.table import TABLE
from bench_protocol.words import SIDES
from bench_sim.model.car import CAR_QUANTITIES
from bench_sim.model.quantities import PLANT_QUANTITIES
from bench_sim.parameters import Parameters
from bench_sim.parameters.vehicle import VehicleParameters

CODE: Final = Code(
    "car",
    start,
    advance,
    NOTHING,
    CAR,
    states=1,
    inputs=INPUTS,
    motions=MOTIONS,
    outputs=OUTPUTS,
    rows=ROWS,
    remembered=NOTHING.itemsize,
    checks="car.c",
)
#: The parameters of the springs that the car uses.
_OF_BENCH: Final = ("gravity", "spring_half_spacing")
_OWN: Final = tuple(one for one in CAR_QUANTITIES if one.name in (CAR.names or ()))
_SHARED: Final = tuple(one for one in PLANT_QUANTITIES if one.name in _OF_BENCH)
_TRACK: Final = (("lateral", "m", "to the left"), ("vertical", "m", "up"), ("roll", "rad", "left side up"))
_RATES: Final = (
    ("", "", "Track under the bogie"),
    ("_speed", "/s", "Its speed"),
    ("_acceleration", "/s2", "Its acceleration"),
)
_READ: Final = ("shear", "height", "roll", "acceleration", "rising", "bump_stop")
_PLACE: Final = (
    ("car.lateral", "m", "Centre of gravity, to the left"),
    ("car.vertical", "m", "Centre of gravity, up"),
    ("car.lean", "rad", "Roll of the car, left side up"),
)


def car(parameters: Parameters, vehicle: VehicleParameters) -> Unit:
    """Return the FMU of half the ``vehicle``.

    Its weight is the nominal preload of both springs with these ``parameters``.
    """
    record = np.zeros(1, CAR)
    for one in _OWN:
        record[one.name][0] = vehicle.record[one.name]
    for one in _SHARED:
        record[one.name][0] = parameters.record[one.name]
    record["mass"][0] = np.sum(parameters.record.nominal_preload) / parameters.record.gravity
    return Unit(
        CODE,
        f"{vehicle.name} {parameters.load_case}",
        f"Half of {vehicle.name} on one bogie, as heavy as {parameters.name} carries under {parameters.load_case}",
        (
            "Half a car with lateral damper, bump stop and anti-roll bar. Its inputs are the forces of its two "
            "springs, the motion of the track and the wind. Its outputs are the positions of the springs, and "
            "have the names of the inputs of the springs' FMU. Units are SI, lateral positions to the left.",
            "The simulation begins at rest on the track. Within a communication step, the track is extrapolated with "
            "the given speeds and accelerations; forces are held.",
        ),
        (*_inputs(parameters), *_outputs(), *_parameters(parameters, vehicle, record[0])),
        record.view(np.float64).copy(),
        {"BUMP_STOP_TRAVEL": offset(CAR, "bump_stop_travel") // 8, "STOP_POINTS": STOP_POINTS},
    )


def _inputs(parameters: Parameters) -> Iterator[Variable]:
    for rate, (behind, per, text) in enumerate(_RATES):
        for way, (name, unit, direction) in enumerate(_TRACK):
            place = 3 * rate + way
            yield Variable(
                f"track.{name}{behind}", unit + per, Kind.MOTION, place, f"{text}, {direction}", 0.0
            )
    carried = np.asarray(parameters.record.nominal_preload)
    for (name, unit, _, text), first in zip(
        OF_SPRINGS, (Force.VERTICAL, Force.LATERAL, Force.MOMENT), strict=True
    ):
        for side, word in enumerate(SIDES):
            begins = float(carried[side]) if first == Force.VERTICAL else 0.0
            yield Variable(f"{word}.{name}", unit, Kind.INPUT, first + side, text, begins)
    yield Variable(
        "car.wind", "N", Kind.INPUT, Force.WIND, "Force of the wind on this half of the car, to the left", 0.0
    )


def _outputs() -> Iterator[Variable]:
    for place, (name, unit, text) in enumerate(STRETCH):
        yield Variable(name, unit, Kind.OUTPUT, CarOutput.HEIGHT + place, text.split(",")[0])
    for place, name in enumerate(_READ):
        signal = TABLE[f"car.{name}"]
        yield Variable(signal.name, signal.si, Kind.OUTPUT, CarOutput.SHEAR + place, signal.description)
    for place, (name, unit, text) in enumerate(_PLACE):
        yield Variable(name, unit, Kind.OUTPUT, CarOutput.PLACE + place, text)


def _parameters(parameters: Parameters, vehicle: VehicleParameters, record: Any) -> Iterator[Variable]:
    place = offset(CAR, "mass") // 8
    text = "mass of this half; what the springs carry at their nominal preload"
    yield Variable("mass", "kg", Kind.TUNABLE, place, text, float(record["mass"]), 1.0, inf)
    yield from parameters_of(_OWN, vehicle.entries, record, CAR, ())
    yield from parameters_of(_SHARED, parameters.entries, record, CAR, _OF_BENCH)
