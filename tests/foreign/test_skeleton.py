"""A first wiring file: much of what people wrote by hand is found, nothing wrong is filled in, and it can be read."""

import csv
import math
import tomllib
from pathlib import Path

import pytest
from click.testing import CliRunner

from astb.acceptance.skeleton.points import dbc_points
from astb.acceptance.skeleton.register_list import read_register_list
from astb.acceptance.skeleton.writing import GROUPS, matches, skeleton
from astb.acceptance.skeleton.written_units import WrittenUnit, unit_of
from astb.cli import commands
from bench_protocol.table import TABLE
from bench_protocol.units import UNITS
from drivers.errors import WiringError
from drivers.wiring.can.messages import read_messages
from drivers.wiring.description import describe
from tests.foreign import wiring_file
from tests.refusals import refuses

HERE = Path(__file__).parent
OURS = Path(__file__).parents[2] / "bench_protocol" / "generated"


def point(entry: dict) -> str:
    return entry.get("from") or entry.get("to") or ""


LISTS = {"plant_a": HERE / "plant_a_registers.csv", "yard_c": HERE / "yard_c_registers.csv"}


def in_holding_registers(name: str, out: Path) -> Path:
    """Write the list of a rig that has all its readings in registers and coils, and does not say which they are."""
    with LISTS[name].open(newline="") as file:
        rows = list(csv.DictReader(file))
    for row in rows:
        row.pop("R/W", None)
        if "Area" in row:  # the written registers follow the readings
            row["Address"] = str(int(row["Address"]) + 1000 * (row["Area"] == "holding"))
            row["Area"] = "coil" if row["Area"] == "discrete" else "holding"
    with out.open("w", newline="") as file:
        writer = csv.DictWriter(file, list(rows[0]))
        writer.writeheader()
        writer.writerows(rows)
    return out


@pytest.mark.parametrize(
    ("name", "unsaid", "clear", "first"),
    [
        ("hall_b", False, 0.8, 0.95),
        ("plant_a", False, 0.7, 0.9),
        ("plant_a", True, 0.5, 0.75),
        ("yard_c", False, 0.8, 0.85),
        ("yard_c", True, 0.6, 0.8),
    ],
)
def test_only_handwritten_files_are_found(name, unsaid, clear, first, tmp_path):
    dbc, registers = (HERE / "hall_b" / "hall_b.dbc", None) if name == "hall_b" else (None, LISTS[name])
    if unsaid:
        registers = in_holding_registers(name, tmp_path / "list.csv")
    points = dbc_points(dbc) if dbc else read_register_list(registers).points
    text = skeleton(dbc, registers, beside=tmp_path)
    content = tomllib.loads(text)
    describe(content, tmp_path / "wiring.toml", TABLE)
    right = tomllib.loads(wiring_file(name).read_text())["signals"]
    known = [one for one in content["signals"] if point(right.get(one, {}))]
    filled = {one: point(entry) for one, entry in content["signals"].items() if point(entry)}
    assert {one: found for one, found in filled.items() if found != point(right.get(one, {}))} == {}
    assert len(filled) >= clear * len(known)
    likeliest, _ = matches(points)
    hits = [
        one
        for one in known
        if likeliest[one].candidates and likeliest[one].candidates[0][1].name == point(right[one])
    ]
    assert len(hits) >= first * len(known)
    for one, entry in content["signals"].items():  # without further entries readings are sent cyclically
        if not dbc and "from" in entry:
            assert content["transports"]["plc"]["points"][entry["from"].removeprefix("plc.")]["group"], one


def test_units_calibration_and_what_tells_settings_are_filled_in(tmp_path):
    told = tomllib.loads(skeleton(HERE / "hall_b" / "hall_b.dbc", None, tmp_path))["signals"]
    cell = {"from": "bus.CellsA.Cell1", "unit": "kg", "calibration": {"gain": "9.80665 N/kg"}}
    assert told["load_cell.1"] == cell
    assert told["air.dpv"] == {"to": "bus.Parameter.Bridge", "read": "bus.ParameterIs.Bridge"}
    assert told["lateral.acceleration"] == {
        "absent": "not found; see the candidates above, with their similarity (0 to 1)"
    }
    assert told["rig.pipe"] == {"absent": "not found; no point has such a name and unit"}


def test_our_own_files_name_everything_by_its_name(tmp_path):
    told = tomllib.loads(skeleton(OURS / "astb.dbc", None, tmp_path))["signals"]
    for name in (*GROUPS["Measurements"], *GROUPS["Set-points"]):
        assert point(told[name]).endswith(f".{name.replace('.', '_')}"), name
    assert told["rig.state"]["choices"]["FAULT_HOLD"] == 9
    both = tomllib.loads(skeleton(OURS / "astb.dbc", OURS / "modbus_map.csv", tmp_path))["signals"]
    wrong = [name for name, one in both.items() if point(one) and not same(point(one), name)]
    assert wrong == []


def same(found: str, name: str) -> bool:
    return name.replace(".", "_") in found.replace(".", "_")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("name,address\nx,1\n", "column"),
        ("name,table,address\nx,inputs,one\n", "2 address 'one'"),
        ("name;table;address\nx;input;1\ny;outlet;2\n", "3 'outlet'"),
        ("name,table,address,type\nx,input,1,half\n", "2 'half'"),
    ],
)
def test_a_wrong_list_says_row_and_column(text, message, tmp_path):
    path = tmp_path / "list.csv"
    path.write_text(text)
    with refuses(WiringError, message):
        read_register_list(path)


def test_columns_may_be_called_otherwise(tmp_path):
    path = tmp_path / "list.csv"
    path.write_text("Tag;Area;Addr;Data type;Factor;Einheit\nDruck Balg links;3x;0x10;INT;0.5;mbar\n")
    (one,) = read_register_list(path).points
    assert (
        one.line
        == '"Druck_Balg_links" = { table = "input", address = 16, type = "int16", scale = 0.5, group = "fast" }'
    )
    likeliest, _ = matches([one])
    assert likeliest["left.bellows_pressure"].clear is one


def test_the_command_writes_a_file_once(tmp_path):
    out = tmp_path / "wiring.toml"
    call = ["rig", "new", "--dbc", str(HERE / "hall_b" / "hall_b.dbc"), "--out", str(out)]
    assert CliRunner().invoke(commands, call).exit_code == 0
    assert "bus.Heights.HeightLeft" in out.read_text()
    again = CliRunner().invoke(commands, call)
    assert again.exit_code == 2
    assert "exists already" in again.output


@pytest.mark.parametrize("nobody", ["Vector__XXX", "XXX"])
def test_without_senders_the_skeleton_is_the_same_and_says_so(tmp_path, nobody):
    named = tmp_path / "named.dbc"
    named.write_text(
        'VERSION ""\nNS_ :\nBS_:\nBU_: PLC BENCH\nBO_ 256 Heights: 8 PLC\n'
        ' SG_ HeightLeft : 0|16@1- (0.01,0) [0|0] "mm" BENCH\n SG_ HeightRight : 16|16@1- (0.01,0) [0|0] "mm" BENCH\n'
        'BO_ 257 Air: 8 PLC\n SG_ BellowsPressureLeft : 0|16@1- (0.001,0) [0|0] "bar" BENCH\n'
        'BO_ 258 Setpoints: 8 BENCH\n SG_ ForceSetpointVerticalLeft : 0|16@1- (1,0) [0|0] "N" PLC\n'
    )
    other = tmp_path / "other.dbc"
    other.write_text(named.read_text().replace("PLC", nobody).replace("BENCH", nobody))
    texts = [skeleton(path, None, tmp_path) for path in (named, other)]
    one, another = (
        {name: entry for name, entry in tomllib.loads(text)["signals"].items() if point(entry)}
        for text in texts
    )
    assert one == another
    assert "left.height" in one and one["vertical_left.force_setpoint"]["to"].endswith(
        "ForceSetpointVerticalLeft"
    )
    assert "does not name the sender" not in texts[0] and "does not name the sender of 4 signals" in texts[1]


def test_units_in_utf8_are_read_correctly(tmp_path):
    path = tmp_path / "rig.dbc"
    for charset in ("utf-8", "utf-8-sig", "cp1252"):
        path.write_text(
            'VERSION ""\nNS_ :\nBS_:\nBU_: PLC BENCH\nBO_ 256 Gas: 8 PLC\n'
            ' SG_ TemperaturBalgLinks : 0|16@1- (0.01,0) [0|0] "°C" BENCH\n',
            encoding=charset,
        )
        told = tomllib.loads(skeleton(path, None, tmp_path))["signals"]["left.bellows_temperature"]
        assert told == {"from": "bus.Gas.TemperaturBalgLinks", "unit": "degC"}


@pytest.mark.parametrize(
    ("text", "unit"),
    [
        ("psia", WrittenUnit("psi", absolute=True)),
        ("PSIG", WrittenUnit("psi")),
        ("bar(a)", WrittenUnit("bar", absolute=True)),
        ("mbar abs.", WrittenUnit("mbar", absolute=True)),
        ("kPa abs", WrittenUnit("kPa", absolute=True)),
        ("[bar g]", WrittenUnit("bar")),
        ("0.01 mm", WrittenUnit("mm", factor=0.01)),
        ("1/100 mm", WrittenUnit("mm", factor=0.01)),
        ("x0,1 °C", WrittenUnit("degC", factor=0.1)),
        ("deg F", WrittenUnit("degF")),
        ("µrad", WrittenUnit("urad")),
        ("MN", WrittenUnit("MN")),
        ("mN", WrittenUnit("mN")),
        ("mn", WrittenUnit("mn")),  # ambiguous
        ("1/m", WrittenUnit("1/m")),
        ("4-20 mA", WrittenUnit("4-20 mA")),
    ],
)
def test_units_are_those_that_people_mean(text, unit):
    assert unit_of(text) == unit


def test_every_unit_parses_and_another_case_is_equal_or_invalid():
    for name in UNITS:
        assert unit_of(name).name == name
        assert unit_of(name.upper()).name in (
            name,
            name.upper(),
            *(one for one in UNITS if one == name.upper()),
        )


def test_raw_values_that_a_dbc_names_become_null_and_the_file_can_be_read(tmp_path):
    dbc = tmp_path / "rig.dbc"
    dbc.write_text(
        'VERSION ""\nNS_ :\nBS_:\nBU_: PLC B\nBO_ 256 Spring: 8 PLC\n'
        ' SG_ Height : 0|16@1+ (0.1,-300) [0|0] "mm" B\n SG_ Mode : 16|8@1+ (1,0) [0|0] "" B\n\n'
        'VAL_ 256 Height 65534 "Fehler" 65535 "SNA" ;\nVAL_ 256 Mode 0 "Off" 1 "On" ;\n'
    )
    told = tomllib.loads(skeleton(dbc, None, tmp_path))["transports"]["bus"]
    assert told["points"] == {"Spring.Height": {"null": [65534, 65535]}}
    for points, raw, value in (
        (told["points"], 65534, math.nan),
        ({}, 65535, math.nan),  # the DBC alone says it
        ({"Spring.Height": {"null": []}}, 65535, 6253.5),
        ({"Spring.Height": {"null": 0}}, 0, math.nan),
    ):
        message = read_messages("transports.bus", {**told, "points": points}, tmp_path, None, None)["Spring"]
        received = message.decode(raw.to_bytes(2, "little") + bytes(6))
        assert received["Spring.Height"] == pytest.approx(value, nan_ok=True)
