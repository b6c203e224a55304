"""Contributions of rubber and friction: their share of the damping, and the friction loop."""

import numpy as np

from astb_studies.paper.claims import CheckOutcome, Claim
from astb_studies.paper.experiments import damping
from astb_studies.paper.subject import LOADS, Subject
from bench_protocol.units import mm
from bench_sim.model.algebraic import Algebraic
from bench_sim.model.experiments import LATERAL, ImposedMotion, impose


@Claim(
    "A22",
    "Rubber and friction add about 5 % to the damping of the orifice",
    "the paper, figure 8(c): a deviation of about 5 %",
).on("plant", "(5 ± 3) % under AW0, 1.2 Hz, 5 mm")
def rubber_share(subject: Subject) -> CheckOutcome:
    """Share of rubber and friction in the vertical damping of the whole spring at 1.2 Hz and 5 mm."""

    def added(load: str, *without: str) -> float:
        whole = damping(subject, load, 5 * mm, 1.2, *without, cycles=30)
        return whole / damping(subject, load, 5 * mm, 1.2, *without, "rubber", cycles=30) - 1.0

    shares = [added(load) for load in LOADS]
    alone = [added(load, "emergency_spring") for load in LOADS]
    return CheckOutcome(
        f"AW0 {100 * shares[0]:.1f} %, AW3 {100 * shares[1]:.1f} %",
        abs(shares[0] - 0.05) <= 0.03,
        {"AW0": shares[0], "AW3": shares[1], "bellows_AW0": alone[0], "bellows_AW3": alone[1]},
        "Of the whole spring, as a bench can measure it. The emergency spring in series takes a part of both: without"
        f" it the shares are {100 * alone[0]:.1f} and {100 * alone[1]:.1f} %.",
    )


@Claim(
    "A28",
    "Amplitude and loss of a friction loop are those of the closed forms",
    "Berg 1998: friction and loss of a loop",
).on("plant", "±1 %")
def friction_loop(subject: Subject) -> CheckOutcome:
    """Amplitude and loss of the lateral friction loop alone: no membrane, no shell, no coupling."""
    nothing = {
        "membrane_length": 0,
        "membrane_length_slope": 0,
        "shell_stiffness_lateral": 0,
        "coupling_sign": 0,
    }
    worst_force = worst_loss = 0.0
    for x_0 in np.array([0.5, 5.0, 20.0]) * mm:
        plant = subject.resting("AW0", "emergency_spring", **nothing)
        par = plant.parameters
        gauge = par.nominal_preload[0] / par.effective_area[0]
        F_max = par.friction_lateral[0] + par.friction_lateral_slope[0] * gauge
        x_2 = par.friction_lateral_travel[0]
        impose(plant, [ImposedMotion(LATERAL, x_0, 1.0)], 30.0, rows=0)
        loop = impose(plant, [ImposedMotion(LATERAL, x_0, 1.0)], 1.001)
        F, y = -loop.of(Algebraic.LATERAL_FORCE), loop.of(Algebraic.LATERAL)
        F_0 = F_max / (2 * x_2) * (np.sqrt(x_2**2 + x_0**2 + 6 * x_2 * x_0) - x_2 - x_0)
        mu = F_0 / F_max if F_max > 0.0 else 0.0
        grip = x_2 * (1 + mu) ** 2 * np.log((x_2 * (1 + mu) + 2 * x_0) / (x_2 * (1 + mu)))
        loss = 2 * F_max * (2 * x_0 - grip)
        found = np.sum(0.5 * (F[1:] + F[:-1]) * np.diff(y))
        if F_max <= 0.0:
            return CheckOutcome("no friction, no loop", False)
        worst_force = max(worst_force, abs(0.5 * np.ptp(F) / F_0 - 1.0))
        worst_loss = max(worst_loss, abs(found / loss - 1.0))
    return CheckOutcome(
        f"amplitude within {100 * worst_force:.2f} %, loss within {100 * worst_loss:.2f} % (0.5, 5, 20 mm)",
        bool(worst_force < 0.01 and worst_loss < 0.01),
        {"force": float(worst_force), "loss": float(worst_loss)},
    )
