"""What drivers see of each fault of the bus and of Modbus."""

import math

import numpy as np
import pytest

from bench_protocol.frames import join
from bench_protocol.units import NS, mm, ms, s
from drivers.errors import LinkLost, Refused
from tests.system.fault_stand import IDENTIFIER, FaultRig, seen

# -- the bus -----------------------------------------------------------------------------------------------------


@seen
def drop(stand: FaultRig) -> None:
    before = stand.tally("lost")
    stand.on("drop", probability="50 %", direction="from_rig")
    count = (stand.frames(1 * s)["id"] == IDENTIFIER["SpringLeft"]).sum()
    assert 70 < count < 130, "of 200"
    assert stand.tally("lost") - before > 500
    stand.off()
    stand.wait(0.1 * s)
    lost = stand.tally("lost")
    stand.wait(1 * s)
    assert stand.tally("lost") == lost


@seen
def duplicate(stand: FaultRig) -> None:
    rejected = stand.bench.rig.rejected_commands
    height = stand.bench.left.height
    stand.on("duplicate")
    assert (stand.frames(1 * s)["id"] == IDENTIFIER["SpringLeft"]).sum() == pytest.approx(400, abs=4)
    assert stand.tally("repeated") > 1000
    assert stand.bench.rig.rejected_commands > rejected + 100
    assert stand.bench.left.height == pytest.approx(height, abs=1 * mm)


@seen
def corrupt(stand: FaultRig) -> None:
    rejected = stand.bench.rig.rejected_commands
    stand.on("corrupt", probability="20%", direction="to_rig")
    stand.wait(1 * s)
    assert stand.bench.rig.rejected_commands > rejected + 20, "no wrong bit gets past the CRC"
    stand.off()
    stand.on("corrupt", probability="50%", direction="from_rig", message="SpringLeft")
    heights = stand.readings("left.height")
    assert np.ptp(heights[~np.isnan(heights)]) > 50 * mm
    assert np.ptp(stand.readings("right.height")) < 1 * mm


@seen
def delay(stand: FaultRig) -> None:
    stand.on("delay", by="50 ms")
    stand.wait(0.2 * s)
    block = stand.frames(1 * s)
    ticks = [
        (int(frame["time"]), int.from_bytes(frame["data"][:3].tobytes(), "little"))
        for frame in block[block["id"] == IDENTIFIER["Timing"]]
    ]
    assert len(ticks) == 10
    for time, tick in ticks:
        assert time / NS - tick * 1 * ms == pytest.approx(50 * ms, abs=1 * ms)
    arrivals = [time - int(one["time"][0]) for time, one in stand.heard]
    assert max(map(abs, arrivals)) <= 2_000_000, "stamped when it comes"


@seen
def babble(stand: FaultRig) -> None:
    stand.on("babble", identifier=5, rate="500 Hz")
    block = stand.frames(1 * s)
    assert (block["id"] == 5).sum() == pytest.approx(500, abs=3)
    assert np.diff(block["time"][block["id"] == 5].astype(float)) == pytest.approx(2e6, abs=1.1e6)
    assert stand.bench.left.height == pytest.approx(stand.truth("left.height"), abs=1 * mm)


@seen
def bus_off(stand: FaultRig) -> None:
    stand.arm()
    with stand.bench.despite_faults():
        stand.on("bus_off")
        assert stand.frames(0.6 * s).size == 0
        assert math.isnan(stand.bench.left.height)
        assert stand.rig.state.name == "FAULT_DISABLED"
        assert stand.bench.settings.reading("rig.state") == stand.truth("rig.state"), "Modbus goes on"
        stand.off()
        stand.wait(0.2 * s)
        assert not math.isnan(stand.bench.left.height)


@seen
def wrong_counter(stand: FaultRig) -> None:
    stand.on("wrong_counter", message="SpringLeft")
    repeated = stand.tally("repeated")
    stand.wait(0.5 * s)
    assert stand.tally("repeated") - repeated == pytest.approx(99, abs=3)
    assert math.isnan(stand.bench.left.height)
    assert not math.isnan(stand.bench.right.height)
    stand.on("wrong_counter", step=1, message="SpringRight")
    stand.wait(0.1 * s)
    lost = stand.tally("lost")
    stand.wait(0.5 * s)
    assert stand.tally("lost") - lost == pytest.approx(100, abs=3)
    stand.off()
    stand.wait(0.1 * s)
    rejected = stand.bench.rig.rejected_commands
    stand.on("wrong_counter", message="Control")
    stand.wait(0.3 * s)
    assert stand.bench.rig.rejected_commands > rejected + 10


@seen
def wrong_crc(stand: FaultRig) -> None:
    stand.arm()
    rejected = stand.bench.rig.rejected_commands
    with stand.bench.despite_faults():
        stand.on("wrong_crc")
        stand.wait(0.2 * s)
        assert stand.bench.rig.state == "FAULT_HOLD"
        assert stand.bench.rig.rejected_commands > rejected + 10
        stand.wait(0.5 * s)
        assert stand.bench.rig.state == "FAULT_DISABLED"


@seen
def interface_down(stand: FaultRig) -> None:
    stand.arm()
    reasons: list[str] = []
    stand.ear.on_lost(reasons.append)
    stand.on("interface_down")
    stand.wait(2 * ms)
    assert len(reasons) == 1
    assert stand.rig.state.name in ("FAULT_REACTION", "FAULT_HOLD"), "at once: the connection is closed"
    again = stand.memory.can()
    with pytest.raises(LinkLost):
        again.send(join([]))


# -- Modbus ------------------------------------------------------------------------------------------------------


@seen
def modbus_exception(stand: FaultRig) -> None:
    port = stand.memory.modbus()
    stand.on("modbus_exception", code=6, requests="writes")
    with pytest.raises(Refused, match="exception 6") as refused:
        port.write_coil(0, False)
    assert refused.value.code == 6
    assert len(port.read_input(0, 3)) == 3, "reading goes on"


@seen
def modbus_silence(stand: FaultRig) -> None:
    port = stand.memory.modbus()
    sound = port.read_input(1, 2)
    stand.on("modbus_silence")
    with pytest.raises(LinkLost, match="does not answer"):
        port.read_input(1, 2)
    stand.off()
    assert port.read_input(1, 2) == sound


@seen
def modbus_junk(stand: FaultRig) -> None:
    port = stand.memory.modbus()
    for seed, what in enumerate(("transaction", "unit", "noise", "noise", "noise")):
        stand.on("modbus_junk", what=what, seed=seed)
        with pytest.raises(LinkLost):
            port.read_input(1, 2)


@seen
def modbus_slow(stand: FaultRig) -> None:
    port = stand.memory.modbus()
    stand.on("modbus_slow", by="80 ms")
    before = stand.clock.now()
    port.read_input(1, 2)
    assert stand.clock.now() - before == 80_000_000


@seen
def modbus_split(stand: FaultRig) -> None:
    port = stand.memory.modbus()
    sound = port.read_input(1, 2)
    stand.on("modbus_split", size=3, gap="5 ms")
    before = stand.clock.now()
    assert port.read_input(1, 2) == sound
    assert stand.clock.now() - before == 4 * 5_000_000, "13 bytes in five pieces"


@seen
def plc_restart(stand: FaultRig) -> None:
    stand.arm()
    port = stand.memory.modbus()
    with stand.bench.despite_faults():
        stand.on("plc_restart")
        stand.wait(0.1 * s)
        with pytest.raises(LinkLost):
            port.read_input(1, 2)
        assert stand.bench.rig.state == "OFF"
        assert stand.truth("rig.lease") == 0
        stand.wait(2.8 * s)
        assert stand.bench.rig.state == "OFF"
        stand.wait(0.2 * s)
        assert stand.bench.rig.state in ("BOOT", "INIT")
        stand.wait(0.5 * s)
        assert stand.bench.rig.state == "DISABLED"
        assert len(port.read_input(1, 2)) == 2
    assert stand.order(do="list")["on"] == []
