"""Dimensions from motion: a correct description is not doubted, an error of 5 % is reported with the right value."""

from dataclasses import replace

import pytest

from astb.acceptance.checking.moving import move_each
from astb.acceptance.checking.report import MoveLine, Plausibility
from astb.rig_in_memory import RigInMemory
from bench_protocol.dimensions import Dimensions, across, ordinary, place
from bench_sim.parameters import load
from bench_sim.parameters.dimensions import dimensions_of
from bench_sim.rig.rig import Rig
from test_plans.analysis import VERTICAL_CELLS
from test_plans.instruments import ordinary as instruments

pytestmark = [pytest.mark.timeout(300), pytest.mark.slow]
#: A bench on which no two bodies are in line.
BUILT = {
    "spring_half_spacing": 1.23,
    "actuator_half_spacing": 1.1,
    "load_cell_y": 1.3,
    "bolster_mass": 2400.0,
}
#: The false statement: the line that reports it, and the dimensions of the file that it changes.
LIES = {
    "bolster mass": ("bolster_mass",),
    "spring half spacing": ("spring_half_spacing",),
    "lateral actuator height": ("lateral_actuator_height",),
    "centre height": ("centre_height",),
    "column height": ("column_height",),
    "left.height across": (across("left.height"), across("right.height")),
    "vertical_left across": (across("vertical_left"), across("vertical_right")),
    "places of the load cells across": tuple(place(cell)[1] for cell in VERTICAL_CELLS),
}


def lines_of(described: Dimensions, seed: int = 3, **built: float) -> dict[str, MoveLine]:
    memory = RigInMemory(Rig(load("astb").with_values(**built), seed=seed))
    with memory.bench() as bench:
        bench.instruments, bench.dimensions = instruments(), described
        lines = move_each(bench)
        assert bench.state == "DISABLED"
    return {one.what: one for one in lines}


def doubtful(lines: dict[str, MoveLine]) -> list[str]:
    return [f"{one.what}: {one.found}" for one in lines.values() if one.verdict is Plausibility.DOUBTFUL]


def described(**built: float) -> Dimensions:
    return ordinary().built(dimensions_of(load("astb").with_values(**built)))


def lied(about: str, factor: float) -> Dimensions:
    sound = described(**BUILT)
    wrong = {name: replace(sound.known[name], value=factor * sound.known[name].value) for name in LIES[about]}
    return replace(sound, known={**sound.known, **wrong})


def test_lengthwise_offsets_of_seats_are_reported():
    said = lines_of(ordinary(), seat_ahead=(20e-3, 20e-3))["springs' force, ahead of the middle"]
    value, _, rest = said.found.partition(" ± ")
    assert said.verdict is Plausibility.DOUBTFUL
    assert float(value) == pytest.approx(20.0, abs=1.0)
    assert float(rest.partition(" mm")[0]) < 3.0


@pytest.mark.parametrize("seed", range(1, 5))
@pytest.mark.parametrize("built", [{}, BUILT, {"spring_half_spacing": 0.8, "bolster_mass": 700.0}])
def test_a_sound_bench_is_not_accused_whatever_its_dimensions(built, seed):
    assert doubtful(lines_of(described(**built), seed, **built)) == []


@pytest.mark.parametrize("factor", [0.95, 1.05])
@pytest.mark.parametrize("about", LIES)
def test_a_five_per_cent_error_of_a_statement_is_found_with_the_right_value(about, factor):
    if about == "column height":  # the centre height above it is stated within 5 mm
        factor = 1 + 1.4 * (factor - 1)
    said = lines_of(lied(about, factor), **BUILT)[about]
    stated = described(**BUILT).known[LIES[about][0]]
    assert said.verdict is Plausibility.DOUBTFUL
    truth = BUILT["load_cell_y"] if "cells" in about else stated.value
    assert said.value == pytest.approx(truth, abs=said.uncertainty + stated.uncertainty)
    assert said.uncertainty < 0.04 * truth


def test_wrong_dimensions_of_a_bench_are_all_reported():
    lines = lines_of(ordinary(), **BUILT)
    for what, value in (
        ("bolster mass", 2400.0),
        ("spring half spacing", 1.23),
        ("vertical_left across", 1.1),
    ):
        assert lines[what].verdict is Plausibility.DOUBTFUL
        assert lines[what].value == pytest.approx(value, rel=0.02)


def test_a_rig_without_stated_data_is_measured():
    known = {name: one for name, one in ordinary().known.items() if "across" not in name}
    lines = lines_of(Dimensions("mine.toml", "", known))
    laser = lines["left.height across"]
    assert (laser.verdict, laser.right) == (Plausibility.UNTOLD, "not stated")
    assert laser.value == pytest.approx(1.0, rel=0.01)
