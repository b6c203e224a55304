"""Lists of registers as people keep them: the places that are meant, in words how they were taken, or a refusal."""

import random
import tomllib
from pathlib import Path

import pytest
from click.testing import CliRunner

from astb.acceptance.skeleton.register_list import read_register_list
from astb.cli import commands
from drivers.errors import WiringError
from tests.refusals import refuses

HEADS = {
    "english": "Tag{d}Area{d}Address{d}Data type{d}Factor{d}Unit",
    "plural": "Names{d}Tables{d}Addresses{d}Types{d}Factors{d}Units",
    "german": "Bezeichnung{d}Bereich{d}Adresse{d}Datentyp{d}Faktor{d}Einheit",
    "registers": "Bezeichnung{d}Register{d}Adressen{d}Datentypen{d}Faktoren{d}Einheiten",
}
TABLES = {"input": ("3x", "Input registers", "Eingangsregister"), "holding": ("4x", "HR", "Halteregister")}
TYPES = {
    "uint16": ("UINT16", "word", "unsigned 16 bit"),
    "int32": ("INT32", "DINT", "32 bit int"),
    "float32": ("FLOAT32", "real", "Float (32 bit)"),
}
ORDERS = {"": {}, " CDAB": {"word_order": "low"}, " ABCD": {"word_order": "high"}}
OFFSETS = {"input": 30001, "holding": 40001}


def points(path: Path, **keys) -> dict:
    found = read_register_list(path, **keys)
    return tomllib.loads("\n".join(point.line for point in found.points))


def list_of(seed: int) -> tuple[bytes, dict]:
    """A list in some form, and the points that it means."""
    pick = random.Random(seed)
    delimiter = pick.choice([",", ";", "\t"])
    comma = delimiter != "," and pick.random() < 0.5
    modicon, zeros = pick.random() < 0.4, pick.random() < 0.3
    lines = [HEADS[pick.choice(list(HEADS))].format(d=delimiter)]
    right = {}
    for number in range(6):
        table, kind = pick.choice(list(TABLES)), pick.choice(list(TYPES))
        order = pick.choice(list(ORDERS)) if kind != "uint16" else ""
        address, scale = pick.randrange(9000), pick.choice([1.0, 0.01, 0.5, 0.125])
        written = str(address + OFFSETS[table]) if modicon else f"{address:05d}" if zeros else str(address)
        factor = f"{scale:g}".replace(".", ",") if comma else f"{scale:g}"
        cells = [
            f"p{number}",
            pick.choice(TABLES[table]),
            written,
            pick.choice(TYPES[kind]) + order,
            factor,
            "mm",
        ]
        lines.append(delimiter.join(cells))
        right[f"p{number}"] = {"table": table, "address": address, "type": kind, **ORDERS[order]}
        right[f"p{number}"] |= {"scale": scale} if scale != 1.0 else {}
        right[f"p{number}"] |= {"group": "fast"} if table == "input" else {}
    if pick.random() < 0.3:
        lines = ["Registerliste Prüfstand", "", *lines]
    if pick.random() < 0.3:
        lines = [line + delimiter * 2 for line in lines]
    return "\r\n".join(lines).encode(pick.choice(["utf-8", "utf-8-sig", "cp1252", "utf-16"])), right


def test_a_list_names_the_right_registers_in_any_form(tmp_path):
    path = tmp_path / "list.csv"
    for seed in range(200):
        content, right = list_of(seed)
        path.write_bytes(content)
        assert points(path) == right, seed


def test_modicon_numbers_are_marked_and_a_key_reads_them_as_written(tmp_path):
    path = tmp_path / "list.csv"
    path.write_text(
        "Tag,Area,Address\nlaser,input,30011\nrequest,holding,40001\nlamp,coil,00003\nlid,di,10002\n"
    )
    written = CliRunner().invoke(commands, ["rig", "new", "--registers", str(path)]).output
    assert "# The addresses are read as Modicon numbers: 30011 is input register 10 on the wire" in written
    told = tomllib.loads(written)["transports"]["plc"]["points"]
    assert [told[name]["address"] for name in ("laser", "request", "lamp", "lid")] == [10, 0, 2, 1]
    assert points(path, counting="wire")["laser"]["address"] == 30011
    assert points(path, counting="one")["laser"]["address"] == 30010
    path.write_text("Name;Adresse\nlaser;300011\nrequest;400001\n")  # the number alone says the table
    found = points(path)
    assert (found["laser"]["table"], found["laser"]["address"]) == ("input", 10)
    assert (found["request"]["table"], found["request"]["address"]) == ("holding", 0)


def test_unread_lines_of_a_list_are_reported(tmp_path):
    path = tmp_path / "list.csv"
    path.write_text("Plant list\nname;table;address;owner\nHeights\nx;input;1;10\n")
    notes = " ".join(read_register_list(path).notes)
    assert "Lines above the head of the list: 1." in notes
    assert "Columns of the list that were not read: owner." in notes
    assert "read as titles: 1" in notes


@pytest.mark.parametrize(
    ("rows", "told"),
    [
        ("x,input,30011,,\ny,holding,12,,", "30011 2 looks 12 3 does"),
        ("x,coil,00010,,", "00010 2 --addresses"),
        ("x,input,1,FLOAT32 XYZ,", "2 'FLOAT32 XYZ'"),
        ('x,input,1,,"1,000"', "scale '1,000'"),
        ('x,input,1,,"0,5"\ny,input,2,,1.000', "3 scale '1.000'"),
        ("x,input,1,,0", "scale '0'"),
        ("x,input,1.25,,", "address '1.25' 0 15"),
        ("x,coil,1.5,,", "2 5 coil"),
        ("x,input,1.5,float32,", "2 5 float32"),
        ("x,input,70000,,", "wire 0 65535"),
        ("x,input,1,,1,7", "2 6 5"),
        ("", "there"),
    ],
)
def test_what_may_be_two_things_or_none_is_refused(tmp_path, rows, told):
    path = tmp_path / "list.csv"
    path.write_text("name,table,address,type,scale\n" + rows + "\n")
    with refuses(WiringError, told):
        read_register_list(path)


def test_divisors_bits_orders_and_functions_are_read(tmp_path):
    path = tmp_path / "list.csv"
    path.write_text(
        "name;FC;address;type;word order;divisor;bit\nx;4;30011;int32;CDAB;100;\ny;03/16;40001;int16;;10;\n"
        "lamp;3;40003.3;;;;\nlid;3;40003;;;;12\n"
    )
    found = read_register_list(path)
    told = tomllib.loads("\n".join(point.line for point in found.points))
    assert told["x"] == {
        "table": "input",
        "address": 10,
        "type": "int32",
        "word_order": "low",
        "scale": 0.01,
        "group": "fast",
    }
    assert told["y"] == {"table": "holding", "address": 0, "type": "int16", "scale": 0.1}
    # Functions that write are listed where they apply: rows without one are read only.
    assert told["lamp"] == {"table": "holding", "address": 2, "bit": 3, "group": "fast"}
    assert told["lid"] == {"table": "holding", "address": 2, "bit": 12, "group": "fast"}
    assert "The bits of a register are assumed to be numbered from 0, the lowest bit." in found.notes


@pytest.mark.parametrize(
    ("head", "cell", "told"),
    [
        ("Gain", "10", "such 10"),
        ("offset", "-40", "such -40"),
        ("Nachkommastellen", "1", "such 1"),
        ("word order", "middle", "'int16 middle'"),
        ("divisor", "0", "divisor '0'"),
    ],
)
def test_a_column_that_makes_numbers_others_is_never_passed_over(tmp_path, head, cell, told):
    path = tmp_path / "list.csv"
    path.write_text(f"name;table;address;type;{head}\nx;input;1;int16;{cell}\n")
    with refuses(WiringError, told):
        read_register_list(path)
    path.write_text("name;table;address;slave id\nx;input;1;1\ny;input;2;2\n")
    with refuses(WiringError, "slave 1 2"):
        read_register_list(path)


@pytest.mark.parametrize(
    ("head", "read", "write", "both"),
    [
        ("R/W", "R", "W", "R/W"),
        ("Access", "ro", "wo", "rw"),
        ("access", "read only", "write-only", "Read/Write"),
        ("Zugriff", "nur lesen", "schreiben", "lesen/schreiben"),
        ("function", "3", "", "03/16"),
        ("function code", "FC03", "", "FC03, FC06, FC16"),
    ],
)
def test_who_reads_and_writes_what_is_read(tmp_path, head, read, write, both):
    path = tmp_path / "list.csv"
    rows = [f"force;holding;1;{read}", f"push;holding;2;{both}"] + ([f"go;coil;3;{write}"] if write else [])
    path.write_text("\n".join([f"name;table;address;{head}", *rows]))
    content = {
        point.own: (point.read, point.written, "group" in point.line)
        for point in read_register_list(path).points
    }
    assert content.pop("force") == (True, False, True)
    assert content.pop("push") == (True, True, False)
    assert content == ({"go": (False, True, False)} if write else {})
    assert not any("not read" in note for note in read_register_list(path).notes)


def test_access_that_cannot_be_is_refused(tmp_path):
    path = tmp_path / "list.csv"
    path.write_text("name,table,address,access\nx,holding,1,maybe\n")
    with refuses(WiringError, "2 'maybe' R/W"):
        read_register_list(path)
    path.write_text("name,table,address,access\nx,input,1,RW\n")
    with refuses(WiringError, "2 'RW' table"):
        read_register_list(path)
    path.write_text("name,table,address,scale,unit\nx,input,1,0.1,0.01 mm\n")
    with refuses(WiringError, "scale 0.1 '0.01 mm'"):
        read_register_list(path)


@pytest.mark.parametrize(
    ("head", "cells", "scales"),
    [
        ("Scale factor", ("0.1", "1"), (0.1, 1.0)),
        ("Scale factor", ("10", "1"), (None, 1.0)),  # it may multiply or divide
        ("Factor", ("1/100", "2"), (0.01, None)),
        ("SF", ("-1", "2"), (0.1, 100.0)),  # SunSpec
        ("SF", ("1", "2"), (1.0, None)),
        ("SF", ("A_SF", "0.1"), (None, 0.1)),  # another register has it
        ("Exponent", ("2", "-3"), (100.0, 1e-3)),
        ("Exponent", ("0", "0.5"), (1.0, None)),
        ("Multiplier", ("10", "0.1"), (10.0, 0.1)),
        ("Divisor", ("10", "1"), (0.1, 1.0)),
        ("Scaling formula", ("x/10", ""), (None, 1.0)),
        ("Conversion (x)", ("0.1 mm", "1"), (None, 1.0)),
        ("10^x", ("0", "-1"), (1.0, None)),
        ("Skal.-Faktor", ("0,1", "-"), (None, 1.0)),
    ],
)
def test_a_point_is_scaled_as_the_list_says_or_left_out_with_a_reason(tmp_path, head, cells, scales) -> None:
    path = tmp_path / "list.csv"
    rows = [f"p{k};input;{10 + k};int16;{cell}" for k, cell in enumerate(cells)]
    path.write_text("\n".join([f"Name;Table;Address;Type;{head}", *rows]))
    found = read_register_list(path)
    told = tomllib.loads("\n".join(point.line for point in found.points))
    assert {name: one.get("scale", 1.0) for name, one in told.items()} == {
        f"p{k}": scale for k, scale in enumerate(scales) if scale is not None
    }
    for k, scale in enumerate(scales):
        lines = [note for note in found.notes if f"p{k} (row {k + 2})" in note and head in note]
        assert bool(lines) == (scale is None)


@pytest.mark.parametrize(
    ("rows", "types"),
    [
        (["int,1", "int,2", "float32,2"], ["int16", "int32", "float32"]),  # registers
        (["int,2", "uint,4", "float32,4"], ["int16", "uint32", "float32"]),  # bytes
        (["int,16", "uint,32"], ["int16", "uint32"]),  # bits
        (["int,2", "int,4"], [None, None]),  # registers or bytes
        (
            ["int16,2", "int32,2"],
            ["int16", "int32"],
        ),  # bytes of one, registers of the other: the types show it
        (["int32,1"], [None]),
        ([",2", ",1"], [None, ""]),  # two registers of what?
    ],
)
def test_a_size_tells_the_width_or_the_point_is_left_out(tmp_path, rows, types) -> None:
    path = tmp_path / "list.csv"
    lines = [f"p{k},input,{10 + 4 * k},{row}" for k, row in enumerate(rows)]
    path.write_text("\n".join(["Name,Table,Address,Type,Size", *lines]))
    told = points(path)
    assert {name: one.get("type", "") for name, one in told.items()} == {
        f"p{k}": kind for k, kind in enumerate(types) if kind is not None
    }


def test_two_points_on_one_register_are_reported(tmp_path) -> None:
    path = tmp_path / "list.csv"
    path.write_text(
        "Name,Table,Address,Type,Bit\nLaser,input,10,uint16,\nLeft,input,11,int32,\nRight,input,12,int32,\n"
        "Run,input,20,,1\nStop,input,20,,2\nOther,holding,11,int32,\n"
    )
    shared = [note for note in read_register_list(path).notes if "both on" in note]
    assert len(shared) == 1
    assert all(word in shared[0] for word in ("Left (row 3)", "Right (row 4)", "input register 12"))


@pytest.mark.parametrize(
    ("kind", "cell", "null"),
    [
        ("int16", "0x8000", -32768),
        ("int16", "-32768", -32768),
        ("uint16", "FFFFh", 65535),
        ("int32", "0x80000000", -(2**31)),
        ("float32", "-999.9", -999.9),
        ("float32", "nan", None),
        ("int16", "", None),
    ],
)
def test_a_column_names_what_a_register_holds_without_a_value(tmp_path, kind, cell, null) -> None:
    path = tmp_path / "list.csv"
    path.write_text(f"Name,Table,Address,Type,No value\np,input,10,{kind},{cell}\n")
    assert points(path)["p"].get("null") == null
