"""Experiments that several checks share: stiffness, damping, peaks, roll and rides, in the plant and in closed form."""

from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar

from astb_studies.paper.closed_form import PaperParameters, diaphragm_stiffness
from astb_studies.paper.closed_form import dynamic_stiffness as paper_stiffness
from astb_studies.paper.comfort import (
    Samples,
    block_percentiles,
    lateral_percentiles,
    mean_comfort,
    weighting,
    window_rms,
)
from astb_studies.paper.crosswind_ride import Cell, ride_cell
from astb_studies.paper.subject import LOADS, Subject, remembered
from astb_studies.paper.wind import wind_force
from bench_protocol.units import kN, mm, s
from bench_sim.model.algebraic import Algebraic
from bench_sim.model.experiments import (
    LATERAL,
    ROLL,
    ImposedMotion,
    Shape,
    TimeHistory,
    dynamic_stiffness,
    first_harmonic,
    impose,
)
from bench_sim.model.vehicle import NaturalMode, Vehicle

WIND_SPEEDS: Final = (10.0, 15.0, 20.0, 25.0)
#: Seeds of the winds in which each ride is repeated.
REALISATIONS: Final = tuple(range(1, 11))

#: Rides in addition to those of the car of the file: load cases, and the changes of springs and car. The paper loads
#: its springs with 53.5 kN, but its car in the ride with 53.7 kN.
OTHER_RIDES: Final[dict[str, tuple[tuple[str, ...], dict[str, float], dict[str, float]]]] = {
    "no anti-roll bar": (("AW0", "AW3"), {}, {"anti_roll_stiffness": 0.0}),
    "53.7 kN": (("AW0",), {"nominal_preload": 53.7 * kN}, {}),
}

#: The connecting pipe of the bench, and an orifice plate with which it surges.
PIPE: Final = {"orifice_diameter": 30 * mm, "pipe_length": 1.5, "pipe_diameter": 50 * mm}

#: At rest nothing is imposed on the height.
STILL: Final = ImposedMotion(1, 0.0, 1.0)


def closed_form(par: Any, volume: float, exponent: float) -> float:
    """K_z = n p A²/V − p_g A_1 in N/m of gas and membrane; ``par`` is the plant's record, ``volume`` in m³."""
    gauge = par.nominal_preload[0] / par.effective_area[0]
    p = gauge + par.atmospheric_pressure
    return float(exponent * p * par.effective_area[0] ** 2 / volume - gauge * par.effective_area_slope[0])


def in_series(k: float, k_emergency: float) -> float:
    """Return the stiffness of two springs in series, 1/(1/k + 1/k_es)."""
    return 1.0 / (1.0 / k + 1.0 / k_emergency)


def natural_frequency(par: Any) -> float:
    """f_z in Hz of the preload on the whole spring with both volumes, adiabatic: √(K/m)/2π."""
    volume = par.bellows_volume[0] + par.auxiliary_volume[0]
    K = closed_form(par, volume, par.heat_capacity_ratio) + par.shell_stiffness_vertical[0]
    K = in_series(K, par.emergency_stiffness_vertical[0])
    return float(np.sqrt(K * par.gravity / par.nominal_preload[0]) / (2.0 * np.pi))


@remembered
def damping(
    subject: Subject, load: str, amplitude: float, f: float, *without: str, cycles: int = 12, **changes: Any
) -> float:
    """Vertical damping coefficient c = K″/ω in N·s/m from a cold start; ``amplitude`` in m, ``f`` in Hz."""
    plant = subject.resting(load, *without, **changes)
    K, _ = dynamic_stiffness(plant, amplitude, f, cycles, longest_step=2e-3)
    return K.imag / (2.0 * np.pi * f)


@remembered
def damping_peak(subject: Subject, load: str, amplitude: float, *without: str) -> tuple[float, float]:
    """Frequency in Hz and height in N·s/m of the largest vertical damping between 0.3 and 10 Hz."""
    best = minimize_scalar(
        lambda log_f: -damping(subject, load, amplitude, float(np.exp(log_f)), *without),
        bounds=(np.log(0.3), np.log(10.0)),
        method="bounded",
        options={"xatol": 2e-3},
    )
    return float(np.exp(best.x)), float(-best.fun)


@remembered
def pressure_ratio_and_damping(
    subject: Subject, load: str, amplitude: float, f: float
) -> tuple[float, float]:
    """Smallest pressure ratio across the orifice within a cycle, and the vertical damping in N·s/m."""
    K, last = dynamic_stiffness(subject.resting(load), amplitude, f, 12)
    p_b, p_a = last.of(Algebraic.PRESSURE), last.of(Algebraic.AUXILIARY_PRESSURE)
    return float(np.min(np.minimum(p_a / p_b, p_b / p_a))), K.imag / (2.0 * np.pi * f)


@remembered
def lateral_stiffness(
    subject: Subject,
    load: str,
    amplitude: float,
    f: float = 0.5,
    *without: str,
    cycles: int = 10,
    **changes: Any,
) -> complex:
    """Complex lateral stiffness in N/m of one spring, first harmonic; ``amplitude`` in m, ``f`` in Hz."""
    plant = subject.resting(load, *without, **changes)
    return dynamic_stiffness(plant, amplitude, f, cycles, direction=LATERAL, longest_step=2e-3)[0]


@remembered
def quasi_static_lateral(subject: Subject, preload: float) -> float:
    """Lateral stiffness in N/m of membrane, shell and emergency spring: no friction, relaxed rubber, ±1 mm."""
    case = "AW0"
    K = lateral_stiffness(
        subject, case, 1 * mm, 0.2, "friction", "relaxation", cycles=2, nominal_preload=preload
    )
    return K.real


def moved_aside(subject: Subject, load: str, y: float, *without: str, **changes: Any) -> TimeHistory:
    """Return the last instant of a lateral motion: a ramp to ``y`` m in 5 s, then a hold of one minute."""
    plant = subject.resting(load, *without, **changes)
    ramp = ImposedMotion(LATERAL, y, 1.0 / (5 * s), Shape.RAMP)
    impose(plant, [ramp], 65 * s, dt=2.5e-3, rows=0)
    return impose(plant, [ImposedMotion(LATERAL, 0.0, 1.0, offset=y)], 2.5e-3, dt=2.5e-3)


@remembered
def lateral_secant(subject: Subject, load: str, y: float, *without: str) -> float:
    """F_y/y in N/m of one spring after a ramp to ``y`` m that was held for a minute."""
    held = moved_aside(subject, load, y, *without)
    return float(-held.of(Algebraic.LATERAL_FORCE)[0] / held.of(Algebraic.LATERAL)[0])


@remembered
def rolled(subject: Subject, load: str, roll: float, amplitude: float) -> tuple[float, float]:
    """Lateral stiffness in N/m at a fixed roll (rad): first harmonic K′, and secant F_y/y at y = +``amplitude`` (m).

    Mean of both springs, the differential pressure valve isolated. The top plates swing about their feet.
    """
    plant = subject.resting(load)
    dt, f, cycles = 2.5e-3, 0.2, 4
    middle = -plant.parameters.centre_height * roll
    over = 1.0 / (5 * s)
    ramps = [ImposedMotion(ROLL, roll, over, Shape.RAMP), ImposedMotion(LATERAL, middle, over, Shape.RAMP)]
    impose(plant, ramps, 30 * s, dt=dt, rows=0)
    sway = [ImposedMotion(ROLL, 0.0, 1.0, offset=roll), ImposedMotion(LATERAL, amplitude, f, offset=middle)]
    course = impose(plant, sway, cycles / f, dt=dt)
    last = slice(-round(1.0 / (f * dt)), None)
    F = -0.5 * (course.of(Algebraic.LATERAL_FORCE, 0) + course.of(Algebraic.LATERAL_FORCE, 1))[last]
    y = course.of(Algebraic.LATERAL)[last]
    top = int(np.argmax(y))
    return (first_harmonic(F) / first_harmonic(y)).real, float(F[top] / y[top])


def lateral_p95(acceleration: Samples, rate: float) -> float:
    """Return a_YP95 in m/s²: the 95th percentile of the weighted 5-s rms values, mean over blocks of five minutes."""
    return float(np.mean(lateral_percentiles(acceleration, rate)))


@remembered
def plant_ride(subject: Subject, other: str = "") -> dict[tuple[str, float], Cell]:
    """Five minutes on the plant's springs by load case and wind speed (m/s): 10 realisations, 1 if quick.

    ``other`` names one of `OTHER_RIDES`; if quick, it meets the weakest and the strongest wind alone.
    """
    seeds = (1,) if subject.quick else REALISATIONS
    loads, springs, car = OTHER_RIDES[other] if other else (tuple(LOADS), {}, {})
    speeds = (WIND_SPEEDS[0], WIND_SPEEDS[-1]) if other and subject.quick else WIND_SPEEDS
    return {
        (load, speed): ride_cell(
            load,
            subject.parameters(load, **springs).record,
            subject.vehicle.with_values(**car).record,
            subject.wind,
            speed,
            seeds,
            lateral_p95,
            every=2,
        )
        for load in loads
        for speed in speeds
    }


@remembered
def upper_sway(subject: Subject, load: str, **changes: float) -> NaturalMode:
    """Return the faster one of the two natural modes in which the upright car moves sideways and rolls.

    ``changes`` are to the car.
    """
    modes = Vehicle(subject.parameters(load).record, subject.vehicle.with_values(**changes).record).modes()
    return max((m for m in modes if abs(m.shape[1]) < 0.5), key=lambda m: m.frequency)


@remembered
def paper_ride(subject: Subject) -> dict[tuple[str, float], tuple[float, float]]:
    """Equation (28) with one lateral degree of freedom: a_y rms in m/s² and N = 6 a_YP95 by load case and wind speed.

    m ÿ + (2 K_dyn + iω c_d)(y − y_t) = F_w/2 by harmonics of five minutes, mean over 10 realisations of the wind.
    """
    step, count = 0.01 * s, 30_000
    time: Samples = step * np.arange(count, dtype=np.float64)
    f: Samples = np.fft.rfftfreq(count, step).astype(np.float64)
    car = subject.vehicle.record
    f_track = float(car.train_speed / car.track_wavelength)
    table = {}
    for load in LOADS:
        par = subject.spring(load)
        at_track = _half_car(par, car, np.array([f_track]))
        # The unilateral cosine (a/2)(1 − cos ωt) moves the car by its harmonic only.
        track = float(car.track_lateral) * -0.5 * (at_track[1] / at_track[0])[0] * (2j * np.pi * f_track) ** 2
        swing = np.exp(2j * np.pi * f_track * time)
        response, _ = _half_car(par, car, f)
        for speed in WIND_SPEEDS:
            rms, p95 = [], []
            for seed in range(1, 11):
                gust = np.fft.rfft(0.5 * wind_force(time, speed, seed, subject.wind))
                spectrum = gust * (2j * np.pi * f) ** 2 / response
                a = np.fft.irfft(spectrum, count) + (track * swing).real
                weighed = np.fft.irfft(spectrum * weighting(f), count)
                weighed += (track * weighting(f_track) * swing).real
                rms.append(float(a.std()))
                p95.append(float(block_percentiles(window_rms(weighed, 1.0 / step))[0]))
            table[load, speed] = float(np.mean(rms)), float(mean_comfort(np.mean(p95)))
    return table


def _half_car(par: PaperParameters, car: Any, f: Samples) -> tuple[NDArray[Any], NDArray[Any]]:
    """Dynamic stiffness K + iω c_d − m ω² of half a car on two springs, and K + iω c_d alone, in N/m."""
    omega = 2.0 * np.pi * f
    mass = 2.0 * par.nominal_preload / 9.80665
    K = 2.0 * np.asarray(paper_stiffness(omega, 0.0, par.pressure, par, topology="series"))
    K = K + 1j * omega * float(car.damper_rate)
    return K - mass * omega**2, K


def paper_amplitude_stiffness(par: PaperParameters, amplitude: float) -> float:
    """First harmonic of F = K_r(y) y for y = a sin ωt, in N/m: the only amplitude dependence of the closed form."""
    phase = 2.0 * np.pi * np.arange(256) / 256
    y = amplitude * np.sin(phase)
    return float(np.mean(2.0 * diaphragm_stiffness(y, par.pressure, par) * y * np.sin(phase)) / amplitude)
