"""The Modbus codec: the specification's own examples, its limits, and any bytes at all."""

import struct
from itertools import pairwise

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bench_protocol.modbus import (
    MEANING,
    PDU_MAX,
    AduStream,
    FramingError,
    answer,
    pack_bits,
    refuse,
    unpack_bits,
)
from tests.refusals import refuses


def adu(pdu: bytes, transaction: int = 0x1501, unit: int = 1) -> bytes:
    return struct.pack(">HHHB", transaction, 0, len(pdu) + 1, unit) + pdu


def ask(bank, pdu: str | bytes) -> bytes:
    """Return the response PDU, after a look at its header."""
    request = adu(bytes.fromhex(pdu) if isinstance(pdu, str) else pdu)
    response = answer(request, bank)
    transaction, protocol, length, unit = struct.unpack(">HHHB", response[:7])
    assert (transaction, protocol, length, unit) == (0x1501, 0, len(response) - 6, 1)
    return response[7:]


# --- examples printed in MODBUS Application Protocol Specification V1.1b3, section 6 -----------------------------


@pytest.mark.parametrize(
    ("function", "address", "count", "table"),
    [(1, 0x13, 0x13, "CD6B05"), (2, 0xC4, 0x16, "ACDB35")],
)
def test_reading_bits_as_printed(bank, function: int, address: int, count: int, table: str) -> None:
    bits = unpack_bits(bytes.fromhex(table), count)
    (bank.coils if function == 1 else bank.discrete)[address : address + count] = bits
    assert (
        ask(bank, struct.pack(">BHH", function, address, count)).hex() == f"{function:02x}03" + table.lower()
    )


def test_reading_registers_as_printed(bank) -> None:
    bank.holding[0x6B:0x6E] = [0x022B, 0x0000, 0x0064]
    assert ask(bank, "03 006B 0003") == bytes.fromhex("03 06 022B 0000 0064")
    bank.input[8] = 0x000A
    assert ask(bank, "04 0008 0001") == bytes.fromhex("04 02 000A")


def test_writing_as_printed(bank) -> None:
    assert ask(bank, "05 00AC FF00") == bytes.fromhex("05 00AC FF00")
    assert bank.coils[0xAC]
    assert ask(bank, "05 00AC 0000") == bytes.fromhex("05 00AC 0000")
    assert not bank.coils[0xAC]
    assert ask(bank, "06 0001 0003") == bytes.fromhex("06 0001 0003")
    assert bank.holding[1] == 3
    assert ask(bank, "0F 0013 000A 02 CD01") == bytes.fromhex("0F 0013 000A")
    assert bank.coils[0x13:0x1D] == [bool(int(bit)) for bit in "1011001110"]
    assert ask(bank, "10 0001 0002 04 000A 0102") == bytes.fromhex("10 0001 0002")
    assert bank.holding[1:3] == [0x000A, 0x0102]


def test_mask_write_as_printed(bank) -> None:
    bank.holding[4] = 0x12
    assert ask(bank, "16 0004 00F2 0025") == bytes.fromhex("16 0004 00F2 0025")
    assert bank.holding[4] == 0x17


def test_reading_files_as_printed(bank) -> None:
    """Section 6.14: two records of file 4 and two of file 3."""
    bank.files = {4: [0, 0x0DFE, 0x0020], 3: [0] * 9 + [0x33CD, 0x0040]}
    request = "14 0E 06 0004 0001 0002 06 0003 0009 0002"
    assert ask(bank, request) == bytes.fromhex("14 0C 05 06 0DFE 0020 05 06 33CD 0040")


@pytest.mark.parametrize(
    ("request_pdu", "code"),
    [
        ("14", 3),
        ("14 00", 3),
        ("14 06 06 0004 0001 00", 3),  # half a place
        ("14 07 06 0004 0001 0001 00", 3),  # more than it says
        ("14 0E 06 0004 0001 0001", 3),  # less
        ("14 07 05 0004 0001 0001", 2),  # no reference type but 6
        ("14 07 06 0000 0001 0001", 2),  # files count from 1
        ("14 07 06 0004 270F 0002", 2),  # over record 9999
        ("14 07 06 0005 0000 0001", 2),  # no such file
        ("14 07 06 0004 0001 0003", 2),  # beyond its end
        ("14 07 06 0004 0001 0000", 3),
        ("14 07 06 0004 0000 007A", 3),  # 122 registers do not fit
        ("14 0E 06 0003 0000 003D 06 0003 0000 003D", 3),  # 61 and 61 neither
    ],
)
def test_reading_files_that_is_refused(bank, request_pdu: str, code: int) -> None:
    bank.files = {4: [1, 2, 3], 3: [7] * 200}
    assert ask(bank, request_pdu) == bytes((0x94, code))


def test_as_much_of_a_file_as_fits(bank) -> None:
    bank.files = {3: list(range(200))}
    answered = ask(bank, "14 07 06 0003 0005 0079")
    assert len(answered) == 2 + 245 - 1 and answered[1] == 244, "bytes; 245 is the most"
    assert struct.unpack(">121H", answered[4:]) == tuple(range(5, 126))


def test_read_write_as_printed(bank) -> None:
    bank.holding[3:9] = [0x00FE, 0x0ACD, 0x0001, 0x0003, 0x000D, 0x00FF]
    request = "17 0003 0006 000E 0003 06 00FF 00FF 00FF"
    assert ask(bank, request) == bytes.fromhex("17 0C 00FE 0ACD 0001 0003 000D 00FF")
    assert bank.holding[0xE:0x11] == [0xFF, 0xFF, 0xFF]


def test_read_write_writes_before_it_reads(bank) -> None:
    assert ask(bank, "17 0005 0001 0005 0001 02 ABCD") == bytes.fromhex("17 02 ABCD")


# --- refusals ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("pdu", "code", "why"),
    [
        ("07", 1, "unknown function"),
        ("63 0000 0001", 1, "unknown function"),
        ("2B 0D 00", 1, "unknown MEI type"),
        ("2B", 1, "no MEI type"),
        ("03 03E7 0002", 2, "half outside the map"),
        ("03 FFFF 0002", 2, "beyond the last address there can be"),
        ("06 03E8 0001", 2, "outside the map"),
        ("05 03E8 FF00", 2, "outside the map"),
        ("03 0000 0000", 3, "no registers"),
        ("03 0000 007E", 3, "126 registers"),
        ("04 0000 007E", 3, "126 registers"),
        ("01 0000 07D1", 3, "2001 coils"),
        ("02 0000 07D1", 3, "2001 inputs"),
        ("05 0000 0001", 3, "neither on nor off"),
        ("10 0000 0001 04 0001 0002", 3, "byte count does not fit"),
        ("10 0000 0002 04 0001", 3, "too short"),
        ("10 0000", 3, "too short"),
        ("10 0000 007C F8" + "0000" * 124, 3, "124 registers"),
        ("0F 0000 0008 02 0000", 3, "byte count does not fit"),
        ("0F 0000 07B1 F7" + "00" * 247, 3, "1969 coils"),
        ("17 0000 0001 0000 007A F4" + "0000" * 122, 3, "writes 122 registers"),
        ("17 0000 007E 0000 0001 02 0000", 3, "reads 126 registers"),
        ("16 0000 0000", 3, "too short"),
        ("03 0000 0001 00", 3, "too long"),
        ("03", 3, "too short"),
        ("2B 0E 05 00", 3, "unknown access code"),
        ("2B 0E 01", 3, "too short"),
        ("2B 0E 04 33", 2, "no such object"),
    ],
)
def test_a_refusal_has_the_right_code_and_no_effect(bank, pdu: str, code: int, why: str) -> None:
    function = bytes.fromhex(pdu)[0]
    before = list(bank.holding), list(bank.coils)
    assert ask(bank, pdu) == bytes((function | 0x80, code)), why
    assert (bank.holding, bank.coils) == before


@pytest.mark.parametrize("count", [1, 124, 125])
def test_the_longest_reads_are_served(bank, count: int) -> None:
    assert len(ask(bank, struct.pack(">BHH", 4, 0, count))) == 2 + 2 * count


def test_the_longest_writes_are_served(bank) -> None:
    values = list(range(1, 124))
    ask(bank, struct.pack(">BHHB123H", 16, 10, 123, 246, *values))
    assert bank.holding[10:133] == values
    ask(bank, struct.pack(">BHHB", 15, 0, 1000, 125) + b"\xff" * 125)
    assert all(bank.coils)


def test_read_write_that_cannot_read_has_not_written(bank) -> None:
    assert ask(bank, "17 03E7 0002 0005 0001 02 ABCD") == b"\x97\x02"
    assert bank.holding[5] == 0


def test_an_unknown_unit_is_0x0b(bank) -> None:
    assert answer(adu(b"\x03\0\0\0\1", unit=7), bank)[6:] == b"\x07\x83\x0b"
    for unit in (0, 1, 255):
        assert answer(adu(b"\x03\0\0\0\1", unit=unit), bank)[6:8] == bytes((unit, 3))


def test_a_bank_may_refuse(bank) -> None:
    bank.broken = True
    assert ask(bank, "03 0000 0001") == b"\x83\x04"


def test_a_fault_in_the_bank_is_not_hidden() -> None:
    with pytest.raises(AttributeError):
        answer(adu(b"\x03\0\0\0\1"), object())


# --- identification --------------------------------------------------------------------------------------------


def objects_of(pdu: bytes) -> tuple[dict[int, bytes], int, int]:
    function, mei, _, conformity, more, following, count = pdu[:7]
    assert (function, mei, conformity) == (43, 14, 0x83)
    found, rest = {}, pdu[7:]
    for _ in range(count):
        found[rest[0]], rest = rest[2 : 2 + rest[1]], rest[2 + rest[1] :]
    assert rest == b""
    return found, more, following


def test_identification_in_all_its_ways(bank) -> None:
    basic = {number: value for number, value in bank.objects.items() if number < 3}
    assert objects_of(ask(bank, "2B 0E 01 00")) == (basic, 0, 0)
    assert objects_of(ask(bank, "2B 0E 02 00")) == (basic, 0, 0)
    assert objects_of(ask(bank, "2B 0E 03 00")) == (bank.objects, 0, 0)
    assert objects_of(ask(bank, "2B 0E 03 02")) == ({2: b"1.0", 0x80: b"0123abcd"}, 0, 0)
    assert objects_of(ask(bank, "2B 0E 03 55")) == (bank.objects, 0, 0)  # unknown: from the beginning
    assert objects_of(ask(bank, "2B 0E 04 80")) == ({0x80: b"0123abcd"}, 0, 0)


def test_long_identification_takes_several_answers(bank) -> None:
    bank.objects = {number: bytes([number]) * 100 for number in (0, 1, 2, 0x80, 0x81)}
    found: dict[int, bytes] = {}
    start = 0
    for _ in range(len(bank.objects)):
        pdu = ask(bank, bytes((43, 14, 3, start)))
        assert len(pdu) <= PDU_MAX
        part, more, start = objects_of(pdu)
        found |= part
        if not more:
            break
    assert found == bank.objects


# --- any bytes at all ------------------------------------------------------------------------------------------


@settings(deadline=None)
@given(
    pdu=st.one_of(
        st.binary(min_size=1, max_size=PDU_MAX),
        st.builds(
            lambda function, rest: bytes([function]) + rest,
            st.sampled_from([1, 2, 3, 4, 5, 6, 15, 16, 22, 23, 43]),
            st.binary(max_size=30),
        ),
        st.builds(
            struct.pack,
            st.just(">BHH"),
            st.integers(1, 4),
            st.integers(0, 0xFFFF),
            st.integers(0, 2100),
        ),
    ),
    unit=st.integers(0, 255),
)
def test_every_request_has_a_well_formed_answer(pdu: bytes, unit: int, fresh_bank) -> None:
    response = answer(adu(pdu, 77, unit), fresh_bank)
    transaction, protocol, length, back = struct.unpack(">HHHB", response[:7])
    assert (transaction, protocol, length, back) == (77, 0, len(response) - 6, unit)
    assert 2 <= length <= PDU_MAX + 1
    if response[7] & 0x80 and not pdu[0] & 0x80:
        assert response[7] == pdu[0] | 0x80
        assert len(response) == 9
        assert response[8] in MEANING
    else:
        assert response[7] == pdu[0] | (0x80 if response[8:] in (b"\x01", b"\x0b") else 0)


@pytest.fixture(scope="module")
def fresh_bank(request):
    """One bank for all of hypothesis' examples: they look only at the form of the answers."""
    from types import SimpleNamespace

    def read(address: int, count: int) -> list[int]:
        return [1] * count

    return SimpleNamespace(
        read_coils=read,
        read_discrete=read,
        read_input=read,
        read_holding=read,
        write_coils=lambda address, values: None,
        write_holding=lambda address, values: None,
        identification=lambda: {0: b"x", 1: b"y", 2: b"z"},
    )


@settings(deadline=None)
@given(st.lists(st.booleans(), min_size=1, max_size=100))
def test_bits_survive_packing(bits: list[bool]) -> None:
    packed = pack_bits(bits)
    assert len(packed) == -(-len(bits) // 8)
    assert unpack_bits(packed, len(bits)) == bits
    assert packed[0] & 1 == bits[0]


# --- framing ----------------------------------------------------------------------------------------------------

ADUS = st.lists(
    st.builds(adu, st.binary(min_size=1, max_size=PDU_MAX), st.integers(0, 0xFFFF), st.integers(0, 255)),
    max_size=8,
)


@settings(deadline=None)
@given(ADUS, st.lists(st.integers(0), max_size=6))
def test_requests_survive_any_splitting(adus: list[bytes], cuts: list[int]) -> None:
    data = b"".join(adus)
    places = [0, *sorted(cut % (len(data) + 1) for cut in cuts), len(data)]
    stream = AduStream()
    assert [each for a, b in pairwise(places) for each in stream.feed(data[a:b])] == adus
    assert not stream.partial


@pytest.mark.parametrize(
    ("header", "why"),
    [
        ("0001 0001 0006", "protocol 1 0"),
        ("4745 5420 2F20", "protocol 21536"),  # somebody's browser: "GET / "
        ("0001 0000 0001", "length 1"),
        ("0001 0000 0000", "length 0"),
        ("0001 0000 00FF", "length 255"),
    ],
)
def test_a_wrong_header_ends_the_stream_after_what_was_right(header: str, why: str) -> None:
    good = adu(b"\x03\0\0\0\1")
    stream = AduStream()
    assert stream.feed(good + bytes.fromhex(header) + b"\x01\x03") == [good]
    with refuses(FramingError, why):
        stream.feed(b"")


def test_the_memory_of_a_stream_is_bounded() -> None:
    stream = AduStream()
    stream.feed(struct.pack(">HHHB", 1, 0, PDU_MAX + 1, 1))
    assert stream.partial
    for _ in range(PDU_MAX - 1):
        assert stream.feed(b"x") == []
    assert len(stream.feed(b"x")) == 1
    assert not stream.partial


def test_refuse_keeps_transaction_unit_and_function() -> None:
    assert refuse(adu(b"\x10\0\0", 0xABCD, 9), 6) == bytes.fromhex("ABCD 0000 0003 09 90 06")
