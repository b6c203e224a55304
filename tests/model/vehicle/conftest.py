"""Vehicles for the tests: the bench's springs and the car, with this or that taken away so that closed forms hold."""

from collections.abc import Callable

import numpy as np
import pytest

from bench_sim.model.vehicle import Vehicle
from bench_sim.parameters import load
from bench_sim.parameters.vehicle import load_vehicle

BENCH = load("astb")
CAR = load_vehicle()

NO_FRICTION = {"friction_vertical": 0, "friction_lateral": 0, "friction_lateral_slope": 0}

WITHOUT: dict[str, dict[str, object]] = {
    "friction": NO_FRICTION,
    "losses": {**NO_FRICTION, "maxwell_ratio": 0, "bellows_heat_transfer": 0, "auxiliary_heat_transfer": 0},
}

WITHOUT_CAR: dict[str, dict[str, object]] = {
    "track": {"track_shape": 0},
    "damper": {"damper_rate": 0, "damper_rate_beyond": 0},
    "bump_stop": {"bump_stop_force": np.zeros(9)},
}


def _vehicle(load_case="AW0", without=(), *, car=None, options=None, **springs) -> Vehicle:
    bench, body = {}, {}
    for part in without:
        bench |= WITHOUT.get(part, {})
        body |= WITHOUT_CAR.get(part, {})
    bench |= springs
    body |= car or {}
    return Vehicle(
        BENCH.under(load_case).with_values(**bench).record, CAR.with_values(**body).record, **(options or {})
    )


@pytest.fixture(scope="session")
def vehicle() -> Callable[..., Vehicle]:
    """``vehicle("AW3", ("track", "losses"), car={"damper_rate": 0}, emergency_spring=0)``."""
    return _vehicle


def _stiffness(v: Vehicle, gas: str) -> tuple[float, float, float, float]:
    """K_z, K_y, K_φ and σK_yφ of one spring at rest, from the printed formulas; ``gas`` names the change of state."""
    par = v.parameters
    A, V_b, V_a = par.effective_area[0], par.bellows_volume[0], par.auxiliary_volume[0]
    gauge = par.nominal_preload[0] / A
    p = gauge + par.atmospheric_pressure
    n, V = {
        "closed adiabatic": (par.heat_capacity_ratio, V_b),
        "open adiabatic": (par.heat_capacity_ratio, V_a + V_b),
        "open isothermal": (1.0, V_a + V_b),
    }[gas]

    def in_series(k, k_es):
        return 1.0 / (1.0 / k + 1.0 / k_es) if par.emergency_spring else k

    k_z = n * p * A * A / V - gauge * par.effective_area_slope[0] + par.shell_stiffness_vertical[0]
    k_y = par.membrane_length[0] * gauge + par.shell_stiffness_lateral[0]
    K_z = in_series(k_z, par.emergency_stiffness_vertical[0])
    K_y = in_series(k_y, par.emergency_stiffness_lateral[0])
    K_phi = par.torsional_stiffness[0] + par.torsional_stiffness_slope[0] * gauge
    coupling = 0.5 * (K_y * par.column_height + par.nominal_preload[0])
    return K_z, K_y, K_phi, par.coupling_sign * coupling


def _sway_matrix(v: Vehicle, gas: str) -> np.ndarray:
    """Stiffness of (y, φ) of the car body, from U = K_y(y+eφ)² + 2σK_yφ(y+eφ)φ + (K_φ + b²K_z)φ² + ½(K_arb − mge)φ²."""
    K_z, K_y, K_phi, C = _stiffness(v, gas)
    par, e = v.parameters, v.car.centre_height
    roll = 2 * (K_y * e * e + 2 * C * e + K_phi + par.spring_half_spacing**2 * K_z)
    roll += v.car.anti_roll_stiffness - v.mass * par.gravity * e
    return np.array([[2 * K_y, 2 * (K_y * e + C)], [2 * (K_y * e + C), roll]])


@pytest.fixture(scope="session")
def stiffness() -> Callable[..., tuple[float, float, float, float]]:
    return _stiffness


@pytest.fixture(scope="session")
def sway_matrix() -> Callable[..., np.ndarray]:
    return _sway_matrix
