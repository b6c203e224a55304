"""Natural modes from the compiled derivative against closed forms."""

import numpy as np
import pytest

from bench_protocol.units import kN, mm
from bench_sim.model.car import RideChannel
from bench_sim.model.layout import Input, State

LOSSLESS = ("track", "losses", "damper")
SHUT = [Input.LEFT_RESERVOIR_VALVE, Input.RIGHT_RESERVOIR_VALVE]


def by_direction(modes):
    """(bounce, lower sway, upper sway) by the direction that moves most."""
    bounce = [m for m in modes if abs(m.shape[1]) > 0.5]
    sway = [m for m in modes if abs(m.shape[1]) <= 0.5]
    assert len(bounce) == 1
    assert len(sway) == 2
    return bounce[0], *sway


@pytest.mark.parametrize("load_case", ["AW0", "AW3"])
@pytest.mark.parametrize("emergency_spring", [0, 1])
def test_bounce_is_a_mass_on_two_springs(vehicle, stiffness, load_case, emergency_spring):
    v = vehicle(load_case, LOSSLESS, emergency_spring=emergency_spring)
    v.inputs[SHUT] = 0.0
    bounce, _, _ = by_direction(v.modes())
    K_z = stiffness(v, "closed adiabatic")[0]
    assert bounce.frequency == pytest.approx(np.sqrt(2 * K_z / v.mass) / (2 * np.pi), rel=1e-5)
    assert bounce.damping == pytest.approx(0.0, abs=1e-5)


@pytest.mark.parametrize("load_case", ["AW0", "AW3"])
def test_bounce_over_a_wide_orifice_has_both_volumes(vehicle, stiffness, load_case):
    v = vehicle(load_case, LOSSLESS, orifice_diameter=0.1)
    bounce, _, _ = by_direction(v.modes())
    K_z = stiffness(v, "open adiabatic")[0]
    assert bounce.frequency == pytest.approx(np.sqrt(2 * K_z / v.mass) / (2 * np.pi), rel=1e-3)


@pytest.mark.parametrize("load_case", ["AW0", "AW3"])
@pytest.mark.parametrize("sign", [1.0, 0.0, -1.0], ids="coupling {:+g}".format)
@pytest.mark.parametrize("bar", [0.0, 940e3], ids="anti-roll {:g}".format)
def test_sway_modes_are_those_of_the_matrix(vehicle, sway_matrix, load_case, sign, bar):
    v = vehicle(load_case, LOSSLESS, car={"anti_roll_stiffness": bar}, coupling_sign=sign)
    v.inputs[SHUT] = 0.0
    inertia = np.diag([v.mass, v.mass * v.car.roll_gyration**2])
    squares, shapes = np.linalg.eig(np.linalg.solve(inertia, sway_matrix(v, "closed adiabatic")))
    order = np.argsort(squares)
    _, *sway = by_direction(v.modes())
    for mode, k in zip(sway, order, strict=True):
        assert mode.frequency == pytest.approx(np.sqrt(squares[k]) / (2 * np.pi), rel=1e-5)
        expected = shapes[1, k] / shapes[0, k]
        assert mode.shape[2] / mode.shape[0] == pytest.approx(expected, rel=1e-3, abs=1e-4)
    # The lower one turns about a point below the centre of gravity, the upper one above: φ is left side up.
    assert (sway[0].shape[2] / sway[0].shape[0]).real < 0 < (sway[1].shape[2] / sway[1].shape[0]).real


def test_the_damper_acts_at_its_own_height(vehicle, sway_matrix):
    v = vehicle("AW0", ("track", "losses"))
    v.inputs[SHUT] = 0.0
    K = sway_matrix(v, "closed adiabatic")
    inverse = np.diag([1 / v.mass, 1 / (v.mass * v.car.roll_gyration**2)])
    arm = np.array([1.0, v.car.damper_depth])
    C = v.car.damper_rate * np.outer(arm, arm)
    system = np.block([[np.zeros((2, 2)), np.eye(2)], [-inverse @ K, -inverse @ C]])
    expected = sorted((x for x in np.linalg.eigvals(system) if x.imag > 0), key=abs)
    _, *sway = by_direction(v.modes())
    for mode, value in zip(sway, expected, strict=True):
        assert mode.frequency == pytest.approx(abs(value) / (2 * np.pi), rel=1e-5)
        assert mode.damping == pytest.approx(-value.real / abs(value), rel=1e-3)
        assert mode.damping > 0.03


def test_without_loss_no_direction_is_damped_and_with_it_all_are(vehicle):
    lossless = vehicle("AW0", LOSSLESS)
    lossless.inputs[SHUT] = 0.0
    assert all(abs(mode.damping) < 1e-5 for mode in lossless.modes())
    assert all(mode.damping > 0.01 for mode in vehicle("AW0").modes())


@pytest.mark.parametrize("load_case", ["AW0", "AW3"])
def test_the_car_rings_at_its_modes(vehicle, load_case):
    """The nonlinear ride, released from 1 mm, has the frequency of the Jacobian."""
    v = vehicle(load_case, LOSSLESS)
    v.inputs[SHUT] = 0.0
    bounce, _, _ = by_direction(v.modes())
    v.state[State.BOLSTER_VERTICAL_SPEED] = 1 * mm * 2 * np.pi * bounce.frequency
    z = v.ride(0.0, 20.0).of(RideChannel.VERTICAL)
    rising = np.flatnonzero((z[:-1] < 0) & (z[1:] >= 0))
    instants = rising + z[rising] / (z[rising] - z[rising + 1])
    period = np.mean(np.diff(instants)) * v.dt
    assert 1 / period == pytest.approx(bounce.frequency, rel=1e-3)


def test_a_high_body_on_a_narrow_base_topples(vehicle):
    """Gravity's term: beyond m g e = roll stiffness the upright car is an unstable equilibrium."""

    def car_of(height, bar=0.0):
        car = {"centre_height": height, "anti_roll_stiffness": bar}
        return vehicle("AW3", LOSSLESS, car=car, spring_half_spacing=0.3, coupling_sign=0.0)

    v = car_of(2.0)
    assert np.abs(v.slope()).max() < 1e-9
    assert np.linalg.eigvals(v.jacobian()).real.max() > 0.5
    for upright in car_of(0.0), car_of(2.0, 940e3):
        assert np.linalg.eigvals(upright.jacobian()).real.max() < 1e-3


def test_friction_that_sticks_stiffens_small_motions(vehicle):
    free, stuck = (vehicle("AW0", without).modes() for without in (("friction",), ()))
    assert all(a.frequency < b.frequency for a, b in zip(free, stuck, strict=True))


def test_leaning_against_the_bump_stop_stiffens_the_sway(vehicle):
    v = vehicle("AW0", ("friction",))
    upright = v.modes()[0].frequency
    assert v.lean(15 * kN).modes(15 * kN)[0].frequency > 1.1 * upright
