"""Valves and leaks: filling, a choked leak, the differential pressure valve."""

from typing import Any

import numpy as np

from astb_studies.paper.checks.criteria import near
from astb_studies.paper.claims import CheckOutcome, Claim
from astb_studies.paper.experiments import STILL
from astb_studies.paper.subject import ISOTHERMAL, LOADS, Subject
from bench_protocol.units import kN, mm, s
from bench_sim.model.algebraic import Algebraic
from bench_sim.model.experiments import impose
from bench_sim.model.iso6358 import ISO_DENSITY
from bench_sim.model.layout import Input
from bench_sim.model.plant import Plant


def _filling_time(subject: Subject, *without: str, **heat: float) -> float:
    """Return the seconds from AW0 to the pressure of AW3 through an open leveling valve, at a locked height."""
    narrow = {"service_conductance": subject.parameters("AW0").entries["fill_conductance"].value}
    plant = subject.resting("AW0", *without, **narrow, **heat)
    plant.inputs[[Input.LEFT_SERVICE_VALVE, Input.RIGHT_SERVICE_VALVE]] = 1.0
    course = impose(plant, [STILL], 30 * s, every=10)
    par = plant.parameters
    full = LOADS["AW3"] / par.effective_area[0] + par.atmospheric_pressure
    reached = course.of(Algebraic.AUXILIARY_PRESSURE) >= full
    return float(course.time[np.argmax(reached)]) if reached.any() else float("inf")


@Claim("A23", "Filling from AW0 to AW3 at a locked height", "an independent program").on(
    "plant", "17.0 s, isothermal 21.2 s, adiabatic 15.2 s, each ±5 %"
)
def filling(subject: Subject) -> CheckOutcome:
    """Time of filling at a locked height through a narrow valve: with heat exchange, isothermal, adiabatic."""
    table = _filling_time(subject, "emergency_spring")
    warm = _filling_time(subject, "emergency_spring", **ISOTHERMAL)
    closed = _filling_time(subject, "emergency_spring", "heat")
    soft = _filling_time(subject)
    return CheckOutcome(
        f"{table:.1f} s; isothermal {warm:.1f} s, adiabatic {closed:.1f} s",
        near(table, 17.0, 0.05) and near(warm, 21.2, 0.05) and near(closed, 15.2, 0.05),
        {"time": table, "isothermal": warm, "adiabatic": closed, "with_emergency_spring": soft},
        f"Height of the bellows locked. With the whole spring's height locked its emergency spring yields and the"
        f" bellows grows: {soft:.1f} s.",
    )


def _leak_time(subject: Subject, within_: float, **heat: float) -> float:
    """Return the time constant in s of ln p_abs while the leak is choked, over the first ``within_`` s."""
    plant = subject.resting("AW3", "emergency_spring", leak_conductance=1e-9, **heat)
    course = impose(plant, [STILL], within_, every=100, dt=10e-3)
    p = course.of(Algebraic.PRESSURE)
    choked = p > plant.parameters.atmospheric_pressure / plant.parameters.leak_critical_ratio
    return -1.0 / float(np.polyfit(course.time[choked], np.log(p[choked]), 1)[0])


@Claim(
    "A24",
    "A choked leak is a straight line in ln p: τ = V/(C ρ_0 R T)",
    "ISO 6358: choked mass flow, isothermal",
).on("plant", "±1 % near-isothermal (1003 s for C = 1e-9 m³/(s·Pa))")
def choked_leak(subject: Subject) -> CheckOutcome:
    """Time constant of the pressure with a leak of 1e-9 m³/(s·Pa) under AW3."""
    par = subject.parameters("AW3").record
    volume = par.bellows_volume[0] + par.auxiliary_volume[0]
    expected = float(volume / (1e-9 * ISO_DENSITY * par.gas_constant * par.ambient_temperature))
    warm = _leak_time(subject, 1180 * s, **ISOTHERMAL)
    early = _leak_time(subject, 200 * s)
    late = _leak_time(subject, 1180 * s)
    return CheckOutcome(
        f"τ = {warm:.0f} s near-isothermal ({100 * (warm / expected - 1):+.2f} %)",
        near(warm, expected, 0.01) and near(warm, 1003.0, 0.01),
        {"time_constant": warm, "closed_form": expected, "with_heat_exchange": early},
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
    """Return roll (rad) and difference of the preloads (N) at which a sealed, slow roll opens the valve."""
    plant = subject.resting(load, **ISOTHERMAL, **changes)
    opening = float(plant.parameters.dpv_opening)
    for force in np.arange(30.0, 50.0, 0.2) * kN:
        _shift_load(plant, float(force))
        plant.step(1000)
        truth = plant.truth()
        if abs(truth["auxiliary_pressure[1]"] - truth["auxiliary_pressure[0]"]) > opening:
            return abs(truth["roll[0]"]), float(force)
    return float("inf"), float("inf")


@Claim(
    "A25", "The differential pressure valve opens at Δp_o A_e", "balance of forces; an independent program"
).on("plant", "31.2 kN ±2 % with leveling; sealed slow roll 0.081 / 0.038 rad ±3 %")
def differential_pressure_valve(subject: Subject) -> CheckOutcome:
    """Difference of preloads that opens the valve with leveling, and roll that opens it when sealed."""
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
    return CheckOutcome(
        f"ΔP = {opened / kN:.1f} kN with leveling; sealed roll {rolls['AW0']:.4f} rad at {free['AW0'][1] / kN:.1f} kN"
        f" (AW0), {rolls['AW3']:.4f} rad at {free['AW3'][1] / kN:.1f} kN (AW3)",
        near(opened, 31.2 * kN, 0.02) and near(rolls["AW0"], 0.081, 0.03) and near(rolls["AW3"], 0.038, 0.03),
        {"difference": opened, "roll_AW0": rolls["AW0"], "roll_AW3": rolls["AW3"], "roll_touching": touching},
        "The contact on the emergency spring at −60 mm is taken out of the way: AW0 meets it just before, and with it"
        f" reaches {touching:.4f} rad.",
    )
