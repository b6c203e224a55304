"""A reading has an age and a quality; every row of the table has exactly one reader or writer."""

import math
from collections import Counter

import pytest

from bench_protocol.signals import Kind
from bench_protocol.table import TABLE
from bench_protocol.units import NS, bar, mm
from drivers.declarations import Action, Bit, Contact, Declaration, Reading, Setpoint, Setting
from drivers.devices import Spring
from drivers.reading import Quality
from drivers.settings import UNKNOWN
from tests.refusals import refuses


def test_every_row_of_the_table_stands_in_exactly_one_device(world):
    declared = Counter(name for device in world.bench.devices for name in device.signals())
    assert declared == Counter(signal.name for signal in TABLE.signals)


def test_every_declaration_is_of_the_kind_that_the_table_says(world):
    allowed = {
        Kind.MEASUREMENT: "Reading",
        Kind.FURTHER: "Reading",
        Kind.STATUS: "Reading ChoiceReading",
        Kind.SETPOINT: "Setpoint Bit",
        Kind.SETTING: "Setting ChoiceSetting ControlMode",
        Kind.ACTION: "Action",
        Kind.INTERLOCK: "Contact",
    }
    for device in world.bench.devices:
        for declaration in device.declarations():
            signal = TABLE[declaration.full_name(device)]
            assert type(declaration).__name__ in allowed[signal.kind].split(), signal.name
            wants_names = type(declaration).__name__ in ("ChoiceReading", "ChoiceSetting", "ControlMode")
            if signal.kind in (Kind.STATUS, Kind.SETTING):
                assert wants_names == bool(signal.choices), signal.name


def test_a_declaration_of_the_wrong_kind_is_refused_when_the_device_is_made(world):
    class Wrong(Spring):
        __slots__ = ()
        height = Setting()

    with refuses(TypeError, "left.height"):
        Wrong(world.bench, "left")


def test_every_reading_is_the_last_one_from_the_rig(world, bench):
    for k, signal in enumerate(TABLE.of_kind(Kind.MEASUREMENT)):
        world.peer.values[signal.name] = signal.low + (signal.high - signal.low) * (k + 1) / 64
    bench.wait(0.2)
    for signal in TABLE.of_kind(Kind.MEASUREMENT):
        place = next(p for m in TABLE.messages for p in m.fields if p.signal == signal.name)
        device, attribute = signal.attribute
        part = getattr(bench, device)
        value = part[int(attribute)] if device == "load_cell" else getattr(part, attribute)
        assert value == pytest.approx(world.peer.values[signal.name], abs=0.501 * (place.step or signal.step))


def test_no_value_before_the_first_frame(world):
    bench = world.bench
    for signal in TABLE.of_kind(Kind.MEASUREMENT):
        sample = bench.sample(signal.name)
        assert math.isnan(sample.value)
        assert sample.quality is Quality.MISSING
        assert sample.age == math.inf
    assert bench.rig.state == UNKNOWN
    assert not bench.left.height > -1
    assert not bench.left.height < 1


@pytest.mark.parametrize(
    ("name", "limit"),
    [
        ("left.height", 0.1),
        ("platform.roll", 0.1),
        ("supply.pressure", 0.3),
        ("left.bellows_temperature", 0.3),
    ],
)
def test_a_reading_is_stale_after_100_ms_or_three_periods(world, bench, name, limit):
    world.peer.values[name] = 1 * mm if name != "left.bellows_temperature" else 290.0
    period = max(1 / next(m.rate for m in TABLE.messages if name in [p.signal for p in m.fields]), 0.005)
    bench.wait(1 - bench.now % 1 + 0.2)  # all messages are sent at whole multiples of 100 ms
    world.peer.silent_can = True
    assert bench.sample(name).quality is Quality.GOOD
    world.pass_time(limit)
    assert bench.sample(name).quality is Quality.GOOD  # exactly at the limit
    world.clock.sleep_until(world.clock.now() + 1)
    sample = bench.sample(name)
    assert sample.quality is Quality.STALE
    assert math.isnan(sample.value)
    assert sample.age * NS == pytest.approx(limit * NS + 1)
    world.peer.silent_can = False
    world.pass_time(period)
    assert bench.sample(name).quality is Quality.GOOD


def test_what_the_rig_has_no_value_for_is_unavailable_not_stale(world, bench):
    world.peer.values["left.height"] = math.nan
    bench.wait(0.1)
    sample = bench.sample("left.height")
    assert sample.quality is Quality.UNAVAILABLE
    assert math.isnan(sample.value)
    assert sample.age < 0.02


def test_readings_that_can_does_not_carry_come_through_modbus(world, bench):
    world.peer.values["rig.lateness_50us"] = 1234.0
    asked = len(world.peer.requests)
    assert bench.rig.lateness_50us == 1234
    assert len(world.peer.requests) > asked
    assert bench.rig.lease == 0 or bench.sample("rig.lease").quality is Quality.GOOD


def test_event_messages_do_not_grow_stale(world):
    assert world.bench.sample("emergency.code").quality is Quality.MISSING


def test_a_typing_error_is_an_error(bench):
    with refuses(AttributeError, "'hieght' 'height'"):
        bench.left.hieght = 3
    with pytest.raises(AttributeError):
        bench.left.hieght  # noqa: B018
    with pytest.raises(AttributeError):
        bench.lefft = 3
    with refuses(AttributeError, "left.height"):
        bench.left.height = 3 * mm
    with pytest.raises(AttributeError):
        bench.left.signals = 3


def test_set_points_settings_and_actions_are_attributes(world, bench):
    bench.lateral.force_setpoint = 300.0
    bench.air.left_target = 3 * bar
    bench.air.left_mode = "level"
    bench.action.program_stop()
    bench.wait_cycles(2)
    assert world.peer.commands["lateral.force_setpoint"] == 300
    assert bench.lateral.force_setpoint == 300
    assert bench.air.left_target == pytest.approx(3 * bar)
    assert bench.air.left_mode == "level"
    assert world.peer.settings["air.left_mode"] == 1
    assert world.peer.actions[-1] == "action.program_stop"


@pytest.mark.parametrize("cell", [0, 9, -1])
def test_there_are_eight_load_cells_at_most(bench, cell):
    with refuses(Exception, "cells 1 8"):
        bench.load_cell[cell]


def test_declarations_know_what_they_are_for():
    assert all(issubclass(kind, Declaration) for kind in (Reading, Setpoint, Bit, Setting, Action, Contact))
