"""Rig B on an interface of the kernel: led by hand, and through the whole of AW0, over real SocketCAN."""

import json
import subprocess
import sys

import pytest

from astb.exit_codes import INCOMPLETE
from astb.rig_file import read
from astb.session import open_session
from bench_protocol.units import bar, mm
from drivers.can_port import has_interface
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
            assert bench.left.height == pytest.approx(-52.2 * mm, abs=0.2 * mm)
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


@pytest.mark.slow
@pytest.mark.timeout(420)
def test_aw0_judges_a_spring_on_rig_b(started, tmp_path):
    """The bolster is held sideways, where rolling tells nothing: two checks of forty are not available."""
    with started("hall_b", INTERFACE) as (rig_file, _):
        command = [sys.executable, "-m", "astb", "run", "aw0", "--rig", str(rig_file), "--out", str(tmp_path)]
        done = subprocess.run(command, cwd=ROOT, check=False, capture_output=True, text=True, timeout=400)
    assert done.returncode == INCOMPLETE, done.stdout + done.stderr
    verdicts = [one["verdict"] for one in json.loads((tmp_path / "aw0/result.json").read_text())["checks"]]
    assert (len(verdicts), verdicts.count("not available"), verdicts.count("fail")) == (40, 2, 0), done.stdout
