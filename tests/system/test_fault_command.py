"""Faults on a rig in real time: the command, the control socket, and the values that clients then receive."""

import json
import math
import os
import socket
import stat
import struct
import time
from collections.abc import Callable, Iterator
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest

from astb.exit_codes import BLOCKED, MISUSE, PASS
from bench_protocol.named_files import named_files
from bench_protocol.table import TABLE
from bench_protocol.table_signals import MEASUREMENTS
from bench_sim.parameters import load
from bench_sim.rig.control_socket import LINE_MAX, ask, control_path
from bench_sim.rig.faults.catalogue import FAULTS
from bench_sim.rig.rig import Rig
from drivers.can_port import open_can
from drivers.errors import LinkLost, Refused
from drivers.modbus_port import open_modbus
from tests.refusals import refuses

LOCAL = named_files("rigs")["local"]
READ = b"\0\7\0\0\0\6\1\4\0\1\0\2"  # two input registers: the hash of the map
HASH = b"\0\7\0\0\0\7\1\4\4" + struct.pack(">I", TABLE.map_hash)
LATE = next(r.address for r in TABLE.registers if r.signal == "rig.late_ticks" and r.encoding == "float32")


@pytest.fixture
def cli(astb_here, tmp_path):
    """Run ``astb`` with arguments in an empty directory: exit code, stdout, stderr."""
    return lambda *arguments: astb_here(tmp_path, *arguments)


@pytest.fixture(scope="module")
def sound_rig() -> Rig:
    return Rig(load(), seed=1)


@pytest.fixture
def path(shared_rig) -> Path:
    return Path(shared_rig.ready.rpartition("control=")[2])


@pytest.fixture
def order(path) -> Iterator[Callable[..., dict]]:
    yield lambda **order: json.loads(ask(path, json.dumps(order).encode()))
    ask(path, b'{"do": "off", "name": "all"}')


@pytest.fixture
def fault(cli, shared_rig):
    """`astb rig fault` for this shared_rig."""
    return lambda *words: cli("rig", "fault", *words, "--rig", LOCAL, "--modbus-port", shared_rig.modbus_port)


def read_hash(rig) -> list[int]:
    """Read two registers as a driver does, over a separate connection."""
    with closing(open_modbus("127.0.0.1", rig.modbus_port, timeout=0.3)) as modbus:
        return modbus.read_input(1, 2)


def received(rig, request: bytes, until: float = 0.3) -> list[tuple[float, bytes]]:
    """Send a request and return the pieces of its answer with their times (s), until nothing has come for a while."""
    pieces = []
    with socket.create_connection(("127.0.0.1", rig.modbus_port), timeout=until) as connection:
        start = time.monotonic()
        connection.sendall(request)
        try:
            while part := connection.recv(4096):
                pieces.append((time.monotonic() - start, part))
        except TimeoutError:
            pass
    return pieces


def test_the_command_breaks_mends_and_says_what_is_on(fault, shared_rig):
    code, out, err = fault("list")
    assert (code, err) == (PASS, "")
    assert all(f"  {name} " in out for name in FAULTS)
    assert "no fault is on" in out
    code, out, err = fault("on", "bias", "sensor=left.height", "value=5mm")
    assert (code, err) == (PASS, "")
    assert out.startswith("on: bias.left.height sensor=left.height value=5mm (since ")
    assert fault("on", "drop", "probability=50%", "--for", "60s")[0] == PASS
    code, out, _ = fault("list")
    assert "  bias.left.height sensor=left.height value=5mm (since " in out
    assert "  drop probability=50% (since " in out
    assert ", until " in out
    assert fault("off", "bias") == (PASS, "off: bias.left.height\n", "")
    assert fault("off", "all") == (PASS, "off: drop\n", "")
    assert fault("off", "all") == (PASS, "no fault was on\n", "")


@pytest.mark.parametrize(
    ("name", "given", "said"),
    [
        ("dorp", "", "dorp is not a fault; did you mean 'drop'?"),
        ("drop", "probabilty=5%", "probabilty is not a parameter of drop; did you mean 'probability'?"),
        ("drop", "probability=500%", "drop: probability = 500% is outside 0.01 to 100 %"),
        ("drop", "probability=5", "drop: probability = 5 is outside 0.01 to 100 %"),
        (
            "drop",
            "probability=5mm",
            "drop: probability = '5mm' has a missing or wrong unit; use 1 or % or ppm",
        ),
        ("drop", "seed=0.5", "drop: seed = 0.5 is not a whole number"),
        ("drop", "direction=up", "direction = up is unknown; use one of from_rig, to_rig, both"),
        ("bias", "sensor=left.height", "bias: value (size of the error) is missing; use"),
        ("bias", "sensor=left.height value=9m", "bias: value = 9m is outside -600 to 600 mm"),
        ("bias", "sensor=left.height value=nanm", "bias: value = nanm is outside -600 to 600 mm"),
        (
            "bias",
            "sensor=left.hight value=1mm",
            "bias: sensor = left.hight is unknown; did you mean 'left.height'?",
        ),
        (
            "drift",
            "sensor=left.height value=1mm",
            "drift: value = '1mm' has a missing or wrong unit; use m/s or mm/s",
        ),
        ("leak", "side=left for=soon", "for = 'soon' is not a number with its unit"),
        ("leak", "side=left for=0s", "for = 0 s is outside 0.001 to 86400 s"),
    ],
)
def test_invalid_faults_are_refused_with_a_reason(sound_rig, name, given, said):
    values = dict(word.split("=") for word in given.split())
    lasting = {"for": values.pop("for")} if "for" in values else {}
    before = sound_rig.plant.parameter_array.tobytes()
    answer = sound_rig.order(json.dumps({"do": "on", "name": name, "values": values, **lasting}).encode())
    assert said in json.loads(answer)["error"]
    assert json.loads(sound_rig.order(b'{"do": "list"}'))["on"] == []
    assert sound_rig.plant.parameter_array.tobytes() == before


def test_what_is_not_on_cannot_be_switched_off(sound_rig):
    def off(name: str) -> str:
        return json.loads(sound_rig.order(json.dumps({"do": "off", "name": name}).encode()))["error"]

    assert off("leak") == "leak is not on; no fault is on"
    assert off("lake") == "lake is not a fault; did you mean 'leak'?"


def test_misuse_of_the_command_has_its_exit_code(fault, cli):
    assert fault("on", "dorp") == (MISUSE, "", "astb: dorp is not a fault; did you mean 'drop'?\n")
    text = "astb: probability has no value; write KEY=VALUE, such as area=2mm2\n"
    assert fault("on", "drop", "probability") == (MISUSE, "", text)
    assert cli("rig", "fault", "list", "--rig", LOCAL.with_name("hall.toml"))[0] == MISUSE


def test_the_socket_is_private(shared_rig, path, order):
    assert path == control_path("127.0.0.1", shared_rig.modbus_port)
    assert stat.S_IMODE(path.stat().st_mode) == 0o600
    assert stat.S_IMODE(path.parent.stat().st_mode) == 0o700
    assert path.stat().st_uid == os.getuid()
    assert len(order(do="list")["faults"]) == len(FAULTS)


def test_bad_lines_are_answered_without_effect(shared_rig, path, order):
    bad = [
        b"",
        b"{",
        b"[]",
        b'{"do": 1}',
        b'{"do": "burn"}',
        b'{"do": "list", "more": 1}',
        b"\xff\xfe",
        b"[" * 4000,
    ]
    bad += [
        b'{"do": "on", "name": "drop", "values": {"seed": [1]}}',
        b'{"do": "off"}',
        b'{"do": "list", "name": "x"}',
    ]
    with socket.socket(socket.AF_UNIX) as connection:
        connection.settimeout(2)
        connection.connect(str(path))
        connection.sendall(b"\n".join(bad) + b"\n")
        with connection.makefile("rb") as answers:
            for line in bad:
                assert "error" in json.loads(answers.readline()), line
            connection.sendall(b" " * (LINE_MAX + 1))
            assert "at most" in json.loads(answers.readline())["error"]
            assert answers.readline() == b"", "closed"
    assert order(do="list")["on"] == []


@pytest.mark.slow
def test_modbus_faults_reach_the_sockets(shared_rig, order):
    assert b"".join(part for _, part in received(shared_rig, READ, 0.1)) == HASH
    order(do="on", name="modbus_split", values={"size": 2, "gap": "20 ms"})
    pieces = received(shared_rig, READ * 2)
    assert b"".join(part for _, part in pieces) == HASH * 2
    assert len(pieces) >= 10
    assert all(len(part) <= 4 for _, part in pieces)
    order(do="off", name="all")
    order(do="on", name="modbus_slow", values={"by": "150 ms"})
    ((when, answer),) = received(shared_rig, READ)
    assert answer == HASH
    assert 0.14 < when < 0.3
    order(do="off", name="all")
    for name in ("modbus_silence", "hung_plc"):
        order(do="on", name=name)
        assert received(shared_rig, READ, 0.15) == []
        order(do="off", name=name)
    order(do="on", name="modbus_exception", values={"code": 6})
    with refuses(Refused, "exception 6"):
        read_hash(shared_rig)
    order(do="off", name="all")
    order(do="on", name="modbus_junk", values={"what": "noise"})
    with pytest.raises(LinkLost):
        read_hash(shared_rig)
    order(do="off", name="all")
    assert b"".join(part for _, part in received(shared_rig, READ, 0.1)) == HASH


def test_connections_close_and_come_back(shared_rig, order):
    lost: list[str] = []
    modbus = open_modbus("127.0.0.1", shared_rig.modbus_port, timeout=0.3)
    can = open_can("tcp", port=shared_rig.can_port)
    can.on_lost(lost.append)
    order(do="on", name="plc_restart", **{"for": "300 ms"})
    order(do="on", name="interface_down", **{"for": "300 ms"})
    time.sleep(0.1)
    with pytest.raises(LinkLost):
        modbus.read_input(1, 2)
    assert len(lost) == 1
    with pytest.raises(LinkLost):
        open_can("tcp", port=shared_rig.can_port)
    time.sleep(0.4)
    assert len(read_hash(shared_rig)) == 2
    modbus.close()
    again = open_can("tcp", port=shared_rig.can_port)
    heard: list[np.ndarray] = []
    again.subscribe(heard.append)
    time.sleep(0.2)
    assert sum(len(block) for block in heard) > 50
    again.close()
    assert order(do="list")["on"] == []


def test_bus_and_tick_are_disturbed_in_real_time(shared_rig, order):
    heard: list[np.ndarray] = []
    can = open_can("tcp", port=shared_rig.can_port)
    can.subscribe(heard.append)
    order(do="on", name="babble", values={"identifier": 3, "rate": "1000 Hz"})
    order(do="on", name="bias", values={"sensor": "left.height", "value": "50 mm"})
    order(do="on", name="late_ticks", values={"by": "30 ms", "every": "100 ms"})
    time.sleep(0.8)
    order(do="off", name="all")
    frames = np.concatenate(heard)
    can.close()
    assert (frames["id"] == 3).sum() == pytest.approx(800, rel=0.4)
    left, right = (frames[frames["id"] == identifier] for identifier in (0x181, 0x182))
    heights = [np.ascontiguousarray(one["data"][:, :2]).view("<i2")[-1, 0] for one in (left, right)]
    assert heights[0] - heights[1] == pytest.approx(5000, abs=300), "of 10 µm"
    with closing(open_modbus("127.0.0.1", shared_rig.modbus_port)) as modbus:
        words = modbus.read_input(LATE, 2)
    late = struct.unpack(">f", struct.pack(">HH", *words))[0]
    assert not math.isnan(late)
    assert late > 5 * 25, "of 30 ticks each time"


FILE = """
name = "broken"
[simulation]
seed = 1
[[simulation.faults]]
name = "bias"
values = { sensor = "left.height", value = "50 mm" }
[[simulation.faults]]
name = "drop"
at = "1 h"
for = "3 s"
"""


@pytest.mark.slow
def test_a_rig_file_breaks_its_rig_whose_socket_goes_with_it(start_rig, tmp_path, cli):
    (tmp_path / "rig.toml").write_text(FILE)
    rig = start_rig("--can", "tcp", "--can-port", "0", "--modbus-port", "0", file=tmp_path / "rig.toml")
    path = Path(rig.ready.rpartition("control=")[2])
    on = json.loads(ask(path, b'{"do": "list"}'))["on"]
    assert [(one["label"], one["since"], one["until"]) for one in on] == [("bias.left.height", 0.0, None)]
    assert rig.stop() == ""
    assert not path.exists()
    code, out, err = cli("rig", "fault", "list", "--rig", LOCAL, "--modbus-port", rig.modbus_port)
    assert (code, out) == (BLOCKED, "")
    assert err.startswith(f"astb: no rig answers at {path}; ")


@pytest.mark.parametrize(
    ("faults", "said"),
    [
        ('name = "dorp"', "dorp is not a fault; did you mean 'drop'?"),
        ('name = "drop"\nat = "soon"', "at = 'soon' is not a number with its unit"),
        ('name = "drop"\nfor = "0 s"', "for = 0 s is outside 0.001 to 86400 s"),
        ('name = "drop"\nvalues = { seed = "x" }', "drop: seed = 'x' is not a number"),
        (
            'name = "drop"\nwhen = "1 s"',
            "simulation.faults[0].when is not a key here; use one of name, at, for, values",
        ),
        ("name = 1", "simulation.faults[0].name = 1; use a text"),
        ('at = "1 s"', "the key simulation.faults[0].name is missing"),
    ],
)
def test_a_rig_file_is_refused_in_words(cli, tmp_path, faults, said):
    file = tmp_path / "rig.toml"
    file.write_text(f'name = "x"\n[simulation]\n[[simulation.faults]]\n{faults}\n')
    code, out, err = cli("rig", "--rig", file, "--modbus-port", "0", "--can", "tcp", "--can-port", "0")
    assert (code, out) == (MISUSE, "")
    assert said in err


def as_listed(fault: dict, sensor: str) -> dict[str, str]:
    """Values for a fault by nothing but what the list says of it, for one sensor where it has one."""
    values = {}
    for one in fault["parameters"]:
        if one["name"] == "other":
            values["other"] = sensor.replace("left", "right") if "left" in sensor else "left.height"
        elif "choices" in one:
            values[one["name"]] = sensor if sensor in one["choices"] else one["usual"] or one["choices"][0]
        elif "spans" in one:
            high, _, unit = one["spans"][sensor].partition(" to ")[2].partition(" ")
            values[one["name"]] = f"{float(high) / 100:g} {unit}"
        else:
            values[one["name"]] = one["usual"]
    return values


def test_every_fault_can_be_on_by_what_the_list_says_of_it():
    """As the panel in the browser does, which knows no more."""
    sound_rig = Rig(load(), seed=1)
    faults = json.loads(sound_rig.order(b'{"do": "list"}'))["faults"]
    of_sensors = [one for one in faults if any("spans" in each for each in one["parameters"])]
    assert {one["name"] for one in of_sensors} == {"bias", "drift", "spike", "noise"}
    orders = [
        (one, "left.height") for one in faults if one["name"] not in {"plc_restart", "hung_plc", "power_loss"}
    ]
    orders += [(one, sensor.name) for one in of_sensors for sensor in MEASUREMENTS]
    for fault, sensor in orders:
        order = {"do": "on", "name": fault["name"], "values": as_listed(fault, sensor)}
        answer = json.loads(sound_rig.order(json.dumps(order).encode()))
        assert "error" not in answer, (order, answer)
        assert "off" in json.loads(sound_rig.order(b'{"do": "off", "name": "all"}'))
