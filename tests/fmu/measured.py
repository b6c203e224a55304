"""Measurements of two tanks and of an actuator, by an integrator and equations that are not those of the FMUs."""

from pathlib import Path

import numpy as np
from scipy.integrate import solve_ivp

from tests.fmu.asked import save

ROLES = """
[[runs.role]]
files = "run0.csv"
role = "select"
[[runs.role]]
files = "run4.csv"
role = "report"
[[runs.role]]
role = "fit"
"""
TANKS = """
[columns]
flow = { column = "Q", unit = "m3/s" }
upper = { column = "h1", unit = "mm", noise = "1 mm" }
lower = { column = "h2", unit = "mm", noise = "1 mm" }
[fmu.base]
upper_hole = { spread = "3 %", low = "5e-5 m2" }
lower_hole = { spread = "3 %", low = "5e-5 m2" }
upper_start = { spread = "20 mm", low = "0 mm", per_run = true }
lower_start = { spread = "20 mm", low = "0 mm", per_run = true }
[fmu.measured]
flow.causes = ["gain", "offset"]
"""
OVERFLOW = """
[fmu.effects.overflow]
variable = "overflow"
typical = "2e-3"
low = "0"
says = "the upper tank runs over"
shapes.edge = { tried = ["0.3 m", "0.45 m", "0.6 m"], low = "0.2 m", high = "0.8 m" }
"""
SEEP = """
[fmu.effects.seep]
variable = "seep"
typical = "1e-4"
low = "0"
says = "the lower tank seeps"
"""
ANY_FLOW = """
[[fmu.surfaces]]
signal = "flow"
over = { upper = ["0 mm", "700 mm"], lower = ["0 mm", "700 mm"] }
typical = "5e-5 m3/s"
knots = 4
"""
ACTUATOR = """
[columns]
position = { column = "x", unit = "mm" }
speed = { column = "v", unit = "mm/s" }
pressure = { column = "p", unit = "bar", reading = "absolute", noise = "3 mbar" }
force = { column = "F", unit = "N", noise = "0.5 N" }
[fmu.base]
area = { spread = "1 %", low = "10 cm2" }
dead = { spread = "1 mm", low = "30 mm" }
filled = { spread = "0.05 bar", low = "2 bar", per_run = true }
warmth = { value = "0.4 s", spread = "0.2 s", low = "0.05 s", high = "5 s", logarithmic = true }
"offset.force" = { spread = "2 N" }
[fmu.measured]
position.causes = []
speed.causes = []
pressure.causes = ["gain", "offset", "drift", "lag"]
[fmu.effects.leak]
variable = "leak"
typical = "0.05 mm2"
low = "0 mm2"
says = "the chamber leaks"
[fmu.effects.seal]
variable = "seal"
typical = "5 N"
low = "0 N"
says = "the seal has friction"
"""


def tanks(folder: Path, *, overflow: float, seep: float = 0.0, edge: float = 0.45) -> list[Path]:
    """Five runs of ten minutes; the pump goes up and down in ramps, and the last run is another one."""
    rng, time = np.random.default_rng(7), np.arange(0.0, 600.0, 1.0)
    files = []
    for run in range(5):
        corners = rng.uniform(3e-4, 7.5e-4, 13)
        flow = np.interp(time, np.linspace(0.0, 600.0, 13), corners)

        def rates(t, h, flow=flow):
            upper, lower = np.maximum(h, 0.0)
            # Torricelli, smoothed in a way unknown to the builder of the tanks.
            down = 2.03e-4 * np.sqrt(2 * 9.81 * upper**2 / (upper + 1e-3))
            away = 2.15e-4 * np.sqrt(2 * 9.81 * lower**2 / (lower + 1e-3)) + seep * lower
            over = overflow * max(upper - edge, 0.0) ** 1.5
            return (np.interp(t, time, flow) - down - over) / 0.05, (down - away) / 0.08

        start = rng.uniform(0.15, 0.25, 2)
        h = solve_ivp(rates, (0.0, 599.0), start, t_eval=time, rtol=1e-8, atol=1e-9, max_step=1.0).y
        h1, h2 = 1e3 * h + rng.standard_normal(h.shape)
        files.append(save(folder / f"run{run}.csv", time=time, Q=flow, h1=h1, h2=h2))
    return files


def actuator(folder: Path, *, leak: float = 0.0, seal: float = 0.0, late: float = 0.0) -> list[Path]:
    """Five runs of 8 s in strokes of other speeds; ``late``: the force is read so many s late."""
    rng, time = np.random.default_rng(8), np.arange(0.0, 8.0, 0.01)
    area, dead, tau, warm = 20.1e-4, 60.6e-3, 0.33, 293.15
    files = []
    for run in range(5):
        lines = [(f, a, rng.uniform(0, 6.28)) for f, a in ((0.2, 9e-3), (0.7, 5e-3), (1.9, 2e-3))]
        x = sum(a * np.sin(2 * np.pi * f * time + phase) for f, a, phase in lines)
        v = sum(2 * np.pi * f * a * np.cos(2 * np.pi * f * time + phase) for f, a, phase in lines)

        def motion(t, lines=lines):
            return (
                sum(a * np.sin(2 * np.pi * f * t + p) for f, a, p in lines),
                sum(2 * np.pi * f * a * np.cos(2 * np.pi * f * t + p) for f, a, p in lines),
            )

        def rates(t, state):
            # Energy and mass, where the FMU has temperature and mass.
            m, energy = state
            here, speed = motion(t)
            T = energy / (m * 717.6)
            p = m * 287.05 * T / (area * (dead - here))
            out = 1e-6 * leak * p * 0.6847 / np.sqrt(287.05 * T)
            heat = m * 717.6 * (warm - T) / tau
            return -out, p * area * speed - out * 1004.7 * T + heat

        filled = 4e5 * (1.0 + 0.01 * rng.standard_normal())
        m = filled * area * (dead - x[0]) / (287.05 * warm)
        start = (m, m * 717.6 * warm)
        state = solve_ivp(rates, (0.0, 7.99), start, t_eval=time, rtol=1e-9, atol=1e-12, max_step=0.01).y
        p = (287.05 / 717.6) * state[1] / (area * (dead - x))
        F = area * (p - 101_325.0) + seal * np.tanh(v / 0.002) + 1.5
        if late:
            F = np.interp(time - late, time, F)
        p = p / 1e5 + 3e-3 * rng.standard_normal(len(p))
        F = F + 0.5 * rng.standard_normal(len(F))
        files.append(save(folder / f"run{run}.csv", time=time, x=1e3 * x, v=1e3 * v, p=p, F=F))
    return files
