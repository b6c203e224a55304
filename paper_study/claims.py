"""What the paper claims, T1 to T11, put to each layer by itself: the plant, and the paper's own closed forms."""

from dataclasses import replace
from typing import Any, Final

import numpy as np

from bench_protocol.units import kN, mm
from bench_sim.model.paper import (
    combined,
    diaphragm_stiffness,
    gas_stiffness,
    layered_stiffness,
    orifice_damping,
    peak_ratio,
)
from paper_study.acceptance import (
    DIAMETERS,
    FREQUENCIES,
    OMEGA,
    ROLLS,
    area_and_volume,
    comfort_index,
    falls,
    listed,
    maxima,
    paper_area_over_offset,
    paper_damping_over_diameter,
    paper_damping_over_frequency,
    paper_stiffness_over_roll,
    rises,
    why_the_heavy_car_shakes,
    within,
)
from paper_study.check import Check, Measured
from paper_study.experiments import (
    PIPE,
    WIND_SPEEDS,
    damping,
    lateral_secant,
    lateral_stiffness,
    natural_frequency,
    paper_amplitude_stiffness,
    paper_ride,
    plant_ride,
    pressure_ratio_and_damping,
    rolled,
)
from paper_study.subject import LOADS, Subject

PRELOADS: Final = tuple(P * kN for P in (40.0, 53.5, 80.0, 110.0, 145.0, 160.0))
AMPLITUDES: Final = tuple(a * mm for a in (1, 5, 20))
OFFSETS: Final = tuple(y * mm for y in (20, 40, 60))


# T1 to T3: pressure, amplitude, load ----------------------------------------------------------------------------


def pressure(subject: Subject) -> Measured:
    """First harmonics at six preloads."""
    K = [lateral_stiffness(subject, "AW0", 5 * mm, nominal_preload=P).real for P in PRELOADS]
    return _by_pressure(
        K, subject.parameters("AW0").record.effective_area[0], "First harmonic at 5 mm, 0.5 Hz."
    )


def paper_pressure(subject: Subject) -> Measured:
    """(10) at the same pressures."""
    par = subject.spring("AW0")
    p = np.array(PRELOADS) / par.effective_area + par.atmospheric_pressure
    return _by_pressure(
        diaphragm_stiffness(0.0, p, par), par.effective_area, "Diaphragm (10): in proportion to p."
    )


def _by_pressure(K: Any, area: Any, note: str) -> Measured:
    p = np.array(PRELOADS) / float(area)
    return Measured(
        f"{listed(np.array(K) / 1e3, '.0f')} kN/m at {listed(p / 1e5)} bar",
        rises(K),
        {f"stiffness_{P / kN:g}kN": float(k) for P, k in zip(PRELOADS, K, strict=True)},
        note,
    )


def amplitude(subject: Subject) -> Measured:
    """First harmonics, slow."""
    K = {
        load: [lateral_stiffness(subject, load, a, 0.2, cycles=25).real for a in AMPLITUDES] for load in LOADS
    }
    return _by_amplitude(K, "Friction of the rubber does it; the geometry would be far less.")


def paper_amplitude(subject: Subject) -> Measured:
    """First harmonic of the secant law (10)."""
    K = {load: [paper_amplitude_stiffness(subject.spring(load), a) for a in AMPLITUDES] for load in LOADS}
    note = "The closed forms know an amplitude only through (8): falling, but not to be seen in a figure. No friction."
    return _by_amplitude(K, note)


def _by_amplitude(K: dict[str, list[float]], note: str) -> Measured:
    fall = {load: 1.0 - row[-1] / row[0] for load, row in K.items()}
    return Measured(
        "; ".join(f"{k} {listed(np.array(K[k]) / 1e3)} kN/m ({-100 * fall[k]:+.1f} %)" for k in K)
        + " at 1 / 5 / 20 mm",
        all(falls(row) for row in K.values()) and min(fall.values()) > 0.05,
        {f"fall_{load}": value for load, value in fall.items()},
        note,
    )


def load(subject: Subject) -> Measured:
    """First harmonics at 5 mm."""
    return _by_load(
        {case: lateral_stiffness(subject, case, 5 * mm).real for case in LOADS}, "At 5 mm, 0.5 Hz."
    )


def paper_load(subject: Subject) -> Measured:
    """(10) and (16)."""
    K, parallel = {}, {}
    for case in LOADS:
        par = subject.spring(case)
        K_r, K_e = diaphragm_stiffness(0.0, par.pressure, par), layered_stiffness(par)
        K[case], parallel[case] = (float(combined(K_r, K_e, topology)) for topology in ("series", "parallel"))
    more = 100.0 * (parallel["AW3"] / parallel["AW0"] - 1.0)
    return _by_load(
        K, f"With the emergency spring in series; in parallel, as worded, {more:+.1f} % are left."
    )


def _by_load(K: dict[str, float], note: str) -> Measured:
    return Measured(
        f"AW0 {K['AW0'] / 1e3:.0f} kN/m, AW3 {K['AW3'] / 1e3:.0f} kN/m",
        K["AW3"] > 1.05 * K["AW0"],
        dict(K),
        note,
    )


# T4, T5, T10: the orifice ---------------------------------------------------------------------------------------


def _lateral_damping(subject: Subject, f: float, **changes: Any) -> float:
    """Lateral damping coefficient in N·s/m at 5 mm."""
    return lateral_stiffness(subject, "AW0", 5 * mm, f, **changes).imag / (2.0 * np.pi * f)


def _no_lateral_orifice(subject: Subject) -> tuple[float, str]:
    """By how much the lateral damping changes from the smallest to the largest orifice, and that in words."""
    small, large = (_lateral_damping(subject, 1.2, orifice_diameter=d) for d in (DIAMETERS[0], DIAMETERS[-1]))
    change = abs(large / small - 1.0)
    return change, (
        "Vertical only. Sideways an orifice damps nothing in the plant, where that motion hardly moves volume: from 13"
        f" to 22 mm the lateral c of {small / 1e3:.2f} kN·s/m, all of it rubber, changes by {100 * change:.2f} %."
    )


def ratio(subject: Subject) -> Measured:
    """The ratio that amplitudes of 1 to 30 mm produce."""
    amplitudes = np.array([1, 2, 5, 8, 12, 16, 20, 30]) * mm
    parts, holds = [], True
    numbers: dict[str, float] = {}
    for case in LOADS:
        r, c = np.array([pressure_ratio_and_damping(subject, case, float(a), 1.2) for a in amplitudes]).T
        top = int(np.argmax(c))
        parts.append(f"{case} {listed(c[[0, top, -1]] / 1e3)} kN·s/m at r = {listed(r[[0, top, -1]], '.3f')}")
        holds &= len(maxima(c)) == 1 and 0.95 * c[top] > max(c[0], c[-1])
        numbers |= {f"best_ratio_{case}": float(r[top]), f"peak_{case}": float(c[top])}
    change, words = _no_lateral_orifice(subject)
    return Measured(
        "; ".join(parts),
        holds,
        numbers | {"lateral_change": change},
        f"{words} The ratio cannot be set: it follows from amplitude (here, 1 to 30 mm), frequency and orifice.",
    )


def paper_ratio(subject: Subject) -> Measured:
    """(19) over the ratio at which (18) is linearised."""
    par = subject.spring("AW0")
    diameters = np.array([10.0, 14.0, 18.0]) * mm
    best = peak_ratio(OMEGA, diameters, par)
    c = orifice_damping(OMEGA, np.linspace(0.53, 0.9994, 2001)[:, None], diameters, par.pressure, par)
    return Measured(
        f"maximum at r = {listed(best, '.4f')} ({listed(diameters / mm, 'g')} mm)",
        all(len(maxima(column)) == 1 for column in np.asarray(c).T),
        {f"best_ratio_{d / mm:g}mm": float(r) for d, r in zip(diameters, np.asarray(best), strict=True)},
        "The ratio at which (18) is linearised is free, and c falls or rises with it as one likes.",
    )


def diameter(subject: Subject) -> Measured:
    """Vertical damping, and the lateral one beside it."""
    parts, holds = [], True
    for case in LOADS:
        c = [damping(subject, case, 5 * mm, 1.2, orifice_diameter=d) for d in DIAMETERS]
        parts.append(f"{case} {listed(np.array(c) / 1e3)}")
        holds &= falls(c)
    change, words = _no_lateral_orifice(subject)
    text = "; ".join(parts) + " kN·s/m at 13/14/16/18/22 mm"
    return Measured(text, holds, {"lateral_change": change}, words)


def frequency_of_damping(subject: Subject) -> Measured:
    """Vertical damping, and the lateral one beside it."""
    grid = FREQUENCIES
    parts, holds = [], True
    numbers: dict[str, float] = {}
    for case in LOADS:
        c = np.array([damping(subject, case, 5 * mm, float(f)) for f in grid])
        tops = maxima(c)
        f_pk = float(grid[tops[0]]) if tops else float("nan")
        f_z = natural_frequency(subject.parameters(case).record)
        parts.append(
            f"{case} maximum at {f_pk:.2f} Hz, f_z {f_z:.2f} Hz, c(12 Hz)/c_max {c[-1] / c.max():.3f}"
        )
        holds &= len(tops) == 1 and within(f_pk / f_z, 0.7, 1.3) and c[-1] < 0.1 * c.max()
        numbers[f"last_over_peak_{case}"] = float(c[-1] / c.max())
    sideways = [_lateral_damping(subject, f) / 1e3 for f in (0.3, 1.0, 3.0, 10.0)]
    return Measured(
        "; ".join(parts),
        holds,
        numbers,
        f"Vertical only. Sideways c is that of rubber and falls all along: {listed(sideways)} kN·s/m at 0.3 / 1 / 3 /"
        " 10 Hz. That the maximum meets the natural frequency is a choice of the orifice, and of 5 mm.",
    )


# T6 to T9: displacement, roll, frequency ------------------------------------------------------------------------


def area_and_equivalent_volume(subject: Subject) -> Measured:
    """The paper's volume grows; that of the plant cannot."""
    area, volume = area_and_volume(subject)
    return Measured(
        f"A_e {100 * area:+.1f} %, V_b {100 * volume:+.1f} % at 60 mm",
        area < 0.0 and volume > 3.0 * abs(area),
        {"area": area, "volume": volume},
        "The area falls; the volume falls too, and by less. A conservative bellows whose volume grew sideways would"
        " push away from its centre, against T1. The paper's volume is a fitted number of (10).",
    )


def displacement(subject: Subject) -> Measured:
    """Secants of whole springs after a slow ramp."""
    K = {case: [lateral_secant(subject, case, y) for y in OFFSETS] for case in LOADS}
    return _by_displacement(K, OFFSETS, "Secant after a slow ramp, friction and rubber included.")


def paper_displacement(subject: Subject) -> Measured:
    """(10) is a secant."""
    offsets = (0.0, *OFFSETS)
    K = {
        case: diaphragm_stiffness(np.array(offsets), subject.spring(case).pressure, subject.spring(case))
        for case in LOADS
    }
    return _by_displacement(K, offsets, "Diaphragm (10).")


def _by_displacement(K: dict[str, Any], offsets: tuple[float, ...], note: str) -> Measured:
    return Measured(
        "; ".join(f"{case} {listed(np.array(row) / 1e3)}" for case, row in K.items())
        + f" kN/m at {listed(np.array(offsets) / mm, 'g')} mm",
        all(falls(row) for row in K.values()),
        {f"fall_{case}": float(1.0 - row[-1] / row[0]) for case, row in K.items()},
        note,
    )


def roll(subject: Subject) -> Measured:
    """The claim names no sign and no displacement: it has to hold for both signs and in the first harmonic."""
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
    return Measured(
        "; ".join(parts) + " kN/m at 0 / 0.05 / 0.08 rad",
        holds,
        numbers,
        "An elastic coupling is odd in roll: it stiffens the secant for one sign and softens it for the other, and does"
        " not touch the first harmonic. For φ·y > 0 the claim holds (A19).",
    )


def frequency(subject: Subject) -> Measured:
    """First harmonics of the lateral force at 5 mm."""
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
    return Measured(
        "; ".join(parts) + " kN/m at 0.1 / 1 / 10 / 28 Hz",
        holds,
        numbers,
        "It rises, by the relaxation of the rubber, and does not oscillate: sideways the motion hardly moves air"
        " through the pipe that is fitted here. Vertically it does what is claimed (A21).",
    )


def paper_frequency(subject: Subject) -> Measured:
    """(23) with the inertia of a pipe."""
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
    return Measured(
        "; ".join(parts),
        holds,
        numbers,
        "With the inertia of the air in a pipe (1.5 m × 50 mm, 30 mm plate, r = 0.9995). The paper's (23) has none:"
        " without it the stiffness rises and does not oscillate.",
    )


# T11: the car ---------------------------------------------------------------------------------------------------


def ride(subject: Subject) -> Measured:
    """The car on the plant's springs: accelerations and comfort."""
    cells = plant_ride(subject)
    a = {key: cell.estimate("acceleration").mean for key, cell in cells.items()}
    index = {key: cell.estimate("weighted", 6.0).mean for key, cell in cells.items()}
    sample = "Quick: one realisation" if subject.quick else "Ten realisations"
    return _ride(a, index, f"{sample} of the wind. {why_the_heavy_car_shakes(subject)}")


def paper_ride_claim(subject: Subject) -> Measured:
    """Equation (28) in closed form: accelerations and comfort."""
    table = paper_ride(subject)
    note = "Equation (28) with one degree of freedom, ten realisations of the wind."
    return _ride({k: v[0] for k, v in table.items()}, {k: v[1] for k, v in table.items()}, note)


def _ride(a: dict[tuple[str, float], float], index: dict[tuple[str, float], float], note: str) -> Measured:
    rows = {case: np.array([a[case, speed] for speed in WIND_SPEEDS]) for case in LOADS}
    judged = comfort_index(index, "")
    grows = all(bool(np.all(np.diff(row) >= 0.0)) for row in rows.values())
    lower = bool(np.all(rows["AW3"] < rows["AW0"]))
    accelerations = "; ".join(f"{case} {listed(row, '.3f')}" for case, row in rows.items())
    return Measured(
        f"a_y rms {accelerations} m/s²; N {judged.text}",
        judged.holds and grows and lower,
        judged.numbers | {f"a_{case}_{speed:g}": float(one) for (case, speed), one in a.items()},
        note,
    )


_ROLL: Final = "≥ 20 % up to 0.05 rad, then changed by < 10 % of it up to 0.08 rad"
_RIDE: Final = "a_y and N non-decreasing from 10 to 25 m/s, lower for AW3 at every speed, N < 2"

CLAIMS: Final = (
    Check("T1", "K_lat rises with pressure", "plant", "strictly, six preloads", pressure, "lateral"),
    Check("T1", "K_lat rises with pressure", "paper", "strictly, six preloads", paper_pressure),
    Check(
        "T2",
        "K_lat falls with the excitation amplitude",
        "plant",
        "at every step, by > 5 % from 1 to 20 mm",
        amplitude,
        "lateral",
    ),
    Check(
        "T2",
        "K_lat falls with the excitation amplitude",
        "paper",
        "at every step, by > 5 % from 1 to 20 mm",
        paper_amplitude,
    ),
    Check("T3", "K_lat(AW3) > K_lat(AW0)", "plant", "by > 5 %", load, "lateral"),
    Check("T3", "K_lat(AW3) > K_lat(AW0)", "paper", "by > 5 %", paper_load),
    Check(
        "T4",
        "c rises and then falls with the pressure ratio",
        "plant",
        "vertical c at 1.2 Hz: one maximum, both ends > 5 % below",
        ratio,
        "diameter",
    ),
    Check(
        "T4",
        "c rises and then falls with the pressure ratio",
        "paper",
        "one maximum in 0.53–1, for 10, 14, 18 mm",
        paper_ratio,
    ),
    Check(
        "T5",
        "c falls with the orifice diameter",
        "plant",
        "vertical c at 1.2 Hz, 5 mm: strictly, 13 to 22 mm",
        diameter,
        "diameter",
    ),
    Check(
        "T5",
        "c falls with the orifice diameter",
        "paper",
        "strictly, 13 to 22 mm, at 1.2 Hz",
        paper_damping_over_diameter,
    ),
    Check(
        "T6",
        "A_e falls and V_eq grows with lateral displacement, |ΔV/V| ≫ |ΔA/A|",
        "plant",
        "A_e falls, V grows by more than three times as much, at 60 mm",
        area_and_equivalent_volume,
    ),
    Check(
        "T6",
        "A_e falls and V_eq grows with lateral displacement, |ΔV/V| ≫ |ΔA/A|",
        "paper",
        "A falls by 1 to 5 %, V_eq grows by more than three times as much, at 60 mm",
        paper_area_over_offset,
    ),
    Check("T7", "K_lat falls with lateral displacement", "plant", "strictly, 20 to 60 mm", displacement),
    Check("T7", "K_lat falls with lateral displacement", "paper", "strictly, 0 to 60 mm", paper_displacement),
    Check(
        "T8",
        "K_lat rises sharply with roll, then hardly beyond 0.05 rad",
        "plant",
        f"both signs, secant at +20 mm and first harmonic: {_ROLL}",
        roll,
        "roll",
    ),
    Check(
        "T8",
        "K_lat rises sharply with roll, then hardly beyond 0.05 rad",
        "paper",
        _ROLL,
        paper_stiffness_over_roll,
    ),
    Check(
        "T9",
        "K_lat rises with frequency, oscillates at high frequency and settles",
        "plant",
        "lateral |K| rises from 0.1 to 28 Hz and overshoots its last value by > 5 %",
        frequency,
    ),
    Check(
        "T9",
        "K_lat rises with frequency, oscillates at high frequency and settles",
        "paper",
        "|K| rises, overshoots K_r by > 5 % and ends within 1 % of it",
        paper_frequency,
    ),
    Check(
        "T10",
        "c is largest at the natural frequency and small at high frequency",
        "plant",
        "vertical c at 5 mm: one maximum in 0.3–12 Hz, within ±30 % of f_z; c(12 Hz) < 0.1 c_max",
        frequency_of_damping,
        "frequency",
    ),
    Check(
        "T10",
        "c is largest at the natural frequency and small at high frequency",
        "paper",
        "one maximum in 0.3–10 Hz, within ±30 % of f_z at 5 mm; c(10 Hz) < 0.1 c_max",
        paper_damping_over_frequency,
    ),
    Check(
        "T11",
        "a_y and comfort index rise with the wind, stay comfortable, are lower for AW3",
        "plant",
        _RIDE,
        ride,
        "ride",
    ),
    Check(
        "T11",
        "a_y and comfort index rise with the wind, stay comfortable, are lower for AW3",
        "paper",
        _RIDE,
        paper_ride_claim,
        "paper ride",
    ),
)
