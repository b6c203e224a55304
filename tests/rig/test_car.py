"""A car in the tick: what moves it is measured, what it moves is the springs, and it ends as any program does."""

import numpy as np
import pytest

from bench_protocol.units import Hz, m, mm, ms
from bench_protocol.words import CONTROL_MODES, Program

DISPLACEMENT = CONTROL_MODES.index("displacement")
#: A car that no spring moves: its track alone moves them.
HEAVY = {
    "car_mass": 1e9, "car_roll_gyration": 1.3 * m, "car_centre_height": 0.67 * m,
    "car_track_frequency": 1.2 * Hz, "car_track_waves": 6,
    "car_piston_lead": 14 * ms, "car_platform_lead": 8 * ms,
    **{f"car_stop_travel_{k}": (20 + 5 * k) * mm for k in range(1, 10)},
}  # fmt: skip


@pytest.fixture
def floating(commander):
    """A bench whose springs carry the bolster, held at its place."""
    commander.arm()
    commander.hold_height()
    commander.apply(lateral_control=DISPLACEMENT)
    return commander


def ride(commander, seconds, **car):
    commander.apply(**HEAVY | car)
    assert commander.coil("program_car")[0] == 5
    rows = []
    for _ in range(round(seconds / 0.02)):
        commander.cycle()
        rows.append([commander.read(name) for name in NAMES])
    return dict(zip(NAMES, np.array(rows).T, strict=True))


NAMES = (
    "car.shear", "car.height", "car.roll", "car.wind", "left.height", "right.height", "lateral.displacement",
    "rig.program", "rig.generator_cycle",
)  # fmt: skip


def test_springs_follow_a_track_that_moves_under_a_car_that_stands(floating):
    found = ride(floating, 7.5, car_track_vertical=5 * mm)
    there = np.isfinite(found["car.height"])
    assert there.sum() == pytest.approx(6 / 1.2 * 50, abs=2)
    asked = found["car.height"][there]
    assert asked.min() == pytest.approx(-5 * mm, abs=0.02 * mm)
    moved = 0.5 * (found["left.height"] + found["right.height"])[there]
    assert moved - moved[0] == pytest.approx(asked, abs=0.4 * mm)
    assert found["rig.program"][-1] == Program.IDLE
    assert found["rig.generator_cycle"][-1] == 6
