"""The example of a user's program: it runs, and the how-to is correct about the rig."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

from bench_protocol.e2e import COUNTER_PERIOD, POLYNOMIAL
from bench_protocol.registers import ACTIVE_BLOCK, LEASE_ADDRESS, WATCHDOG_ADDRESS
from bench_protocol.table import TABLE
from bench_sim.rig.registers import WATCHDOG_MS_MAX

PAGE = Path(__file__).parents[2] / "docs" / "how-to" / "use-can-and-modbus-tools.md"
REAL = ("tcp", pytest.param("socketcan", marks=pytest.mark.vcan))


@pytest.fixture(scope="module")
def program() -> str:
    return (Path(__file__).parent / "command.py").read_text()


def test_the_program_contains_no_code_of_ours(program):
    imports = set(re.findall(r"^(?:import|from) (\w+)", program, flags=re.MULTILINE))
    assert imports <= {"can", "cantools", "csv", "pathlib", "pymodbus", "sys", "threading", "time"}


@pytest.mark.parametrize("site", REAL, indirect=True)
def test_the_program_runs(site, program, astb_command, tmp_path):
    site.close_shared()
    if site.transport == "tcp":
        bus = [
            "interface=socketcand",
            "channel=vcan0",
            "host=127.0.0.1",
            f"port={site.rig.can_port}",
            "tcp_tune=True",
        ]
    else:
        bus = ["interface=socketcan", "channel=vcan0"]
    (tmp_path / "command.py").write_text(program)

    def run(*command: str) -> str:
        done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=60, check=False)
        assert done.returncode == 0, done.stderr
        return done.stdout

    run(*astb_command, "rig", "signals", "--dbc", "astb.dbc", "--csv", "map.csv")
    said = run(sys.executable, "command.py", f"127.0.0.1:{site.rig.modbus_port}", *bus)
    told = re.findall(r"rig_state = (\w+)", said)
    assert told == ["DISABLED", "AIR_LOW", "AIR_HIGH", "HOLD", "ACTIVE", "DISABLED"]
    heights = [float(height) for height in re.findall(r"platform_vertical = (\S+)", said)]
    up, down = heights
    assert up > 4.8
    assert down < 0.2
    modbus = site.modbus()
    assert modbus.read_holding(LEASE_ADDRESS, 2) == [0, 0], "the bench is given back"
    modbus.close()


def test_the_page_says_what_the_rig_does():
    page = " ".join(PAGE.read_text().split())
    for said in (
        f"holding register {LEASE_ADDRESS}",
        f"holding register {WATCHDOG_ADDRESS}",
        f"1 to {WATCHDOG_MS_MAX}",
        f"polynomial {POLYNOMIAL:#x}".replace("0x1d", "0x1D"),
        f"0 to {COUNTER_PERIOD - 1}",
        f"address of the setting + {ACTIVE_BLOCK}",
    ):
        assert said in page
    for name in re.findall(r"`((?:rig|action)\.\w+)`", page):
        assert name in TABLE.index
    for name in re.findall(r"`(control_\w+)`", page):
        assert name.replace("_", ".", 1) in TABLE.index
