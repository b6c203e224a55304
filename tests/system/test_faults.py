"""Every fault on purpose is seen by a driver as its page says, in virtual time, and gone when it is mended."""

import json
import math
from collections.abc import Callable

import numpy as np
import pytest

from astb.rig_in_memory import RigInMemory
from bench_protocol.frames import Block, join
from bench_protocol.table import TABLE
from bench_protocol.units import NS, Hz, bar, mm, ms, s
from bench_sim.parameters import load
from bench_sim.rig.faults.catalogue import FAULTS
from bench_sim.rig.faults.panel import PlannedFault
from bench_sim.rig.rig import Rig
from drivers.errors import LinkLost, Refused
from test_plans.discovery import plans
from test_plans.execution import execute

IDENTIFIER = {message.name: message.identifier for message in TABLE.messages}
PARAMETERS = load()
#: What a fault was seen to do, by its name.
SEEN: dict[str, Callable[["Stand"], None]] = {}


class Stand:
    """A rig in memory with a connected bench, and the fault panel by its orders."""

    def __init__(self) -> None:
        self.memory = RigInMemory(Rig(PARAMETERS, seed=1))
        self.rig, self.clock = self.memory.rig, self.memory.clock
        self.bench = self.memory.bench()
        self.bench.connect()
        self.heard: list[tuple[int, Block]] = []
        self.ear = self.memory.can()
        self.ear.subscribe(lambda block: self.heard.append((self.clock.now(), block.copy())))

    def order(self, **order: object) -> dict:
        return json.loads(self.rig.order(json.dumps(order).encode()))

    def on(self, name: str, lasting: str | None = None, **values: str | float) -> None:
        answer = self.order(do="on", name=name, values=values, **({"for": lasting} if lasting else {}))
        assert "error" not in answer, answer

    def off(self, name: str = "all") -> None:
        answer = self.order(do="off", name=name)
        assert "error" not in answer, answer

    def wait(self, time: float) -> None:
        """Let time pass, whatever becomes of the bench."""
        self.clock.sleep_until(self.clock.now() + round(time * NS))

    def frames(self, time: float = 0.5 * s) -> Block:
        """Return what somebody else on the bus hears in the next ``time``."""
        self.heard.clear()
        self.wait(time)
        return join(block for _, block in self.heard)

    def readings(self, name: str, time: float = 1 * s) -> np.ndarray:
        """Return the samples of the next ``time`` that the bench takes for readings."""
        with self.bench.capture(name) as capture:
            self.wait(time)
        return capture.values(name)

    def told(self, name: str) -> float:
        """Return what the rig itself holds, at no wire: for what nobody can hear while wires are cut."""
        return float(self.rig.values[TABLE.index[name]])

    def arm(self, pressure: float = 0.0) -> None:
        """Arm the bench, hold the bolster where it is, and fill both springs to a gauge pressure."""
        self.bench.arm()
        self.bench.vertical.hold_position()
        if pressure:
            self.bench.air.fill(pressure)
            self.bench.air.hold()
            self.bench.wait(20 * s)  # what was pressed in cools down

    def tally(self, what: str) -> int:
        return self.bench.receiver.tally()[what]


def seen(function: Callable[[Stand], None]) -> Callable[[Stand], None]:
    SEEN[function.__name__] = function
    return function


# -- the bus -----------------------------------------------------------------------------------------------------


@seen
def drop(stand: Stand) -> None:
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
def duplicate(stand: Stand) -> None:
    rejected = stand.bench.rig.rejected_commands
    height = stand.bench.left.height
    stand.on("duplicate")
    assert (stand.frames(1 * s)["id"] == IDENTIFIER["SpringLeft"]).sum() == pytest.approx(400, abs=4)
    assert stand.tally("repeated") > 1000
    assert stand.bench.rig.rejected_commands > rejected + 100
    assert stand.bench.left.height == pytest.approx(height, abs=1 * mm)


@seen
def corrupt(stand: Stand) -> None:
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
def delay(stand: Stand) -> None:
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
def babble(stand: Stand) -> None:
    stand.on("babble", identifier=5, rate="500 Hz")
    block = stand.frames(1 * s)
    assert (block["id"] == 5).sum() == pytest.approx(500, abs=3)
    assert np.diff(block["time"][block["id"] == 5].astype(float)) == pytest.approx(2e6, abs=1.1e6)
    assert stand.bench.left.height == pytest.approx(stand.told("left.height"), abs=1 * mm)


@seen
def bus_off(stand: Stand) -> None:
    stand.arm()
    with stand.bench.despite_faults():
        stand.on("bus_off")
        assert stand.frames(0.6 * s).size == 0
        assert math.isnan(stand.bench.left.height)
        assert stand.rig.state.name == "FAULT_DISABLED"
        assert stand.bench.settings.reading("rig.state") == stand.told("rig.state"), "Modbus goes on"
        stand.off()
        stand.wait(0.2 * s)
        assert not math.isnan(stand.bench.left.height)


@seen
def wrong_counter(stand: Stand) -> None:
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
def wrong_crc(stand: Stand) -> None:
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
def interface_down(stand: Stand) -> None:
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
def modbus_exception(stand: Stand) -> None:
    port = stand.memory.modbus()
    stand.on("modbus_exception", code=6, requests="writes")
    with pytest.raises(Refused, match="exception 6") as refused:
        port.write_coil(0, False)
    assert refused.value.code == 6
    assert len(port.read_input(0, 3)) == 3, "reading goes on"


@seen
def modbus_silence(stand: Stand) -> None:
    port = stand.memory.modbus()
    sound = port.read_input(1, 2)
    stand.on("modbus_silence")
    with pytest.raises(LinkLost, match="does not answer"):
        port.read_input(1, 2)
    stand.off()
    assert port.read_input(1, 2) == sound


@seen
def modbus_junk(stand: Stand) -> None:
    port = stand.memory.modbus()
    for seed, what in enumerate(("transaction", "unit", "noise", "noise", "noise")):
        stand.on("modbus_junk", what=what, seed=seed)
        with pytest.raises(LinkLost):
            port.read_input(1, 2)


@seen
def modbus_slow(stand: Stand) -> None:
    port = stand.memory.modbus()
    stand.on("modbus_slow", by="80 ms")
    before = stand.clock.now()
    port.read_input(1, 2)
    assert stand.clock.now() - before == 80_000_000


@seen
def modbus_split(stand: Stand) -> None:
    port = stand.memory.modbus()
    sound = port.read_input(1, 2)
    stand.on("modbus_split", size=3, gap="5 ms")
    before = stand.clock.now()
    assert port.read_input(1, 2) == sound
    assert stand.clock.now() - before == 4 * 5_000_000, "13 bytes in five pieces"


@seen
def plc_restart(stand: Stand) -> None:
    stand.arm()
    port = stand.memory.modbus()
    with stand.bench.despite_faults():
        stand.on("plc_restart")
        stand.wait(0.1 * s)
        with pytest.raises(LinkLost):
            port.read_input(1, 2)
        assert stand.bench.rig.state == "OFF"
        assert stand.told("rig.lease") == 0
        stand.wait(2.8 * s)
        assert stand.bench.rig.state == "OFF"
        stand.wait(0.2 * s)
        assert stand.bench.rig.state in ("BOOT", "INIT")
        stand.wait(0.5 * s)
        assert stand.bench.rig.state == "DISABLED"
        assert len(port.read_input(1, 2)) == 2
    assert stand.order(do="list")["on"] == []


# -- sensors -----------------------------------------------------------------------------------------------------


@seen
def stuck(stand: Stand) -> None:
    stand.on("stuck", sensor="left.bellows_pressure")
    values = stand.readings("left.bellows_pressure")
    assert np.ptp(values) == 0.0
    assert np.ptp(stand.readings("right.bellows_pressure")) > 0.0


@seen
def bias(stand: Stand) -> None:
    sound = stand.readings("left.height").mean()
    stand.on("bias", sensor="left.height", value="5 mm")
    assert stand.readings("left.height")[5:].mean() - sound == pytest.approx(5 * mm, abs=0.1 * mm)
    stand.on("bias", sensor="right.height", value="-5 mm")
    assert [one["label"] for one in stand.order(do="list")["on"]] == ["bias.left.height", "bias.right.height"]
    stand.off("bias.left.height")
    assert stand.readings("left.height")[5:].mean() == pytest.approx(sound, abs=0.1 * mm)


@seen
def drift(stand: Stand) -> None:
    sound = stand.readings("left.height").mean()
    stand.on("drift", sensor="left.height", value="10 mm/s")
    stand.wait(1 * s)
    values = stand.readings("left.height")
    assert values[0] - sound == pytest.approx(10 * mm, abs=0.5 * mm)
    assert values[-1] - values[0] == pytest.approx(10 * mm, abs=0.5 * mm)


@seen
def spike(stand: Stand) -> None:
    sound = np.median(stand.readings("left.height"))
    stand.on("spike", sensor="left.height", value="100 mm", rate="5 Hz", seed=2)
    values = stand.readings("left.height", 4 * s)
    off = np.abs(values - sound) > 50 * mm
    assert 8 < off.sum() < 40, "5 a second for 4 s"
    assert values[off] - sound == pytest.approx(100 * mm, abs=1 * mm)
    assert stand.told("rig.tripped") == 0


@seen
def noise(stand: Stand) -> None:
    sound = stand.readings("left.height")
    stand.on("noise", sensor="left.height", value="2 mm")
    values = stand.readings("left.height", 3 * s)
    assert values.std() == pytest.approx(2 * mm, rel=0.15)
    assert values.mean() == pytest.approx(sound.mean(), abs=0.4 * mm)


@seen
def broken_wire(stand: Stand) -> None:
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
        assert stand.told("left.auxiliary_pressure") == rail


# -- the plant ---------------------------------------------------------------------------------------------------


@seen
def leak(stand: Stand) -> None:
    stand.arm(2 * bar)
    stand.on("leak", side="left", area="5 mm2")
    pressure = stand.bench.left.bellows_pressure
    other = stand.bench.right.bellows_pressure
    stand.bench.wait(5 * s)
    fallen = pressure - stand.bench.left.bellows_pressure
    assert fallen > 100e2
    assert abs(other - stand.bench.right.bellows_pressure) < 0.2 * fallen


@seen
def burst(stand: Stand) -> None:
    stand.arm(2 * bar)
    stand.on("burst", side="right", area="1000 mm2")
    stand.bench.wait(3 * s)
    assert stand.bench.right.bellows_pressure < 0.3 * bar
    assert stand.bench.left.bellows_pressure > 1.2 * bar


@seen
def blocked_orifice(stand: Stand) -> None:
    stand.arm(1 * bar)

    def parted() -> float:
        stand.bench.settings.write({"air.left_mode": "fill", "air.left_target": 4 * bar})
        stand.bench.wait(0.5 * s)
        difference = stand.bench.left.auxiliary_pressure - stand.bench.left.bellows_pressure
        stand.bench.air.vent(1 * bar)
        stand.bench.wait(3 * s)
        return difference

    sound = parted()
    stand.on("blocked_orifice", side="left", share="95 %")
    assert parted() > 3 * abs(sound)


@seen
def stuck_leveling(stand: Stand) -> None:
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
def stuck_dpv(stand: Stand) -> None:
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
def stuck_service_valve(stand: Stand) -> None:
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
def stuck_reservoir_valve(stand: Stand) -> None:
    stand.arm(2 * bar)
    stand.on("stuck_reservoir_valve", side="left")
    stand.bench.settings.write({f"air.{side}_mode": "vent" for side in ("left", "right")})
    stand.bench.settings.write({f"air.{side}_target": 0.0 for side in ("left", "right")})
    stand.bench.wait(8 * s)
    assert stand.bench.left.auxiliary_pressure < 0.3 * bar
    assert stand.bench.right.bellows_pressure < 0.3 * bar
    assert stand.bench.left.bellows_pressure > 1.5 * bar


@seen
def seized_actuator(stand: Stand) -> None:
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
def supply_loss(stand: Stand) -> None:
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
def late_ticks(stand: Stand) -> None:
    stand.on("late_ticks", by="20 ms", every="100 ms")
    stand.wait(1 * s)
    assert stand.bench.rig.late_ticks == 0, "virtual time waits for nobody; see the rig in real time below"


@seen
def hung_plc(stand: Stand) -> None:
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
    cycle = stand.rig._controls["phase"]
    stand.wait(0.5 * s)
    assert stand.rig._controls["phase"] == cycle, "the program stands still"
    assert not math.isnan(stand.bench.left.height), "CAN goes on"


@seen
def estop(stand: Stand) -> None:
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
def power_loss(stand: Stand) -> None:
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


def test_every_fault_is_seen() -> None:
    assert SEEN.keys() == FAULTS.keys()
    assert len(FAULTS) >= 25


@pytest.mark.parametrize("name", FAULTS)
def test_a_fault_does_what_its_page_says_and_is_gone_afterwards(name: str) -> None:
    stand = Stand()
    parameters = stand.rig.plant.parameter_array.tobytes()
    SEEN[name](stand)
    stand.off()
    assert stand.order(do="list")["on"] == []
    # A new commander finds a sound bench, and its parameters are the old ones to the bit.
    assert stand.rig.plant.parameter_array.tobytes() == parameters
    stand.bench._port.lose("the commander is gone")
    stand.bench.commander.stop()
    stand.bench.watchdog.stop()
    stand.rig.lease.peer_lost(stand.bench._modbus.name)
    with stand.memory.bench() as bench:
        bench.arm()
        bench.wait(1 * s)
        assert bench.rig.state == "ACTIVE"


# -- what is drawn, and plans ------------------------------------------------------------------------------------------


def frames_of(seed: int) -> bytes:
    stand = Stand()
    stand.on("drop", probability="10 %", seed=seed)
    stand.on("delay", by="3 ms", jitter="10 ms", seed=seed)
    stand.on("spike", sensor="left.height", value="20 mm", rate="20 Hz", seed=seed)
    stand.on("noise", sensor="right.height", value="1 mm", seed=seed)
    return stand.frames(2 * s).tobytes()


def test_the_seed_draws_what_is_hit() -> None:
    once = frames_of(1)
    assert len(once) > 50_000
    assert once == frames_of(1)
    assert once != frames_of(2)


def test_two_changes_of_one_parameter_end_in_any_order() -> None:
    """The torn bellows that leaks as well is sound again only when both are mended."""
    stand = Stand()
    parameters = stand.rig.plant.parameters
    sound = float(parameters.leak_conductance[0])
    stand.on("leak", side="left", area="3 mm2")
    alone = float(parameters.leak_conductance[0])
    stand.on("burst", side="left", area="300 mm2")
    both = float(parameters.leak_conductance[0])
    stand.off("leak")
    assert both > float(parameters.leak_conductance[0]) > alone > sound
    stand.off("burst")
    assert float(parameters.leak_conductance[0]) == sound


def test_a_planned_fault_begins_and_ends_at_its_tick() -> None:
    rig = Rig(PARAMETERS, seed=1)
    rig.faults.plan(PlannedFault("bias", {"sensor": "left.height", "value": "50 mm"}, at=0.5, lasting=0.2))
    memory = RigInMemory(rig)
    with memory.bench() as bench:
        start = memory.clock.now() / NS
        with bench.capture("left.height") as capture:
            bench.wait(1.5 * s)
    times, heights = capture.times("left.height"), capture.values("left.height")
    off = np.abs(heights - np.median(heights)) > 25 * mm
    assert off.sum() == 40
    assert start + times[off][[0, -1]] == pytest.approx([0.505, 0.7], abs=1e-9)


#: What happens to plan AW0 under a fault from 30 s on: "pass" for what a driver must bear.
UNDER_FAULTS = [
    ("drop", {"probability": "2 %"}, "pass"),
    ("duplicate", {}, "pass"),
    ("delay", {"by": "2 ms", "jitter": "2 ms"}, "pass"),
    ("modbus_split", {}, "pass"),
    ("babble", {"rate": "100 Hz"}, "pass"),
    ("leak", {"side": "left", "area": "2 mm2"}, "fail"),
    ("estop", {}, "blocked"),
    ("plc_restart", {}, "blocked"),
    ("interface_down", {}, "blocked"),
]


@pytest.mark.slow
@pytest.mark.parametrize(("name", "values", "verdict"), UNDER_FAULTS, ids=[row[0] for row in UNDER_FAULTS])
def test_a_plan_under_a_fault_gives_the_same_record_twice(tmp_path, name, values, verdict) -> None:
    records = []
    for turn in "ab":
        rig = Rig(PARAMETERS, seed=1)
        rig.faults.plan(PlannedFault(name, values, at=30.0))
        memory = RigInMemory(rig)
        with memory.bench() as bench:
            result = execute(plans()["aw0"], bench, tmp_path / turn)
        assert result.verdict == verdict, result.reason
        records.append((tmp_path / turn / "record.parquet").read_bytes())
    assert records[0] == records[1]
