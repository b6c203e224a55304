"""Causes that grow, that are gone again, and two at once: through the wires they are named, with size and times."""

import numpy as np
import pytest

from astb_studies.benchmarks.twin.cases import Case
from astb_studies.benchmarks.twin.rigs import bench_of
from bench_records.record import read
from bench_sim.parameters import load
from bench_sim.rig.faults.panel import PlannedFault
from diagnosis.twin.twin import Twin
from test_plans.discovery import plans
from test_plans.execution import execute
from tests.twin.test_twin import Growing, run

pytestmark = pytest.mark.slow


def during_and_after(folder, until: float, *looks: float):
    """Return the twin's only parting, after looks while the run went on and one at its end."""
    growing = Growing(read(folder))
    twin = Twin(growing, load("astb"), "astb")
    for growing.until in looks:
        twin.look(ended=False)
    growing.until = until
    (parting,) = twin.look().all_deviations
    return parting


def words(parting) -> list[str]:
    return [one.word for one in parting.course]


def test_two_simultaneous_causes_are_reported_together(tmp_path):
    leak = PlannedFault("leak", {"side": "left", "area": "0.5mm2"}, 60.0, None)
    cell = PlannedFault("bias", {"sensor": "load_cell.2", "value": "1kN"}, 66.0, None)
    parting = during_and_after(run("aw0", tmp_path, 14, leak, cell), 85.0)
    assert not parting.causes
    names = {tuple(one.name for one in pair) for pair in parting.pairs}
    assert names <= {("leak.left", "cell_offset.2"), ("leak_laminar.left", "cell_offset.2")}
    hole, zero = next(pair for pair in parting.pairs if pair[0].name == "leak.left")
    assert hole.low < 0.5e-6 < hole.high and hole.since == pytest.approx(60.0, abs=1.0)
    assert zero.low < 1000.0 < zero.high and zero.since == pytest.approx(66.0, abs=0.3)
    assert "leak of a bellows (orifice), left" in parting.sentence


def test_while_it_lasts_only_the_first_of_two_is_reported(tmp_path):
    leak = PlannedFault("leak", {"side": "left", "area": "0.5mm2"}, 60.0, None)
    cell = PlannedFault("bias", {"sensor": "load_cell.2", "value": "1kN"}, 72.0, None)
    parting = during_and_after(run("aw0", tmp_path, 19, leak, cell), 85.0, 66.0, 70.0)
    assert words(parting)[0] == "told" and words(parting)[-1] == "otherwise"
    assert "leak.left" in {one.name for one in parting.course[0].causes}
    assert ("leak.left", "cell_offset.2") in {tuple(one.name for one in pair) for pair in parting.pairs}
    assert parting.lasts


@pytest.mark.parametrize(
    ("fault", "values", "cause", "size"),
    [
        ("leak", {"side": "left", "area": "0.5mm2"}, "leak.left", 0.5e-6),
        ("bias", {"sensor": "load_cell.2", "value": "0.5kN"}, "cell_offset.2", 500.0),
    ],
)
def test_a_temporary_deviation_has_start_and_end(tmp_path, fault, values, cause, size):
    folder = run("aw0", tmp_path, 16, PlannedFault(fault, values, 62.0, 8.0))
    parting = during_and_after(folder, 88.0, 68.0)
    found = next(one for one in parting.causes if one.name == cause)
    assert found.form == "gone again"
    assert found.low < size < found.high
    assert found.since == pytest.approx(62.0, abs=1.0)
    assert found.until == pytest.approx(70.0, abs=1.0)
    assert parting.over == pytest.approx(70.0, abs=1.0) and not parting.lasts
    assert words(parting) == ["told", "otherwise", "over"]
    assert f"{parting.over:.1f} s" in parting.sentence


@pytest.mark.parametrize(("effect", "size"), [("leak.left", 1e-6), ("cell_offset.3", 600.0)])
def test_a_growing_deviation_is_reported_with_size_and_falling_uncertainty(tmp_path, effect, size):
    case = Case("aw0", 5, effect=effect, size=size, at=58.0, creeps=25.0)
    folder = tmp_path / "run"
    with bench_of(case) as bench:
        execute(plans()["aw0"], bench, folder, rig="virtual", seed=case.seed)
    parting = during_and_after(folder, 95.0, 75.0)
    found = next(one for one in parting.causes if one.name == effect)
    assert {one.name for one in parting.causes} <= {effect, "leak_laminar.left"}
    assert found.form == "growing"
    assert found.low < size < found.high
    assert found.since == pytest.approx(58.0, abs=3.0)
    assert found.until == pytest.approx(83.0, abs=3.0)
    early = next(one for one in parting.course[0].causes if one.name == effect)
    assert abs(early.size) < 0.95 * size, "at 75 s two thirds of it have grown"
    assert words(parting)[0] == "told" and len(parting.course) > 1


@pytest.mark.parametrize(
    ("effect", "size", "share"),
    [("auxiliary_volume", 0.8, 0.01), ("blocked_orifice.left", 0.75, 0.05)],
)
def test_a_growing_deviation_in_the_nonlinear_range_is_reported_with_size(tmp_path, effect, size, share):
    case = Case("screening", 5, effect=effect, size=size, at=145.0, creeps=30.0)
    folder = tmp_path / "run"
    with bench_of(case) as bench:
        execute(plans()["screening"], bench, folder, rig="virtual", seed=case.seed)
    first, *_ = Twin(read(folder), load("astb"), "astb").look().all_deviations
    (found,) = first.causes
    assert found.name == effect and found.form == "growing"
    assert found.size == pytest.approx(size, rel=share)
    assert found.low < size < found.high
    assert found.since == pytest.approx(145.0, abs=2.0)


def test_what_is_gone_in_the_next_stretch_is_over(tmp_path):
    fault = PlannedFault("bias", {"sensor": "load_cell.2", "value": "0.5kN"}, 100.0, 95.0)
    parting = during_and_after(run("endurance", tmp_path, 17, fault), 330.0)
    assert {one.name for one in parting.causes} == {"cell_offset.2"}
    assert parting.since == pytest.approx(100.0, abs=1.0)
    assert parting.over == pytest.approx(195.0, abs=1.5)
    assert words(parting)[0] == "told" and words(parting)[-1] == "over"


def test_one_fault_over_many_segments_is_one_deviation(tmp_path):
    fault = PlannedFault("bias", {"sensor": "load_cell.2", "value": "0.5kN"}, 90.0, None)
    parting = during_and_after(run("endurance", tmp_path, 18, fault), 330.0)
    assert {one.name for one in parting.causes} == {"cell_offset.2"}
    assert parting.lasts
    assert np.sign(parting.causes[0].size) == 1.0


def test_updates_do_not_wait_for_the_search_and_end_equal(tmp_path):
    leak = PlannedFault("leak", {"side": "left", "area": "0.5mm2"}, 60.0, None)
    cell = PlannedFault("bias", {"sensor": "load_cell.2", "value": "1kN"}, 66.0, None)
    folder = run("aw0", tmp_path, 14, leak, cell)
    growing, said = Growing(read(folder)), []
    twin = Twin(growing, load("astb"), "astb")
    for growing.until in np.arange(61.0, 72.0, 1.0):
        story = twin.look(ended=False, later=True)
        twin.search(0.7)
        said += [(growing.until, one) for one in story.all_deviations[-1:]]
    first, *_, last = said
    assert first[0] < 65.0 and words(first[1]) == ["told"] and not first[1].searched
    assert "search" in first[1].sentence
    assert [one.word for one in last[1].course][:2] == ["told", "explained"]
    assert {"leak.left"} <= {one.name for one in last[1].course[1].causes}
    growing.until = 78.0
    (parting,) = twin.look().all_deviations
    assert parting.searched and not twin.searches
    assert ("leak.left", "cell_offset.2") in {tuple(one.name for one in pair) for pair in parting.pairs}
    assert words(parting)[:2] == ["told", "explained"] and words(parting)[-1] == "otherwise"
