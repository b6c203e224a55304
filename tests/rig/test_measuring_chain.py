"""The table of signals and the sensors of the measuring chain are one numbering, and nothing of either is left out."""

import dataclasses

import numpy as np
import pytest

from bench_protocol.signals import Kind
from bench_protocol.table import TABLE
from bench_protocol.table_signals import BY_GROUP
from bench_sim.model import wiring
from bench_sim.model.layout import Sensor
from bench_sim.model.plant import Plant
from bench_sim.parameters import load
from bench_sim.parameters.sensors import SENSOR_KINDS
from tests.refusals import refuses

LAST = TABLE["platform.roll"]


def test_every_sensor_feeds_the_signal_of_its_name() -> None:
    for signal in TABLE.of_kind(Kind.MEASUREMENT):
        assert wiring.sensor_of(signal.name).name == signal.name.replace(".", "_").upper()
    assert sorted(sensor for _, members in SENSOR_KINDS.values() for sensor in members) == list(Sensor)
    assert {name for names in BY_GROUP.values() for name in names} == {
        signal.name for signal in TABLE.of_kind(Kind.MEASUREMENT)
    }


def test_the_chain_gives_every_sensor_a_value() -> None:
    plant = Plant.at_rest(load("astb").record)
    plant._values.fill(np.nan)
    blind = [Sensor(k).name for k in np.isnan(plant.ideal()).nonzero()[0]]
    assert blind == [], "true_values in bench_sim/model/sensors.py says nothing of these"


@pytest.mark.parametrize(
    ("measurement", "sensor", "message"),
    [
        (dataclasses.replace(LAST, name="left.strain"), None, "left.strain LEFT_STRAIN"),
        (None, Sensor.PLATFORM_ROLL, "Sensor.PLATFORM_ROLL"),
        (LAST, Sensor.LEFT_HEIGHT, "0 MEASUREMENTS PLATFORM_ROLL LEFT_HEIGHT"),
    ],
)
def test_missing_sensors_and_signals_are_named(measurement: object, sensor: object, message: str) -> None:
    with refuses(ImportError, message):
        wiring._check(measurement, sensor)
