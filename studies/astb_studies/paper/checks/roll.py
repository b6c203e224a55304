"""Lateral stiffness over the roll angle, and the sign of the coupling."""

from typing import Final

import numpy as np

from astb_studies.paper.checks.criteria import listed
from astb_studies.paper.claims import CheckOutcome, Claim
from astb_studies.paper.closed_form import roll_factor
from astb_studies.paper.experiments import rolled
from astb_studies.paper.subject import LOADS, Subject
from bench_protocol.units import kN, mm
from bench_sim.model.algebraic import Algebraic
from bench_sim.model.experiments import LATERAL, ROLL, ImposedMotion, impose

_SHARPLY: Final = "≥ 20 % up to 0.05 rad, then changed by < 10 % of it up to 0.08 rad"
ROLLS: Final = (0.0, 0.05, 0.08)


T8: Final = Claim(
    "T8", "Lateral stiffness rises sharply with roll, and hardly beyond 0.05 rad.", "the paper, figure 10"
)


@T8.on("plant", f"both signs, secant at +20 mm and first harmonic: {_SHARPLY}", shares="roll")
def stiffness_over_roll_of_both_signs(subject: Subject) -> CheckOutcome:
    """Lateral stiffness over roll for both signs, as secant and first harmonic: the claim restricts neither."""
    parts, holds = [], True
    numbers: dict[str, float] = {}
    for case in LOADS:
        for name, sign, which in (
            ("secant with φ·y > 0", 1, 1),
            ("with φ·y < 0", -1, 1),
            ("first harmonic", 1, 0),
        ):
            K = np.array([rolled(subject, case, sign * phi, 20 * mm)[which] for phi in ROLLS])
            parts.append(f"{case} {name} {listed(K / 1e3, '.0f')}")
            holds &= bool(K[1] - K[0] >= 0.2 * K[0] and abs(K[2] - K[1]) < 0.1 * abs(K[1] - K[0]))
            numbers[f"change_{case}_{('first_harmonic', 'secant')[which]}_{sign:+d}"] = float(
                K[1] / K[0] - 1.0
            )
    return CheckOutcome(
        "; ".join(parts) + " kN/m at 0 / 0.05 / 0.08 rad",
        holds,
        numbers,
        "An elastic coupling is odd in roll: it stiffens the secant for one sign and softens it for the other, and does"
        " not touch the first harmonic. For φ·y > 0 the claim holds (A19).",
    )


A19: Final = Claim("A19", "K_lat rises with roll and then stays", "claim T8 of the paper")


@A19.on(
    "plant",
    "secant at +20 mm, φ·y > 0: ≥ 20 % up to 0.05 rad, then < 10 % of it up to 0.08 rad",
    shares="roll",
)
def stiffness_over_roll(subject: Subject) -> CheckOutcome:
    """Secant stiffness at +20 mm at fixed roll angles; in the note, the other sign of roll and the harmonic."""
    parts, others, holds = [], [], True
    numbers: dict[str, float] = {}
    for load in LOADS:
        up, down = (
            np.array([rolled(subject, load, sign * phi, 20 * mm) for phi in ROLLS]) / 1e3 for sign in (1, -1)
        )
        with_, against, harmonic = up[:, 1], down[:, 1], up[:, 0]
        rise, more = with_[1] - with_[0], with_[2] - with_[1]
        parts.append(f"{load} {listed(with_, '.0f')} kN/m")
        others.append(f"{load} {listed(against, '.0f')} and {listed(harmonic, '.0f')}")
        holds &= bool(rise >= 0.2 * with_[0] and more < 0.1 * rise)
        numbers |= {
            f"{name}_{load}_{phi:g}": float(1e3 * value)
            for name, row in (("secant_with", with_), ("secant_against", against), ("harmonic", harmonic))
            for phi, value in zip(ROLLS, row, strict=True)
        }
    return CheckOutcome(
        "secant at y = +20 mm, φ·y > 0: " + "; ".join(parts) + " at 0 / 0.05 / 0.08 rad",
        holds,
        numbers,
        "Only for this sign: with φ·y < 0 the secant falls, and the first harmonic falls for both signs ("
        + "; ".join(others)
        + " kN/m). The coupling force does not depend on y.",
    )


@T8.on("paper", _SHARPLY)
@A19.on("paper", "≥ 20 % up to 0.05 rad, then < 10 % of it up to 0.08 rad")
def paper_stiffness_over_roll(subject: Subject) -> CheckOutcome:
    """Factor of the even law of the paper's layer at three roll angles."""
    rest, knee, beyond = (float(roll_factor(phi, subject.spring("AW0"))) for phi in ROLLS)
    return CheckOutcome(
        f"×{knee:.3f} at 0.05 rad, ×{beyond:.3f} at 0.08 rad",
        knee - rest >= 0.2 * rest and beyond - knee < 0.1 * (knee - rest),
        {"at_0.05": knee, "at_0.08": beyond},
        "An even law that is put in for this purpose: it is assumed, not derived.",
    )


@Claim("A20", "The coupling force turns with the roll", "an elastic coupling is odd in roll").on(
    "plant", "odd within 1 %"
)
def coupling_sign(subject: Subject) -> CheckOutcome:
    """Lateral force of both springs at ±0.02 rad with the top plates over their feet."""

    def force(load: str, roll: float) -> float:
        plant = subject.resting(load)
        middle = -plant.parameters.centre_height * roll
        still = [ImposedMotion(LATERAL, 0.0, 1.0, offset=middle), ImposedMotion(ROLL, 0.0, 1.0, offset=roll)]
        last = impose(plant, still, 1e-3)
        return float(last.of(Algebraic.LATERAL_FORCE, 0)[0] + last.of(Algebraic.LATERAL_FORCE, 1)[0])

    parts, holds = [], True
    numbers: dict[str, float] = {}
    for load in LOADS:
        up, down = force(load, 0.02), force(load, -0.02)
        size = max(abs(up), abs(down))
        odd = abs(up + down) / size if size > 0.0 else float("inf")
        parts.append(f"{load} {up / kN:+.2f} / {down / kN:+.2f} kN")
        holds &= size > 1.0 and odd < 0.01
        numbers |= {f"up_{load}": up, f"down_{load}": down}
    return CheckOutcome("; ".join(parts) + " at +0.02 / −0.02 rad, y = 0", holds, numbers)
