"""A computed car on the rigs of strangers: the delay of each is measured, and what it does not allow is refused."""

import pytest

from bench_records.result import CheckVerdict, Outcome
from test_plans.discovery import plans
from test_plans.execution import execute
from tests.foreign.virtual import VirtualHall, VirtualPlc, VirtualYard

pytestmark = [pytest.mark.slow, pytest.mark.timeout(300)]
ACCELERATION = "lateral acceleration of the floor, rms"


def ride_on(made, folder, load):
    given = {"load": load, "wind": "10 m/s", "duration": "20 s"}
    with made(seed=1).bench() as bench:
        result = execute(plans()["ride"].given(given), bench, folder, rig=made.name, seed=1)
        assert bench.state != "FAULT_DISABLED"
    return result, {one.name: one for one in result.checks}


def test_it_rides_where_the_delay_allows_it_and_agrees_with_the_simulation(tmp_path):
    """Rig B answers after 52 ms, has springs at other places and no transducer for the lateral force."""
    result, found = ride_on(VirtualHall, tmp_path / "out", "AW0")
    assert result.verdict is Outcome.PASS, result.reason
    assert not any("comfort" in name for name in found)  # an index needs five minutes
    assert found[ACCELERATION].verdict is CheckVerdict.PASS
    assert abs(found["acceleration against the simulation, E_n"].value) <= 1.0
    assert abs(found["mean lean against the simulation, E_n"].value) <= 1.0


@pytest.mark.parametrize(("made", "words"), [(VirtualPlc, "every 50 ms"), (VirtualYard, "every 20 ms")])
def test_it_does_not_ride_where_the_delay_does_not_allow_it(tmp_path, made, words):
    result, found = ride_on(made, tmp_path / "out", "AW0")
    assert result.verdict is Outcome.BLOCKED
    assert {one.verdict for one in found.values()} == {CheckVerdict.NOT_AVAILABLE}
    assert words in result.reason
    assert "a car on it would swing by itself, and does not ride. It would with" in result.reason


def test_a_rig_without_a_car_in_its_tick_says_so_before_anything_moves(tmp_path):
    """Simulated on the host it runs; on the rig it is blocked with the missing signal."""
    with VirtualHall(seed=1).bench() as bench:
        given = {"load": "AW0", "by": "rig"}
        result = execute(plans()["ride"].given(given), bench, tmp_path / "out", rig=VirtualHall.name, seed=1)
    assert result.verdict is Outcome.BLOCKED
    assert "action.program_car" in result.reason
    assert "by the host it can" in result.reason
