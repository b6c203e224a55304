"""A driver sees every injected fault as its page describes, in virtual time, and no longer after its removal."""

import numpy as np
import pytest

from astb.rig_in_memory import RigInMemory
from bench_protocol.units import NS, mm, s
from bench_sim.rig.faults.catalogue import FAULTS
from bench_sim.rig.faults.panel import PlannedFault
from bench_sim.rig.rig import Rig
from test_plans.discovery import plans
from test_plans.execution import execute
from tests.system import faults_in_the_bench, faults_on_the_wires
from tests.system.fault_stand import PARAMETERS, SEEN, FaultRig

assert faults_in_the_bench and faults_on_the_wires  # they register the effects


def test_every_fault_is_seen() -> None:
    assert SEEN.keys() == FAULTS.keys()
    assert len(FAULTS) >= 25


@pytest.mark.parametrize("name", FAULTS)
def test_a_fault_does_what_its_page_says_and_is_gone_afterwards(name: str) -> None:
    stand = FaultRig()
    parameters = stand.rig.plant.parameter_array.tobytes()
    SEEN[name](stand)
    stand.off()
    assert stand.order(do="list")["on"] == []
    # A new commander finds a sound bench, and its parameters are the old ones to the bit.
    assert stand.rig.plant.parameter_array.tobytes() == parameters
    stand.bench.wiring.carrier.can.lose("the commander is gone")
    stand.bench.commander.stop()
    stand.bench.wiring.carrier.watchdog.stop()
    stand.rig.lease.peer_lost(stand.bench.wiring.carrier.modbus.name)
    with stand.memory.bench() as bench:
        bench.arm()
        bench.wait(1 * s)
        assert bench.rig.state == "ACTIVE"


# -- drawn faults, and plans -------------------------------------------------------------------------------------------


def frames_of(seed: int) -> bytes:
    stand = FaultRig()
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
    """The torn bellows that leaks as well is sound again only when both are repaired."""
    stand = FaultRig()
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
