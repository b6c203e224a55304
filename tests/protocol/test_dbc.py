"""Files of messages are read by one function: their charsets, duplicates, and J1939."""

import math
from pathlib import Path

import cantools
import numpy as np
import pytest

from bench_protocol import j1939
from bench_protocol.account import Account
from bench_protocol.can_codec import Encoder
from bench_protocol.dbc import DbcError, Described, read_dbc
from bench_protocol.dbc_decoding import Decoding
from bench_protocol.frames import payload
from bench_protocol.table import TABLE
from tests.refusals import refuses

HEAD = 'VERSION ""\nNS_ :\nBS_:\nBU_: PLC BENCH\n'
GAS = (
    HEAD
    + 'BO_ 256 Gas: 8 PLC\n SG_ Temp : 0|16@1- (0.01,0) [0|0] "°C" BENCH\n SG_ Way : 16|16@1- (1,0) [0|0] "µm" BENCH\n'
)
J1939 = """BA_DEF_ BO_ "VFrameFormat" ENUM "StandardCAN","ExtendedCAN","reserved","J1939PG";
BA_DEF_ "ProtocolType" STRING ;
BA_DEF_DEF_ "VFrameFormat" "{format}";
BA_DEF_DEF_ "ProtocolType" "";
BA_ "ProtocolType" "J1939";
"""


def values(one: Described, data: bytes) -> dict[str, float]:
    return dict(Decoding(one).values(data, Account()))


def written(tmp_path: Path, text: str, charset: str = "utf-8") -> Path:
    path = tmp_path / "rig.dbc"
    path.write_bytes(text.encode(charset))
    return path


@pytest.mark.parametrize("charset", ["utf-8", "utf-8-sig", "utf-16", "cp1252"])
def test_units_are_read_whatever_the_charset(tmp_path, charset: str) -> None:
    gas = read_dbc(written(tmp_path, GAS, charset)).messages["Gas"]
    assert [signal.unit for signal in gas.coding.signals] == ["°C", "µm"]


def test_another_charset_is_given_by_name_or_named_in_the_error(tmp_path) -> None:
    path = written(tmp_path, GAS.replace("°C", "č"), "cp1250")
    assert read_dbc(path, "cp1250").messages["Gas"].coding.signals[0].unit == "č"
    with refuses(DbcError, 'charset "klingon" "utf-8"'):
        read_dbc(path, "klingon")
    path.write_bytes(GAS.encode("cp1252").replace(b"\xb5", b"\x81"))
    with refuses(DbcError, "7 utf-8 cp1252"):
        read_dbc(path)


def test_identifiers_distinguish_messages_of_one_name(tmp_path) -> None:
    text = HEAD + "".join(
        f'BO_ {number} Heights: 8 PLC\n SG_ Height : 0|16@1- (0.01,0) [0|0] "mm" BENCH\n'
        for number in (256, 257, 257)
    )
    dbc = read_dbc(written(tmp_path, text))
    assert list(dbc.messages) == ["Heights_0x100", "Heights_0x101"]
    assert dbc.of(0x101, False).name == "Heights_0x101"


def test_one_identifier_of_two_messages_is_refused_when_it_is_asked_for(tmp_path) -> None:
    text = GAS + 'BO_ 256 Air: 8 PLC\n SG_ P : 0|16@1- (1,0) [0|0] "" BENCH\nBO_ 257 Fine: 8 PLC\n'
    dbc = read_dbc(written(tmp_path, text))
    assert dbc.of(0x101, False).name == "Fine"
    with refuses(DbcError, "describes 0x100"):
        dbc.of(0x100, False)


def test_signals_that_share_bits_forbid_only_sending(tmp_path) -> None:
    text = (
        GAS
        + 'BO_ 512 Faults: 8 PLC\n SG_ Code : 0|8@1+ (1,0) [0|255] "" BENCH\n SG_ Pump : 0|1@1+ (1,0) [0|1] "" BENCH\n'
    )
    dbc = read_dbc(written(tmp_path, text))
    assert dbc.messages["Gas"].unsound == ""
    assert "share bits" in dbc.messages["Faults"].unsound
    assert values(dbc.messages["Faults"], b"\x03" + bytes(7)) == {"Code": 3, "Pump": 1}
    text = (
        GAS
        + 'BO_ 513 Wide: 1 PLC\n SG_ One : 0|8@1+ (1,0) [0|0] "" X\n SG_ Code : 0|16@1+ (1,0) [0|0] "" X\n'
    )
    wide, account = read_dbc(written(tmp_path, text)).messages["Wide"], Account()
    assert "Code does not fit into its 1 bytes" in wide.unsound
    assert dict(Decoding(wide).values(b"\x07", account)) == {"One": 7}
    assert Decoding(wide).outside == ["Code"]


def test_pages_with_shared_bits_decode_like_single_pages(tmp_path) -> None:
    text = HEAD + (
        'BO_ 256 Pages: 8 PLC\n SG_ Page M : 0|8@1+ (1,0) [0|0] "" X\n SG_ A m0 : 8|16@1+ (1,0) [0|0] "" X\n'
        ' SG_ Low m0 : 8|8@1+ (1,0) [0|0] "" X\n SG_ B m1 : 8|8@1- (1,0) [0|0] "" X\n'
    )
    one, account = Decoding(read_dbc(written(tmp_path, text)).messages["Pages"]), Account()
    assert one.message.unsound and one.outside == []
    assert sorted(one.values(b"\0\x34\x12" + bytes(5), account)) == [
        ("A", 0x1234),
        ("Low", 0x34),
        ("Page", 0),
    ]
    assert sorted(one.values(b"\1\xff" + bytes(6), account)) == [("B", -1), ("Page", 1)]


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (HEAD + "BO_ 256 Gas 8 PLC\n", "DBC 5 13 '8 PLC'"),
        (HEAD + "BO_ 256 Gas:", "5 'BO_ 256 Gas'"),
        (GAS[:-20], "7 'SG_ Way'"),
        ("<xml/>", "DBC 1 1 '<xml/>'"),
    ],
)
def test_an_invalid_dbc_is_reported_with_its_line(tmp_path, text: str, said: str) -> None:
    with refuses(DbcError, said):
        read_dbc(written(tmp_path, text))
    with refuses(DbcError):
        read_dbc(tmp_path / "gone.dbc")


@pytest.mark.parametrize("form", ["J1939PG", "ExtendedCAN"])
def test_j1939_goes_by_the_group_whatever_source_destination_and_priority(tmp_path, form: str) -> None:
    broadcast, told = 0x18FF21FE, 0x0CEFFEFE
    text = HEAD + "".join(
        f'BO_ {number | 1 << 31} {name}: 8 PLC\n SG_ A : 0|8@1+ (1,0) [0|0] "" BENCH\n'
        for number, name in ((broadcast, "Wide"), (told, "Told"))
    )
    if form == "ExtendedCAN":  # only the file as a whole says that it is J1939
        text += J1939.replace('BA_DEF_DEF_ "VFrameFormat" "{format}";\n', "").replace(
            'BA_DEF_ BO_ "VFrameFormat" ENUM "StandardCAN","ExtendedCAN","reserved","J1939PG";\n', ""
        )
    else:
        text += J1939.format(format=form)
    dbc = read_dbc(written(tmp_path, text))
    assert dbc.of(0x0CFF2127, True).name == "Wide"
    assert dbc.of(0x18EF1127, True).name == "Told"
    assert dbc.of(0x18FF2227, True) is None
    assert dbc.of(0x7FF, False) is None


def test_of_one_group_described_twice_each_source_has_its_own(tmp_path) -> None:
    text = (
        HEAD
        + "".join(
            f'BO_ {0x18FF2100 | source | 1 << 31} S{source:02X}: 8 PLC\n SG_ A : 0|8@1+ (1,0) [0|0] "" BENCH\n'
            for source in (0x27, 0x28)
        )
        + J1939.format(format="J1939PG")
    )
    dbc = read_dbc(written(tmp_path, text))
    assert dbc.of(0x18FF2128, True).name == "S28"
    assert dbc.of(0x18FF2130, True) is None


@pytest.mark.parametrize(
    ("bits", "error", "unavailable", "values"),
    [
        (1, [], [], [0, 1]),
        (2, [2], [3], [0, 1]),
        (4, [14], [15], [13]),
        (8, [0xFE], [0xFF], [0xFA, 0xFD]),
        (10, [0x3FE], [0x3FF], [0x3FD]),
        (12, [0xFE0, 0xFEF], [0xFF0, 0xFFF], [0xFDF]),
        (16, [0xFE00, 0xFEFF], [0xFF00, 0xFFFF], [0xFAFF, 0xFDFF]),
        (32, [0xFE000000], [0xFF000000, 0xFFFFFFFF], [0xFAFFFFFF]),
    ],
)
def test_codes_of_j1939_that_are_no_values(bits: int, error, unavailable, values) -> None:
    assert all(j1939.missing(raw, bits) == "error" for raw in error)
    assert all(j1939.missing(raw, bits) == "not available" for raw in unavailable)
    assert not any(j1939.missing(raw, bits) for raw in values)


def test_our_own_dbc_says_here_what_cantools_says() -> None:
    path = Path(__file__).resolve().parents[2] / "bench_protocol" / "generated" / "astb.dbc"
    theirs, ours = cantools.database.load_file(path), read_dbc(path)
    assert {one.name: one.frame_id for one in theirs.messages} == {
        name: one.coding.frame_id for name, one in ours.messages.items()
    }
    assert not any(one.unsound for one in ours.messages.values())


def test_values_of_j1939_are_missing_where_the_code_says_so_and_counted(tmp_path) -> None:
    text = (
        HEAD
        + (
            f'BO_ {0x18FF21FE | 1 << 31} S: 8 PLC\n SG_ H : 0|16@1+ (0.05,-1600) [-1600|1612.75] "mm" B\n'
            ' SG_ P : 16|8@1+ (8,0) [0|2000] "kPa" B\n SG_ On : 24|2@1+ (1,0) [0|3] "" B\n'
            ' SG_ Far : 32|32@1+ (1,0) [0|0] "" B\n'
        )
        + J1939.format(format="J1939PG")
    )
    one, account = Decoding(read_dbc(written(tmp_path, text)).messages["S"]), Account()
    found = dict(one.values(bytes.fromhex("00 7D 3C 01 01 00 00 00"), account))
    assert found == {"H": 0.0, "P": 480.0, "On": 1.0, "Far": 1.0}
    assert account.lines() == []
    for data in ("FF FF FF FF FF FF FF FF", "34 FE FE FE 00 00 00 FE"):
        assert all(math.isnan(value) for _, value in one.values(bytes.fromhex(data), account))
    assert account.left_out.startswith("4 J1939 values that are not available, 4 J1939 values in error")


@pytest.mark.parametrize("length", range(9))
def test_a_short_frame_has_what_fits_as_cantools_says(length: int) -> None:
    path = Path(__file__).resolve().parents[2] / "bench_protocol" / "generated" / "astb.dbc"
    data, account = bytes(range(1, length + 1)), Account()
    for one in read_dbc(path).messages.values():
        theirs = one.coding.decode(data, decode_choices=False, allow_truncated=True)
        assert dict(Decoding(one).values(data, account)) == theirs


@pytest.mark.parametrize(
    ("signal", "named", "codes"),
    [
        ('0|16@1+ (0.1,-300) [0|0] "mm"', '65534 "Fehler" 65535 "SNA"', {65534, 65535}),
        ('0|16@1+ (0.001,0) [0|0] "bar"', '65535 "Signal not available"', {65535}),
        ('0|11@1+ (0.005,-7.22) [-7.22|3.005] "mm"', '2046 "Neutralwert" 2047 "Fehler"', {2046, 2047}),
        ('0|16@1- (0.01,0) [-300|300] "mm"', '-32768 "not_available"', {-32768}),
        ('0|8@1+ (1,0) [0|100] "%"', '0 "Off" 100 "Full" 101 "Kurzschluss" 200 "Xyz"', {101, 200}),
        ('0|8@1+ (1,-40) [-40|210] "degC"', '0 "InitialValue" 254 "reserved" 255 "SIGNAL_INVALID"', {0, 254, 255}),
        ('0|16@1+ (1,0) [0|0] ""', '65535 "Fehler"', {65535}),
        ('0|8@1+ (0.5,0) [0|0] "V"', '0 "NoError" 24 "kein Fehler"', set()),
        ('0|4@1+ (1,0) [0|15] ""', '0 "Idle" 1 "Run" 2 "Fault" 15 "SNA"', {15}),
        ('0|1@1+ (1,0) [0|1] ""', '0 "kein Fehler" 1 "Fehler"', set()),
        ('0|1@1+ (1,0) [0|1] ""', '1 "Fehler"', set()),
        ('0|8@1+ (1,0) [0|0] ""', '0 "OK" 1 "Fehler" 2 "Warnung"', set()),
        ('0|2@1+ (1,0) [0|3] ""', '0 "aus" 1 "ein" 2 "Fehler" 3 "nicht verfügbar"', {3}),
    ],
)  # fmt: skip
def test_named_raw_values_that_are_no_measurement_have_no_value_and_are_counted(
    tmp_path, signal: str, named: str, codes: set[int]
) -> None:
    text = f"{HEAD}BO_ 256 S: 8 PLC\n SG_ X : {signal} B\n\nVAL_ 256 X {named} ;\n"
    one, account = Decoding(read_dbc(written(tmp_path, text)).messages["S"]), Account()
    coding = one.signals["X"]
    for code in map(int, coding.choices):
        data = (code & (1 << coding.length) - 1).to_bytes(8, "little")
        (value,) = dict(one.values(data, account)).values()
        assert (
            math.isnan(value)
            if code in codes
            else value == pytest.approx(coding.scale * code + coding.offset)
        )
    assert sum(account.counts.values()) == len(codes)


def test_a_stock_client_sees_where_our_bus_has_no_value() -> None:
    """Without a name in the DBC, the code of a bench without a car reads as car_height = -327.68 mm."""
    path = Path(__file__).resolve().parents[2] / "bench_protocol" / "generated" / "astb.dbc"
    theirs, ours = cantools.database.load_file(path), read_dbc(path)
    absent = np.full(len(TABLE.signals), np.nan)
    checked = 0
    for record in Encoder(TABLE).encode(absent, np.arange(len(TABLE.messages)), 0):
        row = next(one for one in TABLE.messages if one.identifier == int(record["id"]))
        decoded = theirs.decode_message(row.identifier, payload(record))
        found = dict(Decoding(ours.messages[row.name]).values(payload(record), Account()))
        for field in (one for one in row.fields if one.nullable):
            name = field.signal.replace(".", "_")
            assert str(decoded[name]) == "not available"
            assert math.isnan(found[name])
            checked += 1
    assert checked == sum(field.nullable for one in TABLE.messages for field in one.fields)
