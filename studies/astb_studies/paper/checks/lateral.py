"""Lateral stiffness over pressure, amplitude and load."""

from typing import Any, Final

import numpy as np

from astb_studies.paper.checks.criteria import falls, listed, near, rises, within
from astb_studies.paper.claims import CheckOutcome, Claim
from astb_studies.paper.closed_form import combined, diaphragm_stiffness, layered_stiffness
from astb_studies.paper.experiments import lateral_stiffness, paper_amplitude_stiffness, quasi_static_lateral
from astb_studies.paper.subject import LOADS, Subject
from bench_protocol.units import kN, mm

PRELOADS: Final = tuple(P * kN for P in (40.0, 53.5, 80.0, 110.0, 145.0, 160.0))
AMPLITUDES: Final = tuple(a * mm for a in (1, 5, 20))


T1: Final = Claim("T1", "Lateral stiffness rises with the pressure.", "the paper, figure 6(a) and (b)")


@T1.on("plant", "strictly, six preloads", shares="lateral")
def harmonic_over_pressure(subject: Subject) -> CheckOutcome:
    """Lateral first harmonic at 5 mm under six preloads."""
    K = [lateral_stiffness(subject, "AW0", 5 * mm, nominal_preload=P).real for P in PRELOADS]
    return _by_pressure(
        K, subject.parameters("AW0").record.effective_area[0], "First harmonic at 5 mm, 0.5 Hz."
    )


@T1.on("paper", "strictly, six preloads")
def diaphragm_over_pressure(subject: Subject) -> CheckOutcome:
    """Stiffness (10) at the same pressures."""
    par = subject.spring("AW0")
    p = np.array(PRELOADS) / par.effective_area + par.atmospheric_pressure
    return _by_pressure(
        diaphragm_stiffness(0.0, p, par), par.effective_area, "Diaphragm (10): in proportion to p."
    )


def _by_pressure(K: Any, area: Any, note: str) -> CheckOutcome:
    p = np.array(PRELOADS) / float(area)
    return CheckOutcome(
        f"{listed(np.array(K) / 1e3, '.0f')} kN/m at {listed(p / 1e5)} bar",
        rises(K),
        {f"stiffness_{P / kN:g}kN": float(k) for P, k in zip(PRELOADS, K, strict=True)},
        note,
    )


A14: Final = Claim("A14", "K_y rises with pressure", "claim T1 of the paper; the membrane adds p_g κ_0")


@A14.on("plant", "monotonically; slope κ_0 = 0.35 m ±20 %", shares="lateral")
def stiffness_over_pressure(subject: Subject) -> CheckOutcome:
    """Quasi-static lateral stiffness under six preloads, and its slope over the pressure."""
    preloads = np.array([30.0, 53.5, 80.0, 110.0, 145.0, 160.0]) * kN
    K = np.array([quasi_static_lateral(subject, float(P)) for P in preloads])
    p = preloads / subject.parameters("AW0").record.effective_area[0]
    slope = float((K[4] - K[1]) / (p[4] - p[1]))
    return _stiffness_slope(K, slope, "Quasi-static, with the emergency spring in series.")


@A14.on("paper", "monotonically; slope κ_0 = 0.35 m ±20 %")
def paper_stiffness_over_pressure(subject: Subject) -> CheckOutcome:
    """Stiffness (10) at the same pressures, and its slope."""
    par = subject.spring("AW0")
    p_g = np.array([30.0, 53.5, 80.0, 110.0, 145.0, 160.0]) * kN / par.effective_area
    K = np.asarray(diaphragm_stiffness(0.0, p_g + par.atmospheric_pressure, par))
    series = np.asarray(combined(K, layered_stiffness(par), "series"))
    slope, less = (float((k[4] - k[1]) / (p_g[4] - p_g[1])) for k in (K, series))
    return _stiffness_slope(K, slope, f"Diaphragm (10); in series with the emergency spring {less:.3f} m.")


def _stiffness_slope(K: Any, slope: float, note: str) -> CheckOutcome:
    return CheckOutcome(
        f"{listed(K / 1e3, '.0f')} kN/m at 30 … 160 kN; slope {slope:.3f} m between AW0 and AW3",
        rises(K) and near(slope, 0.35, 0.2),
        {"slope": slope, "lowest": float(K[0]), "highest": float(K[-1])},
        note,
    )


T2: Final = Claim(
    "T2", "Lateral stiffness falls with the excitation amplitude.", "the paper, figure 6(a) and (b)"
)


@T2.on("plant", "at every step, by > 5 % from 1 to 20 mm", shares="lateral")
def harmonic_over_amplitude(subject: Subject) -> CheckOutcome:
    """Lateral first harmonic at 1, 5 and 20 mm, 0.2 Hz."""
    K = {
        load: [lateral_stiffness(subject, load, a, 0.2, cycles=25).real for a in AMPLITUDES] for load in LOADS
    }
    return _by_amplitude(K, "Friction of the rubber does it; the geometry would be far less.")


@T2.on("paper", "at every step, by > 5 % from 1 to 20 mm")
def paper_harmonic_over_amplitude(subject: Subject) -> CheckOutcome:
    """First harmonic of the secant law (10) at the same amplitudes."""
    K = {load: [paper_amplitude_stiffness(subject.spring(load), a) for a in AMPLITUDES] for load in LOADS}
    note = "The closed forms know an amplitude only through (8): falling, but not to be seen in a figure. No friction."
    return _by_amplitude(K, note)


def _by_amplitude(K: dict[str, list[float]], note: str) -> CheckOutcome:
    fall = {load: 1.0 - row[-1] / row[0] for load, row in K.items()}
    return CheckOutcome(
        "; ".join(f"{k} {listed(np.array(K[k]) / 1e3)} kN/m ({-100 * fall[k]:+.1f} %)" for k in K)
        + " at 1 / 5 / 20 mm",
        all(falls(row) for row in K.values()) and min(fall.values()) > 0.05,
        {f"fall_{load}": value for load, value in fall.items()},
        note,
    )


@Claim("A16", "K_y falls with the amplitude", "claim T2 of the paper").on(
    "plant", "K(1 mm) > K(5 mm) > K(20 mm), K(1)/K(20) = 1.3–1.7", shares="lateral"
)
def stiffness_over_amplitude(subject: Subject) -> CheckOutcome:
    """Lateral first harmonic at 1, 5 and 20 mm, 0.2 Hz, and the ratio of the first to the last."""
    parts, holds = [], True
    numbers: dict[str, float] = {}
    for load in LOADS:
        K = [lateral_stiffness(subject, load, a * mm, 0.2, cycles=25).real for a in (1, 5, 20)]
        ratio = K[0] / K[2]
        parts.append(f"{load} {listed(np.array(K) / 1e3, '.0f')} kN/m, ratio {ratio:.2f}")
        holds &= falls(K) and within(ratio, 1.3, 1.7)
        numbers |= {f"ratio_{load}": ratio}
    return CheckOutcome("; ".join(parts) + " (1 / 5 / 20 mm, 0.2 Hz)", holds, numbers)


T3: Final = Claim(
    "T3", "Lateral stiffness is larger under AW3 than under AW0.", "the paper, figure 8(a) and (b)"
)


@T3.on("plant", "by > 5 %", shares="lateral")
def harmonic_over_load(subject: Subject) -> CheckOutcome:
    """Lateral first harmonic at 5 mm under both loads."""
    return _by_load(
        {case: lateral_stiffness(subject, case, 5 * mm).real for case in LOADS}, "At 5 mm, 0.5 Hz."
    )


@T3.on("paper", "by > 5 %")
def series_over_load(subject: Subject) -> CheckOutcome:
    """Stiffness (10) with the emergency spring (16) in series, under both loads."""
    K, parallel = {}, {}
    for case in LOADS:
        par = subject.spring(case)
        K_r, K_e = diaphragm_stiffness(0.0, par.pressure, par), layered_stiffness(par)
        K[case], parallel[case] = (float(combined(K_r, K_e, topology)) for topology in ("series", "parallel"))
    more = 100.0 * (parallel["AW3"] / parallel["AW0"] - 1.0)
    return _by_load(
        K, f"With the emergency spring in series; in parallel, as worded, {more:+.1f} % are left."
    )


def _by_load(K: dict[str, float], note: str) -> CheckOutcome:
    return CheckOutcome(
        f"AW0 {K['AW0'] / 1e3:.0f} kN/m, AW3 {K['AW3'] / 1e3:.0f} kN/m",
        K["AW3"] > 1.05 * K["AW0"],
        dict(K),
        note,
    )


A15: Final = Claim("A15", "K_y(AW3)/K_y(AW0)", "claim T3 of the paper")


@A15.on("plant", "1.6–2.3, quasi-static and at 5 mm", shares="lateral")
def stiffness_over_load(subject: Subject) -> CheckOutcome:
    """Ratio of lateral stiffness between the loads: quasi-static, and the first harmonic at 5 mm."""
    slow = quasi_static_lateral(subject, LOADS["AW3"]) / quasi_static_lateral(subject, LOADS["AW0"])
    moving = lateral_stiffness(subject, "AW3", 5 * mm).real / lateral_stiffness(subject, "AW0", 5 * mm).real
    return CheckOutcome(
        f"{slow:.2f} quasi-static, {moving:.2f} at 5 mm",
        within(slow, 1.6, 2.3) and within(moving, 1.6, 2.3),
        {"quasi_static": slow, "at_5mm": moving},
    )


@A15.on("paper", "1.6–2.3, diaphragm and in series")
def paper_stiffness_over_load(subject: Subject) -> CheckOutcome:
    """Ratio of stiffness (10) between the loads, alone and with the emergency spring."""
    K = {
        load: float(diaphragm_stiffness(0.0, subject.spring(load).pressure, subject.spring(load)))
        for load in LOADS
    }
    K_e = float(layered_stiffness(subject.spring("AW0")))
    alone = K["AW3"] / K["AW0"]
    series = float(combined(K["AW3"], K_e, "series") / combined(K["AW0"], K_e, "series"))
    parallel = float(combined(K["AW3"], K_e, "parallel") / combined(K["AW0"], K_e, "parallel"))
    return CheckOutcome(
        f"{alone:.2f} diaphragm, {series:.2f} with the emergency spring in series",
        within(alone, 1.6, 2.3) and within(series, 1.6, 2.3),
        {"diaphragm": alone, "series": series, "parallel": parallel},
        f"With the emergency spring in parallel, as the paper words it, {parallel:.2f}: it hides the load.",
    )
