"""A driver whose table is not the rig's: what differs is said, what agrees is right to the bit, the rest is refused."""

import random
import re
from dataclasses import replace

import numpy as np
import pytest

from astb.rig_in_memory import RigInMemory
from bench_protocol.map_differences import compare
from bench_protocol.map_file import MAP_FILE, map_registers, read_places
from bench_protocol.messages import Field
from bench_protocol.modbus import FILE_READ_MAX
from bench_protocol.registers import free_address, registers_of
from bench_protocol.signals import Group, Kind, Signal
from bench_protocol.table import TABLE
from bench_protocol.units import NS, bar, kN, mm, s
from bench_protocol.wires import Table
from bench_protocol.words import STATES
from bench_sim.parameters import load
from bench_sim.rig.rig import Rig
from drivers.bench import Bench
from drivers.errors import MapMismatch, NotAvailable
from drivers.wiring.own import own_wiring
from test_plans.execution import execute
from test_plans.plan import plan
from test_plans.run import NullWatcher

#: What no rig of ours has.
FURTHER = {signal.name for signal in TABLE.of_kind(Kind.FURTHER)}


def table(signals=None, **messages) -> Table:
    """Our table, with other signals by name (None: without it) and other fields by the name of the message."""
    signals = signals or {}
    rows = [signals.get(row.name, row) for row in TABLE.signals]
    rows = [row for row in rows if row is not None] + [
        row for name, row in signals.items() if row and name not in TABLE.index
    ]
    names = {row.name for row in rows}
    changed = tuple(
        replace(
            message,
            fields=tuple(
                field for field in messages.get(message.name, message.fields) if field.signal in names
            ),
        )
        for message in TABLE.messages
    )
    return Table(tuple(rows), changed, registers_of(rows))


def fields(message: str) -> tuple[Field, ...]:
    return TABLE.messages[TABLE.message_index[message]].fields


def changed(name: str, **values) -> Table:
    return table({name: replace(TABLE[name], **values)})


SWAPPED = table(SpringLeft=fields("SpringLeft")[::-1])
RESCALED = changed("supply.pressure", step=2 * TABLE["supply.pressure"].step)
FREE = free_address(TABLE.signals)
MOVED_REGISTER = changed("right.height", address=FREE)
EXTRA = table(
    {
        "supply.flow": Signal(
            "supply.flow",
            Kind.MEASUREMENT,
            "1",
            0,
            100,
            0.01,
            "More",
            address=FREE,
            group=Group.SUPPLY_PRESSURE,
        )
    },
    Supply=(*fields("Supply"), Field("supply.flow", 16)),
)
OLDER = table({"supply.pressure": None, "load_cell.6": None})


class MixedVersions:
    """A rig with the table, and a driver that has another one."""

    def __init__(self, known: Table) -> None:
        self.rig = Rig(load(), seed=1)
        self.memory = RigInMemory(self.rig)
        self.wiring = own_wiring(self.memory.can(), self.memory.modbus(), table=known)
        self.heard: dict[str, float] = {}
        self.table = known

    def open(self) -> None:
        def receive(times, rows, values, fresh):
            self.heard |= {
                self.table.signals[row].name: value for row, value in zip(rows, values, strict=True)
            }

        self.wiring.open(self.memory.clock, receive, lambda reason: None, within=1 * s)
        self.memory.clock.sleep_until(self.memory.clock.now() + 1 * NS)

    def check_what_agrees(self) -> set[str]:
        """Every measurement that is not absent is what the rig has, on both wires; return their names."""
        present = {
            signal.name
            for signal in self.table.of_kind(Kind.MEASUREMENT)
            if signal.name not in self.wiring.absent
        }
        assert not set(self.wiring.absent) & set(self.heard), "moved signals are not received"
        told = self.wiring.read(sorted(present))
        for name in present:
            true = self.rig.values[TABLE.index[name]]
            step = next(
                f.step or TABLE[name].step for m in TABLE.messages for f in m.fields if f.signal == name
            )
            assert told[name] == pytest.approx(true, rel=1e-6), name
            # Sampled a while ago, and noisy: far from any other signal's value in its place.
            assert abs(self.heard[name] - true) < max(
                20 * step, 0.002 * (TABLE[name].high - TABLE[name].low)
            ), name
        return present


def test_the_rig_tells_its_map_as_a_file():
    port = RigInMemory(Rig(load())).modbus()
    assert read_places(port.read_file, FILE_READ_MAX, TABLE.map_hash) == TABLE.places


@pytest.mark.parametrize(
    ("spoil", "why"),
    [
        (lambda words: [2, *words[1:]], "format 2"),
        (lambda words: [1, 30_000, *words[2:]], "30000 bytes"),
        (lambda words: [*words[:9], words[9] ^ 1, *words[10:]], "cannot be unpacked|has the hash"),
        (lambda words: map_registers(SWAPPED), "has the hash"),
    ],
)
def test_a_file_that_is_no_map_is_refused(spoil, why):
    words = spoil(map_registers(TABLE))
    words += [0] * (10_000 - len(words))

    def read(file, record, count):
        assert file == MAP_FILE
        return words[record : record + count]

    with pytest.raises(ValueError, match=why):
        read_places(read, FILE_READ_MAX, TABLE.map_hash)


@pytest.mark.parametrize(
    ("known", "absent", "said"),
    [
        (
            SWAPPED,
            {"left.height", "left.auxiliary_pressure"},
            r"moved: .*left.height \(can 0x181 bit 32 here, can 0x181 bit 00 there\)",
        ),
        (
            RESCALED,
            {"supply.pressure"},
            r"otherwise: supply.pressure \(can 0x384 bit 00 is “.*step 100.*” here, “.*step 50 ",
        ),
        (MOVED_REGISTER, {"right.height"}, f"moved: right.height .*input {FREE:05}.* here, .*input 00106"),
        (EXTRA, {"supply.flow"}, "missing: supply.flow .ours is can 0x384 bit 16"),
        (OLDER, {"lateral.acceleration"}, "new: .*supply.pressure"),
    ],
    ids=["swapped", "rescaled", "moved register", "extra", "older"],
)
def test_differences_are_reported_and_agreement_passes(known, absent, said):
    stand = MixedVersions(known)
    stand.open()
    assert set(stand.wiring.absent) == absent | FURTHER
    assert re.search(said, stand.wiring.capabilities.notes["identity"])
    assert len(stand.check_what_agrees()) >= len(TABLE.of_kind(Kind.MEASUREMENT)) - 3
    assert stand.wiring.failure is None, "the hash on CAN is the one that was agreed upon"
    settings = [signal.name for signal in TABLE.of_kind(Kind.SETTING)]
    assert stand.wiring.read(settings) == pytest.approx(
        {name: stand.rig.registers.active[name] for name in settings}
    )
    stand.wiring.write({"air.left_target": 2 * bar})
    assert stand.rig.registers.active["air.left_target"] == pytest.approx(2 * bar)
    stand.wiring.close()


@pytest.mark.parametrize("seed", range(6))
def test_any_shuffle_of_the_measurements_is_read_right_or_not_at_all(seed):
    chance = random.Random(seed)
    own = [m for m in TABLE.messages if m.from_rig and all(TABLE[f.signal].group for f in m.fields)]
    shuffled = {m.name: tuple(chance.sample(m.fields, len(m.fields))) for m in chance.sample(own, 4)}
    steps = {
        row.name: replace(row, step=2 * row.step) for row in chance.sample(TABLE.of_kind(Kind.MEASUREMENT), 3)
    }
    stand = MixedVersions(table(steps, **shuffled))
    stand.open()
    stand.check_what_agrees()
    expected = {
        row.name
        for row in TABLE.of_kind(Kind.MEASUREMENT)
        if places_of(row.name, stand.table) != places_of(row.name, TABLE)
    }
    assert set(stand.wiring.absent) == expected | FURTHER
    stand.wiring.close()


def places_of(name: str, known: Table) -> dict[str, str]:
    return {
        place: content for place, content in known.places.items() if content.split(",")[0].split()[0] == name
    }


@pytest.mark.parametrize(
    ("known", "why"),
    [
        (changed("lateral.force_setpoint", step=5.0), "lateral.force_setpoint differs"),
        (table(PlatformSetpoints=fields("PlatformSetpoints")[::-1]), "platform.vertical_setpoint differs"),
        (table(Control=fields("Control")[:-2] + fields("Control")[-1:]), "control.(reset|token)"),
        (changed("generator.cycles", address=300), "generator.cycles differs"),
        (changed("action.air_high", address=40), "action.air_high differs"),
        (changed("interlock.estop", address=40), "interlock.estop differs"),
        (table(State=fields("State")[::-1]), "rig.state differs"),
        (changed("rig.state", choices=STATES[:-1], high=10), "states that these drivers do not know: .* ESTOP"),
        (changed("vertical.control", choices=("force", "off", "displacement")), "vertical.control differs"),
    ],
)  # fmt: skip
def test_a_bench_goes_nowhere_with_a_rig_that_would_take_its_word_otherwise(known, why):
    stand = MixedVersions(known)
    with pytest.raises(MapMismatch, match=f"These differences must not exist.*({why})") as mismatch:
        stand.open()
    assert len(str(mismatch.value)) < 2000
    assert stand.rig.lease.token == 0, "the lease was not even asked for"


def test_a_bench_on_another_map_arms_moves_and_says_what_it_lacks():
    stand = MixedVersions(SWAPPED)
    with Bench(stand.wiring, stand.memory.clock) as bench:
        bench.arm()
        bench.platform.move_to(vertical=5 * mm)
        assert bench.platform.vertical == pytest.approx(5 * mm, abs=0.5 * mm)
        with pytest.raises(
            NotAvailable, match=r"has no left\.height: the rig's map has it in another place: can 0x181"
        ):
            bench.left.height  # noqa: B018
        assert bench.left.bellows_pressure == pytest.approx(0, abs=0.1 * bar)
        assert "height: absent (the rig's map has it in another place" in repr(bench.left)


def test_a_plan_says_with_what_it_goes_on(tmp_path):
    said = []

    class Watcher(NullWatcher):
        def say(self, text):
            said.append(text)

    @plan(setup=lambda run: None, teardown=lambda run: None)
    def look(run):
        """Look: it does not press."""
        run.check("force", run.bench.vertical_left.force, "kN", low=-2 * kN, high=2 * kN)

    stand = MixedVersions(SWAPPED)
    with Bench(stand.wiring, stand.memory.clock) as bench:
        assert execute(look, bench, tmp_path, watcher=Watcher()).verdict == "pass"
    assert any("the rig uses another table of signals" in text and "left.height" in text for text in said)


def test_a_rig_without_a_map_file_is_refused_as_ever(world):
    world.peer.map_hash ^= 1
    with pytest.raises(MapMismatch, match=r"the differences are unknown: .*does not know the function"):
        world.bench.connect()


def test_more_choices_of_a_reading_are_no_harm():
    fewer = changed("rig.program", choices=TABLE["rig.program"].choices[:-1], high=2)
    found = compare(fewer, TABLE.places)
    assert not found.refused
    assert not found.absent
    assert found.new == ("choices of rig.program",)


def test_many_differences_are_counted_not_listed():
    found = compare(
        TABLE,
        {
            place: text
            for place, text in TABLE.places.items()
            if "load_cell" not in text and "left." not in text
        },
    )
    assert "and" in str(found)
    assert len(str(found)) < 700
    assert np.sum([name.startswith("load_cell") for name in found.missing]) == 6
