"""Tests of Modbus answers: latency, agreement of CAN and Modbus, and exceptions for refused requests."""

import math
import struct
from typing import Final

import numpy as np

from astb.acceptance.conformance.raw_access import ModbusConnection, RawAccess
from astb.acceptance.conformance.report import Notebook
from bench_protocol.modbus import ILLEGAL_ADDRESS, ILLEGAL_FUNCTION, ILLEGAL_VALUE, NO_SUCH_UNIT
from bench_protocol.registers import FLOAT_BLOCK, PROBE_FLOAT, PROBE_WORD
from bench_protocol.signals import Kind
from bench_protocol.table import TABLE
from bench_protocol.units import ms

READS: Final = 200
#: Longest latency of an answer: the commander feeds its watchdog every 300 ms, and one reading must not cost a cycle.
ANSWER_MAX: Final = 100 * ms
#: Difference between the answer times of two rigs from which it is reported.
ANSWER_APART: Final = 20 * ms
#: Permitted difference of a reading between the two wires, relative to its range: they report different instants.
AGREE: Final = 0.01
#: A function, a unit and an address that our rigs do not have.
NO_FUNCTION: Final = 0x41
NO_UNIT: Final = 77
NO_ADDRESS: Final = 60000


def ask(access: RawAccess) -> list[Notebook]:
    """Send requests on a Modbus connection without a lease, and return the findings."""
    line = access.modbus()
    return [_speed(line), _agreement(access, line), _exceptions(line)]


def _speed(line: ModbusConnection) -> Notebook:
    book = Notebook("Modbus response time")
    block = [r for r in TABLE.registers if r.space == "input" and r.encoding == "float32"]
    last = max(r.address for r in block if r.address < FLOAT_BLOCK + 120) + 2
    took = [line.read(4, FLOAT_BLOCK, min(last - FLOAT_BLOCK, 120)).took for _ in range(READS)]
    for what, share in (("median", 50), ("99th percentile", 99), ("slowest", 100)):
        time = float(np.percentile(took, share))
        book.note(
            f"response time, {what}",
            time <= ANSWER_MAX,
            f"{time / ms:.2f} ms",
            f"at most {ANSWER_MAX / ms:g} ms",
            value=time,
            apart=ANSWER_APART,
        )
    return book


def _agreement(access: RawAccess, line: ModbusConnection) -> Notebook:
    book = Notebook("CAN and Modbus")
    own = line.words(0, 7)
    number, word = struct.unpack(">fI", struct.pack(">4H", *own[3:7]))
    found = f"{number:g} and {word:#010x}"
    good = math.isclose(number, PROBE_FLOAT, rel_tol=1e-6) and word == PROBE_WORD
    book.note("probe registers", good, found, f"{PROBE_FLOAT:g} and {PROBE_WORD:#010x}")
    found = f"{own[1] << 16 | own[2]:#010x}"
    book.note("hash of the signal map", found == f"{TABLE.map_hash:#010x}", found, f"{TABLE.map_hash:#010x}")
    apart = []
    for signal in TABLE.of_kind(Kind.MEASUREMENT):
        assert signal.address is not None  # of a measured value
        here, there = access.listener.latest(signal.name), line.number(signal.address)
        if math.isnan(here) is not math.isnan(there) or abs(here - there) > AGREE * (
            signal.high - signal.low
        ):
            apart.append(f"{signal.name}: {signal.show(here)} on CAN, {signal.show(there)} on Modbus")
    book.note("readings that differ between CAN and Modbus", not apart, ", ".join(apart) or "none", "none")
    return book


def _exceptions(line: ModbusConnection) -> Notebook:
    book = Notebook("Modbus exceptions")
    two = struct.Struct(">HH").pack
    book.refusal("unknown function code", line.ask(NO_FUNCTION, b"\0\0").code, ILLEGAL_FUNCTION)
    book.refusal("unknown unit number", line.ask(4, two(0, 1), unit=NO_UNIT).code, NO_SUCH_UNIT)
    book.refusal("unassigned input register", line.read(4, NO_ADDRESS, 1).code, ILLEGAL_ADDRESS)
    book.refusal("registers beyond the last address", line.read(4, 0xFFFF, 2).code, ILLEGAL_ADDRESS)
    book.refusal("quantity of 0 registers", line.read(4, 0, 0).code, ILLEGAL_VALUE)
    book.refusal("quantity of 126 registers", line.read(4, 0, 126).code, ILLEGAL_VALUE)
    book.refusal("one register of a float", line.read(4, FLOAT_BLOCK, 1).code, ILLEGAL_VALUE)
    book.refusal("incomplete request", line.ask(4, b"\0\0\0").code, ILLEGAL_VALUE)
    book.refusal("coil value neither on nor off", line.ask(5, two(0, 0x1234)).code, ILLEGAL_VALUE)
    book.refusal("unknown file record", line.ask(20, b"\7\6" + two(999, 0) + b"\0\1").code, ILLEGAL_ADDRESS)
    return book
