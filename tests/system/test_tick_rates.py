"""A rig that ticks faster than once a millisecond: the same wires and the same bench, with a finer step."""

import os
import subprocess
import sys

import pytest

from bench_protocol.rates import TICK_RATE_VARIABLE
from bench_protocol.table import TABLE
from bench_protocol.units import mm, s
from tests.system.conftest import ANYWHERE, LiveSite


@pytest.mark.slow
@pytest.mark.timeout(400)  # it compiles a separate tick: 100 s
@pytest.mark.parametrize("rate", [5000])
def test_a_faster_rig_is_the_same_on_its_wires(start_rig, monkeypatch, tmp_path, rate: int) -> None:
    # The compiled tick of this rate must not take the place of the usual one in the cache of all other tests.
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    site = LiveSite("tcp", start_rig(*ANYWHERE, "--tick-rate", str(rate)))
    with site.bench() as bench:
        before = bench.wiring.carrier.registers.snapshot()
        with bench.capture("left.height") as capture:
            bench.wait(2 * s)
        after = bench.wiring.carrier.registers.snapshot()
        samples = len(capture.values("left.height"))
        assert samples == pytest.approx(400, abs=20), "200 a second, whatever the tick"
        assert after["rig.tick"] - before["rig.tick"] == pytest.approx(2 * rate, rel=0.1)
        bench.arm()
        bench.lateral.move_to(5 * mm)
        assert bench.lateral.displacement == pytest.approx(5 * mm, abs=1 * mm)
        bench.disarm()


def test_a_rate_that_no_rig_has_is_refused() -> None:
    done = subprocess.run(
        [sys.executable, "-c", "import bench_protocol.rates"],
        env=os.environ | {TICK_RATE_VARIABLE: "3000"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode != 0
    assert (
        "ASTB_TICK_RATE = '3000' is not a tick rate of this rig; use one of 1000, 2000, 5000" in done.stderr
    )


def test_the_table_does_not_contain_the_tick() -> None:
    """A client sees the same table at every rate: its hash is part of what it checks."""
    code = "from bench_protocol.table import TABLE; print(f'{TABLE.map_hash:08x}')"
    environment = os.environ | {TICK_RATE_VARIABLE: "5000"}
    done = subprocess.run(
        [sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=True
    )
    assert done.stdout.strip() == f"{TABLE.map_hash:08x}"
