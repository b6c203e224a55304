"""The faults of sensors, by name: wrong readings of the rig, on both buses and for its own limits."""

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
_SENSOR: Final = FaultChoice("sensor", _NAMES, "whose reading")
_SEED: Final = FaultNumber("seed", "1", 0, 1_000_000, "draws the samples", 0, whole=True)
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
        "A sensor is frozen at what it reads when the fault begins.",
        "The same value in every sample, without noise, and of good quality: only its counter lives.",
        _disturbed(DisturbanceKind.STUCK),
        (_SENSOR,),
        "sensor",
    ),
    Fault(
        "bias",
        FaultPlace.SENSORS,
        "A sensor is off by a constant.",
        "The reading jumps by that much when it begins, and stays within the range of the transducer.",
        _disturbed(DisturbanceKind.BIAS),
        (_SENSOR, _of_sensor("value", OF_SENSOR, "how far it is off")),
        "sensor",
    ),
    Fault(
        "drift",
        FaultPlace.SENSORS,
        "A sensor drifts away from the truth.",
        "The reading leaves the truth at that rate, from where it was, up to the end of the transducer's range.",
        _disturbed(DisturbanceKind.DRIFT),
        (_SENSOR, _of_sensor("value", OF_SENSOR_PER_SECOND, "how fast")),
        "sensor",
    ),
    Fault(
        "spike",
        FaultPlace.SENSORS,
        "A loose contact: single samples are off, at random.",
        "Single samples far from their neighbours; a limit that asks for 20 ms does not trip.",
        _disturbed(DisturbanceKind.SPIKE, lambda v: chance_of(v["rate"])),
        (
            _SENSOR,
            _of_sensor("value", OF_SENSOR, "how far a sample is off"),
            FaultNumber("rate", "Hz", 0.001, 200, "how many there are on average", 1),
            _SEED,
        ),
        "sensor",
    ),
    Fault(
        "noise",
        FaultPlace.SENSORS,
        "A sensor has more noise, normally distributed.",
        "The readings scatter with that standard deviation about what they were.",
        _disturbed(DisturbanceKind.NOISE),
        (_SENSOR, _of_sensor("value", OF_SENSOR, "standard deviation"), _SEED),
        "sensor",
    ),
    Fault(
        "broken_wire",
        FaultPlace.SENSORS,
        "The wire of a sensor is broken: its amplifier reads the end of the range, or says that there is nothing.",
        "The reading sits at its rail, beyond limits perhaps; or it is NaN, with the quality bit of Modbus cleared. "
        "Without a pressure reading the actuators stay blocked.",
        _broken_wire,
        (_SENSOR, FaultChoice("reads", (LOW, HIGH, NOTHING), "what the amplifier makes of it", LOW)),
        "sensor",
    ),
    Fault(
        "swapped",
        FaultPlace.SENSORS,
        "Two sensors are wired crosswise: each reads what the other one should.",
        "Two readings have changed places, on both wires and for the rig's own limits and valves.",
        _swapped,
        (_SENSOR, FaultChoice("other", _NAMES, "whose reading it has instead, and gives its own to")),
        "sensor",
    ),
    Fault(
        "turned",
        FaultPlace.SENSORS,
        "A sensor is wired the wrong way round.",
        "The reading has the other sign, as far as the transducer reads that way.",
        _disturbed(DisturbanceKind.TURNED),
        (_SENSOR,),
        "sensor",
    ),
)
