"""Effective area, volume and lateral stiffness of laterally displaced springs."""

from typing import Any, Final

import numpy as np

from astb_studies.paper.checks.criteria import falls, listed, within
from astb_studies.paper.claims import CheckOutcome, Claim
from astb_studies.paper.closed_form import diaphragm_stiffness, equivalent_volume, lateral_area
from astb_studies.paper.experiments import lateral_secant, moved_aside
from astb_studies.paper.subject import LOADS, Subject
from bench_protocol.units import mm
from bench_sim.model.algebraic import Algebraic

OFFSETS: Final = tuple(y * mm for y in (20, 40, 60))


def area_and_volume(subject: Subject) -> tuple[float, float]:
    """Return by which shares A_e and V_b of the plant change from the centre to 60 mm aside, at design height."""
    aside = moved_aside(subject, "AW0", 60 * mm, "emergency_spring")
    par = subject.parameters("AW0").record
    area = aside.of(Algebraic.AREA)[0] / par.effective_area[0]
    return float(area) - 1.0, float(aside.of(Algebraic.VOLUME)[0] / par.bellows_volume[0]) - 1.0


T6: Final = Claim(
    "T6",
    "Sideways the effective area falls a little and the equivalent volume grows by far more.",
    "the paper, figure 7",
)


@T6.on("plant", "A_e falls, V grows by more than three times as much, at 60 mm")
def area_and_equivalent_volume(subject: Subject) -> CheckOutcome:
    """Change of the plant's area and volume at 60 mm: the paper's volume grows, that of the plant cannot."""
    area, volume = area_and_volume(subject)
    return CheckOutcome(
        f"A_e {100 * area:+.1f} %, V_b {100 * volume:+.1f} % at 60 mm",
        area < 0.0 and volume > 3.0 * abs(area),
        {"area": area, "volume": volume},
        "The area falls; the volume falls too, and by less. A conservative bellows whose volume grew sideways would"
        " push away from its centre, against T1. The paper's volume is a fitted number of (10).",
    )


A18: Final = Claim("A18", "The effective area falls with the displacement", "claim T6 of the paper")


@A18.on("plant", "−1 to −5 % at 60 mm")
def area_over_offset(subject: Subject) -> CheckOutcome:
    """Change of A_e = ∂V/∂ζ and of V of a bellows that is held 60 mm aside."""
    area, volume = area_and_volume(subject)
    return CheckOutcome(
        f"A_e {100 * area:+.1f} %, V_b {100 * volume:+.1f} % at 60 mm",
        within(area, -0.05, -0.01),
        {"area": area, "volume": volume},
        "The volume falls: a conservative bellows whose volume grew aside would push itself off its centre.",
    )


@T6.on("paper", "A falls by 1 to 5 %, V_eq grows by more than three times as much, at 60 mm")
@A18.on("paper", "A −1 to −5 %, V up by more than three times as much, at 60 mm")
def paper_area_over_offset(subject: Subject) -> CheckOutcome:
    """Change of area and equivalent volume at 60 mm by the fits (8)."""
    par = subject.spring("AW0")
    area = float(lateral_area(60 * mm, par) / par.lateral_area) - 1.0
    volume = float(equivalent_volume(60 * mm, par) / par.bellows_volume) - 1.0
    return CheckOutcome(
        f"A {100 * area:+.1f} %, V_eq {100 * volume:+.1f} % at 60 mm",
        within(area, -0.05, -0.01) and volume > 3.0 * abs(area),
        {"area": area, "volume": volume},
        "Both are fitted numbers of (10), not an area and a volume of a body.",
    )


T7: Final = Claim("T7", "Lateral stiffness falls with the lateral displacement.", "the paper, figure 9")


@T7.on("plant", "strictly, 20 to 60 mm")
def secant_after_a_ramp(subject: Subject) -> CheckOutcome:
    """Lateral secant stiffness of whole springs after a slow ramp to each displacement."""
    K = {case: [lateral_secant(subject, case, y) for y in OFFSETS] for case in LOADS}
    return _by_displacement(K, OFFSETS, "Secant after a slow ramp, friction and rubber included.")


@T7.on("paper", "strictly, 0 to 60 mm")
def diaphragm_over_displacement(subject: Subject) -> CheckOutcome:
    """Stiffness (10) over the displacement: it is a secant already."""
    offsets = (0.0, *OFFSETS)
    K = {
        case: diaphragm_stiffness(np.array(offsets), subject.spring(case).pressure, subject.spring(case))
        for case in LOADS
    }
    return _by_displacement(K, offsets, "Diaphragm (10).")


def _by_displacement(K: dict[str, Any], offsets: tuple[float, ...], note: str) -> CheckOutcome:
    return CheckOutcome(
        "; ".join(f"{case} {listed(np.array(row) / 1e3)}" for case, row in K.items())
        + f" kN/m at {listed(np.array(offsets) / mm, 'g')} mm",
        all(falls(row) for row in K.values()),
        {f"fall_{case}": float(1.0 - row[-1] / row[0]) for case, row in K.items()},
        note,
    )


A17: Final = Claim("A17", "Secant K_y falls with the displacement", "claim T7 of the paper")


@A17.on("plant", "−5 to −30 % at 60 mm")
def secant_over_offset(subject: Subject) -> CheckOutcome:
    """Lateral secant stiffness F_y/y of relaxed springs without friction, held aside."""
    offsets = (1, 20, 40, 60)
    K = {
        load: [lateral_secant(subject, load, y * mm, "friction", "relaxation") for y in offsets]
        for load in LOADS
    }
    return _secants(K, offsets, "Friction off: it would add F_max/y to each.")


@A17.on("paper", "−5 to −30 % at 60 mm")
def paper_secant_over_offset(subject: Subject) -> CheckOutcome:
    """Stiffness (10) over the displacement: it is a secant already."""
    offsets = (0, 20, 40, 60)
    y = np.array(offsets) * mm
    K = {load: diaphragm_stiffness(y, subject.spring(load).pressure, subject.spring(load)) for load in LOADS}
    return _secants(K, offsets, "Diaphragm (10).")


def _secants(K: dict[str, Any], offsets: tuple[int, ...], note: str) -> CheckOutcome:
    change = {load: float(row[-1] / row[0] - 1.0) for load, row in K.items()}
    return CheckOutcome(
        "; ".join(f"{k} {listed(np.array(K[k]) / 1e3)} kN/m, {100 * change[k]:+.1f} %" for k in K)
        + f" ({listed(offsets, 'g')} mm)",
        all(falls(row) for row in K.values()) and all(within(d, -0.30, -0.05) for d in change.values()),
        {f"change_{load}": d for load, d in change.items()},
        note,
    )
