"""Readings in more than one Modbus block: as few requests as needed, and all of one step."""

import dataclasses
import math

import numpy as np
import pytest

from bench_protocol.modbus import ModbusError
from bench_protocol.registers import BLOCKS, READINGS, free_address, registers_of, twin_address
from bench_protocol.table import TABLE
from bench_protocol.wires import Table
from bench_sim.rig.registers import RegisterBank
from drivers.errors import LinkLost
from drivers.wiring.astb.modbus import AstbRegisters
from tests.refusals import refuses


def grown(table: Table, count: int) -> Table:
    """``table`` with ``count`` readings more, one after the other."""
    signals = table.signals
    for number in range(count):
        new = dataclasses.replace(
            table["left.height"], name=f"left.strain_{number}", address=free_address(signals)
        )
        signals = (*signals, new)
    return Table(signals, table.messages, registers_of(signals))


class Rig:
    """What the registers ask of a rig, and the port of a driver to it; ``pace`` steps a request pass meanwhile."""

    def __init__(self, table: Table, pace: int = 0) -> None:
        chance = np.random.default_rng(1)
        self.base = chance.integers(0, 2**8, len(table.signals)).astype(float)
        self.step, self.pace, self.asked = 0, pace, []
        self.bank = RegisterBank(table, self, None)  # no writer
        self.read_file = self.bank.read_file

    @property
    def seen(self):
        return self.base + self.step

    @property
    def sequence(self):
        return self.step & 0xFFFF

    def read_input(self, address: int, count: int):
        self.asked.append((address, count))
        words = self.bank.read_input(address, count)
        self.step += self.pace > 0 and len(self.asked) % self.pace == 0
        return words


LARGE = grown(TABLE, 20)
NEW = [row.name for row in LARGE.signals if row.name not in TABLE.index]
LAST = NEW[-1]  # in the second block
FIRST = [row.name for row in TABLE.of_kind(*READINGS) if row.address < BLOCKS[1].floats]
OLD = [row.name for row in TABLE.of_kind(*READINGS)]


def test_all_readings_come_by_a_request_a_block_and_a_few_by_those_they_need():
    rig = Rig(LARGE)
    registers = AstbRegisters(LARGE, rig)
    told = registers.snapshot()
    assert told == {name: rig.seen[LARGE.index[name]] for name in (*OLD, *NEW)}
    assert len(rig.asked) == 2
    assert all(count <= 125 for _, count in rig.asked)
    for names, requests in ((FIRST, 1), (OLD, 2), (NEW[-2:], 1), ([OLD[0], LAST], 2), ([LAST], 1)):
        rig.asked.clear()
        assert registers.read(names) == {name: told[name] for name in names}
        assert len(rig.asked) == requests, names


def test_a_step_between_the_blocks_is_not_read_across():
    """A new step comes behind every third request, first between the two blocks: that is read again."""
    rig = Rig(LARGE, pace=3)
    rig.asked += [(0, 0)] * 2
    told = AstbRegisters(LARGE, rig).snapshot()
    assert len({told[name] - rig.base[LARGE.index[name]] for name in told}) == 1
    assert len(rig.asked) == 2 + 4
    with refuses(LinkLost, "register 99 1099 20"):
        AstbRegisters(LARGE, Rig(LARGE, pace=1)).snapshot()


@pytest.mark.parametrize(("known", "there"), [(TABLE, LARGE), (LARGE, TABLE), (grown(TABLE, 5), LARGE)])
def test_a_driver_reads_what_it_knows_of_a_rig_with_other_blocks(known, there):
    rig = Rig(there)
    registers = AstbRegisters(known, rig)
    found = registers.differences(there.map_hash)
    both = {row.name for row in known.of_kind(*READINGS) if row.name in there.index}
    assert {row.name for row in known.of_kind(*READINGS)} - both == set(found.absent)
    assert registers.snapshot() == {name: rig.seen[there.index[name]] for name in both}
    asked = [row.name for row in known.of_kind(*READINGS)]
    for name, value in registers.read(asked).items():
        assert math.isnan(value) if name in found.absent else value == rig.seen[there.index[name]]


def test_the_second_block_has_twins_and_quality_bits_too():
    rig = Rig(LARGE)
    rig.base[LARGE.index[LAST]] = math.nan
    rig.base[LARGE.index[NEW[-2]]] = 0.1
    assert rig.bank.read_input(twin_address(LARGE[NEW[-2]]), 1) == [10_000]
    assert rig.bank.read_input(twin_address(LARGE[LAST]), 1) == [0x8000]
    first = 99 + LARGE.trip_number(NEW[-2])
    assert rig.bank.read_discrete(first, 1) == [True]
    assert rig.bank.read_discrete(99 + LARGE.trip_number(LAST), 1) == [False]
    with pytest.raises(ModbusError):
        rig.bank.read_input(LARGE[LAST].address + 3, 1)
