"""How six load cells share a load: statics, and a platform on four springs solved as such, are the oracles."""

import numpy as np
import pytest

from bench_sim.model.layout import Input, Sensor
from bench_sim.model.plant import Plant
from bench_sim.parameters.effects import with_effects
from bench_sim.parameters.loading import ParameterError
from test_plans.analysis.cells import PARTS, against_each_other, ahead_of, wrench
from test_plans.description import ours
from tests.refusals import refuses

CORNERS = np.array([[0.9, 1.0], [0.9, -1.0], [-0.9, 1.0], [-0.9, -1.0]])
#: Loads that differ from corner to corner: pressed unequally, pushed sideways, the platform rolled.
PRESSED, PUSHED, ROLLED = 6e3, 3e3, 4e-3


@pytest.fixture
def cells(parameters):
    """Make a loaded bench with effects and return what its cells read, and what else is true of it."""

    def read(effects=None):
        plant = Plant.at_rest(with_effects(parameters("AW0", ("noise",)), effects or {}).record)
        plant.inputs[Input.VERTICAL_LEFT_COMMAND] += PRESSED
        plant.inputs[Input.LATERAL_COMMAND] = PUSHED
        plant.inputs[Input.PLATFORM_ROLL] = ROLLED
        plant.step(200)
        return plant.ideal()[Sensor.LOAD_CELL_1 : Sensor.LOAD_CELL_6 + 1].copy(), plant.truth()

    return read


def parts(readings):
    values = {f"load_cell.{k}": one for k, one in enumerate(readings, 1)}
    return dict(zip(PARTS, (float(one) for one in wrench(values, ours())), strict=True))


def test_a_sound_bench_is_even_lengthwise(cells):
    readings, _ = cells()
    assert readings[0] == readings[2] and readings[1] == readings[3] and readings[4] == readings[5]


def test_a_seat_off_the_middle_pitches_and_yaws_the_wrench(cells):
    """r × F of each spring's force where its seat stands: M_y = −x F_z, M_z = x F_y of what pushes the bolster."""
    ahead = {"left": 7e-3, "right": -3e-3}
    sound, truth = cells()
    readings, _ = cells({f"seat_offset.{side}": {"ahead": one} for side, one in ahead.items()})
    found, before = parts(readings), parts(sound)
    F_z, F_y = (np.array([truth[f"{way}_force[{i}]"] for i in (0, 1)]) for way in ("vertical", "lateral"))
    x = np.array(list(ahead.values()))
    assert found["pitch moment"] == pytest.approx(-(x @ F_z), rel=1e-9)
    assert found["yaw moment"] == pytest.approx(x @ F_y, rel=1e-9)
    for part in ("force sideways", "force upward", "roll moment"):
        assert found[part] == pytest.approx(before[part], rel=1e-9), part
    assert len(set(readings)) == 6, "six readings, none of which follows from another"


def test_a_load_off_the_middle_pitches_without_yawing(cells):
    readings, truth = cells({"load_offset": {"ahead": 4e-3}})
    pressed = truth["vertical_left_force"] + truth["vertical_right_force"]
    assert parts(readings)["pitch moment"] == pytest.approx(-4e-3 * pressed, rel=1e-9)
    assert readings[4] == readings[5]


@pytest.mark.parametrize("softer", [0.05, 0.6, 8.0])
@pytest.mark.parametrize("cell", [1, 2, 3, 4])
def test_a_soft_support_leaves_its_load_to_its_neighbours(cells, cell, softer):
    """Against heave, roll and pitch of a rigid platform on four springs, one of them 1 + δ times as compliant."""
    sound, _ = cells()
    readings, _ = cells({f"soft_support.{cell}": {"softer": softer}})
    stiffness = np.ones(4)
    stiffness[cell - 1] /= 1.0 + softer
    ways = np.column_stack((np.ones(4), CORNERS))  # what each corner moves by one of heave, pitch and roll
    upright = sound[:4]
    moved = np.linalg.solve(ways.T @ (stiffness[:, None] * ways), ways.T @ upright)
    np.testing.assert_allclose(readings[:4], stiffness * (ways @ moved), rtol=1e-9)
    assert readings[cell - 1] < upright[cell - 1]
    np.testing.assert_array_equal(readings[4:], sound[4:])


def test_a_twisted_seat_loads_a_diagonal_whatever_it_carries(cells):
    """Four supports of stiffness k, one short by s: the same platform on springs of which one begins s lower."""
    sound, _ = cells()
    k, short = 4e8, 10e-6
    readings, _ = cells({"twisted_seat": {"force": 0.25 * k * short}})
    ways = np.column_stack((np.ones(4), CORNERS))
    gap = short * np.eye(4)[1]  # below cell 2
    moved = np.linalg.solve(k * ways.T @ ways, ways.T @ (sound[:4] + k * gap))
    np.testing.assert_allclose(readings[:4], k * (ways @ moved - gap), rtol=1e-9)
    assert parts(readings) == pytest.approx(parts(sound), rel=1e-9, abs=1e-6)


def test_plans_read_from_six_cells_what_no_sum_of_them_tells(cells):
    twist = {"twisted_seat": {"force": 700.0}}
    both = {f"seat_offset.{side}": {"ahead": 6e-3} for side in ("left", "right")}
    readings, _ = cells(twist | both)
    values = {f"load_cell.{k}": one for k, one in enumerate(readings, 1)}
    found = against_each_other(values, ours())
    assert list(found.values()) == pytest.approx([700.0, -700.0, -700.0, 700.0, 0.0, 0.0], abs=1e-6)
    for force in ("force upward", "force sideways"):
        size, moment = ahead_of(values, ours(), force)
        assert moment / size == pytest.approx(6e-3, rel=1e-6), force


def test_four_supports_that_are_alike_are_as_good_as_stiff_ones(cells):
    sound, _ = cells()
    readings, _ = cells({f"soft_support.{cell}": {"softer": 0.5} for cell in (1, 2, 3, 4)})
    np.testing.assert_allclose(readings, sound, rtol=1e-12)


def test_invalid_soft_supports_are_refused(parameters):
    with refuses(ParameterError, "softer -10 % 0 % 1000 %"):
        with_effects(parameters("AW0"), {"soft_support.1": {"softer": -0.1}})
    with refuses(ParameterError, "soft_support.5"):
        with_effects(parameters("AW0"), {"soft_support.5": {"softer": 0.1}})


def test_sums_for_the_springs_do_not_change(cells):
    """What a diagnosis and the plans make of the cells for each spring is free of all this."""
    sound, _ = cells()
    readings, _ = cells(
        {"soft_support.3": {"softer": 0.4}, "twisted_seat": {"force": 800.0}, "load_offset": {"ahead": 0.01}}
    )
    for share in ([1, 1, 1, 1], [1, -1, 1, -1]):
        assert np.dot(share, readings[:4]) == pytest.approx(np.dot(share, sound[:4]), rel=1e-12)
