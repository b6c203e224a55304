"""A rig file that names a wiring: refusals before anything is sent, its end, and a running rig."""

import socket

import numpy as np
import pytest

from astb.exit_codes import BLOCKED, MISUSE
from astb.rig_file import read
from astb.session import open_session
from bench_protocol.units import mm
from tests.drivers.own_as_file import own_description, write_wiring

WIRING = """
[transports.plc]
kind = "modbus"
host = "127.0.0.1"
port = PORT
[transports.plc.groups.fast]
every = "50 ms"
[transports.plc.points]
state = { table = "input", address = 1, group = "fast" }
command = { table = "holding", address = 0 }
[signals]
"rig.state" = { from = "plc.state", choices = { DISABLED = 0, ACTIVE = 3 } }
[[sequences.up]]
start = ["DISABLED"]
orders = [{ "plc.command" = 3 }]
end = ["ACTIVE"]
"""


@pytest.fixture
def run(astb_here, tmp_path):
    """Run aw0 on a rig with these files, at a port without a server: exit code and complaint."""

    def call(wiring: str = WIRING, rig: str = 'name = "hall"\n', *options: str):
        with socket.create_server(("127.0.0.1", 0)) as server:
            port = server.getsockname()[1]
        (tmp_path / "wiring.toml").write_text(wiring.replace("PORT", str(port)))
        (tmp_path / "rig.toml").write_text(rig)
        code, _, err = astb_here(tmp_path, "run", "aw0", "--rig", "rig.toml", *options)
        return code, err

    return call


def test_a_rig_that_does_not_answer_blocks_the_plan(run):
    code, err = run()
    assert code == BLOCKED
    assert "127.0.0.1" in err


@pytest.mark.parametrize(
    ("was", "becomes", "message"),
    [
        ('"rig.state"', '"rig.stat"', "wiring.toml: signals.\"rig.stat\" is not a signal; did you mean 'rig.state'?"),
        ('"plc.state"', '"plc.stat"', 'wiring.toml: signals."rig.state".from = \'plc.stat\': '),
        ("address = 1,", "address = 70000,", "wiring.toml: transports.plc"),
        ('kind = "modbus"', 'kind = "modbos"', "wiring.toml: transports.plc"),
        ('end = ["ACTIVE"]', 'end = ["HOLD"]', "the rig never reports HOLD"),
    ],
)  # fmt: skip
def test_a_wiring_that_cannot_be_is_misuse(run, was, becomes, message):
    code, err = run(WIRING.replace(was, becomes))
    assert code == MISUSE
    assert message in err


@pytest.mark.parametrize(
    ("rig", "message"),
    [
        ('name = "a"\n[simulation]\n', "remove simulation, or the wiring"),
        ('name = "a"\n[can]\n[modbus]\n', "remove can and modbus, or the wiring"),
        ('name = "a"\nwiring = 3\n', "wiring = 3; use a text or a table of keys"),
        ('name = "a"\n[wiring]\ntransports = {}\nsignals = {}\n', "rig.toml: wiring.transports is empty"),
        (
            'name = "a"\n[wiring]\nsignal = {}\n',
            "rig.toml: wiring: there is no key 'signal' here; did you mean",
        ),
    ],
)
def test_a_rig_file_that_does_not_go_with_its_wiring(run, rig, message):
    code, err = run(WIRING, rig)
    assert code == MISUSE
    assert message in err


def test_a_rig_with_a_wiring_has_real_time(run):
    code, err = run(WIRING, 'name = "hall"\n', "--virtual")
    assert code == MISUSE
    assert "there is no [simulation] table; virtual time needs one" in err


@pytest.mark.slow
@pytest.mark.real_time
def test_a_running_rig_is_moved_over_the_wires_as_a_file_describes_them(shared_rig, tmp_path):
    keys = own_description(tmp_path, generator=False)
    keys["transports"]["bus"] |= {"bus": "tcp", "host": "127.0.0.1", "port": shared_rig.can_port}
    keys["transports"]["plc"] |= {"port": shared_rig.modbus_port}
    path = tmp_path / "rig.toml"
    write_wiring(tmp_path, keys).rename(tmp_path / "wiring.toml")
    path.write_text('name = "own"\n')
    with open_session(read(path), path) as session, session.bench as bench:
        bench.arm()
        bench.vertical.hold_position()
        with bench.capture("vertical_left.displacement") as capture:
            bench.generator.run("vertical", amplitude=3 * mm, frequency=2.0, cycles=4)
        bench.disarm()
        assert np.ptp(capture.values("vertical_left.displacement")) == pytest.approx(6 * mm, abs=0.5 * mm)
        assert np.diff(capture.times("vertical_left.displacement")).min() > 0
        assert bench.rig.strangers == 0
