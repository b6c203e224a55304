"""Rig B on an interface of the kernel: armed, filled, shaken and brought to rest over real SocketCAN."""

import pytest

from astb.rig_file import read
from astb.session import open_session
from bench_protocol.units import bar, mm
from drivers.can_port import has_interface

INTERFACE = "vcan0"


@pytest.mark.vcan
@pytest.mark.real_time
def test_rig_b_is_led_over_socketcan(started):
    if not has_interface(INTERFACE):
        pytest.skip("this kernel has no vcan0; `make test-vcan` runs this where there is one")
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
