"""Limits that the specimen's file takes from equations: the equations, solved here by themselves."""

import cmath
from math import pi, tanh, tau

import numpy as np
import pytest

from bench_protocol.units import mm, mrad
from test_plans.specimen import ordinary

#: Of the drawing: gas, heat, orifice, rubber.
KAPPA, R, ATMOSPHERE, AMBIENT = 1.4, 287.05, 101325.0, 293.15
HEAT, DENSITY, EXPONENT = (8.0, 9.0), 3.65, 0.67
CONTRACTION = 0.62
SHELL, BRANCH, TIMES = 40e3, 0.1, (0.03, 0.3, 3.0)
FRICTION, GRIP = 300.0, 3 * mm


def friction(amplitude):
    """First harmonic of Berg's friction over that of a motion of ``amplitude`` (m)."""
    ends = 0.5 * FRICTION
    for _ in range(60):  # a closed loop ends as far up as it began down
        way = 2 * amplitude / (GRIP * (1 + ends / FRICTION) + 2 * amplitude)
        ends = 0.5 * (ends + way * (FRICTION + ends) - ends)
    phase = np.linspace(0.0, tau, 2000, endpoint=False)
    s = amplitude * (1 - np.where(phase < pi, 1, -1) * np.cos(phase))  # from where it turned
    branch = -ends + s / (GRIP * (1 + ends / FRICTION) + s) * (FRICTION + ends)
    force = np.where(phase < pi, branch, -branch)
    return np.mean(force * np.exp(-1j * phase)) / np.mean(-amplitude * np.cos(phase) * np.exp(-1j * phase))


def stiffness(preload, frequency, amplitude, plate):
    """Complex stiffness (N/m) of one spring: gas, orifice by its first harmonic, contour and rubber, in series."""
    one, omega = ordinary(), tau * frequency
    gauge = preload / one.effective_area
    p = gauge + ATMOSPHERE
    rho = p / (R * AMBIENT)
    elastic = []
    for volume, heat in zip((one.bellows_volume, one.auxiliary_volume), HEAT, strict=True):
        time = rho * volume * R / (KAPPA - 1) / (heat * (rho / DENSITY) ** EXPONENT)
        elastic.append((1 + KAPPA * 1j * omega * time) / (1 + 1j * omega * time) * p / volume)
    rubber = SHELL * (1 + sum(BRANCH * 1j * omega * t / (1 + 1j * omega * t) for t in TIMES))
    contour = -one.effective_area_slope * gauge
    bellows, moved = complex(amplitude), 0.0j
    for _ in range(200):
        flow = omega * abs(moved)
        resistance = 8 / (3 * pi) * rho * flow / (2 * (CONTRACTION * pi * plate**2 / 4) ** 2)
        through = elastic[0] * one.effective_area * bellows / (sum(elastic) + 1j * omega * resistance)
        moved = 0.5 * (moved + through)
        gas = one.effective_area * elastic[0] * (one.effective_area - moved / bellows)
        K = gas + contour + rubber + friction(abs(bellows))
        bellows = amplitude * one.emergency_stiffness_vertical / (one.emergency_stiffness_vertical + K)
    return 1 / (1 / K + 1 / one.emergency_stiffness_vertical)


def middle(band):
    return 0.5 * (band.low + band.high)


@pytest.mark.parametrize("name", ["AW0", "AW3"])
def test_stiffness_and_damping_with_each_plate(name):
    load = ordinary().load(name)
    damping = load.limits.curve("orifice_plates.damping", "N*s/m")
    for plate, band in load.limits.curve("orifice_plates.stiffness", "N/m").items():
        K = stiffness(load.preload, 1.2, 5 * mm, plate)
        assert K.real == pytest.approx(middle(band), rel=0.01)
        assert K.imag / (tau * 1.2) == pytest.approx(middle(damping[plate]), rel=0.01)
        assert 0 < cmath.phase(K) < pi / 4


@pytest.mark.parametrize("name", ["AW0", "AW3"])
def test_the_force_of_the_coupling(name):
    """K_yφ φ_s tanh(φ/φ_s), K_yφ = (K_y h + P)/2 of the sheared column: h = 0.2 m, φ_s = 30 mrad."""
    load = ordinary().load(name)
    K_y = 1 / (1 / (0.35 * load.preload / 0.26 + 45e3) + 1 / 2e6)
    for roll, band in load.limits.curve("roll_coupling.force", "N").items():
        force = 0.5 * (K_y * 0.2 + load.preload) * 30 * mrad * tanh(roll / (30 * mrad))
        assert force == pytest.approx(middle(band), rel=0.01)
