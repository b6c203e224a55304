"""The acceptance checks A01 to A30: closed forms, conservation and figures that both model layers have to meet."""

from typing import Any, Final

import numpy as np

from bench_protocol.units import bar, kN, mm, s
from bench_sim.model import spring
from bench_sim.model.algebraic import ALGEBRAICS, Algebraic
from bench_sim.model.experiments import (
    LATERAL,
    ROLL,
    VERTICAL,
    Motion,
    dynamic_stiffness,
    first_harmonic,
    impose,
)
from bench_sim.model.iso6358 import ISO_DENSITY
from bench_sim.model.layout import Input, Mode, State
from bench_sim.model.paper import (
    amplitude_damping,
    combined,
    diaphragm_stiffness,
    equivalent_volume,
    lateral_area,
    layered_stiffness,
    orifice_damping,
    peak_angular_frequency,
    peak_ratio,
    roll_factor,
)
from bench_sim.model.plant import Plant
from bench_sim.model.vehicle import Vehicle
from paper_study.check import Check, Measured
from paper_study.experiments import (
    PIPE,
    STILL,
    WIND_SPEEDS,
    closed_form,
    damping,
    damping_peak,
    lateral_secant,
    lateral_stiffness,
    moved_aside,
    natural_frequency,
    paper_ride,
    plant_ride,
    quasi_static_lateral,
    rolled,
    upper_sway,
    wind_alone,
)
from paper_study.subject import BARE, ISOTHERMAL, LOADS, Subject, remembered
from test_plans.comfort import weighting

OMEGA: Final = 2.0 * np.pi * 1.2
#: Where damping is looked at over frequency, in Hz.
FREQUENCIES: Final = np.geomspace(0.3, 12.0, 32)
DIAMETERS: Final = tuple(d * mm for d in (13, 14, 16, 18, 22))


def within(value: float, low: float, high: float) -> bool:
    """Tell whether low ≤ value ≤ high; nothing that is not a number is."""
    return bool(low <= value <= high)


def near(value: float, expected: float, share: float) -> bool:
    """Tell whether a value lies within ± ``share`` of what is expected."""
    return bool(abs(value - expected) <= share * abs(expected))


def maxima(values: Any) -> list[int]:
    """Places of the local maxima inside a series."""
    rising = np.diff(values) > 0.0
    return [int(k) + 1 for k in np.flatnonzero(rising[:-1] & ~rising[1:])]


def falls(values: Any) -> bool:
    """Tell whether a series falls strictly."""
    return bool(np.all(np.diff(values) < 0.0))


def rises(values: Any) -> bool:
    """Tell whether a series rises strictly."""
    return bool(np.all(np.diff(values) > 0.0))


def listed(values: Any, form: str = ".1f") -> str:
    """One figure after the other, with slashes between."""
    return " / ".join(format(float(value), form) for value in values)


def _shut(plant: Plant) -> Plant:
    plant.inputs[[Input.LEFT_RESERVOIR_VALVE, Input.RIGHT_RESERVOIR_VALVE]] = 0.0
    return plant


# Gas and membrane ---------------------------------------------------------------------------------------------------


def static_pressure(subject: Subject) -> Measured:
    """Rest with closed valves, and the bench as its leveling valves fill it."""
    expected = {"AW0": 2.058 * bar, "AW3": 5.577 * bar}
    found = {}
    for load in LOADS:
        plant = subject.resting(load)
        plant.step(5_000)
        found[load] = plant.truth()["left_bellows_pressure"]
    plant = Plant.depressurised(subject.parameters("AW0").record)
    plant.inputs[[Input.SUPPLY, Input.LEFT_LEVELING, Input.RIGHT_LEVELING]] = 1.0
    weight = 0.5 * plant.parameters.bolster_mass * plant.parameters.gravity
    for j in (0, 1):
        plant.inputs[Input.VERTICAL_LEFT_MODE + j] = Mode.FORCE
        plant.inputs[Input.VERTICAL_LEFT_COMMAND + j] = LOADS["AW0"] - weight
    plant.step(120_000)
    leveled = plant.truth()
    height, lower = leveled["left_height"], leveled["left_bellows_pressure"] / found["AW0"] - 1.0
    return Measured(
        f"AW0 {found['AW0'] / bar:.3f} bar, AW3 {found['AW3'] / bar:.3f} bar (gauge)",
        all(near(found[load], expected[load], 0.005) for load in LOADS),
        {f"pressure_{load}": p for load, p in found.items()} | {"leveled_height": height},
        f"Valves isolated. Filled by its leveling valves, the bench stays at {height / mm:.1f} mm, the edge of their"
        f" dead zone, with {100 * lower:+.1f} % of pressure.",
    )


def slow_stiffness(subject: Subject) -> Measured:
    """One cycle of an hour, ±1 mm."""
    found, wanted = {}, {}
    for load in LOADS:
        plant = subject.resting(load, *BARE)
        par = plant.parameters
        wanted[load] = closed_form(par, par.bellows_volume[0] + par.auxiliary_volume[0], 1.0)
        found[load] = dynamic_stiffness(plant, 1 * mm, 3e-4, 1, longest_step=10e-3)[0].real
    return _against_closed_form(found, wanted, 0.01)


def fast_stiffness(subject: Subject) -> Measured:
    """20 Hz at 5 mm, and at 1 mm for the note."""
    found, wanted, small = {}, {}, 0.0
    for load in LOADS:
        plant = subject.resting(load, *BARE)
        par = plant.parameters
        wanted[load] = closed_form(par, par.bellows_volume[0], par.heat_capacity_ratio)
        found[load] = dynamic_stiffness(plant, 5 * mm, 20.0, 60)[0].real
        less = dynamic_stiffness(subject.resting(load, *BARE), 1 * mm, 20.0, 60)[0].real
        small = min(small, less / wanted[load] - 1.0)
    note = f"At 5 mm. The smaller the motion, the less an orifice shuts: at 1 mm {100 * small:+.1f} %."
    return _against_closed_form(found, wanted, 0.01, note)


def _against_closed_form(
    found: dict[str, float], wanted: dict[str, float], share: float, note: str = ""
) -> Measured:
    parts = [
        f"{load} {found[load] / 1e3:.1f} kN/m ({100 * (found[load] / wanted[load] - 1):+.2f} %)"
        for load in found
    ]
    return Measured(
        ", ".join(parts),
        all(near(found[load], wanted[load], share) for load in found),
        {f"stiffness_{load}": K for load, K in found.items()}
        | {f"closed_form_{load}": K for load, K in wanted.items()},
        note,
    )


def shut_orifice(subject: Subject) -> Measured:
    """Reservoir valves closed, gas and membrane alone, no heat."""
    excess: dict[int, list[float]] = {1: [], 5: []}
    loss = 0.0
    for load in LOADS:
        for amplitude, found in excess.items():
            for f in (0.1, 10.0):
                plant = _shut(subject.resting(load, *BARE, "heat"))
                par = plant.parameters
                wanted = closed_form(par, par.bellows_volume[0], par.heat_capacity_ratio)
                K, _ = dynamic_stiffness(plant, amplitude * mm, f, 3)
                found.append(K.real / wanted - 1.0)
                loss = max(loss, abs(K.imag / K.real))
    small, large = max(excess[1]), max(excess[5])
    return Measured(
        f"K {100 * small:+.3f} % at 1 mm, {100 * large:+.2f} % at 5 mm; K''/K {loss:.1e}",
        min(map(min, excess.values())) > -1e-4 and small < 2e-4 and large < 2.5e-3 and loss < 1e-6,
        {"excess_1mm": small, "excess_5mm": large, "loss": loss},
    )


def wide_orifice(subject: Subject) -> Measured:
    """An orifice of 60 mm, gas and membrane alone, no heat."""
    worst = loss = 0.0
    for load in LOADS:
        for f in (0.5, 2.0):
            plant = subject.resting(load, *BARE, "heat", orifice_diameter=60 * mm)
            par = plant.parameters
            volume = par.bellows_volume[0] + par.auxiliary_volume[0]
            K, _ = dynamic_stiffness(plant, 5 * mm, f, 6, longest_step=2.5e-4)
            worst = max(worst, abs(K.real / closed_form(par, volume, par.heat_capacity_ratio) - 1.0))
            loss = max(loss, K.imag / K.real)
    return Measured(
        f"K' within {100 * worst:.2f} %, K''/K up to {100 * loss:.2f} %",
        worst < 0.005 and within(loss, 0.0, 0.015),
        {"deviation": worst, "loss": loss},
        "What loss there is comes from the linear flow law above a pressure ratio of 0.9995.",
    )


def polytropic_exponent(subject: Subject) -> Measured:
    """Pressure over volume of the closed bellows, by first harmonics."""
    worst = 0.0
    for load in LOADS:
        for f in (0.005, 0.0137, 0.1, 1.0):
            plant = _shut(subject.resting(load, *BARE))
            par = plant.parameters
            m, V, kappa = plant.state[State.BELLOWS_MASS], par.bellows_volume[0], par.heat_capacity_ratio
            hS = (
                par.bellows_heat_transfer[0]
                * (m / V / par.heat_reference_density) ** par.heat_density_exponent
            )
            tau = m * par.gas_constant / (kappa - 1.0) / hS
            cycles = max(3, round(60 * f))
            _, last = dynamic_stiffness(plant, 0.1 * mm, f, cycles, longest_step=10e-3)
            p, volume = last.of(Algebraic.PRESSURE), last.of(Algebraic.VOLUME)
            n = -(first_harmonic(p) / p.mean()) / (first_harmonic(volume) / volume.mean())
            iwt = 2j * np.pi * f * tau
            worst = max(worst, abs(n / ((1.0 + kappa * iwt) / (1.0 + iwt)) - 1.0))
    return Measured(f"largest deviation {worst:.1e}", worst < 0.01, {"deviation": worst})


#: Step in s that leaves little to the trapezoidal rule, which adds up heat and work.
_FINE: Final = 0.5e-3


@remembered
def _sealed_course(subject: Subject, load: str) -> Any:
    plant = subject.resting(load)
    motion = [Motion(VERTICAL, 10 * mm, 1.0), Motion(LATERAL, 20 * mm, 0.5)]
    return impose(plant, motion, 20 * s, dt=_FINE)


def mass_balance(subject: Subject) -> Measured:
    """Twenty seconds of vertical and lateral motion with closed valves."""
    drift = 0.0
    for load in LOADS:
        states = _sealed_course(subject, load).states
        mass = states[:, State.BELLOWS_MASS] + states[:, State.AUXILIARY_MASS]
        drift = max(drift, float(np.ptp(mass) / mass[0]))
    return Measured(f"drift {drift:.1e} of the mass", drift < 1e-9, {"drift": drift})


def energy_balance(subject: Subject) -> Measured:
    """The same motion: energy of the gas against heat and work; then ten adiabatic cycles."""
    worst = 0.0
    for load in LOADS:
        course = _sealed_course(subject, load)
        energy = course.states[:, State.BELLOWS_ENERGY] + course.states[:, State.AUXILIARY_ENERGY]
        power = (
            course.of(Algebraic.HEAT)
            + course.of(Algebraic.AUXILIARY_HEAT)
            - course.of(Algebraic.PRESSURE)
            * (
                course.of(Algebraic.AREA) * course.of(Algebraic.BELLOWS_VERTICAL_SPEED)
                + course.of(Algebraic.LATERAL_AREA) * course.of(Algebraic.BELLOWS_LATERAL_SPEED)
            )
        )
        given = np.concatenate([[0.0], np.cumsum(0.5 * (power[1:] + power[:-1]))]) * _FINE
        missing = np.max(np.abs(energy - energy[0] - given))
        worst = max(worst, float(missing / (np.sum(np.abs(power)) * _FINE)))
    plant = subject.resting("AW3", *BARE, "heat")
    course = impose(plant, [Motion(VERTICAL, 10 * mm, 1.0)], 10.0, every=1000, rows=11)
    energy = course.states[:, State.BELLOWS_ENERGY] + course.states[:, State.AUXILIARY_ENERGY]
    warming = float(energy[9] - energy[0]) / 9.0
    return Measured(
        f"missing {worst:.1e} of the energy that was exchanged; orifice loss {warming:.0f} J per cycle",
        worst < 1e-6 and near(warming, 199.0, 0.02),
        {"missing": worst, "loss_per_cycle": warming},
    )


def reciprocity(subject: Subject) -> Measured:
    """Central differences of the forces of one bellows at constant pressure, and of p_g V."""
    plant = subject.resting("AW0", *BARE)
    par, x, h = plant.parameters, plant.state, 1e-4
    worst = 0.0
    for gauge in (0.5 * bar, 2.06 * bar, 5.58 * bar):
        scale = 0.04 * gauge  # N/m: at ∂²V/∂ζ∂y = 4 and 10 mm
        for zeta, y in ((0.0, 0.01), (0.02, -0.04), (-0.03, 0.06), (0.05, 0.0)):
            F_z, F_y, work = {}, {}, {}
            for i in (-1, 0, 1):
                for j in (-1, 0, 1):
                    V = spring.volume(par, 0, zeta + i * h, y + j * h)
                    x[State.BELLOWS_ENERGY] = (
                        (gauge + par.atmospheric_pressure) * V / (par.heat_capacity_ratio - 1.0)
                    )
                    out = np.zeros(ALGEBRAICS)
                    spring.load_bellows(x, plant.memory, par, 0, zeta + i * h, y + j * h, out)
                    F_z[i, j], F_y[i, j] = out[Algebraic.STACK_VERTICAL], out[Algebraic.STACK_LATERAL]
                    work[i, j] = gauge * V
            z_by_y = (F_z[0, 1] - F_z[0, -1]) / (2 * h)
            y_by_z = (F_y[1, 0] - F_y[-1, 0]) / (2 * h)
            mixed = (work[1, 1] - work[1, -1] - work[-1, 1] + work[-1, -1]) / (4 * h * h)
            size = max(abs(z_by_y), scale)
            worst = max(worst, abs(z_by_y - y_by_z) / size, abs(z_by_y - mixed) / size)
    return Measured(f"largest difference {100 * worst:.1e} %", worst < 1e-3, {"difference": worst})


# Orifice ------------------------------------------------------------------------------------------------------------


def scaling_laws(subject: Subject) -> Measured:
    """Peaks of damping by amplitude and load, gas and membrane alone."""
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
    return Measured(
        f"f_pk {listed(f, '.2f')} Hz, c_pk {listed(c / 1e3)} kN·s/m at {listed(amplitudes / mm, 'g')} mm (AW0); "
        f"AW3 {f_loaded:.2f} Hz, {c_loaded / 1e3:.1f} kN·s/m: laws within {100 * worst:.1f} %",
        bool(worst < 0.02),
        {"deviation": float(worst), "peak_frequency": float(f[middle]), "peak_damping": float(c[middle])},
    )


def damping_over_frequency(subject: Subject) -> Measured:
    """Vertical damping of the whole spring at 5 mm."""
    grid = FREQUENCIES[FREQUENCIES <= 10.0]
    parts, holds = [], True
    numbers: dict[str, float] = {}
    for load in LOADS:
        c = np.array([damping(subject, load, 5 * mm, float(f)) for f in grid])
        f_z = natural_frequency(subject.parameters(load).record)
        tops = maxima(c)
        f_pk, c_pk = damping_peak(subject, load, 5 * mm)
        last = damping(subject, load, 5 * mm, 10.0) / c_pk
        parts.append(
            f"{load}: {len(tops)} maximum at {f_pk:.2f} Hz ({f_pk / f_z:.2f} f_z), {c_pk / 1e3:.1f} kN·s/m,"
            f" c(10 Hz)/c_max {last:.3f}"
        )
        holds &= len(tops) == 1 and within(f_pk / f_z, 0.7, 1.3) and last < 0.1
        numbers |= {f"peak_{load}": f_pk, f"natural_{load}": f_z, f"at_10Hz_{load}": last}
    return Measured("; ".join(parts), holds, numbers, "Vertical, with rubber and friction.")


def paper_damping_over_frequency(subject: Subject) -> Measured:
    """Harmonic balance of the orifice: the pressure ratio follows from the motion."""
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
    return Measured("; ".join(parts), holds, numbers, note)


def damping_over_diameter(subject: Subject) -> Measured:
    """Vertical damping of the whole spring at 1.2 Hz, 5 mm."""
    c = {load: [damping(subject, load, 5 * mm, 1.2, orifice_diameter=d) for d in DIAMETERS] for load in LOADS}
    return _by_diameter(c, "Vertical.")


def paper_damping_over_diameter(subject: Subject) -> Measured:
    """(19) at the pressure ratio of the parameter set."""
    c, best = {}, 0.0
    for load in LOADS:
        par = subject.spring(load)
        c[load] = orifice_damping(OMEGA, par.pressure_ratio, np.array(DIAMETERS), par.pressure, par)
        best = float(peak_ratio(OMEGA, DIAMETERS[0], par))
    ratio = float(subject.spring("AW0").pressure_ratio)
    note = f"At a pressure ratio of {ratio:g}; below {best:.3f}, the ratio of 13 mm's maximum, the order turns round."
    return _by_diameter(c, note)


def _by_diameter(c: dict[str, Any], note: str) -> Measured:
    return Measured(
        "; ".join(f"{load} {listed(np.array(row) / 1e3)}" for load, row in c.items())
        + " kN·s/m at 13/14/16/18/22 mm",
        all(falls(row) for row in c.values()),
        {
            f"damping_{load}_{d / mm:g}mm": float(value)
            for load, row in c.items()
            for d, value in zip(DIAMETERS, row, strict=True)
        },
        note,
    )


def damping_over_ratio(subject: Subject) -> Measured:
    """(19) at 1.2 Hz through 14 mm."""
    par = subject.spring("AW0")
    r = np.linspace(0.53, 0.9994, 4001)
    c = np.asarray(orifice_damping(OMEGA, r, 14 * mm, par.pressure, par))
    tops = maxima(c)
    best = float(r[tops[0]]) if tops else float("inf")
    exact = float(peak_ratio(OMEGA, 14 * mm, par))
    return Measured(
        f"{len(tops)} maximum, at r = {exact:.4f}, of {c.max() / 1e3:.1f} kN·s/m (14 mm, 1.2 Hz)",
        len(tops) == 1 and abs(best - exact) < 5e-4 and abs(exact - 0.973) <= 0.005,
        {"best_ratio": exact, "peak_damping": float(c.max())},
    )


# Lateral stiffness --------------------------------------------------------------------------------------------------


def stiffness_over_pressure(subject: Subject) -> Measured:
    """Quasi-static lateral stiffness at six preloads, each with its pressure."""
    preloads = np.array([30.0, 53.5, 80.0, 110.0, 145.0, 160.0]) * kN
    K = np.array([quasi_static_lateral(subject, float(P)) for P in preloads])
    p = preloads / subject.parameters("AW0").record.effective_area[0]
    slope = float((K[4] - K[1]) / (p[4] - p[1]))
    return _stiffness_slope(K, slope, "Quasi-static, with the emergency spring in series.")


def paper_stiffness_over_pressure(subject: Subject) -> Measured:
    """(10) at the same pressures."""
    par = subject.spring("AW0")
    p_g = np.array([30.0, 53.5, 80.0, 110.0, 145.0, 160.0]) * kN / par.effective_area
    K = np.asarray(diaphragm_stiffness(0.0, p_g + par.atmospheric_pressure, par))
    series = np.asarray(combined(K, layered_stiffness(par), "series"))
    slope, less = (float((k[4] - k[1]) / (p_g[4] - p_g[1])) for k in (K, series))
    return _stiffness_slope(K, slope, f"Diaphragm (10); in series with the emergency spring {less:.3f} m.")


def _stiffness_slope(K: Any, slope: float, note: str) -> Measured:
    return Measured(
        f"{listed(K / 1e3, '.0f')} kN/m at 30 … 160 kN; slope {slope:.3f} m between AW0 and AW3",
        rises(K) and near(slope, 0.35, 0.2),
        {"slope": slope, "lowest": float(K[0]), "highest": float(K[-1])},
        note,
    )


def stiffness_over_load(subject: Subject) -> Measured:
    """Quasi-static, and first harmonic at 5 mm."""
    slow = quasi_static_lateral(subject, LOADS["AW3"]) / quasi_static_lateral(subject, LOADS["AW0"])
    moving = lateral_stiffness(subject, "AW3", 5 * mm).real / lateral_stiffness(subject, "AW0", 5 * mm).real
    return Measured(
        f"{slow:.2f} quasi-static, {moving:.2f} at 5 mm",
        within(slow, 1.6, 2.3) and within(moving, 1.6, 2.3),
        {"quasi_static": slow, "at_5mm": moving},
    )


def paper_stiffness_over_load(subject: Subject) -> Measured:
    """(10), alone and with the emergency spring."""
    K = {
        load: float(diaphragm_stiffness(0.0, subject.spring(load).pressure, subject.spring(load)))
        for load in LOADS
    }
    K_e = float(layered_stiffness(subject.spring("AW0")))
    alone = K["AW3"] / K["AW0"]
    series = float(combined(K["AW3"], K_e, "series") / combined(K["AW0"], K_e, "series"))
    parallel = float(combined(K["AW3"], K_e, "parallel") / combined(K["AW0"], K_e, "parallel"))
    return Measured(
        f"{alone:.2f} diaphragm, {series:.2f} with the emergency spring in series",
        within(alone, 1.6, 2.3) and within(series, 1.6, 2.3),
        {"diaphragm": alone, "series": series, "parallel": parallel},
        f"With the emergency spring in parallel, as the paper words it, {parallel:.2f}: it hides the load.",
    )


def stiffness_over_amplitude(subject: Subject) -> Measured:
    """First harmonics at 1, 5 and 20 mm."""
    parts, holds = [], True
    numbers: dict[str, float] = {}
    for load in LOADS:
        K = [lateral_stiffness(subject, load, a * mm, 0.2, cycles=25).real for a in (1, 5, 20)]
        ratio = K[0] / K[2]
        parts.append(f"{load} {listed(np.array(K) / 1e3, '.0f')} kN/m, ratio {ratio:.2f}")
        holds &= falls(K) and within(ratio, 1.3, 1.7)
        numbers |= {f"ratio_{load}": ratio}
    return Measured("; ".join(parts) + " (1 / 5 / 20 mm, 0.2 Hz)", holds, numbers)


def secant_over_offset(subject: Subject) -> Measured:
    """F_y/y of relaxed springs held aside."""
    offsets = (1, 20, 40, 60)
    K = {
        load: [lateral_secant(subject, load, y * mm, "friction", "relaxation") for y in offsets]
        for load in LOADS
    }
    return _secants(K, offsets, "Friction off: it would add F_max/y to each.")


def paper_secant_over_offset(subject: Subject) -> Measured:
    """(10) is a secant."""
    offsets = (0, 20, 40, 60)
    y = np.array(offsets) * mm
    K = {load: diaphragm_stiffness(y, subject.spring(load).pressure, subject.spring(load)) for load in LOADS}
    return _secants(K, offsets, "Diaphragm (10).")


def _secants(K: dict[str, Any], offsets: tuple[int, ...], note: str) -> Measured:
    change = {load: float(row[-1] / row[0] - 1.0) for load, row in K.items()}
    return Measured(
        "; ".join(f"{k} {listed(np.array(K[k]) / 1e3)} kN/m, {100 * change[k]:+.1f} %" for k in K)
        + f" ({listed(offsets, 'g')} mm)",
        all(falls(row) for row in K.values()) and all(within(d, -0.30, -0.05) for d in change.values()),
        {f"change_{load}": d for load, d in change.items()},
        note,
    )


def area_and_volume(subject: Subject) -> tuple[float, float]:
    """A_e and V_b of the plant at 60 mm aside, less one, at design height."""
    aside = moved_aside(subject, "AW0", 60 * mm, "emergency_spring")
    par = subject.parameters("AW0").record
    area = aside.of(Algebraic.AREA)[0] / par.effective_area[0]
    return float(area) - 1.0, float(aside.of(Algebraic.VOLUME)[0] / par.bellows_volume[0]) - 1.0


def area_over_offset(subject: Subject) -> Measured:
    """∂V/∂ζ and V of a bellows held aside."""
    area, volume = area_and_volume(subject)
    return Measured(
        f"A_e {100 * area:+.1f} %, V_b {100 * volume:+.1f} % at 60 mm",
        within(area, -0.05, -0.01),
        {"area": area, "volume": volume},
        "The volume falls: a conservative bellows whose volume grew aside would push itself off its centre.",
    )


def paper_area_over_offset(subject: Subject) -> Measured:
    """The fits (8) of area and volume."""
    par = subject.spring("AW0")
    area = float(lateral_area(60 * mm, par) / par.lateral_area) - 1.0
    volume = float(equivalent_volume(60 * mm, par) / par.bellows_volume) - 1.0
    return Measured(
        f"A {100 * area:+.1f} %, V_eq {100 * volume:+.1f} % at 60 mm",
        within(area, -0.05, -0.01) and volume > 3.0 * abs(area),
        {"area": area, "volume": volume},
        "Both are fitted numbers of (10), not an area and a volume of a body.",
    )


ROLLS: Final = (0.0, 0.05, 0.08)


def stiffness_over_roll(subject: Subject) -> Measured:
    """Lateral cycles of ±20 mm at fixed roll angles of both signs."""
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
    return Measured(
        "secant at y = +20 mm, φ·y > 0: " + "; ".join(parts) + " at 0 / 0.05 / 0.08 rad",
        holds,
        numbers,
        "Only for this sign: with φ·y < 0 the secant falls, and the first harmonic falls for both signs ("
        + "; ".join(others)
        + " kN/m). The coupling force does not depend on y.",
    )


def paper_stiffness_over_roll(subject: Subject) -> Measured:
    """The even law of the paper's layer."""
    rest, knee, beyond = (float(roll_factor(phi, subject.spring("AW0"))) for phi in ROLLS)
    return Measured(
        f"×{knee:.3f} at 0.05 rad, ×{beyond:.3f} at 0.08 rad",
        knee - rest >= 0.2 * rest and beyond - knee < 0.1 * (knee - rest),
        {"at_0.05": knee, "at_0.08": beyond},
        "An even law that is put in for this purpose: it is assumed, not derived.",
    )


def coupling_sign(subject: Subject) -> Measured:
    """Lateral force of both springs at ±0.02 rad with the top plates over their feet."""

    def force(load: str, roll: float) -> float:
        plant = subject.resting(load)
        middle = -plant.parameters.centre_height * roll
        still = [Motion(LATERAL, 0.0, 1.0, offset=middle), Motion(ROLL, 0.0, 1.0, offset=roll)]
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
    return Measured("; ".join(parts) + " at +0.02 / −0.02 rad, y = 0", holds, numbers)


def surge(subject: Subject) -> Measured:
    """Vertical stiffness with pipe and plate fitted, gas and membrane alone."""
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
    return Measured("; ".join(parts), holds, {k: float(v) for k, v in numbers.items()}, "Pipe 1.5 m × 50 mm.")


def rubber_share(subject: Subject) -> Measured:
    """Vertical damping with and without rubber."""
    shares = []
    for load in LOADS:
        whole = damping(subject, load, 5 * mm, 1.2, "emergency_spring", cycles=30)
        gas = damping(subject, load, 5 * mm, 1.2, *BARE, cycles=30)
        shares.append(whole / gas - 1.0)
    mean = float(np.mean(shares))
    return Measured(
        f"AW0 {100 * shares[0]:.1f} %, AW3 {100 * shares[1]:.1f} %, mean {100 * mean:.1f} %",
        abs(mean - 0.05) <= 0.03,
        {"mean": mean, "AW0": shares[0], "AW3": shares[1]},
    )


# Valves and leaks ---------------------------------------------------------------------------------------------------


def _filling_time(subject: Subject, *without: str, **heat: float) -> float:
    """Seconds from AW0 to the pressure of AW3 through a leveling valve that stands open, at a locked height."""
    narrow = {"service_conductance": subject.parameters("AW0").entries["fill_conductance"].value}
    plant = subject.resting("AW0", *without, **narrow, **heat)
    plant.inputs[[Input.LEFT_SERVICE_VALVE, Input.RIGHT_SERVICE_VALVE]] = 1.0
    course = impose(plant, [STILL], 30 * s, every=10)
    par = plant.parameters
    full = LOADS["AW3"] / par.effective_area[0] + par.atmospheric_pressure
    reached = course.of(Algebraic.AUXILIARY_PRESSURE) >= full
    return float(course.time[np.argmax(reached)]) if reached.any() else float("inf")


def filling(subject: Subject) -> Measured:
    """A valve as narrow as a leveling valve, fully open."""
    table = _filling_time(subject, "emergency_spring")
    warm = _filling_time(subject, "emergency_spring", **ISOTHERMAL)
    closed = _filling_time(subject, "emergency_spring", "heat")
    soft = _filling_time(subject)
    return Measured(
        f"{table:.1f} s; isothermal {warm:.1f} s, adiabatic {closed:.1f} s",
        near(table, 17.0, 0.05) and near(warm, 21.2, 0.05) and near(closed, 15.2, 0.05),
        {"time": table, "isothermal": warm, "adiabatic": closed, "with_emergency_spring": soft},
        f"Height of the bellows locked. With the whole spring's height locked its emergency spring yields and the"
        f" bellows grows: {soft:.1f} s.",
    )


def _leak_time(subject: Subject, within_: float, **heat: float) -> float:
    """Time constant in s of ln p_abs while the leak is choked, over the first ``within_`` s."""
    plant = subject.resting("AW3", "emergency_spring", leak_conductance=1e-9, **heat)
    course = impose(plant, [STILL], within_, every=100, dt=10e-3)
    p = course.of(Algebraic.PRESSURE)
    choked = p > plant.parameters.atmospheric_pressure / plant.parameters.leak_critical_ratio
    return -1.0 / float(np.polyfit(course.time[choked], np.log(p[choked]), 1)[0])


def choked_leak(subject: Subject) -> Measured:
    """A leak of 1e-9 m³/(s·Pa) at AW3."""
    par = subject.parameters("AW3").record
    volume = par.bellows_volume[0] + par.auxiliary_volume[0]
    wanted = float(volume / (1e-9 * ISO_DENSITY * par.gas_constant * par.ambient_temperature))
    warm = _leak_time(subject, 1180 * s, **ISOTHERMAL)
    early = _leak_time(subject, 200 * s)
    late = _leak_time(subject, 1180 * s)
    return Measured(
        f"τ = {warm:.0f} s near-isothermal ({100 * (warm / wanted - 1):+.2f} %)",
        near(warm, wanted, 0.01) and near(warm, 1003.0, 0.01),
        {"time_constant": warm, "closed_form": wanted, "with_heat_exchange": early},
        f"With the heat exchange of the table the answer depends on the window of the fit: {early:.0f} s over the first"
        f" 200 s, {late:.0f} s over 1180 s.",
    )


def _shift_load(plant: Plant, difference: float) -> None:
    """Press harder on the right by ``difference`` N, at a constant sum."""
    par = plant.parameters
    middle = 0.5 * (par.nominal_preload.sum() - par.bolster_mass * par.gravity)
    plant.inputs[Input.VERTICAL_LEFT_COMMAND] = middle - 0.5 * difference
    plant.inputs[Input.VERTICAL_RIGHT_COMMAND] = middle + 0.5 * difference


def _sealed_roll(subject: Subject, load: str, **changes: Any) -> tuple[float, float]:
    """Roll in rad and difference of the preloads in N at which a sealed, slow roll reaches the valve's pressure."""
    plant = subject.resting(load, **ISOTHERMAL, **changes)
    opening = float(plant.parameters.dpv_opening)
    for force in np.arange(30.0, 50.0, 0.2) * kN:
        _shift_load(plant, float(force))
        plant.step(1000)
        truth = plant.truth()
        if abs(truth["auxiliary_pressure[1]"] - truth["auxiliary_pressure[0]"]) > opening:
            return abs(truth["roll[0]"]), float(force)
    return float("inf"), float("inf")


def differential_pressure_valve(subject: Subject) -> Measured:
    """Unequal preloads in small steps: with leveling, and sealed, slow and isothermal."""
    plant = Plant.at_rest(subject.parameters("AW0").record)
    plant.inputs[[Input.LEFT_LEVELING, Input.RIGHT_LEVELING]] = 1.0
    opened = float("inf")
    for force in np.arange(24.0, 36.0, 0.2) * kN:
        _shift_load(plant, float(force))
        plant.step(10_000)
        if plant.memory.dpv_latch:
            opened = float(force)
            break
    free = {load: _sealed_roll(subject, load, contact_height=-85 * mm) for load in LOADS}
    touching, _ = _sealed_roll(subject, "AW0")
    rolls = {load: roll for load, (roll, _) in free.items()}
    return Measured(
        f"ΔP = {opened / kN:.1f} kN with leveling; sealed roll {rolls['AW0']:.4f} rad at {free['AW0'][1] / kN:.1f} kN"
        f" (AW0), {rolls['AW3']:.4f} rad at {free['AW3'][1] / kN:.1f} kN (AW3)",
        near(opened, 31.2 * kN, 0.02) and near(rolls["AW0"], 0.081, 0.03) and near(rolls["AW3"], 0.038, 0.03),
        {"difference": opened, "roll_AW0": rolls["AW0"], "roll_AW3": rolls["AW3"], "roll_touching": touching},
        "The contact on the emergency spring at −60 mm is taken out of the way: AW0 meets it just before, and with it"
        f" reaches {touching:.4f} rad.",
    )


# Comfort, rubber, numerics ------------------------------------------------------------------------------------------


def weighting_gains(subject: Subject) -> Measured:
    """Exact frequency response."""
    f = np.array([0.5, 1.0, 2.0, 4.0, 8.0, 16.0])
    standard = np.array([0.853, 1.011, 0.890, 0.512, 0.253, 0.125])
    gains = np.abs(weighting(f))
    worst = float(np.abs(gains / standard - 1.0).max())
    return Measured(
        f"{listed(gains, '.3f')} at {listed(f, 'g')} Hz, within {100 * worst:.2f} %",
        worst < 0.01,
        {"deviation": worst} | {f"gain_{one:g}Hz": float(g) for one, g in zip(f, gains, strict=True)},
        "The filter belongs to neither layer: both are judged by it.",
    )


def comfort(subject: Subject) -> Measured:
    """The car on the plant's springs."""
    cells = plant_ride(subject)
    index = {key: cell.estimate("weighted", 6.0).mean for key, cell in cells.items()}
    width = 0.0 if subject.quick else max(c.estimate("weighted", 6.0).half_width for c in cells.values())
    contact = {load: cells[load, WIND_SPEEDS[-1]].estimate("bump_stop_time").mean for load in LOADS}
    sample = (
        "quick: one realisation" if subject.quick else f"ten realisations, ±{width:.2f} at the most (95 %)"
    )
    return comfort_index(
        index,
        f"At the floor, {sample}. {why_the_heavy_car_shakes(subject)} At 25 m/s the bump stop is touched"
        f" {100 * contact['AW0']:.0f} % (AW0) and {100 * contact['AW3']:.0f} % (AW3) of the time.",
    )


def why_the_heavy_car_shakes(subject: Subject) -> str:
    """Tell wind and track apart: comfort without the track, and the sway mode that the track meets."""
    quiet = wind_alone(subject)
    sway = {load: upper_sway(subject, load) for load in LOADS}
    car = subject.vehicle.record
    return (
        f"From the wind alone, at 25 m/s, N is {quiet['AW0']:.2f} (AW0) and {quiet['AW3']:.2f} (AW3). The track's"
        f" {float(car.train_speed / car.track_wavelength):.1f} Hz meet the upper sway mode:"
        f" {sway['AW0'].frequency:.2f} Hz with {100 * sway['AW0'].damping:.0f} % of damping (AW0),"
        f" {sway['AW3'].frequency:.2f} Hz with {100 * sway['AW3'].damping:.0f} % (AW3)."
    )


def paper_comfort(subject: Subject) -> Measured:
    """Equation (28) in closed form."""
    index = {key: N for key, (_, N) in paper_ride(subject).items()}
    return comfort_index(
        index, "One lateral degree of freedom (28), emergency spring in series, ten realisations."
    )


def comfort_index(index: dict[tuple[str, float], float], note: str) -> Measured:
    """Judge a table of N = 6 a_YP95 by load case and wind speed."""
    rows = {load: np.array([index[load, speed] for speed in WIND_SPEEDS]) for load in LOADS}
    grows = {load: bool(np.all(np.diff(row) >= 0.0)) for load, row in rows.items()}
    better = bool(np.all(rows["AW3"] < rows["AW0"]))
    good = bool(max(row.max() for row in rows.values()) < 2.0)
    failing = [f"not non-decreasing for {load}" for load, grows_ in grows.items() if not grows_]
    if not better:
        failing.append("AW3 is not better than AW0 at every speed")
    if not good:
        failing.append("beyond 2")
    return Measured(
        "; ".join(f"{load} {listed(row, '.2f')}" for load, row in rows.items())
        + " at 10 / 15 / 20 / 25 m/s"
        + "".join(f"; {one}" for one in failing),
        all(grows.values()) and better and good,
        {f"N_{load}_{speed:g}": float(N) for (load, speed), N in index.items()},
        note,
    )


def friction_loop(subject: Subject) -> Measured:
    """Nothing lateral but friction: no membrane, no shell, no coupling."""
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
        impose(plant, [Motion(LATERAL, x_0, 1.0)], 30.0, rows=0)
        loop = impose(plant, [Motion(LATERAL, x_0, 1.0)], 1.001)
        F, y = -loop.of(Algebraic.LATERAL_FORCE), loop.of(Algebraic.LATERAL)
        F_0 = F_max / (2 * x_2) * (np.sqrt(x_2**2 + x_0**2 + 6 * x_2 * x_0) - x_2 - x_0)
        mu = F_0 / F_max if F_max > 0.0 else 0.0
        grip = x_2 * (1 + mu) ** 2 * np.log((x_2 * (1 + mu) + 2 * x_0) / (x_2 * (1 + mu)))
        loss = 2 * F_max * (2 * x_0 - grip)
        found = np.sum(0.5 * (F[1:] + F[:-1]) * np.diff(y))
        if F_max <= 0.0:
            return Measured("no friction, no loop", False)
        worst_force = max(worst_force, abs(0.5 * np.ptp(F) / F_0 - 1.0))
        worst_loss = max(worst_loss, abs(found / loss - 1.0))
    return Measured(
        f"amplitude within {100 * worst_force:.2f} %, loss within {100 * worst_loss:.2f} % (0.5, 5, 20 mm)",
        bool(worst_force < 0.01 and worst_loss < 0.01),
        {"force": float(worst_force), "loss": float(worst_loss)},
    )


def rest(subject: Subject) -> Measured:
    """Bench and car for a minute."""
    drift = 0.0
    for load in LOADS:
        plant = Plant.at_rest(subject.parameters(load).record)
        car = Vehicle(subject.parameters(load).record, subject.vehicle.with_values(track_shape=0).record)
        for state, go in ((plant.state, plant.step), (car.state, _ride_on(car))):
            before = state.copy()
            go(60_000)
            scale = np.where(before != 0.0, np.abs(before), 1.0)
            drift = max(drift, float(np.max(np.abs(state - before) / scale)))
    return Measured(
        f"drift {drift:.1e} in 60 s", drift < 1e-8, {"drift": drift}, "The bench, and a car on its springs."
    )


def _ride_on(car: Vehicle) -> Any:
    return lambda steps: car.ride(0.0, steps * car.dt, every=steps)


def halved_step(subject: Subject) -> Measured:
    """Complex vertical stiffness with 1 and 0.5 ms."""
    worst = 0.0
    for load in LOADS:
        coarse, fine = (
            dynamic_stiffness(subject.resting(load), 5 * mm, 1.2, 10, longest_step=step)[0]
            for step in (1e-3, 0.5e-3)
        )
        worst = max(worst, abs(coarse.real / fine.real - 1.0), abs(coarse.imag / fine.imag - 1.0))
    return Measured(f"largest change {100 * worst:.1e} %", worst < 2e-3, {"change": worst})


ACCEPTANCE: Final = (
    Check(
        "A01",
        "Static pressure is load over effective area",
        "plant",
        "2.058 / 5.577 bar gauge ±0.5 %",
        static_pressure,
    ),
    Check(
        "A02", "Very slow, sealed: K = p A²/(V_a+V_b) − p_g A_1", "plant", "±1 % at 3e-4 Hz", slow_stiffness
    ),
    Check(
        "A03",
        "Very fast: K = κ p A²/V_b − p_g A_1",
        "plant",
        "±1 % at 20 Hz, no pipe, cold start, 60 cycles",
        fast_stiffness,
    ),
    Check(
        "A04",
        "Orifice shut, no heat: K = κ p A²/V_b − p_g A_1",
        "plant",
        "+0.01 % at 1 mm, +0.21 % at 5 mm (geometry), K''/K < 1e-6; 0.1 and 10 Hz",
        shut_orifice,
    ),
    Check(
        "A05",
        "Orifice wide open, no heat: K = κ p A²/(V_a+V_b) − p_g A_1",
        "plant",
        "K' ±0.5 %, K''/K ≤ 1.5 % up to 2 Hz",
        wide_orifice,
    ),
    Check(
        "A06", "Closed chamber: n*(iω) = (1+iωτκ)/(1+iωτ)", "plant", "deviation < 0.01", polytropic_exponent
    ),
    Check("A07", "Sealed springs keep their mass of air", "plant", "drift < 1e-9", mass_balance),
    Check(
        "A08",
        "ΔU + ∫p dV = ∫Q̇ dt; what the orifice takes stays as heat",
        "plant",
        "relative < 1e-6; 199 J per cycle ±2 % (AW3, 10 mm, 1 Hz)",
        energy_balance,
    ),
    Check("A09", "∂F_z/∂y = ∂F_y/∂ζ = ∂²(p_g V)/∂ζ∂y at constant pressure", "plant", "< 0.1 %", reciprocity),
    Check("A10", "f_pk √a = const under any load, c_pk ∝ p √a", "plant", "±2 %", scaling_laws),
    Check(
        "A11",
        "c(f) has one maximum, near the natural frequency, and is small beyond",
        "plant",
        "one in 0.3–10 Hz within ±30 % of f_z at 5 mm; c(10 Hz) < 0.1 c_max",
        damping_over_frequency,
        "frequency",
    ),
    Check(
        "A11",
        "c(f) has one maximum, near the natural frequency, and is small beyond",
        "paper",
        "one in 0.3–10 Hz within ±30 % of f_z at 5 mm; c(10 Hz) < 0.1 c_max",
        paper_damping_over_frequency,
    ),
    Check(
        "A12",
        "c(1.2 Hz) falls with the orifice",
        "plant",
        "strictly, 13 to 22 mm",
        damping_over_diameter,
        "diameter",
    ),
    Check(
        "A12",
        "c(1.2 Hz) falls with the orifice",
        "paper",
        "strictly, 13 to 22 mm",
        paper_damping_over_diameter,
    ),
    Check(
        "A13",
        "c has a maximum over the pressure ratio",
        "paper",
        "one in 0.53–1, r* = 0.973 ± 0.005 (14 mm)",
        damping_over_ratio,
    ),
    Check(
        "A14",
        "K_y rises with pressure",
        "plant",
        "monotonically; slope κ_0 = 0.35 m ±20 %",
        stiffness_over_pressure,
        "lateral",
    ),
    Check(
        "A14",
        "K_y rises with pressure",
        "paper",
        "monotonically; slope κ_0 = 0.35 m ±20 %",
        paper_stiffness_over_pressure,
    ),
    Check(
        "A15",
        "K_y(AW3)/K_y(AW0)",
        "plant",
        "1.6–2.3, quasi-static and at 5 mm",
        stiffness_over_load,
        "lateral",
    ),
    Check("A15", "K_y(AW3)/K_y(AW0)", "paper", "1.6–2.3, diaphragm and in series", paper_stiffness_over_load),
    Check(
        "A16",
        "K_y falls with the amplitude",
        "plant",
        "K(1 mm) > K(5 mm) > K(20 mm), K(1)/K(20) = 1.3–1.7",
        stiffness_over_amplitude,
        "lateral",
    ),
    Check(
        "A17", "Secant K_y falls with the displacement", "plant", "−5 to −30 % at 60 mm", secant_over_offset
    ),
    Check(
        "A17",
        "Secant K_y falls with the displacement",
        "paper",
        "−5 to −30 % at 60 mm",
        paper_secant_over_offset,
    ),
    Check(
        "A18",
        "The effective area falls with the displacement",
        "plant",
        "−1 to −5 % at 60 mm",
        area_over_offset,
    ),
    Check(
        "A18",
        "The effective area falls, the equivalent volume grows by far more",
        "paper",
        "−1 to −5 %, and more than three times as much, at 60 mm",
        paper_area_over_offset,
    ),
    Check(
        "A19",
        "K_lat rises with roll and then stays",
        "plant",
        "secant at +20 mm, φ·y > 0: ≥ 20 % up to 0.05 rad, then < 10 % of it up to 0.08 rad",
        stiffness_over_roll,
        "roll",
    ),
    Check(
        "A19",
        "K_lat rises with roll and then stays",
        "paper",
        "≥ 20 % up to 0.05 rad, then < 10 % of it up to 0.08 rad",
        paper_stiffness_over_roll,
    ),
    Check("A20", "The coupling force turns with the roll", "plant", "odd within 1 %", coupling_sign),
    Check(
        "A21",
        "With a pipe |K_z| has a minimum and a peak and comes back",
        "plant",
        "minimum near 7 Hz, peak > 1.3 K_∞ near 15 Hz, K_∞ ±25 % at 28 Hz (0.5 mm, 30 mm plate)",
        surge,
    ),
    Check(
        "A22",
        "Rubber and friction add about 5 % to the orifice's damping",
        "plant",
        "(5 ± 3) % at 1.2 Hz, 5 mm, mean of both loads",
        rubber_share,
    ),
    Check(
        "A23",
        "Filling from AW0 to AW3 at a locked height",
        "plant",
        "17.0 s, isothermal 21.2 s, adiabatic 15.2 s, each ±5 %",
        filling,
    ),
    Check(
        "A24",
        "A choked leak is a straight line in ln p: τ = V/(C ρ_0 R T)",
        "plant",
        "±1 % near-isothermal (1003 s for C = 1e-9 m³/(s·Pa))",
        choked_leak,
    ),
    Check(
        "A25",
        "The differential pressure valve opens at Δp_o A_e",
        "plant",
        "31.2 kN ±2 % with leveling; sealed slow roll 0.081 / 0.038 rad ±3 %",
        differential_pressure_valve,
    ),
    Check("A26", "Gains of W_d at 0.5, 1, 2, 4, 8, 16 Hz", "both", "ISO 2631-1 ±1 %", weighting_gains),
    Check(
        "A27",
        "Comfort index N = 6 a_YP95 in crosswind",
        "plant",
        "non-decreasing from 10 to 25 m/s, N(AW3) < N(AW0), N < 2",
        comfort,
        "ride",
    ),
    Check(
        "A27",
        "Comfort index N = 6 a_YP95 in crosswind",
        "paper",
        "non-decreasing from 10 to 25 m/s, N(AW3) < N(AW0), N < 2",
        paper_comfort,
        "paper ride",
    ),
    Check(
        "A28",
        "Amplitude and loss of a friction loop are those of the closed forms",
        "plant",
        "±1 %",
        friction_loop,
    ),
    Check(
        "A29", "Without wind and excitation everything stays at rest", "plant", "drift < 1e-8 over 60 s", rest
    ),
    Check("A30", "Half the time step gives the same K', K''", "plant", "change < 0.2 %", halved_step),
)
