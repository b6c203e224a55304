"""What motion tells of dimensions: a sound description is not doubted, one 5 % off is told with what is right."""

import pytest

from acceptance.checking.moving import move_each
from acceptance.checking.report import Plausibility
from astb.rig_in_memory import RigInMemory
from bench_protocol.dimensions import Dimensions, across, ordinary
from bench_sim.parameters import load
from bench_sim.parameters.dimensions import dimensions_of
from bench_sim.rig.rig import Rig
from test_plans.instruments import ordinary as instruments

pytestmark = pytest.mark.timeout(300)
slow = pytest.mark.slow
#: A bench on which no two things stand in line.
BUILT = {
    "spring_half_spacing": 1.23,
    "actuator_half_spacing": 1.1,
    "load_cell_y": 1.3,
    "bolster_mass": 2400.0,
}
#: What a parameter of the rig is called in its description, and what a line about it begins with.
SEEN = {
    "bolster_mass": ("bolster mass", "kg"),
    "spring_half_spacing": ("spring half spacing", "m"),
    "actuator_half_spacing": ("vertical_left across", "m"),
    "load_cell_y": ("places of the load cells", "m"),
}


def doubts(described: Dimensions, **built: float) -> dict[str, str]:
    """Return what the moves of a rig contradict, and by which value."""
    memory = RigInMemory(Rig(load("astb").with_values(**built), seed=3))
    with memory.bench() as bench:
        bench.instruments, bench.dimensions = instruments(), described
        lines = move_each(bench)
        assert bench.state == "DISABLED"
    assert sum(" ± " in one.found for one in lines) > 12
    return {one.what: one.found for one in lines if one.verdict is Plausibility.DOUBTFUL}


@slow
def test_seats_that_stand_off_the_middle_lengthwise_are_told_with_how_far():
    told = doubts(ordinary(), seat_ahead=(20e-3, 20e-3))
    (said,) = (found for what, found in told.items() if what == "springs' force, ahead of the middle")
    value, _, rest = said.partition(" ± ")
    assert float(value) == pytest.approx(20.0, abs=1.0)
    assert float(rest.partition(" mm")[0]) < 3.0


def described(**built: float) -> Dimensions:
    return ordinary().built(dimensions_of(load("astb").with_values(**built)))


def test_a_bench_of_other_dimensions_is_as_its_description_says():
    assert doubts(described(**BUILT), **BUILT) == {}


@pytest.mark.parametrize(
    "name", [pytest.param(one, marks=slow) if one != "load_cell_y" else one for one in SEEN]
)
def test_what_is_stated_five_per_cent_too_large_is_told_with_what_is_right(name):
    what, unit = SEEN[name]
    told = doubts(described(**BUILT | {name: 1.05 * BUILT[name]}), **BUILT)
    said = next(found for line, found in told.items() if line.startswith(what))
    value, _, rest = said.partition(" ± ")
    assert float(value) == pytest.approx(BUILT[name], rel=0.015)
    assert f" {unit}" in rest


@slow
def test_with_our_dimensions_for_another_bench_all_that_is_seen_is_told():
    told = doubts(ordinary(), **BUILT)
    for what, _ in SEEN.values():
        assert any(one.startswith(what) for one in told), what


def test_a_rig_of_which_nothing_is_stated_is_measured_all_the_same():
    known = {name: one for name, one in ordinary().known.items() if "across" not in name}
    memory = RigInMemory(Rig(load("astb"), seed=3))
    with memory.bench() as bench:
        bench.instruments, bench.dimensions = instruments(), Dimensions("mine.toml", "", known)
        lines = {one.what: one for one in move_each(bench)}
    laser = lines["left.height across, by the roll of the platform"]
    assert (laser.verdict, laser.right) == (Plausibility.UNTOLD, "not stated")
    assert float(laser.found.partition(" ± ")[0]) == pytest.approx(1.0, rel=0.01)
    assert across("vertical_left") in lines
