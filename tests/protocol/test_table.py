"""The table of signals: what it promises about the bus, and that it refuses what could not work."""

import dataclasses

import pytest

from bench_protocol.messages import Field, Message, Protection
from bench_protocol.registers import (
    BLOCKS,
    READINGS,
    SEQUENCE,
    Register,
    free_address,
    reading_number,
    registers_of,
)
from bench_protocol.signals import Group, Kind, Signal
from bench_protocol.table import TABLE
from bench_protocol.units import mm
from bench_protocol.wires import Table, moved
from tests.refusals import refuses
from tools.generate import files as generate
from tools.generate.files import kept_places


def signal(name: str = "left.height", **changes: object) -> Signal:
    values = {
        "kind": Kind.MEASUREMENT,
        "unit": "mm",
        "low": -0.3,
        "high": 0.3,
        "step": 1e-5,
        "description": "",
        "group": Group.HEIGHT,
    }
    return Signal(name, **(values | changes))


def message(field: str = "left.height", **changes: object) -> Message:
    values = {
        "name": "M",
        "identifier": 1,
        "rate": 1.0,
        "from_rig": True,
        "fields": (Field(field, 16),),
        "protection": Protection.COUNTER,
        "description": "",
    }
    return Message(**(values | changes))


def test_bus_load_stays_under_half_of_500_kbit() -> None:
    worst = sum(135 * message.rate for message in TABLE.messages) + 135 * (10 + 100)  # heartbeats and SYNC
    assert worst == pytest.approx(TABLE.bus_load * 500_000)
    assert 0.3 < TABLE.bus_load <= 0.5


def test_a_table_that_overloads_the_bus_is_refused() -> None:
    greedy = tuple(
        Message(f"M{k}", 0x100 + k, 1000.0, True, (Field("left.height", 16),), Protection.COUNTER, "")
        for k in range(2)
    )
    with refuses(ValueError, "57.0% 50%"):
        Table((signal(),), greedy, ())


def test_every_signal_travels_by_its_kinds_door() -> None:
    on_can = {field.signal for message in TABLE.messages for field in message.fields}
    on_modbus = {register.signal for register in TABLE.registers}
    for row in TABLE.signals:
        if row.kind is Kind.SETPOINT:
            assert row.name in on_can
        elif row.kind is Kind.FURTHER:
            assert row.name not in on_can | on_modbus
        else:
            assert row.name in on_modbus, row.name
        if row.kind is Kind.MEASUREMENT:
            assert row.name in on_can, row.name


def test_every_reading_has_a_float_a_scaled_twin_and_a_quality_bit() -> None:
    for row in TABLE.of_kind(Kind.MEASUREMENT, Kind.STATUS):
        places = {(r.space, r.encoding) for r in TABLE.registers if r.signal == row.name}
        assert places == {("input", "float32"), ("input", "int16"), ("discrete", "bit")}


def changed(name: str, **changes: object) -> Table:
    """The table with one signal changed, and its registers with it."""
    signals = tuple(dataclasses.replace(s, **changes) if s.name == name else s for s in TABLE.signals)
    return Table(signals, TABLE.messages, registers_of(signals))


def with_message(**changes: object) -> Table:
    """The table with its first message changed."""
    return dataclasses.replace(
        TABLE, messages=(dataclasses.replace(TABLE.messages[0], **changes), *TABLE.messages[1:])
    )


FIRST = TABLE.messages[0]
#: The address that a new reading takes.
FREE = free_address(TABLE.signals)


@pytest.mark.parametrize(
    "other",
    [
        with_message(fields=FIRST.fields[::-1]),
        with_message(fields=(dataclasses.replace(FIRST.fields[0], step=1e-4), *FIRST.fields[1:])),
        with_message(fields=(dataclasses.replace(FIRST.fields[0], nullable=False), *FIRST.fields[1:])),
        with_message(identifier=0x18F),
        with_message(rate=100.0),
        with_message(protection=Protection.NONE),
        changed("left.height", step=2e-5),
        changed("left.height", address=FREE),
        changed("rig.program", choices=("RUN", "IDLE", "HOLD", "STOPPED")),
        changed("air.dpv", address=260),
    ],
    ids=lambda table: f"{table.map_hash:08x}",
)
def test_the_hash_changes_with_what_is_on_the_wire(other: Table) -> None:
    assert other.map_hash != TABLE.map_hash
    assert moved(TABLE.places, other)


def test_the_hash_covers_only_the_wire() -> None:
    """Neither words nor what only people see move it, nor the order of the rows."""
    words = [changed(s.name, description=f"{s.description}.") for s in TABLE.signals]
    words += [with_message(description=""), changed("left.height", unit="m", low=-0.2, high=0.2)]
    words.append(Table(TABLE.signals[::-1], TABLE.messages[::-1], TABLE.registers[::-1]))
    assert {table.map_hash for table in words} == {TABLE.map_hash}


def test_identifiers_and_addresses_are_unchanged() -> None:
    """Programs of others rely on identifiers and addresses. `make generate` keeps the new ones."""
    kept = kept_places()
    assert len(kept) > 350
    assert moved(kept, TABLE) == [], "restore the old entries, and give new ones a free place"
    assert TABLE.places == kept, "run `make generate`: it stores the new entries"


def test_adding_is_no_move_and_removing_is() -> None:
    """One reading after the other, until no block has room; each block is one request and has no hole."""
    table, added = TABLE, 0
    while True:
        try:
            address = free_address(table.signals)
        except ValueError as full:
            assert "are full" in str(full)
            break
        new = dataclasses.replace(TABLE["left.height"], name=f"left.strain_{added}", address=address)
        grown = Table((*table.signals, new), TABLE.messages, registers_of((*table.signals, new)))
        assert moved(table.places, grown) == []
        number = grown.trip_number(new.name)
        assert (grown.tripped(number), number) == (new, reading_number(new) + 1)
        assert f"input {address:05} was “{new.name} float32” and is now empty" in moved(grown.places, table)
        table, added = grown, added + 1
    assert added > 25
    assert max(table.trip_number(row.name) for row in table.of_kind(*READINGS)) <= TABLE["rig.tripped"].high
    inputs = {
        a: r.signal
        for r in table.registers
        if r.space == "input"
        for a in range(r.address, r.address + r.words)
    }
    sequences = [address for address, name in inputs.items() if name == SEQUENCE]
    for block in BLOCKS:
        first, end = block.span(sequences)
        assert end - first + 1 <= 125
        assert all(address in inputs for address in range(first, end + 1))


def test_a_signal_at_the_end_of_a_block_is_reported_as_a_move() -> None:
    taken = dataclasses.replace(TABLE["left.height"], name="left.strain", address=216)
    shifted = Table((*TABLE.signals, taken), TABLE.messages, registers_of((*TABLE.signals, taken)))
    wanted = "input 00216 was “modbus.sequence uint16” and is now “left.strain float32”"
    assert wanted in moved(TABLE.places, shifted)


def test_generating_refuses_to_move(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture) -> None:
    monkeypatch.setattr(generate, "TABLE", changed("left.height", address=FREE))
    assert generate.main(["--check"]) == generate.main([]) == 1
    printed = capsys.readouterr()
    assert "input 00100 was “left.height float32”" in printed.err and not printed.out


def test_rig_tripped_returns_a_reading_or_none() -> None:
    for row in TABLE.of_kind(Kind.MEASUREMENT, Kind.STATUS):
        assert TABLE.tripped(float(TABLE.trip_number(row.name))) is row
    assert [TABLE.tripped(value) for value in (0.0, float("nan"), 255.0)] == [None] * 3


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: signal(unit="inch"), "'inch'"),
        (lambda: signal(low=0.3), "range 0.3 0.3"),
        (lambda: signal(step=0.0), "step 0"),
        (lambda: signal(kind=Kind.SETTING, group=None, default=1.0), "default 1"),
        (lambda: Table((signal(), signal()), (), ()), "left.height 2"),
        (
            lambda: Table(
                (signal(),),
                (Message("M", 1, 1.0, True, (Field("left.height", 12),), Protection.COUNTER, ""),),
                (),
            ),
            "does not fit 12",
        ),
        (
            lambda: Table(
                (signal(),),
                (Message("M", 1, 1.0, True, (Field("left.height", 16),) * 4, Protection.COUNTER, ""),),
                (),
            ),
            "fields 64 56",
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
            "1 left.height left.height",
        ),
        (lambda: signal("left height"), "'left height' device.reading"),
        (lambda: signal("Left.height"), "device.reading"),
        (lambda: signal("height"), "device.reading"),
        (lambda: signal(high=float("inf")), "-0.3 inf"),
        (lambda: signal(group=None), "measurement"),
        (lambda: signal(low=0, high=1, step=0.5, choices=("a", "b")), "low = 0 step = 1"),
        (lambda: signal(low=0, high=1, step=1, choices=("a", "a")), "choices"),
        (lambda: message(identifier=0x18FF0000), "identifier 0x18ff0000 11"),
        (lambda: message(identifier=-1), "than 11"),
        (lambda: message(name="Spring Left"), "'Spring Left' 32"),
        (lambda: message(rate=-1.0), "rate -1 Hz"),
        (lambda: message(data_id=0x10000), "data 0x10000 16"),
        (lambda: Field("left.height", 0), "field 0 1 53"),
        (lambda: Field("left.height", 64), "field 64 1 53"),
        (lambda: Table((signal(),), (message(field="left.width"),), ()), "M left.width"),
        (lambda: Register("left.height", "inputs", 0, "float32"), "'inputs'"),
        (lambda: Register("left.height", "input", 0, "float64"), "'float64' float32"),
        (lambda: Register("left.height", "coil", 0, "float32"), "float32"),
        (lambda: Register("left.height", "input", 0, "bit"), "bit space input"),
        (lambda: Register("left.height", "input", 65_535, "float32"), "address 65535 0 65534"),
        (lambda: Table((signal(),), (), (Register("left.width", "input", 0, "float32"),)), "left.width"),
        (lambda: registers_of((signal(),)), "left.height"),
        (lambda: registers_of((signal(address=101),)), "left.height 101"),
        (lambda: registers_of((signal(address=222),)), "from 100 220 1100 1220"),
        (
            lambda: registers_of((signal(address=100), signal("right.height", address=100))),
            "left.height right.height 100",
        ),
        (lambda: registers_of((signal(kind=Kind.SETTING, group=None),)), "left.height"),
    ],
)
def test_a_row_that_cannot_work_is_refused(make: object, message: str) -> None:
    with refuses(ValueError, message):
        make()


def test_a_value_that_does_not_fit_names_value_unit_and_range() -> None:
    with refuses(ValueError, "left.height 400 mm -300 300 mm"):
        TABLE["left.height"].check(400 * mm)
