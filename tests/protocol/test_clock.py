"""The clock: absolute deadlines in real time, strict order in virtual time."""

import threading

import pytest

from bench_protocol.clock import RealClock, VirtualClock
from bench_protocol.units import NS
from tests.refusals import refuses

MS = NS // 1000


def test_virtual_time_passes_only_in_sleep_and_stops_at_every_cycle() -> None:
    clock = VirtualClock()
    world: list[int] = []
    cycles: list[tuple[str, int]] = []
    clock.attach(world.append)
    clock.every(20 * MS, lambda: cycles.append(("command", clock.now())))
    clock.every(30 * MS, lambda: cycles.append(("poll", clock.now())))
    clock.sleep_until(65 * MS)
    assert cycles == [
        ("command", 20 * MS),
        ("poll", 30 * MS),
        ("command", 40 * MS),
        ("command", 60 * MS),
        ("poll", 60 * MS),
    ]
    assert world == [20 * MS, 30 * MS, 40 * MS, 60 * MS, 65 * MS]
    assert clock.now() == 65 * MS


def test_virtual_time_never_goes_back() -> None:
    clock = VirtualClock()
    clock.sleep_until(5 * MS)
    clock.sleep_until(3 * MS)
    assert clock.now() == 5 * MS


def test_a_cancelled_cycle_does_not_come() -> None:
    clock = VirtualClock()
    cycles: list[int] = []
    task = clock.every(MS, lambda: cycles.append(clock.now()))
    clock.every(2 * MS, task.cancel)
    clock.sleep_until(10 * MS)
    assert cycles == [MS, 2 * MS]


@pytest.mark.real_time
def test_real_cycles_use_absolute_deadlines() -> None:
    clock = RealClock()
    cycles: list[int] = []
    enough = threading.Event()
    start = clock.now()

    def cycle() -> None:
        cycles.append(clock.now())
        clock.sleep_until(clock.now() + 3 * MS)  # work that would add up if deadlines were relative
        if len(cycles) == 20:
            enough.set()

    task = clock.every(10 * MS, cycle)
    assert enough.wait(5)
    task.cancel()
    # 19 periods later than the first, plus what this machine was late: never 19 times 3 ms more.
    assert cycles[19] - start < 20 * 10 * MS + 40 * MS
    assert all(time - start >= (k + 1) * 10 * MS for k, time in enumerate(cycles[:20]))


@pytest.mark.real_time
def test_a_scaled_clock_runs_at_its_pace() -> None:
    fast, wall = RealClock(scale=50.0), RealClock()
    fast.sleep_until(fast.now() + NS // 2)
    assert 9 * MS < wall.now() < 200 * MS


def test_a_pace_that_cannot_be_kept_is_refused() -> None:
    with refuses(ValueError, "scale 1e+06"):
        RealClock(scale=1e6)
