"""A link that loses, doubles, delays and echoes frames, seeded: plans work through it, or the rig holds."""

import numpy as np
import pytest

from bench_protocol.dimensions import ordinary
from bench_protocol.units import Hz, kN, mm, ms, s
from bench_records.result import Outcome
from drivers.bench import Bench
from drivers.errors import RigFault
from drivers.memory import Faults, FaultyCan
from drivers.wiring.own import own_wiring
from test_plans.discovery import plans
from test_plans.execution import execute
from tests.refusals import refuses

in_memory = pytest.mark.parametrize("site", ["memory"], indirect=True)
on_every_wire = pytest.mark.parametrize(
    "site",
    [
        "memory",
        pytest.param("tcp", marks=pytest.mark.slow),
        pytest.param("socketcan", marks=pytest.mark.vcan),
    ],
    indirect=True,
)
#: Some 7 % of the frames do not come in time. At twice as many, five commands in a row fail every ten minutes, and the
#: rig holds, rightly.
BAD = Faults(lose=0.03, double=0.03, delay=0.03, echo=0.03)


@pytest.fixture
def through(site):
    """Connect a bench through a faulty link."""
    site.close_shared()
    benches = []

    def connect(faults: Faults, seed: int = 1) -> Bench:
        port = FaultyCan(site.can(), faults, seed)
        benches.append(Bench(own_wiring(port, site.modbus()), site.clock))
        benches[-1].connect()
        return benches[-1]

    yield connect
    for bench in benches:
        bench.close()


@on_every_wire
def test_procedures_work_through_a_bad_link(site, through):
    """3 % of every mishap in both directions: each step of a plan still does what it says."""
    bench = through(BAD)
    bench.arm()
    bench.lateral.move_to(4 * mm, rate=20 * mm / s)
    bench.vertical.preload(3 * kN, 4 * kN, rate=20 * kN / s)
    with bench.capture("platform.vertical") as capture:
        bench.generator.run(
            "platform_vertical", "unilateral_cosine", amplitude=5 * mm, frequency=3 * Hz, cycles=3
        )
    assert capture.values("platform.vertical").max() == pytest.approx(5 * mm, abs=0.3 * mm)
    assert bench.average("lateral.displacement", over=200 * ms) == pytest.approx(4 * mm, abs=0.2 * mm)
    bench.disarm()
    assert bench.rig.state == "DISABLED"
    tally = bench.wiring.carrier.tally()
    assert tally["lost"] > 0
    assert tally["repeated"] > 0


@pytest.mark.slow
def test_a_whole_plan_gives_its_verdict_through_a_bad_link(memory_site, tmp_path):
    site = memory_site()
    with Bench(own_wiring(FaultyCan(site.can(), BAD, seed=1), site.modbus()), site.clock) as bench:
        bench.dimensions = ordinary()
        result = execute(plans()["aw0"], bench, tmp_path)
    assert result.verdict is Outcome.PASS, [str(c) for c in result.checks if c.verdict != "pass"]


@on_every_wire
def test_the_rig_holds_when_most_commands_are_lost(site, through):
    """Of 20 commands in 100 ms (five cycles of four) the five that feed the watchdog are lost every second time."""
    bench = through(Faults())
    bench.arm()
    bench.lateral.move_to(2 * mm, rate=20 * mm / s)
    bench.wiring.carrier.can._outward._faults = Faults(lose=0.9)
    with refuses(RigFault, "reason"):
        bench.wait(3 * s)
    with bench.despite_faults():  # the fault may be seen in the one tick of FAULT_REACTION
        bench.wait_for(lambda: bench.rig.state in ("FAULT_HOLD", "FAULT_DISABLED"), within=200 * ms)
    assert bench.emergency.code == 0x8130
    bench.wiring.carrier.can._outward._faults = Faults()
    bench.arm()
    assert bench.rig.state == "ACTIVE"


@in_memory
def test_a_late_command_does_not_reverse_the_bench(site, through):
    """A third of all commands comes up to five cycles late, behind its successors: what moves up never moves down."""
    bench = through(Faults(delay=0.33, delay_frames=20))
    bench.arm()
    with site.listening() as received:
        bench.platform.move_to(vertical=20 * mm, rate=20 * mm / s)
    path = received.series("platform.vertical")
    path = path[~np.isnan(path)]
    assert path[-1] - path[0] > 15 * mm
    # Noise of 5 µm and steps of 10 µm; one cycle of the ramp is 400 µm.
    assert np.diff(path).min() > -50e-6
    assert bench.rig.rejected_commands > 10, "such commands did come"


def test_the_seed_decides_what_goes_wrong(memory_site):
    """Rig and link from the same seeds give the same samples at the same times; another link gives others."""

    def samples(seed: int) -> bytes:
        site, received = memory_site(), []
        with Bench(own_wiring(FaultyCan(site.can(), BAD, seed), site.modbus()), site.clock) as bench:
            bench.receiver.sink = lambda *columns: received.extend(column.tobytes() for column in columns)
            bench.arm()
            bench.platform.move_to(vertical=4 * mm)
        return b"".join(received)

    once = samples(1)
    assert len(once) > 100_000
    assert once == samples(1)
    assert once != samples(2)
