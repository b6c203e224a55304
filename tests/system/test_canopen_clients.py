"""python's canopen with our EDS, over the rig's real wires: one node that boots, beats, obeys NMT and answers SDOs."""

import re
import struct
import threading
import time
from collections.abc import Iterator
from importlib.resources import files
from pathlib import Path
from typing import Any

import can
import canopen
import cantools
import pytest
from canopen.sdo import SdoAbortedError

from bench_protocol.canopen import NODE
from bench_protocol.frames import frame
from bench_protocol.table import TABLE
from drivers.errors import RigFault
from tests.refusals import refuses

ROOT = Path(__file__).parents[2]
GENERATED = files("bench_protocol") / "generated"
REAL = ("tcp", pytest.param("socketcan", marks=pytest.mark.vcan))
on_real_wires = pytest.mark.parametrize("site", REAL, indirect=True)
SETTLED = 0.05  # s, more than a frame needs


@pytest.fixture
def network(site) -> Iterator[canopen.Network]:
    site.close_shared()
    if site.transport == "tcp":
        options = {"interface": "astb-hub", "host": "127.0.0.1", "port": site.rig.can_port}
    else:
        options = {"interface": "socketcan"}
    network = canopen.Network(can.Bus(channel="vcan0", ignore_config=True, **options))
    network.connect()
    yield network
    network.disconnect()


@pytest.fixture
def node(network) -> Iterator[canopen.RemoteNode]:
    node = network.add_node(canopen.RemoteNode(NODE, str(GENERATED / "astb.eds")))
    node.sdo.RESPONSE_TIMEOUT = 1.0
    node.sdo["Producer heartbeat time"].raw = 100
    yield node
    # Its neighbours want the rig as it was.
    node.nmt.send_command(0x82)
    time.sleep(SETTLED)


@on_real_wires
def test_the_node_boots_beats_and_obeys(node, network) -> None:
    assert node.nmt.wait_for_heartbeat(2) == "OPERATIONAL"
    received: list[int] = []
    for identifier in (0x181, 0x282):
        network.subscribe(identifier, lambda identifier, data, timestamp: received.append(identifier))
    for state, sends in (("PRE-OPERATIONAL", False), ("STOPPED", False), ("OPERATIONAL", True)):
        node.nmt.state = state
        node.nmt.wait_for_heartbeat(2)  # which may have been on its way before the command arrived
        node.nmt.wait_for_heartbeat(2)
        assert node.nmt.state == state
        received.clear()
        time.sleep(0.2)
        assert bool(received) is sends, state
    # wait_for_bootup would miss what arrives before it begins to wait.
    booted = threading.Event()
    node.nmt.add_heartbeat_callback(lambda state: state == 0 and booted.set())
    node.nmt.send_command(0x81)
    assert booted.wait(2)
    assert node.sdo["Producer heartbeat time"].raw == 1000


@on_real_wires
def test_it_answers_sdos(node) -> None:
    assert node.sdo["Manufacturer device name"].raw == "ASTB virtual air spring test bench", "in segments"
    assert node.sdo["Identity object"]["Revision number"].raw == TABLE.map_hash
    assert 250 < node.sdo["left.bellows_temperature"].raw < 330
    assert node.sdo["State"]["rig.state"].raw == node.sdo["rig.state"].raw
    assert node.sdo["interlock.estop"].raw is False
    for name, code in (("Device type", 0x06010002), ("supply.pressure", 0x06010002)):
        with pytest.raises(SdoAbortedError) as refused:
            node.sdo[name].raw = 0
        assert refused.value.code == code
    with pytest.raises(SdoAbortedError) as refused:
        print(node.sdo["Token"].raw)
    assert refused.value.code == 0x06010001
    with pytest.raises(SdoAbortedError) as refused:
        node.sdo["Producer heartbeat time"].raw = 20
    assert refused.value.code == 0x06090032


@pytest.mark.slow
@on_real_wires
def test_pdos_decode_as_the_dbc_says_and_come_with_sync_if_asked_to(node, network) -> None:
    """The mapping is read from the node itself."""
    database = cantools.database.load_file(str(GENERATED / "astb.dbc"))
    node.tpdo.read()
    pairs: dict[str, bytes] = {}
    for number, name in ((1, "SpringLeft"), (5, "LoadCells"), (18, "State"), (35, "Identity")):
        pdo = node.tpdo[number]
        assert pdo.wait_for_reception(1) is not None, name
        with pdo.receive_condition:
            pairs[name] = bytes(pdo.data)
            theirs = {variable.od.signal_name: variable.raw * variable.od.factor for variable in named(pdo)}
        message = database.get_message_by_name(name)
        dbc = message.decode(pairs[name], decode_choices=False)
        compared = {key.replace(".", "_"): value for key, value in theirs.items()}
        assert compared and set(compared) <= set(dbc)
        for key, value in compared.items():
            assert value == pytest.approx(dbc[key], rel=1e-9), key
    pdo = node.tpdo[1]
    pdo.trans_type = 2
    pdo.save()
    times: list[float] = []
    pdo.add_callback(lambda pdo: times.append(pdo.timestamp))
    time.sleep(0.2)
    del times[:]
    network.sync.start(0.05)
    time.sleep(1.0)
    network.sync.stop()
    assert 8 <= len(times) <= 11, "with every second SYNC"


def named(pdo: canopen.pdo.PdoMap) -> list[canopen.pdo.PdoVariable]:
    """The variables of a PDO that are signals."""
    found = [variable for variable in pdo.map if variable.subindex < 0xFC]
    for variable in found:
        variable.od.signal_name = variable.od.name
    return found


@on_real_wires
def test_emergencies_arrive_and_stay_readable(node, site, eventually) -> None:
    before = len(node.emcy.log)
    site.press_estop()
    try:
        eventually(lambda: len(node.emcy.log) > before, what="an emergency message")
    finally:
        site.release_estop()
    told = node.emcy.log[-1]
    assert (told.code, told.register) == (0xFF02, 0x81)
    assert node.sdo["Error register"].raw == 0x81
    assert node.sdo["Pre-defined error field"][1].raw & 0xFFFF == 0xFF02


@pytest.mark.slow
@on_real_wires
def test_the_bench_holds_when_the_guarded_heartbeat_of_its_commander_stops(node, network, site) -> None:
    with site.bench() as bench:
        bench.arm()
        with pytest.raises(SdoAbortedError) as refused:
            node.sdo["Consumer heartbeat time"][1].raw = 0x7F << 16 | 400
        assert refused.value.code == 0x08000022, "not without the token"
        # On a hub the node takes it from the connection that commands, and from no other.
        for index, sub, data in (
            (0x2001, 0, struct.pack("<H", int(bench.rig.lease))),
            (0x1016, 1, struct.pack("<I", 0x7F << 16 | 400)),
        ):
            head = struct.pack("<BHB", 0x23 | (4 - len(data)) << 2, index, sub)
            bench.wiring.carrier.can.send(frame(0x601, head + data.ljust(4, b"\0")))
            bench.wait(0.05)
        beating = network.send_periodic(0x77F, b"\x05", 0.05)
        bench.wait(0.8)
        node.nmt.state = "STOPPED"
        bench.wait(0.1)
        assert bench.rig.state == "ACTIVE", "an NMT command has no token either"
        beating.stop()
        with refuses(RigFault, "heartbeat"):
            bench.wait(2)
        with bench.despite_faults():
            bench.wait_for(lambda: bench.rig.state == "FAULT_HOLD", within=0.2)
        bench.reset()
        assert bench.rig.state == "HOLD"


@pytest.mark.parametrize("site", ["tcp"], indirect=True)
def test_the_how_to_does_what_it_says(site, tmp_path, monkeypatch, capsys) -> None:
    site.close_shared()
    page = (ROOT / "docs" / "how-to" / "use-can-and-modbus-tools.md").read_text(encoding="utf-8")
    (program,) = [
        block for block in re.findall(r"```python\n(.*?)```", page, re.S) if "import canopen" in block
    ]
    (tmp_path / "astb.eds").write_text((GENERATED / "astb.eds").read_text(encoding="utf-8"), encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    names: dict[str, Any] = {}
    try:
        exec(program.replace("29536", str(site.rig.can_port)), names)
        received = names["rig"].tpdo[1].wait_for_reception(1)
        assert received is not None, "with SYNC"
    finally:
        names["network"].sync.stop()
        names["rig"].nmt.send_command(0x82)
        time.sleep(SETTLED)
        names["network"].disconnect()
    state, metres, millimetres = capsys.readouterr().out.splitlines()
    assert state == "OPERATIONAL ASTB virtual air spring test bench"
    assert 1000 * float(metres.split()[0]) == pytest.approx(float(millimetres.split()[0]), abs=0.5)


@on_real_wires
def test_one_node_answers_where_identifiers_suggest_several(node, network) -> None:
    time.sleep(0.3)
    assert len(network.scanner.nodes) > 1
    network.scanner.reset()
    answering = []
    network.subscribe(0x581, lambda identifier, data, timestamp: answering.append(1))
    for other in range(2, 7):
        network.subscribe(0x580 + other, lambda identifier, data, timestamp: answering.append(identifier))
    network.scanner.search(limit=8)
    time.sleep(0.3)
    assert answering == [1]
