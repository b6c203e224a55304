"""Our own protocol as points of a bus and of a PLC, decoded by no code of ours: the same rig, the same plan."""

from pathlib import Path

import numpy as np
import pytest

from astb.rig_file import Simulation
from astb.rig_in_memory import RigInMemory
from astb.session import build_rig
from bench_protocol.dimensions import ordinary
from bench_protocol.signals import Kind
from bench_protocol.table import TABLE
from bench_protocol.units import bar, mm, s
from drivers.bench import Bench
from drivers.errors import Refused
from drivers.wiring.astb.can import AstbListener
from drivers.wiring.described import open_described
from drivers.wiring.description import describe
from test_plans.discovery import plans
from test_plans.execution import execute
from tests.drivers.own_as_file import own_description


@pytest.fixture
def memory():
    return RigInMemory(build_rig(Simulation()))


def _described(memory: RigInMemory, directory: Path, *, generator: bool = True) -> Bench:
    keys = own_description(directory, generator=generator)
    description = describe(keys, directory / "own.toml", TABLE)
    wiring = open_described("own", description, {"bus": memory.can, "plc": memory.modbus})
    bench = Bench(wiring, memory.clock)
    bench.dimensions = ordinary()
    return bench


@pytest.fixture
def described(memory, tmp_path) -> Bench:
    """A bench on our own rig that knows it from a description alone."""
    return _described(memory, tmp_path)


def test_a_description_of_our_own_rig_arms_moves_and_disarms_it(memory, described):
    with described as bench:
        bench.arm()
        assert bench.state == "ACTIVE"
        bench.vertical.hold_position()  # or the air would lift the bolster
        bench.air.fill(to=2 * bar, within=60 * s)
        assert bench.left.bellows_pressure == pytest.approx(2 * bar, abs=0.1 * bar)
        with bench.capture("vertical_left.displacement") as capture:
            bench.generator.run("vertical", amplitude=3 * mm, frequency=1.0, cycles=3)
        assert np.ptp(capture.values("vertical_left.displacement")) == pytest.approx(6 * mm, abs=0.5 * mm)
        assert capture.values("vertical_left.displacement").size == pytest.approx(200 * 3, rel=0.1)
        with pytest.raises(Refused):
            bench.settings.act("action.power_on")
        bench.air.vent()
        assert memory.rig.state.name == "ACTIVE"
        bench.disarm()
        assert bench.rig.strangers == 0
    assert memory.rig.lease.token == 0


def test_both_wirings_receive_the_same(memory, described):
    received = {"own": [], "file": []}
    own = AstbListener(
        TABLE, memory.clock, None, lambda t, rows, v, _: received["own"].extend(zip(t, rows, v, strict=True))
    )
    with described as bench:
        port = memory.can()
        port.subscribe(own.receive)
        bench.receiver.sink = lambda t, rows, v: received["file"].extend(zip(t, rows, v, strict=True))
        bench.wait(2 * s)
        bench.receiver.sink = None
        port.close()
    tables = {
        who: {
            (int(t), int(row)): float(v)
            for t, row, v in samples
            if TABLE.signals[row].kind is not Kind.SETPOINT
        }
        for who, samples in received.items()
    }
    assert len(tables["own"]) > 2000
    assert tables["file"].keys() == tables["own"].keys()
    assert [tables["file"][key] for key in tables["own"]] == pytest.approx(
        list(tables["own"].values()), nan_ok=True
    )


@pytest.mark.slow
@pytest.mark.parametrize("generator", [True, False], ids=["the rig's generator", "the bench's player"])
def test_aw0_says_the_same_over_a_file_as_over_our_own_wiring(memory, tmp_path, generator):
    def run(bench: Bench, name: str) -> dict[str, tuple[str, float]]:
        with bench:
            result = execute(plans()["aw0"], bench, tmp_path / name, rig="own", seed=0)
        assert result.verdict == "pass", result.reason
        return {check.name: (check.verdict, check.value) for check in result.checks}

    own = run(RigInMemory(build_rig(Simulation())).bench(), "own")
    file = run(_described(memory, tmp_path, generator=generator), "file")
    assert {name: verdict for name, (verdict, _) in file.items()} == {
        name: verdict for name, (verdict, _) in own.items()
    }
    stiffness = [name for name in own if "K'" in name or "stiffness" in name]
    assert len(stiffness) >= 10
    for name in stiffness:
        assert file[name][1] == pytest.approx(own[name][1], rel=0.02), name
