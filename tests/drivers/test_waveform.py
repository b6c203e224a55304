"""A waveform that the host streams: each cycle of it arrives, in bytes that cantools reads, or nothing moves at all."""

from pathlib import Path
from types import SimpleNamespace

import cantools
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import bench_protocol
from astb.rig_in_memory import RigInMemory
from bench_protocol.clock import VirtualClock
from bench_protocol.frames import join
from bench_protocol.units import NS, kN, mm, ms, s
from bench_sim.parameters import load
from bench_sim.rig.rig import Rig
from drivers.commander import CYCLE, Commander
from drivers.errors import LinkLost, Misuse, NotAvailable, RigFault
from drivers.memory import InMemoryCan
from drivers.modbus_port import InMemoryModbus
from drivers.wiring.own import own_wiring
from test_plans.steps import carrying
from tests.foreign.virtual import VirtualHall, VirtualPlc

DBC = cantools.database.load_file(Path(bench_protocol.__file__).parent / "generated" / "astb.dbc")
BASE = {"lateral.force_setpoint": 3 * kN, "vertical_left.force_setpoint": 50 * kN}


def decoded(blocks, message, signal):
    """Return the values (in the unit of the DBC) that a stranger finds in the frames of a message."""
    entry = DBC.get_message_by_name(message)
    block = join(blocks)
    chosen = block[block["id"] == entry.frame_id]
    return [entry.decode(bytes(one["data"][: one["length"]]))[signal] for one in chosen]


@settings(max_examples=25, deadline=None)
@given(
    knots=st.lists(st.floats(-4 * kN, 4 * kN), min_size=1, max_size=12),
    step=st.floats(0.09, 0.4),
    lead=st.integers(1, 7),
)
def test_every_cycle_of_it_is_on_the_wire_once_and_exact_to_half_a_step(knots, step, lead):
    clock, blocks = VirtualClock(), []
    commander = Commander(own_wiring(InMemoryCan(blocks.append), InMemoryModbus(lambda _: b"")), clock)
    commander.set_all(BASE)
    commander.start()
    clock.sleep_until(lead * CYCLE)
    way = np.array([0.0, *knots, 0.0])
    times = np.arange(way.size) * step
    cycles = np.interp(np.arange(round(times[-1] * NS) // CYCLE + 2) * CYCLE / NS, times, way)
    commander.play({"lateral.force_setpoint": cycles, "vertical_left.force_setpoint": -2 * cycles})
    clock.sleep_until(clock.now() + (cycles.size + 5) * CYCLE)
    for message, signal, base, factor, half in (
        ("ForceSetpoints", "lateral_force_setpoint", 3.0, 1e-3, 1.01e-3),
        ("ForceSetpoints", "vertical_left_force_setpoint", 50.0, -2e-3, 5.01e-3),
    ):
        found = decoded(blocks, message, signal)
        expected = np.concatenate([np.zeros(lead), cycles, np.full(5, cycles[-1])]) * factor + base
        assert found == pytest.approx(expected, abs=half)
    assert commander.played == (cycles.size, cycles.size, False)


@pytest.fixture
def made():
    """A virtual rig, and a bench on it in ACTIVE whose bolster is held sideways."""
    memory = RigInMemory(Rig(load("astb"), seed=1))
    with memory.bench(seed=1) as bench:
        bench.arm()
        bench.lateral.move_to(0.0)
        yield memory, bench


def bump(height, lasts=2 * s):
    """Return times and a smooth bump that begins and ends at rest."""
    times = np.linspace(0.0, lasts, 401)
    way = height * np.sin(np.pi * times / lasts) ** 2
    way[-1] = 0.0
    return times, way


def test_the_bolster_follows_it(made):
    """The measured value is the waveform, 50 to 55 ms later: two cycles, the loop and the transducer."""
    _, bench = made
    times, way = bump(20 * mm)
    with bench.capture("lateral.displacement") as capture:
        bench.waveform.run(times, {"lateral.displacement": way})
    there, found = capture.times("lateral.displacement"), capture.values("lateral.displacement")
    found = found - found[:4].mean()
    off = {lag: np.std(found - np.interp(there - lag * ms, times, way)) for lag in range(30, 80)}
    assert 50 <= min(off, key=off.get) <= 57
    assert min(off.values()) < 0.1 * mm
    assert found[-10:].mean() == pytest.approx(0.0, abs=0.3 * mm)


TIMES = np.array([0.0, 1.0, 2.0])


@pytest.mark.parametrize(
    ("times", "offsets", "error", "words"),
    [
        (
            TIMES * 4,
            {"lateral.displacement": [0, 0.4, 0]},
            Misuse,
            "30.* mm at [23].* s of the waveform; use",
        ),
        (
            TIMES,
            {"lateral.displacement": [0, 0.25, 0]},
            Misuse,
            "with 250 mm/s at .* s; .* follows 200 mm/s at most",
        ),
        (TIMES, {"platform.roll": [0, 0.25, 0]}, Misuse, "with 250 mrad/s at .*; .* 200 mrad/s"),
        (TIMES, {"lateral.displacement": [0, 0.01, 0.01]}, Misuse, "ends at 0.01; use 0 for both"),
        (TIMES, {"lateral.displacement": [0, np.nan, 0]}, Misuse, "2 finite numbers for 3 times"),
        (TIMES, {"lateral.displacement": [0, 0]}, Misuse, "2 finite numbers for 3 times"),
        (TIMES[::-1], {"lateral.displacement": [0, 0, 0]}, Misuse, "do not rise from 0 s"),
        (
            TIMES,
            {"lateral.force": [0, 1.0, 0]},
            Misuse,
            "lateral.control is 'displacement'; it must be 'force'",
        ),
        (TIMES, {"left.height": [0, 1.0, 0]}, KeyError, "left.height_setpoint"),
        (TIMES * 1e4, {"lateral.displacement": [0, 0.01, 0]}, Misuse, "up to 8 set-points and 1200 s"),
        (TIMES, {}, Misuse, "at least one"),
    ],
)
def test_what_cannot_be_is_refused_with_time_value_and_limit_before_anything_moves(
    made, times, offsets, error, words
):
    _, bench = made
    before = bench.commander.value("lateral.displacement_setpoint")
    with pytest.raises(error, match=words):
        bench.waveform.run(times, {name: np.array(way, float) for name, way in offsets.items()})
    assert not bench.commander.played.going
    assert bench.commander.value("lateral.displacement_setpoint") == before


def test_one_that_is_overruled_ends_and_says_so(made):
    _, bench = made
    bench.waveform.start(*_sideways(10 * mm))
    bench.wait(0.5 * s)
    bench.lateral.displacement_setpoint = 1 * mm
    with pytest.raises(Misuse, match=r"ended at 0\.5.* s of 2\.02 s, because one of its set-points received"):
        bench.waveform.wait_done(within=5 * s)
    assert bench.commander.value("lateral.displacement_setpoint") == 1 * mm


def test_one_that_is_stopped_leads_back_to_where_it_began(made):
    _, bench = made
    start = bench.commander.value("lateral.displacement_setpoint")
    bench.waveform.start(*_sideways(10 * mm))
    bench.wait(1 * s)
    assert abs(bench.commander.value("lateral.displacement_setpoint") - start) > 9 * mm
    bench.waveform.stop()
    bench.wait(0.5 * s)
    assert bench.commander.value("lateral.displacement_setpoint") == start
    bench.waveform.stop()  # nothing to do


def test_a_host_that_is_lost_in_the_middle_leaves_the_bench_holding(made):
    memory, bench = made
    bench.waveform.start(*_sideways(20 * mm, 4 * s))
    bench.wait(1 * s)
    memory.disconnect("can")
    with pytest.raises((LinkLost, RigFault)):
        bench.waveform.wait_done(within=10 * s)
    memory.clock.sleep_until(memory.clock.now() + round(0.2 * NS))
    assert memory.rig.state.name == "FAULT_HOLD"


def test_a_host_that_falls_silent_in_the_middle_leaves_the_bench_holding(made):
    memory, bench = made
    bench.waveform.start(*_sideways(20 * mm, 4 * s))
    bench.wait(1 * s)
    bench.commander.stop()
    with pytest.raises(RigFault, match="FAULT_"), bench.capture("lateral.displacement") as capture:
        bench.waveform.wait_done(within=10 * s)
    assert memory.rig.state.name in ("FAULT_REACTION", "FAULT_HOLD")
    found = capture.values("lateral.displacement")
    assert found[-2] - found[0] < 8 * mm  # of 20: it stands where the last cycle left it
    assert not bench.commander.played.going


@pytest.mark.parametrize("strange", [VirtualPlc, VirtualHall])
def test_a_described_rig_follows_it_by_way_of_python(strange):
    rig = strange(seed=1)
    with rig.bench() as bench:
        bench.arm()
        bench.lateral.control = "displacement"
        times, offsets = _sideways(10 * mm, 4 * s)
        with bench.capture("lateral.displacement") as capture:
            bench.waveform.run(times, offsets)
        there, found = capture.times("lateral.displacement"), capture.values("lateral.displacement")
        found = found - found[:3].mean()
        off = [
            np.std(found - np.interp(there - lag * ms, times, offsets["lateral.displacement"]))
            for lag in range(0, 400, 10)
        ]
        assert min(off) < 0.3 * mm
        with pytest.raises(Misuse, match="at most"):
            bench.waveform.run(*_sideways(100 * mm, 0.2 * s))


def test_a_rig_with_unknown_update_rate_is_not_moved(made):
    _, bench = made
    bench.wiring.capabilities = type(bench.wiring.capabilities)(generator=True)
    with pytest.raises(NotAvailable, match=r"does not state how fast lateral\.displ"):
        bench.waveform.run(*_sideways(10 * mm))


def _sideways(height, lasts=2 * s):
    times, way = bump(height, lasts)
    return times, {"lateral.displacement": way}


def test_whatever_moves_has_stopped_before_the_air_is_let_off(made, monkeypatch):
    """A plan that began one and came to grief before it waited for it."""
    _, bench = made
    bench.waveform.start(*_sideways(20 * mm, 60 * s))
    bench.wait(10 * s)
    going = []
    monkeypatch.setattr(carrying, "depressurise", lambda run: going.append(run.bench.commander.played.going))
    carrying.make_safe(SimpleNamespace(bench=bench))
    assert going == [False]
