"""The EDS of the rig, as python's canopen and a plain reader of such files see it; PDOs against the DBC."""

import configparser
import itertools
import re
from collections.abc import Iterator
from importlib.resources import files

import canopen
import cantools
import numpy as np
import pytest
from canopen.objectdictionary import ODVariable

from bench_protocol.can_codec import Encoder
from bench_protocol.canopen import NODE, is_pdo, pdo_number
from bench_protocol.frames import payload
from bench_protocol.object_dictionary import OBJECT_DICTIONARY, ObjectCode, object_dictionary
from bench_protocol.registers import registers_of
from bench_protocol.signals import Kind
from bench_protocol.table import TABLE
from bench_protocol.wires import Table
from tools.generate.eds import eds

GENERATED = files("bench_protocol") / "generated"
PDOS = [message for message in TABLE.messages if is_pdo(message)]


@pytest.fixture(scope="module")
def text() -> str:
    return (GENERATED / "astb.eds").read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def node() -> canopen.RemoteNode:
    od = canopen.import_od(str(GENERATED / "astb.eds"), node_id=NODE)
    node = canopen.RemoteNode(NODE, od)
    network = canopen.Network()
    network.add_node(node)
    node.tpdo.read(from_od=True)
    node.rpdo.read(from_od=True)
    return node


def test_a_strict_reader_finds_every_section_once_and_all_that_are_mandatory(text: str) -> None:
    """configparser refuses a section or a key that appears twice."""
    reader = configparser.ConfigParser(strict=True, interpolation=None)
    reader.read_string(text)
    lists = ("MandatoryObjects", "OptionalObjects", "ManufacturerObjects")
    assert {"FileInfo", "DeviceInfo", "DummyUsage", "Comments", *lists} <= set(reader.sections())
    listed = []
    for title in lists:
        rows = dict(reader[title])
        assert int(rows.pop("supportedobjects")) == len(rows)
        listed += [int(index, 16) for index in rows.values()]
    described = {int(s, 16) for s in reader.sections() if re.fullmatch("[0-9A-F]{4}", s)}
    assert sorted(listed) == sorted(described)
    assert {0x1000, 0x1001, 0x1018} == {
        int(i, 16) for k, i in reader["MandatoryObjects"].items() if k.isdigit()
    }
    for index in described:
        kind = int(reader[f"{index:04X}"]["objecttype"], 16)
        subs = [s for s in reader.sections() if s.startswith(f"{index:04X}sub")]
        if kind == ObjectCode.VAR:
            assert not subs
        else:
            assert int(reader[f"{index:04X}"]["subnumber"]) == len(subs)
            assert f"{index:04X}sub0" in subs


def test_what_the_file_says_is_what_canopen_reads(node: canopen.RemoteNode) -> None:
    od = node.object_dictionary
    assert od.device_information.vendor_name == "ASTB"
    assert od.device_information.allowed_baudrates == {500_000}
    assert (od.device_information.nr_of_TXPDO, od.device_information.nr_of_RXPDO) == (
        sum(message.from_rig for message in PDOS),
        sum(not message.from_rig for message in PDOS),
    )
    for one in OBJECT_DICTIONARY:
        read = od[one.index]
        assert read.name == one.name
        for entry in one.entries:
            variable = read if isinstance(read, ODVariable) else read[entry.sub]
            assert (variable.name, variable.data_type, variable.access_type) == (
                entry.name,
                entry.type,
                entry.access,
            )
            assert variable.default == entry.default
            assert variable.factor == entry.factor
            assert variable.unit == entry.unit
            if entry.type.size <= 2 or entry.type.size == 4:  # canopen knows no limits of odd sizes
                assert (variable.min, variable.max) == (entry.low, entry.high)


def test_every_signal_is_an_object_with_its_unit() -> None:
    carried = {entry.signal for one in OBJECT_DICTIONARY for entry in one.entries}
    assert {row.name for row in TABLE.signals if row.kind not in (Kind.ACTION, Kind.FURTHER)} <= carried


def test_all_pdos_belong_to_one_node(node: canopen.RemoteNode) -> None:
    """Identifiers alone would make six nodes of it."""
    maps = {
        k: pdo for pdos in (node.tpdo, node.rpdo) for k, pdo in pdos.map.items() if pdo.cob_id is not None
    }
    assert {pdo.cob_id for pdos in (node.tpdo, node.rpdo) for pdo in pdos.map.values()} == {
        message.identifier for message in PDOS
    }
    assert maps
    for message in PDOS:
        pdo = (node.tpdo if message.from_rig else node.rpdo)[pdo_number(message)]
        assert pdo.cob_id == message.identifier
        assert pdo.length == 64, "the mapping leaves no gap"
        assert pdo.enabled
        assert pdo.rtr_allowed is not message.from_rig


def settings_of(values: np.ndarray) -> Iterator[np.ndarray]:
    """Every signal at zero, at its ends, unknown, and at random."""
    low, high = (np.array([getattr(row, end) for row in TABLE.signals]) for end in ("low", "high"))
    yield from (values, low, high, np.full(low.size, np.nan))
    rng = np.random.default_rng(1)
    for _ in range(20):
        yield rng.uniform(low, high)


@pytest.mark.parametrize("message", PDOS, ids=lambda message: message.name)
def test_canopen_decodes_a_pdo_as_cantools_does(node: canopen.RemoteNode, message: object) -> None:
    database = cantools.database.load_file(str(GENERATED / "astb.dbc"))
    pdo = (node.tpdo if message.from_rig else node.rpdo)[pdo_number(message)]
    by_sub = {variable.subindex: variable for variable in pdo.map}
    encoder = Encoder(TABLE)
    compared = 0
    for values in settings_of(np.zeros(len(TABLE.signals))):
        block = encoder.encode(values, encoder.rows([message.name]), 0)
        data = payload(block[0])
        pdo.on_message(message.identifier, bytearray(data), 0.0)
        decoded = database.decode_message(message.identifier, data, decode_choices=False)
        for sub, (field, bit) in enumerate(message.placed(), 1):
            variable = by_sub[sub]
            odd = bit % 8 or field.bits % 8
            if odd and bit // 8 > 4 and bit % 8 + field.bits > 16:
                continue  # canopen unpacks 24 bits as 32 and would read behind the frame
            raw = int(variable.raw)
            if odd and field.signed and raw == 1 << field.bits - 1:
                raw = field.raw_null  # canopen forgets the sign of the lowest code of such a field
            factor = 1.0 if field.bits == 1 else variable.od.factor
            assert raw * factor == pytest.approx(decoded[field.signal.replace(".", "_")], rel=1e-9), (
                field.signal
            )
            compared += 1
    assert compared >= 24, "one field at least"


def test_an_index_is_given_once() -> None:
    """Rows of the table may change their order, and new ones come: no object moves."""
    shuffled = object_dictionary(
        Table(TABLE.signals[::-1], TABLE.messages[::-1], registers_of(TABLE.signals))
    )
    places = lambda objects: {  # noqa: E731
        (one.index, entry.sub): entry.name for one in objects for entry in one.entries
    }
    assert places(shuffled) == places(OBJECT_DICTIONARY)
    numbers = [(message.from_rig, pdo_number(message)) for message in PDOS]
    assert len(set(numbers)) == len(numbers)


@pytest.mark.parametrize(
    ("identifier", "from_rig"), [(0x180, True), (0x191, True), (0x581, True), (0x211, False)]
)
def test_a_message_without_a_place_among_the_pdos_is_refused(identifier: int, from_rig: bool) -> None:
    import dataclasses

    stray = dataclasses.replace(PDOS[0], identifier=identifier, from_rig=from_rig)
    with pytest.raises(
        ValueError, match=rf"SpringLeft: {identifier:#05x} is not the identifier of a PDO of the bench"
    ):
        pdo_number(stray)


def test_the_text_is_made_only_from_the_table(text: str) -> None:
    assert text == eds()
    assert not [line for line in text.splitlines() if len(line) > 255], "CiA 306 ends a line there"
    assert all(a < b for a, b in itertools.pairwise([one.index for one in OBJECT_DICTIONARY]))
