"""The faults of sensors, by name: wrong readings on both buses, which the limits of the rig also use."""

import math
from collections.abc import Callable
from typing import Final

from bench_protocol.table import TABLE
from bench_protocol.table_signals import MEASUREMENTS
from bench_sim.model.wiring import sensor_of
from bench_sim.rig.faults.fault import (
    OF_SENSOR,
    OF_SENSOR_PER_SECOND,
    Begin,
    Fault,
    FaultChoice,
    FaultNumber,
    FaultPlace,
    Values,
)
from bench_sim.rig.faults.in_tick import DisturbanceKind, chance_of
from bench_sim.rig.faults.insertion import InsertionPoints
from bench_sim.rig.faults.schedule import Undo

_NAMES: Final = tuple(signal.name for signal in MEASUREMENTS)
_SENSOR: Final = FaultChoice("sensor", _NAMES, "affected sensor")
_SEED: Final = FaultNumber("seed", "1", 0, 1_000_000, "random seed", 0, whole=True)
_WIDE: Final = math.inf  # of a sensor: its own range bounds it
LOW, HIGH, NOTHING = "low", "high", "nothing"


def _of_sensor(name: str, unit: str, text: str) -> FaultNumber:
    return FaultNumber(name, unit, -_WIDE, _WIDE, text)


def _disturbed(kind: DisturbanceKind, chance: Callable[[Values], float] = lambda _: 0.0) -> Begin:
    def begin(points: InsertionPoints, v: Values) -> Undo:
        sensor, seed = sensor_of(v["sensor"]), int(v.get("seed", 0))
        return points.tick.disturb(sensor, kind, v.get("value", math.nan), chance=chance(v), seed=seed)

    return begin


def _broken_wire(points: InsertionPoints, v: Values) -> Undo:
    sensor = sensor_of(v["sensor"])
    reads = {LOW: points.sensor_low[sensor], HIGH: points.sensor_high[sensor], NOTHING: math.nan}
    return points.tick.disturb(sensor, DisturbanceKind.LOST, float(reads[v["reads"]]))


def _swapped(points: InsertionPoints, v: Values) -> Undo:
    sensor, other = v["sensor"], v["other"]
    if sensor == other or TABLE[sensor].si != TABLE[other].si:
        raise RuntimeError(
            f"{sensor} and {other} cannot be swapped; choose two different sensors with the same unit"
        )
    return points.tick.disturb(sensor_of(sensor), DisturbanceKind.SWAPPED, float(sensor_of(other)))


FAULTS: Final = (
    Fault(
        "stuck",
        FaultPlace.SENSORS,
        "A sensor is frozen at its reading when the fault begins.",
        "Each sample has the same value, without noise and with good quality. Only the counter changes.",
        _disturbed(DisturbanceKind.STUCK),
        (_SENSOR,),
        "sensor",
    ),
    Fault(
        "bias",
        FaultPlace.SENSORS,
        "A sensor has a constant error.",
        "The reading jumps by this value, and stays within the range of the transducer.",
        _disturbed(DisturbanceKind.BIAS),
        (_SENSOR, _of_sensor("value", OF_SENSOR, "size of the error")),
        "sensor",
    ),
    Fault(
        "drift",
        FaultPlace.SENSORS,
        "The error of a sensor grows.",
        "The error grows at this rate from zero, up to the end of the range of the transducer.",
        _disturbed(DisturbanceKind.DRIFT),
        (_SENSOR, _of_sensor("value", OF_SENSOR_PER_SECOND, "rate of the error")),
        "sensor",
    ),
    Fault(
        "spike",
        FaultPlace.SENSORS,
        "A loose contact: single samples are wrong, at random.",
        "Single samples are far from their neighbours. A limit with a persistence of 20 ms does not trip.",
        _disturbed(DisturbanceKind.SPIKE, lambda v: chance_of(v["rate"])),
        (
            _SENSOR,
            _of_sensor("value", OF_SENSOR, "error of a sample"),
            FaultNumber("rate", "Hz", 0.001, 200, "average rate of the spikes", 1),
            _SEED,
        ),
        "sensor",
    ),
    Fault(
        "noise",
        FaultPlace.SENSORS,
        "A sensor has additional, normally distributed noise.",
        "The readings scatter with this standard deviation.",
        _disturbed(DisturbanceKind.NOISE),
        (_SENSOR, _of_sensor("value", OF_SENSOR, "standard deviation"), _SEED),
        "sensor",
    ),
    Fault(
        "broken_wire",
        FaultPlace.SENSORS,
        "The wire of a sensor is broken: its amplifier reads the end of the range, or reports no value.",
        "The reading is at the end of its range, perhaps beyond a limit; or it is NaN, with the quality bit of "
        "Modbus cleared. Without a pressure reading the actuators stay blocked.",
        _broken_wire,
        (_SENSOR, FaultChoice("reads", (LOW, HIGH, NOTHING), "output of the amplifier", LOW)),
        "sensor",
    ),
    Fault(
        "swapped",
        FaultPlace.SENSORS,
        "Two sensors are exchanged: each has the reading of the other.",
        "Two readings are exchanged on CAN and Modbus, and for the limits and valves of the rig.",
        _swapped,
        (_SENSOR, FaultChoice("other", _NAMES, "sensor with the exchanged reading")),
        "sensor",
    ),
    Fault(
        "turned",
        FaultPlace.SENSORS,
        "A sensor has the wrong sign.",
        "The reading has the opposite sign, within the range of the transducer.",
        _disturbed(DisturbanceKind.TURNED),
        (_SENSOR,),
        "sensor",
    ),
)
