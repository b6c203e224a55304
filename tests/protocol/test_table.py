"""The table of signals: what it promises about the bus, and that it refuses what could not work."""

import dataclasses

import pytest

from bench_protocol.signals import Field, Kind, Message, Protection, Register, Signal, Table
from bench_protocol.table import TABLE
from bench_protocol.units import mm


def signal(name: str = "left.height", **changes: object) -> Signal:
    values = {
        "kind": Kind.MEASUREMENT,
        "unit": "mm",
        "low": -0.3,
        "high": 0.3,
        "step": 1e-5,
        "description": "",
    }
    return Signal(name, **(values | changes))


def test_bus_load_stays_under_half_of_500_kbit() -> None:
    worst = sum(135 * message.rate for message in TABLE.messages)
    assert worst == pytest.approx(TABLE.bus_load * 500_000)
    assert 0.3 < TABLE.bus_load <= 0.5


def test_a_table_that_overloads_the_bus_is_refused() -> None:
    greedy = tuple(
        Message(f"M{k}", 0x100 + k, 1000.0, True, (Field("left.height", 16),), Protection.COUNTER, "")
        for k in range(2)
    )
    with pytest.raises(ValueError, match=r"54\.0% of the bus; at most 50%"):
        Table((signal(),), greedy, ())


def test_every_signal_travels_by_its_kinds_door() -> None:
    on_can = {field.signal for message in TABLE.messages for field in message.fields}
    on_modbus = {register.signal for register in TABLE.registers}
    for row in TABLE.signals:
        if row.kind is Kind.SETPOINT:
            assert row.name in on_can
        else:
            assert row.name in on_modbus, row.name
        if row.kind is Kind.MEASUREMENT:
            assert row.name in on_can, row.name


def test_every_reading_has_a_float_a_scaled_twin_and_a_quality_bit() -> None:
    for row in TABLE.of_kind(Kind.MEASUREMENT, Kind.STATUS):
        places = {(r.space, r.encoding) for r in TABLE.registers if r.signal == row.name}
        assert places == {("input", "float32"), ("input", "int16"), ("discrete", "bit")}


def test_the_hash_changes_with_any_field() -> None:
    message = TABLE.messages[0]
    swapped = dataclasses.replace(message, fields=message.fields[::-1])
    other = dataclasses.replace(TABLE, messages=(swapped, *TABLE.messages[1:]))
    assert other.map_hash != TABLE.map_hash


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: signal(unit="inch"), "unit 'inch' is not one of"),
        (lambda: signal(low=0.3), "range 0.3 to 0.3 is empty"),
        (lambda: signal(step=0.0), "step = 0 must be positive"),
        (lambda: signal(kind=Kind.SETTING, default=1.0), "default 1 is outside"),
        (lambda: Table((signal(), signal()), (), ()), "signal left.height stands in the table 2 times"),
        (
            lambda: Table(
                (signal(),),
                (Message("M", 1, 1.0, True, (Field("left.height", 12),), Protection.COUNTER, ""),),
                (),
            ),
            "too much for 12 bits",
        ),
        (
            lambda: Table(
                (signal(),),
                (Message("M", 1, 1.0, True, (Field("left.height", 16),) * 4, Protection.COUNTER, ""),),
                (),
            ),
            "its fields end at bit 64, the frame has room for 56",
        ),
        (
            lambda: Table(
                (signal(),),
                (),
                (
                    Register("left.height", "input", 0, "float32"),
                    Register("left.height", "input", 1, "int16"),
                ),
            ),
            "input register 1 is taken twice",
        ),
    ],
)
def test_a_row_that_cannot_work_is_refused(make: object, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        make()


def test_a_value_that_does_not_fit_names_value_unit_and_range() -> None:
    with pytest.raises(
        ValueError, match=r"left\.height = 400 mm does not fit on the wire, which carries -300 to 300 mm"
    ):
        TABLE["left.height"].check(400 * mm)
