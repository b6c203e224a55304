"""Damping of the orifice over pressure ratio, diameter, frequency and amplitude."""

from typing import Any, Final

import numpy as np

from astb_studies.paper.checks.criteria import falls, listed, maxima, within
from astb_studies.paper.claims import CheckOutcome, Claim
from astb_studies.paper.closed_form import (
    amplitude_damping,
    orifice_damping,
    peak_angular_frequency,
    peak_ratio,
)
from astb_studies.paper.experiments import (
    damping,
    damping_peak,
    lateral_stiffness,
    natural_frequency,
    pressure_ratio_and_damping,
)
from astb_studies.paper.subject import BARE, LOADS, Subject
from bench_protocol.units import mm

OMEGA: Final = 2.0 * np.pi * 1.2
#: Where damping is looked at over frequency, in Hz.
FREQUENCIES: Final = np.geomspace(0.3, 12.0, 32)
DIAMETERS: Final = tuple(d * mm for d in (13, 14, 16, 18, 22))


def _lateral_damping(subject: Subject, f: float, **changes: Any) -> float:
    """Return the lateral damping coefficient in N·s/m at 5 mm, AW0."""
    return lateral_stiffness(subject, "AW0", 5 * mm, f, **changes).imag / (2.0 * np.pi * f)


def _no_lateral_orifice(subject: Subject) -> tuple[float, str]:
    """Return the share by which lateral damping changes from the smallest to the largest orifice, and words for it."""
    small, large = (_lateral_damping(subject, 1.2, orifice_diameter=d) for d in (DIAMETERS[0], DIAMETERS[-1]))
    change = abs(large / small - 1.0)
    return change, (
        "Vertical only. Sideways an orifice damps nothing in the plant, where that motion hardly moves volume: from 13"
        f" to 22 mm the lateral c of {small / 1e3:.2f} kN·s/m, all of it rubber, changes by {100 * change:.2f} %."
    )


T4: Final = Claim(
    "T4", "Damping first rises and then falls with the pressure ratio.", "the paper, figure 6(c)"
)


@T4.on("plant", "vertical c at 1.2 Hz: one maximum, both ends > 5 % below", shares="diameter")
def damping_over_produced_ratio(subject: Subject) -> CheckOutcome:
    """Vertical damping at 1.2 Hz over the pressure ratio that amplitudes of 1 to 30 mm produce."""
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
    return CheckOutcome(
        "; ".join(parts),
        holds,
        numbers | {"lateral_change": change},
        f"{words} The ratio cannot be set: it follows from amplitude (here, 1 to 30 mm), frequency and orifice.",
    )


@T4.on("paper", "one maximum in 0.53–1, for 10, 14, 18 mm; r* = 0.973 ± 0.005 (14 mm)")
def paper_damping_over_ratio(subject: Subject) -> CheckOutcome:
    """Damping (19) at 1.2 Hz over the ratio at which (18) is linearised: number and place of its maxima."""
    par = subject.spring("AW0")
    diameters = np.array([10.0, 14.0, 18.0]) * mm
    best = np.asarray(peak_ratio(OMEGA, diameters, par))
    r = np.linspace(0.53, 0.9994, 4001)
    c = np.asarray(orifice_damping(OMEGA, r[:, None], diameters, par.pressure, par)).T
    tops = [maxima(row) for row in c]
    single = all(len(one) == 1 for one in tops)
    return CheckOutcome(
        f"maximum at r = {listed(best, '.4f')}, of {listed(c.max(axis=1) / 1e3)} kN·s/m"
        f" ({listed(diameters / mm, 'g')} mm, 1.2 Hz)",
        single and abs(float(r[tops[1][0]]) - best[1]) < 5e-4 and abs(float(best[1]) - 0.973) <= 0.005,
        {f"best_ratio_{d / mm:g}mm": float(one) for d, one in zip(diameters, best, strict=True)}
        | {"peak_damping": float(c[1].max())},
        "The ratio at which (18) is linearised is free, and c falls or rises with it as one likes.",
    )


T5: Final = Claim("T5", "Damping falls with the orifice diameter.", "the paper, figure 6(c)")


@T5.on("plant", "vertical c at 1.2 Hz, 5 mm: strictly, 13 to 22 mm", shares="diameter")
def vertical_and_lateral_damping_over_diameter(subject: Subject) -> CheckOutcome:
    """Vertical damping of the whole spring at 1.2 Hz and 5 mm over the orifice; in the note, the lateral one."""
    c = {load: [damping(subject, load, 5 * mm, 1.2, orifice_diameter=d) for d in DIAMETERS] for load in LOADS}
    change, words = _no_lateral_orifice(subject)
    return _by_diameter(c, words, lateral_change=change)


@T5.on("paper", "strictly, 13 to 22 mm, at 1.2 Hz")
def paper_damping_over_diameter(subject: Subject) -> CheckOutcome:
    """Damping (19) over the orifice, at the pressure ratio of the parameter set."""
    c, best = {}, 0.0
    for load in LOADS:
        par = subject.spring(load)
        c[load] = orifice_damping(OMEGA, par.pressure_ratio, np.array(DIAMETERS), par.pressure, par)
        best = float(peak_ratio(OMEGA, DIAMETERS[0], par))
    ratio = float(subject.spring("AW0").pressure_ratio)
    note = f"At a pressure ratio of {ratio:g}; below {best:.3f}, the ratio of 13 mm's maximum, the order turns round."
    return _by_diameter(c, note)


def _by_diameter(c: dict[str, Any], note: str, **numbers: float) -> CheckOutcome:
    return CheckOutcome(
        "; ".join(f"{load} {listed(np.array(row) / 1e3)}" for load, row in c.items())
        + " kN·s/m at 13/14/16/18/22 mm",
        all(falls(row) for row in c.values()),
        {
            f"damping_{load}_{d / mm:g}mm": float(value)
            for load, row in c.items()
            for d, value in zip(DIAMETERS, row, strict=True)
        }
        | numbers,
        note,
    )


T10: Final = Claim(
    "T10",
    "Damping is largest at the natural frequency and small at high frequency.",
    "the paper, figure 11(c)",
)


@T10.on(
    "plant",
    "vertical c at 5 mm: one maximum in 0.3–12 Hz, within ±30 % of f_z; c(10 Hz) and c(12 Hz) < 0.1 c_max",
    shares="frequency",
)
def damping_over_frequency(subject: Subject) -> CheckOutcome:
    """Vertical damping of the whole spring at 5 mm: number and place of its maxima; in the note, the lateral one."""
    parts, holds = [], True
    numbers: dict[str, float] = {}
    for load in LOADS:
        c = np.array([damping(subject, load, 5 * mm, float(f)) for f in FREQUENCIES])
        f_z = natural_frequency(subject.parameters(load).record)
        tops = maxima(c)
        f_pk, c_pk = damping_peak(subject, load, 5 * mm)
        at_ten, last = damping(subject, load, 5 * mm, 10.0) / c_pk, float(c[-1] / c.max())
        parts.append(
            f"{load}: {len(tops)} maximum at {f_pk:.2f} Hz ({f_pk / f_z:.2f} f_z), {c_pk / 1e3:.1f} kN·s/m,"
            f" c(10 Hz)/c_max {at_ten:.3f}, c(12 Hz)/c_max {last:.3f}"
        )
        holds &= len(tops) == 1 and within(f_pk / f_z, 0.7, 1.3) and max(at_ten, last) < 0.1
        numbers |= {
            f"peak_{load}": f_pk,
            f"natural_{load}": f_z,
            f"at_10Hz_{load}": at_ten,
            f"last_over_peak_{load}": last,
        }
    sideways = [_lateral_damping(subject, f) / 1e3 for f in (0.3, 1.0, 3.0, 10.0)]
    return CheckOutcome(
        "; ".join(parts),
        holds,
        numbers,
        f"Vertical only. Sideways c is that of rubber and falls all along: {listed(sideways)} kN·s/m at 0.3 / 1 / 3 /"
        " 10 Hz. That the maximum meets the natural frequency is a choice of the orifice, and of 5 mm.",
    )


@T10.on("paper", "one maximum in 0.3–10 Hz, within ±30 % of f_z at 5 mm; c(10 Hz) < 0.1 c_max")
def paper_damping_over_frequency(subject: Subject) -> CheckOutcome:
    """Damping by harmonic balance of the orifice over frequency: the pressure ratio follows from the motion."""
    parts, holds = [], True
    numbers: dict[str, float] = {}
    for load in LOADS:
        par = subject.spring(load)
        f = np.geomspace(0.3, 10.0, 200)
        c = np.asarray(amplitude_damping(2.0 * np.pi * f, 5 * mm, par.orifice_diameter, par.pressure, par))
        f_pk = float(peak_angular_frequency(5 * mm, par.orifice_diameter, par)) / (2.0 * np.pi)
        f_z = natural_frequency(subject.parameters(load).record)
        last = float(c[-1] / c.max())
        parts.append(f"{load}: {f_pk:.2f} Hz ({f_pk / f_z:.2f} f_z), c(10 Hz)/c_max {last:.3f}")
        holds &= len(maxima(c)) == 1 and within(f_pk / f_z, 0.7, 1.3) and last < 0.1
        numbers |= {f"peak_{load}": f_pk, f"at_10Hz_{load}": last}
    note = "At the pressure ratio that the motion produces. At a ratio that stays, (19) only falls with frequency."
    return CheckOutcome("; ".join(parts), holds, numbers, note)


@Claim("A10", "f_pk √a = const under any load, c_pk ∝ p √a", "harmonic balance of a square-root orifice").on(
    "plant", "±2 %"
)
def scaling_laws(subject: Subject) -> CheckOutcome:
    """Place and height of the maximum of vertical damping by amplitude and load: gas and membrane alone."""
    amplitudes = np.array([1.0, 2.5, 5.0, 10.0]) * mm
    f, c = np.array([damping_peak(subject, "AW0", float(a), *BARE) for a in amplitudes]).T
    f_loaded, c_loaded = damping_peak(subject, "AW3", 5 * mm, *BARE)
    middle = 2
    by_f = f * np.sqrt(amplitudes / (5 * mm)) / f[middle]
    by_c = c / np.sqrt(amplitudes / (5 * mm)) / c[middle]
    record = {load: subject.parameters(load).record for load in LOADS}
    p = {k: r.nominal_preload[0] / r.effective_area[0] + r.atmospheric_pressure for k, r in record.items()}
    by_load = c_loaded / c[middle] * p["AW0"] / p["AW3"]
    worst = max(
        np.abs(by_f - 1).max(), np.abs(by_c - 1).max(), abs(by_load - 1), abs(f_loaded / f[middle] - 1)
    )
    return CheckOutcome(
        f"f_pk {listed(f, '.2f')} Hz, c_pk {listed(c / 1e3)} kN·s/m at {listed(amplitudes / mm, 'g')} mm (AW0); "
        f"AW3 {f_loaded:.2f} Hz, {c_loaded / 1e3:.1f} kN·s/m: laws within {100 * worst:.1f} %",
        bool(worst < 0.02),
        {"deviation": float(worst), "peak_frequency": float(f[middle]), "peak_damping": float(c[middle])},
    )
