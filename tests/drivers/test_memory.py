"""Links that misbehave, from a seed: whatever is lost, doubled, late or echoed, no wrong value is ever read."""

import numpy as np
import pytest

from bench_protocol.can_codec import Encoder
from bench_protocol.frames import join
from bench_protocol.table import TABLE
from bench_protocol.units import kN, mm, s
from drivers.errors import LinkLost
from drivers.memory import Faults, FaultyCan, InMemoryCan
from tests.refusals import refuses

BAD = Faults(lose=0.05, double=0.05, echo=0.2)


def counted(number):
    encoder, values = Encoder(TABLE), np.zeros(len(TABLE.signals))
    rows = encoder.rows(["SpringLeft"])
    return join(encoder.encode(values, rows, k) for k in range(number))


def through(faults, seed, block):
    """Return inputs, outputs and echoes, block by block of 32."""
    sent, received = [], []
    inner = InMemoryCan(sent.append)
    link = FaultyCan(inner, faults, seed)
    link.subscribe(received.append)
    for k in range(0, block.size, 32):
        inner.receive(block[k : k + 32])
    inward = join(received)
    received.clear()
    for k in range(0, block.size, 32):
        link.send(block[k : k + 32])
    return inward, join(sent), join(received)


def test_without_faults_everything_passes_unchanged():
    block = counted(500)
    inward, outward, echoes = through(Faults(), 1, block)
    assert np.array_equal(inward, block)
    assert np.array_equal(outward, block)
    assert echoes.size == 0


@pytest.mark.parametrize("seed", range(5))
def test_a_seed_is_a_fate(seed):
    block, faults = counted(500), Faults(lose=0.1, double=0.1, delay=0.1, echo=0.1)
    first, again, other = (through(faults, k, block) for k in (seed, seed, seed + 100))
    assert all(np.array_equal(a, b) for a, b in zip(first, again, strict=True))
    assert not any(np.array_equal(a, b) for a, b in zip(first, other, strict=True))
    assert not np.array_equal(first[0], first[1])  # the directions have fates of their own


@pytest.mark.parametrize(
    ("faults", "low", "high"),
    [(Faults(lose=0.2), 0.77, 0.83), (Faults(double=0.2), 1.17, 1.23), (Faults(lose=1.0), 0, 0)],
)
def test_mishaps_are_as_frequent_as_asked_for(faults, low, high):
    inward, outward, _ = through(faults, 3, counted(5000))
    assert low <= inward.size / 5000 <= high
    assert low <= outward.size / 5000 <= high


def test_each_direction_can_have_faults_of_its_own():
    block, sent, received = counted(500), [], []
    inner = InMemoryCan(sent.append)
    link = FaultyCan(inner, Faults(lose=0.5), 3, outward=Faults())
    link.subscribe(received.append)
    inner.receive(block)
    link.send(block)
    assert 200 < join(received).size < 300
    assert np.array_equal(join(sent), block)


def test_delayed_frames_keep_the_stated_delay():
    block = counted(2000)
    inward, _, _ = through(Faults(delay=0.1, delay_frames=20), 5, block)
    order = inward["time"]
    assert inward.size >= 2000 - 20
    assert len(set(order.tolist())) == inward.size
    assert (np.diff(order) < 0).any()
    assert (np.maximum.accumulate(order) - order).max() <= 22


def test_echoes_are_our_own_frames():
    block = counted(1000)
    _, outward, echoes = through(Faults(echo=0.3), 2, block)
    assert np.array_equal(outward, block)
    assert 250 < echoes.size < 350
    assert np.isin(echoes["time"], block["time"]).all()


@pytest.mark.parametrize(
    "faults", [{"lose": 1.1}, {"double": -0.1}, {"echo": float("nan")}, {"delay_frames": 0}]
)
def test_impossible_links_are_refused(faults):
    with pytest.raises(ValueError, match=f"^{next(iter(faults))} = "):
        Faults(**faults)


@pytest.mark.parametrize("seed", range(4))
def test_a_plan_runs_over_a_bad_link(make_world, seed):
    world = make_world(BAD, seed)
    with world.bench as bench:
        bench.arm(within=20 * s)
        bench.vertical.preload(10 * kN, 20 * kN, rate=20 * kN / s)
        world.peer.values["left.height"] = 17 * mm
        bench.wait(0.2)
        for _ in range(100):
            bench.wait(0.02)
            assert bench.left.height == pytest.approx(17 * mm)
            assert bench.rig.state == "ACTIVE"
        tally = bench.wiring.carrier.tally()
        sent = tally["accepted"] + tally["lost"]
        assert 0.03 < tally["lost"] / sent < 0.07
        assert tally["repeated"] > 0
        assert tally["unknown"] > 0  # our own commands, come back
        assert tally["corrupt"] == 0
    assert world.peer.state == "DISABLED"


def test_a_bus_that_is_cut_says_so_once(world):
    reasons = []
    world.can.on_lost(reasons.append)
    world.can.lose("cable pulled")
    world.can.lose("cable pulled again")
    world.can.on_lost(reasons.append)
    assert reasons == ["cable pulled", "cable pulled"]
    with refuses(LinkLost, "pulled"):
        world.can.send(counted(1))
