"""A commander that crashes or is stopped by a signal, as another client on the bus sees it."""

import re
import select
import signal
import subprocess
import sys

import pytest

from bench_protocol.rates import HOLD_AFTER
from bench_protocol.table import TABLE
from bench_protocol.units import NS, ms

COMMANDER = """
import sys
from pathlib import Path
from astb.rig_file import read
from astb.session import real_session
from drivers.errors import BenchError
with real_session(read(Path(sys.argv[1])), Path(sys.argv[1])) as session:
    session.bench.connect(within=10)
    session.bench.arm()
    print("armed", flush=True)
    try:
        session.bench.wait(60)
    except BenchError as error:
        print(f"told: {error}", flush=True)
"""
RIG = """name = "test"
[can]
bus = "{bus}"
port = {can}
[modbus]
port = {modbus}
"""


def commander(site, tmp_path) -> list[str]:
    """Return the way to start a commander of the site's rig, without another commander."""
    site.close_shared()
    rig, path = site.rig, tmp_path / "rig.toml"
    bus = "tcp" if rig.can_port else rig.can
    path.write_text(RIG.format(bus=bus, can=rig.can_port or 1, modbus=rig.modbus_port))
    return [sys.executable, "-c", COMMANDER, str(path)]


def line_of(process) -> str:
    assert select.select([process.stdout], [], [], 60)[0], "the commander says nothing"
    return process.stdout.readline()


@pytest.mark.parametrize("site", ["tcp", pytest.param("socketcan", marks=pytest.mark.vcan)], indirect=True)
def test_a_killed_commander_leaves_the_bench_in_hold(site, tmp_path, eventually):
    command = commander(site, tmp_path)
    with (
        subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process,
        site.listening() as received,
    ):
        assert line_of(process) == "armed\n"
        site.wait(200 * ms)
        process.kill()
        process.wait()
        eventually(lambda: received.positions("Emergency").size, what="an emergency message")
        eventually(lambda: received.states()[-1].startswith("FAULT"), what="the fault")
    frames, emergency = received.frames(), received.positions("Emergency")[0]
    last = received.positions("Control")[-1]
    states = received.states()
    assert states[states.index("ACTIVE") + 1] == "FAULT_HOLD"
    # In the rig's own time, and by the time stamps of rig and hub, or of the kernel.
    assert received.rig_time(last, emergency) <= HOLD_AFTER
    assert (frames["time"][emergency] - frames["time"][last]) / NS <= HOLD_AFTER + 50 * ms
    reason = TABLE["rig.reason"].choices[int(received.series("emergency.reason")[-1])]
    assert reason == "commander disconnected", "the closed Modbus connection reports it first"
    with site.bench() as successor:
        successor.reset()
        assert successor.rig.state in ("HOLD", "DISABLED")


@pytest.mark.slow
@pytest.mark.parametrize("site", ["tcp"], indirect=True)
def test_a_stopped_commander_loses_the_lease_and_is_informed(site, tmp_path, eventually):
    command = commander(site, tmp_path)
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert line_of(process) == "armed\n"
        process.send_signal(signal.SIGSTOP)
        modbus = site.modbus()
        eventually(
            lambda: modbus.read_holding(0, 1) == [0], what="the lease of a commander who is stopped to end"
        )
        modbus.close()
        with site.bench() as successor:
            process.send_signal(signal.SIGCONT)
            told = line_of(process)
            assert re.match("told: .*(no longer has the lease|this commander has lost its lease)", told), told
            assert "somebody else tries" not in told
            successor.wait(200 * ms)
            assert successor.wiring.given["control.token"] == successor.rig.lease
        process.kill()
