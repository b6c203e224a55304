"""A commander that dies by SIGKILL: the rig holds within 100 ms, as somebody else on the bus sees it."""

import select
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
with real_session(read(Path(sys.argv[1]))) as session:
    session.bench.connect(within=10)
    session.bench.arm()
    print("armed", flush=True)
    session.bench.wait(60)
"""
RIG = """name = "test"
[can]
bus = "{bus}"
port = {can}
[modbus]
port = {modbus}
"""


@pytest.mark.parametrize("site", ["tcp", pytest.param("socketcan", marks=pytest.mark.vcan)], indirect=True)
def test_a_killed_commander_leaves_the_bench_in_hold(site, tmp_path, eventually):
    site.close_shared()
    rig = site.rig
    path = tmp_path / "rig.toml"
    bus = "tcp" if rig.can_port else rig.can
    path.write_text(RIG.format(bus=bus, can=rig.can_port or 1, modbus=rig.modbus_port))
    command = [sys.executable, "-c", COMMANDER, str(path)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process, site.listening() as heard:
        assert process.stdout
        assert select.select([process.stdout], [], [], 60)[0], "the commander says nothing"
        assert process.stdout.readline() == "armed\n"
        site.wait(200 * ms)
        process.kill()
        process.wait()
        eventually(lambda: heard.positions("Emergency").size, what="an emergency message")
        eventually(lambda: heard.states()[-1].startswith("FAULT"), what="the fault")
    frames, emergency = heard.frames(), heard.positions("Emergency")[0]
    last = heard.positions("Control")[-1]
    states = heard.states()
    assert states[states.index("ACTIVE") + 1] == "FAULT_HOLD"
    # In the rig's own time, and by the time stamps of rig and hub, or of the kernel.
    assert heard.rig_time(last, emergency) <= HOLD_AFTER
    assert (frames["time"][emergency] - frames["time"][last]) / NS <= HOLD_AFTER + 50 * ms
    reason = TABLE["rig.reason"].choices[int(heard.series("emergency.reason")[-1])]
    assert reason == "commander disconnected", "the closed Modbus connection tells it first"
    with site.bench() as successor:
        successor.reset()
        assert successor.rig.state in ("HOLD", "DISABLED")
