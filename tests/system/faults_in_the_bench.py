"""What drivers see of each fault of the sensors, the plant and the rig itself."""

import math

import numpy as np
import pytest

from bench_protocol.table import TABLE
from bench_protocol.units import Hz, bar, mm, s
from drivers.errors import LinkLost, Refused
from tests.system.fault_stand import FaultRig, seen

# -- sensors -----------------------------------------------------------------------------------------------------


@seen
def stuck(stand: FaultRig) -> None:
    stand.on("stuck", sensor="left.bellows_pressure")
    values = stand.readings("left.bellows_pressure")
    assert np.ptp(values) == 0.0
    assert np.ptp(stand.readings("right.bellows_pressure")) > 0.0


@seen
def bias(stand: FaultRig) -> None:
    sound = stand.readings("left.height").mean()
    stand.on("bias", sensor="left.height", value="5 mm")
    assert stand.readings("left.height")[5:].mean() - sound == pytest.approx(5 * mm, abs=0.1 * mm)
    stand.on("bias", sensor="right.height", value="-5 mm")
    assert [one["label"] for one in stand.order(do="list")["on"]] == ["bias.left.height", "bias.right.height"]
    stand.off("bias.left.height")
    assert stand.readings("left.height")[5:].mean() == pytest.approx(sound, abs=0.1 * mm)


@seen
def drift(stand: FaultRig) -> None:
    sound = stand.readings("left.height").mean()
    stand.on("drift", sensor="left.height", value="10 mm/s")
    stand.wait(1 * s)
    values = stand.readings("left.height")
    assert values[0] - sound == pytest.approx(10 * mm, abs=0.5 * mm)
    assert values[-1] - values[0] == pytest.approx(10 * mm, abs=0.5 * mm)


@seen
def spike(stand: FaultRig) -> None:
    sound = np.median(stand.readings("left.height"))
    stand.on("spike", sensor="left.height", value="100 mm", rate="5 Hz", seed=2)
    values = stand.readings("left.height", 4 * s)
    off = np.abs(values - sound) > 50 * mm
    assert 8 < off.sum() < 40, "5 a second for 4 s"
    assert values[off] - sound == pytest.approx(100 * mm, abs=1 * mm)
    assert stand.truth("rig.tripped") == 0


@seen
def noise(stand: FaultRig) -> None:
    sound = stand.readings("left.height")
    stand.on("noise", sensor="left.height", value="2 mm")
    values = stand.readings("left.height", 3 * s)
    assert values.std() == pytest.approx(2 * mm, rel=0.15)
    assert values.mean() == pytest.approx(sound.mean(), abs=0.4 * mm)


@seen
def broken_wire(stand: FaultRig) -> None:
    row = TABLE.index["left.auxiliary_pressure"]
    stand.on("broken_wire", sensor="left.auxiliary_pressure", reads="nothing")
    stand.wait(0.1 * s)
    assert math.isnan(stand.bench.left.auxiliary_pressure)
    assert stand.bench.readings.sample("left.auxiliary_pressure").quality != "good"
    assert math.isnan(stand.bench.settings.reading("left.auxiliary_pressure")), "on Modbus too"
    rails = stand.rig.plant.parameters.sensor_low[row], stand.rig.plant.parameters.sensor_high[row]
    for reads, rail in zip(("low", "high"), rails, strict=True):
        stand.on("broken_wire", sensor="left.auxiliary_pressure", reads=reads)
        stand.wait(0.1 * s)
        assert stand.truth("left.auxiliary_pressure") == rail


@seen
def swapped(stand: FaultRig) -> None:
    names = "load_cell.1", "load_cell.3"
    values = {"load_cell.1": "8 kN", "load_cell.3": "2 kN"}
    for name, value in values.items():
        stand.on("bias", sensor=name, value=value)
    before = [stand.readings(name)[5:].mean() for name in names]
    stand.on("swapped", sensor=names[0], other=names[1])
    after = [stand.readings(name)[5:].mean() for name in names]
    assert after == pytest.approx(before[::-1], abs=50)
    refused = stand.order(do="on", name="swapped", values={"sensor": "load_cell.2", "other": "left.height"})
    assert "two different sensors with the same unit" in refused["error"]


@seen
def turned(stand: FaultRig) -> None:
    sound = stand.readings("left.height").mean()
    stand.on("turned", sensor="left.height")
    assert stand.readings("left.height")[5:].mean() == pytest.approx(-sound, abs=0.1 * mm)
    stand.on("turned", sensor="supply.pressure")
    low = stand.rig.plant.parameters.sensor_low[TABLE.index["supply.pressure"]]
    assert stand.readings("supply.pressure")[-1] >= low, "no transducer reads beyond its range"


# -- the plant ---------------------------------------------------------------------------------------------------


@seen
def leak(stand: FaultRig) -> None:
    stand.arm(2 * bar)
    stand.on("leak", side="left", area="5 mm2")
    pressure = stand.bench.left.bellows_pressure
    other = stand.bench.right.bellows_pressure
    stand.bench.wait(5 * s)
    fallen = pressure - stand.bench.left.bellows_pressure
    assert fallen > 100e2
    assert abs(other - stand.bench.right.bellows_pressure) < 0.2 * fallen


@seen
def burst(stand: FaultRig) -> None:
    stand.arm(2 * bar)
    stand.on("burst", side="right", area="1000 mm2")
    stand.bench.wait(3 * s)
    assert stand.bench.right.bellows_pressure < 0.3 * bar
    assert stand.bench.left.bellows_pressure > 1.2 * bar


@seen
def blocked_orifice(stand: FaultRig) -> None:
    stand.arm(1 * bar)

    def pressure_difference() -> float:
        stand.bench.settings.write({"air.left_mode": "fill", "air.left_target": 4 * bar})
        stand.bench.wait(0.5 * s)
        difference = stand.bench.left.auxiliary_pressure - stand.bench.left.bellows_pressure
        stand.bench.air.vent(1 * bar)
        stand.bench.wait(3 * s)
        return difference

    sound = pressure_difference()
    stand.on("blocked_orifice", side="left", share="95 %")
    assert pressure_difference() > 3 * abs(sound)


@seen
def stuck_leveling(stand: FaultRig) -> None:
    stand.arm(2 * bar)
    stand.bench.air.isolate_dpv()
    stand.bench.air.level()
    changes = {}
    for at in ("shut", "as_is", "filling", "exhausting"):
        stand.on("stuck_leveling", side="left", at=at)
        stand.bench.wait(3 * s)
        before = stand.bench.left.auxiliary_pressure
        stand.bench.wait(2 * s)
        changes[at] = stand.bench.left.auxiliary_pressure - before
        stand.off()
    assert abs(changes["shut"]) < 0.02 * bar
    assert changes["as_is"] > 0.1 * bar, "it was filling"
    assert changes["filling"] > 0.1 * bar
    assert changes["exhausting"] < -0.1 * bar


@seen
def stuck_dpv(stand: FaultRig) -> None:
    stand.arm(1 * bar)
    stand.bench.air.isolate_dpv()
    stand.bench.air.fill(left=2.6 * bar)
    stand.bench.air.hold()
    stand.on("stuck_dpv", at="shut")
    stand.bench.air.connect_dpv()
    stand.bench.wait(3 * s)
    apart = stand.bench.left.auxiliary_pressure - stand.bench.right.auxiliary_pressure
    assert apart > 1.3 * bar, "beyond the 1.2 bar at which a sound one opens"
    stand.on("stuck_dpv", at="open")
    stand.bench.wait(15 * s)
    assert abs(stand.bench.left.auxiliary_pressure - stand.bench.right.auxiliary_pressure) < 0.1 * bar


@seen
def stuck_service_valve(stand: FaultRig) -> None:
    stand.arm(1 * bar)
    stand.on("stuck_service_valve", side="left", at="shut")
    stand.bench.settings.write({f"air.{side}_mode": "fill" for side in ("left", "right")})
    stand.bench.settings.write({f"air.{side}_target": 2 * bar for side in ("left", "right")})
    stand.bench.wait(3 * s)
    assert stand.bench.left.auxiliary_pressure < 1.2 * bar
    assert stand.bench.right.auxiliary_pressure > 1.8 * bar
    stand.on("stuck_service_valve", side="left", at="exhausting")
    stand.bench.wait(5 * s)
    assert stand.bench.left.auxiliary_pressure < 0.6 * bar


@seen
def stuck_reservoir_valve(stand: FaultRig) -> None:
    stand.arm(2 * bar)
    stand.on("stuck_reservoir_valve", side="left")
    stand.bench.settings.write({f"air.{side}_mode": "vent" for side in ("left", "right")})
    stand.bench.settings.write({f"air.{side}_target": 0.0 for side in ("left", "right")})
    stand.bench.wait(8 * s)
    assert stand.bench.left.auxiliary_pressure < 0.3 * bar
    assert stand.bench.right.bellows_pressure < 0.3 * bar
    assert stand.bench.left.bellows_pressure > 1.5 * bar


@seen
def seized_actuator(stand: FaultRig) -> None:
    stand.arm()
    stand.bench.lateral.move_to(2 * mm, rate=20 * mm / s)
    stand.bench.wait(1 * s)
    here = stand.bench.lateral.displacement
    stand.on("seized_actuator", actuator="lateral")
    stand.bench.commander.set_all({"lateral.displacement_setpoint": 12 * mm})
    stand.bench.wait(1 * s)
    assert stand.bench.lateral.displacement == pytest.approx(here, abs=0.2 * mm)
    stand.bench.commander.set_all({"lateral.displacement_setpoint": here})
    stand.bench.wait(1 * s)
    stand.off()
    stand.bench.lateral.move_to(5 * mm, rate=20 * mm / s)
    stand.bench.wait(1 * s)
    assert stand.bench.lateral.displacement == pytest.approx(5 * mm, abs=0.5 * mm)


@seen
def supply_loss(stand: FaultRig) -> None:
    stand.arm()
    stand.bench.wait(1 * s)
    sound = stand.bench.supply.pressure
    stand.on("supply_loss", pressure="2 bar")
    stand.bench.wait(2 * s)
    assert sound > 7 * bar
    assert stand.bench.supply.pressure == pytest.approx(2 * bar, abs=0.1 * bar)
    stand.bench.settings.write({"air.left_mode": "fill", "air.left_target": 4 * bar})
    stand.bench.wait(8 * s)
    assert stand.bench.left.auxiliary_pressure < 2.1 * bar


# -- the rig -----------------------------------------------------------------------------------------------------


@seen
def late_ticks(stand: FaultRig) -> None:
    stand.on("late_ticks", by="20 ms", every="100 ms")
    stand.wait(1 * s)
    assert stand.bench.rig.late_ticks == 0, "virtual time has no late ticks; see the rig in real time below"


@seen
def hung_plc(stand: FaultRig) -> None:
    stand.arm()
    stand.bench.settings.write({"generator.axis": "platform_vertical", "generator.cycles": 50})
    stand.bench.settings.write({"generator.amplitude": 1 * mm, "generator.frequency": 1 * Hz})
    stand.bench.settings.act("action.program_run")
    stand.bench.wait(0.3 * s)
    port = stand.memory.modbus()
    stand.on("hung_plc")
    stand.wait(0.1 * s)
    with pytest.raises(LinkLost, match="does not answer"):
        port.read_input(1, 2)
    phases = stand.rig._controls["phase"].copy()
    stand.wait(0.5 * s)
    assert phases.any() and (stand.rig._controls["phase"] == phases).all(), "the program is stopped"
    assert not math.isnan(stand.bench.left.height), "CAN goes on"


@seen
def estop(stand: FaultRig) -> None:
    stand.arm()
    with stand.bench.despite_faults():
        stand.on("estop")
        stand.wait(0.1 * s)
        assert stand.bench.rig.state == "ESTOP"
        assert stand.bench.emergency.code == 0xFF02
        assert stand.bench.interlock.estop
        with pytest.raises(Refused):
            stand.bench.settings.act("action.reset")
        stand.off("estop")
        assert not stand.bench.interlock.estop
        assert stand.bench.rig.state == "ESTOP", "released is not reset"


@seen
def power_loss(stand: FaultRig) -> None:
    stand.arm()
    stand.on("power_loss")
    with stand.bench.despite_faults():
        stand.wait(0.1 * s)
        assert stand.bench.rig.state == "OFF"
        with pytest.raises(Refused):
            stand.bench.settings.act("action.power_on")
        stand.off()
        stand.wait(1 * s)
        assert stand.bench.rig.state == "OFF", "nothing comes back by itself"
        stand.bench.settings.act("action.power_on")
        stand.wait(1 * s)
        assert stand.bench.rig.state == "DISABLED"
