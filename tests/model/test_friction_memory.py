"""What friction remembers: a tremble leaves no trace, a loop worth the name begins a new curve as Berg has it."""

import numpy as np
import pytest

from bench_sim.model.layout import STATES, Input
from bench_sim.model.plant import Plant
from bench_sim.model.quantities import MEMORY
from bench_sim.model.rubber import friction_curve, turn_friction
from bench_sim.parameters import load

TRAVEL = 3e-3
SMALL_LOOP = float(load("astb").record.friction_small_loop)


class Element:
    """One friction element, moved from place to place."""

    def __init__(self, small_loop=SMALL_LOOP):
        self.mem = np.zeros(1, MEMORY).view(np.recarray)[0]
        self.par = load("astb").with_values(friction_small_loop=small_loop).record

    def go(self, *places):
        """Move straight to each place and return the normalised force at the last."""
        for place in places:
            start = float(self.mem.friction_last[0, 0])
            for position in np.linspace(start, place, 50)[1:]:
                turn_friction(self.mem, self.par, 0, 0, position, 0.0, 0.0, TRAVEL, 1e-3)
        last = float(self.mem.friction_last[0, 0])
        origin, level = self.mem.friction_origin[0, 0], self.mem.friction_level[0, 0]
        return friction_curve(last, float(origin), float(level), TRAVEL)[0]


@pytest.mark.parametrize("back", [1e-9, 1e-6, 50e-6, 0.99 * SMALL_LOOP * TRAVEL])
def test_a_tremble_on_the_way_leaves_no_trace(back):
    straight = Element().go(-2e-3, 1e-3, 4e-3)
    trembling = Element()
    for turn in (-1e-3, 0.0, 1e-3):
        trembling.go(-2e-3 if turn == -1e-3 else turn - 0.5e-3, turn, turn - back)
    assert trembling.go(1e-3, 4e-3) == pytest.approx(straight, abs=1e-12)


def test_a_small_friction_loop_is_almost_closed():
    element = Element()
    before = element.go(-2e-3, 1e-3)
    element.go(1e-3 - 0.9 * SMALL_LOOP * TRAVEL)
    returned = element.go(1e-3 - 1e-9)
    assert abs(returned - before) < 1.0 / 400.0


def test_a_large_loop_begins_a_new_curve():
    """Berg (1998): from the last reversal on, nothing before it counts."""
    element = Element()
    element.go(-2e-3, 1e-3)
    low = element.go(0.0)
    expected, _ = friction_curve(2e-3, 0.0, low, TRAVEL)
    assert element.go(2e-3) == pytest.approx(expected, rel=1e-9)
    assert abs(expected - Element().go(-2e-3, 2e-3)) > 0.02


@pytest.mark.parametrize("back", [1e-6, 50e-6, 0.99 * SMALL_LOOP * TRAVEL])
def test_without_small_loops_every_reversal_starts_anew(back):
    """Berg (1998), by his closed form from each reversal to the next."""
    berg, turn = 0.0, 0.0
    for place in (-2e-3, 1e-3, 1e-3 - back, 4e-3):
        berg, turn = friction_curve(place, turn, berg, TRAVEL)[0], place
    element = Element(small_loop=0.0)
    assert element.go(-2e-3, 1e-3, 1e-3 - back, 4e-3) == pytest.approx(berg, abs=1e-12)
    assert element.mem.friction_outer_way[0, 0] == 0.0
    assert abs(berg - Element().go(-2e-3, 1e-3, 1e-3 - back, 4e-3)) > 0.01


def test_the_share_says_how_small_a_loop_is():
    """Back over 3 % of x₂: closed at a share of 4 %, a new curve at 2 %."""
    way = (-2e-3, 1e-3, 1e-3 - 0.03 * TRAVEL, 4e-3)
    assert Element(0.04).go(*way) == pytest.approx(Element().go(-2e-3, 4e-3), abs=1e-12)
    assert Element(0.02).go(*way) == pytest.approx(Element(0.0).go(*way), abs=1e-12)


def test_trembles_inside_a_small_loop_do_not_add_up():
    element = Element()
    element.go(-2e-3, 1e-3)
    element.go(1e-3 - 60e-6, 1e-3 - 30e-6, 1e-3 - 80e-6, 1e-3 - 10e-6)
    assert element.go(3e-3) == pytest.approx(Element().go(-2e-3, 3e-3), abs=1e-12)


def test_the_bench_hardly_feels_a_tremble_of_its_table():
    """Micrometres of the platform in a slow motion change the springs' force proportionally, not by 10 %."""

    def force(tremble):
        plant = Plant.at_rest(load("astb").record)
        plant.inputs[Input.DPV_CONNECTED] = 0.0
        forces = []
        for k in range(3000):
            plant.inputs[Input.PLATFORM_VERTICAL] = 2e-3 * k / 3000 + tremble * np.sin(
                2 * np.pi * 15.0 * k * 1e-3
            )
            plant.step()
            forces.append(plant.truth()["stack_vertical[0]"] if k % 50 == 49 else 0.0)
        assert plant.state.shape == (STATES,)
        return np.array(forces)[np.arange(3000) % 50 == 49][-20:].mean()

    assert abs(force(20e-6) - force(0.0)) < 0.02 * float(load("astb").record.friction_vertical[0])
