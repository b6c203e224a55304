"""Stiffness over frequency, with the pipe between bellows and auxiliary chamber."""

from dataclasses import replace
from typing import Final

import numpy as np

from astb_studies.paper.checks.criteria import listed, near, within
from astb_studies.paper.claims import CheckOutcome, Claim
from astb_studies.paper.closed_form import diaphragm_stiffness, gas_stiffness
from astb_studies.paper.experiments import PIPE, closed_form, lateral_stiffness
from astb_studies.paper.subject import BARE, LOADS, Subject
from bench_protocol.units import mm
from bench_sim.model.experiments import dynamic_stiffness

T9: Final = Claim(
    "T9",
    "Lateral stiffness rises with frequency, oscillates at high frequency and settles.",
    "the paper, figure 11(a) and (b)",
)


@T9.on("plant", "lateral |K| rises from 0.1 to 28 Hz and overshoots its last value by > 5 %")
def lateral_stiffness_over_frequency(subject: Subject) -> CheckOutcome:
    """Lateral |K| at 5 mm over frequency, with a pipe fitted."""
    grid = np.array([0.1, 0.3, 1.0, 3.0, 7.0, 10.0, 15.0, 20.0, 25.0, 28.0])
    parts, holds = [], True
    numbers: dict[str, float] = {}
    for case in LOADS:
        K = np.array(
            [
                abs(lateral_stiffness(subject, case, 5 * mm, float(f), cycles=max(4, int(4 * f)), **PIPE))
                for f in grid
            ]
        )
        parts.append(f"{case} {listed(K[[0, 2, 5, 9]] / 1e3, '.0f')}")
        holds &= K[-1] > K[0] and K.max() > 1.05 * K[-1]
        numbers |= {
            f"rise_{case}": float(K[-1] / K[0] - 1.0),
            f"overshoot_{case}": float(K.max() / K[-1] - 1.0),
        }
    return CheckOutcome(
        "; ".join(parts) + " kN/m at 0.1 / 1 / 10 / 28 Hz",
        holds,
        numbers,
        "It rises, by the relaxation of the rubber, and does not oscillate: sideways the motion hardly moves air"
        " through the pipe that is fitted here. Vertically it does what is claimed (A21).",
    )


@T9.on("paper", "|K| rises, overshoots K_r by > 5 % and ends within 1 % of it")
def gas_stiffness_with_a_pipe(subject: Subject) -> CheckOutcome:
    """Stiffness (23) over frequency with the inertia of the air in a pipe."""
    f = np.linspace(0.1, 40.0, 4000)
    parts, holds = [], True
    numbers: dict[str, float] = {}
    for case in LOADS:
        par = replace(subject.spring(case), pipe_length=1.5)
        K_r = float(diaphragm_stiffness(0.0, par.pressure, par))
        K = np.abs(gas_stiffness(2.0 * np.pi * f, K_r, par, r=0.9995, d=30 * mm))
        far = float(np.abs(gas_stiffness(2.0 * np.pi * 300.0, K_r, par, r=0.9995, d=30 * mm)))
        parts.append(
            f"{case} {K[0] / 1e3:.0f} kN/m, minimum {K.min() / 1e3:.0f} at {f[np.argmin(K)]:.1f} Hz,"
            f" peak {K.max() / 1e3:.0f} at {f[np.argmax(K)]:.1f} Hz, then {far / 1e3:.0f}"
        )
        holds &= K_r > K[0] and K.max() > 1.05 * K_r and abs(far / K_r - 1.0) < 0.01
        numbers |= {f"overshoot_{case}": float(K.max() / K_r), f"rise_{case}": K_r / float(K[0])}
    return CheckOutcome(
        "; ".join(parts),
        holds,
        numbers,
        "With the inertia of the air in a pipe (1.5 m × 50 mm, 30 mm plate, r = 0.9995). The paper's (23) has none:"
        " without it the stiffness rises and does not oscillate.",
    )


@Claim(
    "A21",
    "With a pipe |K_z| has a minimum and a peak and comes back",
    "claim T9 of the paper, vertically: the mass of air in a pipe",
).on("plant", "minimum near 7 Hz, peak > 1.3 K_∞ near 15 Hz, K_∞ ±25 % at 28 Hz (0.5 mm, 30 mm plate)")
def surge(subject: Subject) -> CheckOutcome:
    """Vertical |K| over frequency with pipe and plate fitted: gas and membrane alone."""
    f = np.concatenate([[0.5, 2.0, 4.0], np.arange(5.0, 18.01, 0.5), [20.0, 24.0, 28.0]])
    parts, holds = [], True
    numbers: dict[str, float] = {}
    for load in LOADS:
        par = subject.parameters(load, *BARE, **PIPE).record
        stiff = closed_form(par, par.bellows_volume[0], par.heat_capacity_ratio)
        soft = closed_form(par, par.bellows_volume[0] + par.auxiliary_volume[0], par.heat_capacity_ratio)
        K = np.array(
            [
                abs(
                    dynamic_stiffness(
                        subject.resting(load, *BARE, **PIPE), 0.5 * mm, one, max(6, round(2 * one))
                    )[0]
                )
                for one in f
            ]
        )
        low, high = f[np.argmin(K)], f[np.argmax(K)]
        parts.append(
            f"{load}: {K.min() / soft:.2f} K_0 at {low:.1f} Hz, {K.max() / stiff:.2f} K_∞ at {high:.1f} Hz,"
            f" {K[-1] / stiff:.2f} K_∞ at 28 Hz"
        )
        holds &= within(low, 5.5, 8.5) and within(high, 12.5, 17.0)
        holds &= bool(K.max() > 1.3 * stiff and K.min() < 0.9 * soft and near(K[-1], stiff, 0.25))
        numbers |= {f"minimum_{load}": low, f"peak_{load}": high, f"overshoot_{load}": K.max() / stiff}
    return CheckOutcome(
        "; ".join(parts), holds, {k: float(v) for k, v in numbers.items()}, "Pipe 1.5 m × 50 mm."
    )
