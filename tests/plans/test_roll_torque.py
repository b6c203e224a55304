"""Roll torque: pure motions give the stiffnesses of a sheared and rolled spring, known for a virtual one."""

import numpy as np
import pytest

from bench_protocol.units import kN
from bench_records.result import Outcome
from bench_sim.model.spring import coupling_stiffness
from bench_sim.parameters import load
from test_plans.description import ours
from test_plans.discovery import plans
from test_plans.instruments import ordinary
from test_plans.plans.roll_torque import Motion, _law, _motions
from test_plans.steps.wind import fade

OURS = ours()
TORSION = "torsional stiffness of one diaphragm, K_φ"
BY_ROLL = "lateral force of a spring per radian of roll, K_yφ"
BY_SHEAR = "roll torque of a spring per metre of shear, K_φy"


def test_the_law_is_solved_whatever_shear_a_roll_still_has():
    """Both equations forwards, with a loss and with motions that are not pure; both backwards must give the same."""
    K = np.array([[160e3 + 20e3j, 37e3], [41e3, 380e3 + 60e3j]])
    b = OURS["spring_half_spacing"]
    k_z = 370e3 + 55e3j

    def moved(y: complex, phi: complex, z: complex) -> Motion:
        force, torque = 2 * K @ np.array([y, phi])
        return Motion(y, phi, z, force, torque, 2 * k_z * z)

    up = moved(0.0, 0.0, 0.01)
    found = _law(OURS, up, moved(3e-4 + 1e-4j, 0.01, 0.0), moved(5e-3, 2e-4j, 0.0), up)
    assert found.by_roll == pytest.approx(37e3)
    assert found.by_shear == pytest.approx(41e3)
    assert found.ratio == pytest.approx(37 / 41)
    assert found.torsion == pytest.approx(380e3 - b**2 * 370e3)
    assert found.of_the_pair == pytest.approx(760e3)


def test_the_roll_axis_is_the_middle_of_the_top_plates():
    up, rolled, sheared, again = _motions(OURS, 0.01)
    above = OURS["centre_height"] + OURS["lateral_actuator_height"]
    assert rolled["lateral"] + above * 0.01 == pytest.approx(0.0)
    assert rolled["vertical_left"] == -rolled["vertical_right"] > 0.0
    assert up == again == {"vertical_left": 0.01, "vertical_right": 0.01}
    assert set(sheared) == {"lateral"}
    assert fade(np.array([0.0, 1.0, 2.0]), 1.0)[1] == 1.0


@pytest.mark.slow
@pytest.mark.parametrize(
    ("case", "changes", "verdict"),
    [
        ("AW0", {}, Outcome.PASS),
        ("AW3", {"torsional_stiffness": 20e3, "coupling_sign": 0.7}, Outcome.FAIL),
    ],
)
def test_the_truth_of_the_simulated_spring_lies_within_the_uncertainty(judged, case, changes, verdict):
    result, failed = judged("roll_torque", given={"load": case}, instruments=ordinary(), **changes)
    assert result.verdict is verdict, result.reason or failed
    assert result.duration == pytest.approx(plans()["roll_torque"].lasts, rel=0.1)
    if changes:
        assert {TORSION, BY_ROLL, BY_SHEAR} <= failed
    preload = {"AW0": 53.5 * kN, "AW3": 145 * kN}[case]
    par = load("astb").with_values(nominal_preload=preload, **changes).record
    coupling = float(par.coupling_sign) * coupling_stiffness(par, 0)
    size = 0.01 / float(par.coupling_angle)
    # First harmonic of tanh at 10 mrad, by its integral over a cycle.
    angle = np.linspace(0.0, 2 * np.pi, 400, endpoint=False)
    saturated = 2 * np.mean(np.tanh(size * np.sin(angle)) * np.sin(angle)) / size
    gauge = preload / float(par.effective_area[0])
    truth = {
        BY_ROLL: coupling * saturated,
        BY_SHEAR: coupling,
        TORSION: float(par.torsional_stiffness[0] + par.torsional_stiffness_slope[0] * gauge),
    }
    for one in result.checks:
        if one.name in truth:
            assert abs(one.number - truth[one.name]) <= one.expanded, one.name
