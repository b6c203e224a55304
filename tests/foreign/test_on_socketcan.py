"""Rig B on an interface of the kernel: led by hand, and by plans that judge, over real SocketCAN."""

import json
import os
import subprocess
import sys

import pytest

from astb.exit_codes import INCOMPLETE, PASS
from astb.rig_file import read
from astb.session import open_session
from bench_protocol.units import bar, mm
from drivers.can_port import has_interface
from tests.foreign import AT_REST
from tests.foreign.conftest import ROOT

INTERFACE = "vcan0"
pytestmark = [pytest.mark.vcan, pytest.mark.real_time]


@pytest.fixture(autouse=True)
def _socketcan():
    if not has_interface(INTERFACE):
        pytest.skip("this kernel has no vcan0; `make test-vcan` runs these where there is one")


def test_rig_b_is_led_over_socketcan(started):
    with started("hall_b", INTERFACE) as (rig_file, address):
        assert address == INTERFACE
        with open_session(read(rig_file), rig_file) as session, session.bench as bench:
            assert bench.rig.state == "DISABLED"
            assert bench.left.height == pytest.approx(AT_REST["hall_b"] * mm, abs=0.2 * mm)
            bench.arm()
            bench.vertical.move_to(0.0, 0.0, rate=40 * mm)
            bench.air.fill(to=0.5 * bar)
            with bench.capture("lateral.displacement") as capture:
                bench.generator.run("lateral", "sine", amplitude=5 * mm, frequency=1.0, cycles=4)
            values = capture.values("lateral.displacement")
            assert values.max() - values.min() == pytest.approx(10 * mm, rel=0.05)
            bench.air.vent(tolerance=0.2 * bar)
            bench.disarm()
            assert bench.rig.state == "DISABLED"


def judged(plan, exit_code, started, tmp_path, within):
    """Run ``plan`` on rig B in a separate process; return the verdicts of its checks."""
    with started("hall_b", INTERFACE) as (rig_file, _):
        command = [sys.executable, "-m", "astb", "run", plan, "--rig", str(rig_file), "--out", str(tmp_path)]
        done = subprocess.run(command, cwd=ROOT, check=False, capture_output=True, text=True, timeout=within)
    assert done.returncode == exit_code, done.stdout + done.stderr
    return [one["verdict"] for one in json.loads((tmp_path / plan / "result.json").read_text())["checks"]]


@pytest.mark.timeout(180)
def test_leak_down_judges_a_spring_on_rig_b(started, tmp_path):
    """A minute through all layers: heights, pressures, temperatures and settings, and no limit on what time does."""
    verdicts = judged("leak_down", PASS, started, tmp_path, within=170)
    assert verdicts and set(verdicts) == {"pass"}, verdicts


@pytest.mark.slow
@pytest.mark.timeout(420)
@pytest.mark.skipif(
    os.environ.get("WITH_VCAN") == "uml",
    reason="one processor of user-mode Linux keeps no time for limits on damping; leak_down judges there",
)
def test_aw0_judges_a_spring_on_rig_b(started, tmp_path):
    """The bolster is held sideways, where rolling gives no reading: two checks of forty are not available."""
    verdicts = judged("aw0", INCOMPLETE, started, tmp_path, within=400)
    assert (len(verdicts), verdicts.count("not available"), verdicts.count("fail")) == (40, 2, 0), verdicts
