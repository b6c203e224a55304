"""Friction and viscoelasticity against their closed forms."""

import numpy as np
import pytest

from bench_protocol.units import mm
from bench_sim.model.algebraic import Algebraic
from bench_sim.model.experiments import LATERAL, ImposedMotion, Shape, dynamic_stiffness, impose, isolate
from bench_sim.model.rubber import friction_curve

F_MAX, X_2 = 500.0, 4 * mm


def friction_only(resting, **changes):
    """Nothing lateral but friction: no membrane, no shell, no slope with pressure."""
    nothing = {
        "membrane_length": 0,
        "membrane_length_slope": 0,
        "shell_stiffness_lateral": 0,
        "friction_lateral_slope": 0,
        "coupling_sign": 0,
    }
    plant = resting("AW0", ("emergency_spring",), **(nothing | {"friction_lateral": F_MAX} | changes))
    isolate(plant)
    return plant


@pytest.mark.parametrize("shape", [Shape.SINE, Shape.TRIANGLE])
@pytest.mark.parametrize("x_0", [0.5 * mm, 5 * mm, 20 * mm])
def test_amplitude_and_loss_of_a_friction_loop(resting, x_0, shape):
    plant = friction_only(resting)
    impose(plant, [ImposedMotion(LATERAL, x_0, 1.0, shape)], 30.0, rows=0)
    loop = impose(plant, [ImposedMotion(LATERAL, x_0, 1.0, shape)], 1.001)
    F, y = -loop.of(Algebraic.LATERAL_FORCE), loop.of(Algebraic.LATERAL)
    F_0 = F_MAX / (2 * X_2) * (np.sqrt(X_2**2 + x_0**2 + 6 * X_2 * x_0) - X_2 - x_0)
    mu = F_0 / F_MAX
    loss = 2 * F_MAX * (2 * x_0 - X_2 * (1 + mu) ** 2 * np.log((X_2 * (1 + mu) + 2 * x_0) / (X_2 * (1 + mu))))
    assert 0.5 * np.ptp(F) == pytest.approx(F_0, rel=2e-3)
    assert np.sum(0.5 * (F[1:] + F[:-1]) * np.diff(y)) == pytest.approx(loss, rel=5e-3)


def test_friction_does_not_know_the_rate(resting):
    stiffness = [
        dynamic_stiffness(friction_only(resting), 5 * mm, f, 25, direction=LATERAL, longest_step=0.5e-3 / f)[
            0
        ]
        for f in (0.1, 1.0, 3.0)
    ]
    assert stiffness[0] == pytest.approx(stiffness[1], rel=1e-3)
    assert stiffness[1] == pytest.approx(stiffness[2], rel=1e-3)


def test_friction_never_exceeds_its_limit():
    for level in (-1.0, -0.3, 0.0, 0.8, 1.0):
        for x in (-1.0, -1e-6, 0.0, 1e-6, 1.0):
            f, slope = friction_curve(x, 0.0, level, X_2)
            assert abs(f) <= 1.0
            assert slope >= 0.0


@pytest.mark.slow
def test_lateral_stiffness_falls_with_amplitude(resting):
    ratios = []
    for load_case in ("AW0", "AW3"):
        K = [
            dynamic_stiffness(resting(load_case), a * mm, 0.2, 25, direction=LATERAL)[0].real
            for a in (1, 5, 20)
        ]
        assert K[0] > K[1] > K[2]
        ratios.append(K[0] / K[2])
    assert ratios == pytest.approx([1.52, 1.40], rel=0.02)


def test_maxwell_branches_have_their_complex_stiffness(resting):
    k, ratio, tau = 45e3, 0.1, np.array([0.03, 0.3, 3.0])
    for f in (0.05, 0.5, 5.0):
        plant = friction_only(resting, friction_lateral=0, shell_stiffness_lateral=k)
        K, _ = dynamic_stiffness(plant, 5 * mm, f, max(4, round(20 * f)), direction=LATERAL)
        iwt = 2j * np.pi * f * tau
        assert pytest.approx(k * (1 + ratio * np.sum(iwt / (1 + iwt))), rel=2e-3) == K
