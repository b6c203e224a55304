"""Both third-party rigs as processes: whole plans on them, in parallel, and their reaction to a lost commander."""

import json
import os
import signal
import subprocess
import sys
import time
from contextlib import ExitStack

import pytest
from pymodbus.client import ModbusTcpClient

from astb.exit_codes import BLOCKED, INCOMPLETE
from tests.foreign.conftest import ROOT
from tests.foreign.plc_rig import Fault, State

pytestmark = [pytest.mark.real_time, pytest.mark.slow]
ASTB = [sys.executable, "-m", "astb"]


def begin(rig_file, plan, out):
    """Run a plan in a separate process."""
    command = [*ASTB, "run", plan, "--rig", str(rig_file), "--out", str(out)]
    return subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)


@pytest.mark.timeout(280)
def test_aw0_and_aw3_run_on_both_at_once(started, tmp_path):
    with ExitStack() as open_:
        runs = {}
        for name, plan in (("plant_a", "aw0"), ("hall_b", "aw3")):
            rig_file, _ = open_.enter_context(started(name))
            process = open_.enter_context(begin(rig_file, plan, tmp_path / name))
            open_.callback(process.kill)  # Where one fails, none of them goes on.
            runs[name] = plan, process
        for name, (plan, process) in runs.items():
            said, _ = process.communicate(timeout=250)
            assert process.returncode == INCOMPLETE, said
            checks = json.loads((tmp_path / name / plan / "result.json").read_text())["checks"]
            verdicts = [one["verdict"] for one in checks]
            assert (len(verdicts), verdicts.count("not available"), verdicts.count("fail")) == (40, 2, 0), (
                said
            )


@pytest.mark.parametrize("name", ["plant_a", "hall_b"])
def test_a_missing_third_party_rig_blocks_the_plan(name, tmp_path, wired):
    rig_file = wired(name, "127.0.0.1:1", tmp_path)
    done = begin(rig_file, "aw0", tmp_path / "out")
    said, _ = done.communicate(timeout=60)
    assert done.returncode == BLOCKED, said
    assert "127.0.0.1:1" in said


def test_rig_a_holds_and_lets_its_air_off_when_its_commander_is_killed(started, tmp_path):
    with (
        started("plant_a") as (rig_file, address),
        ModbusTcpClient("127.0.0.1", port=int(address[10:])) as plc,
    ):

        def wait_for(*states, within):
            deadline = time.monotonic() + within
            while (registers := plc.read_input_registers(1, count=3).registers)[0] not in states:
                assert time.monotonic() < deadline, f"{State(registers[0]).name} after {within} s"
                time.sleep(0.02)
            return registers

        process = begin(rig_file, "aw0", tmp_path)
        try:
            wait_for(State.RUN, within=60)
            os.kill(process.pid, signal.SIGKILL)
            killed = time.monotonic()
            assert wait_for(State.QUICK_STOP, within=2)[2] == Fault.WATCHDOG
            assert time.monotonic() - killed < 1.5
            wait_for(State.FAULT, within=5)
        finally:
            process.kill()
            process.communicate()
