"""Static pressure and the limits of vertical stiffness: slow and fast, orifice shut and wide open."""

import numpy as np

from astb_studies.paper.checks.criteria import near, within
from astb_studies.paper.claims import CheckOutcome, Claim
from astb_studies.paper.experiments import closed_form
from astb_studies.paper.subject import BARE, LOADS, Subject
from bench_protocol.units import bar, mm
from bench_sim.model.algebraic import Algebraic
from bench_sim.model.experiments import dynamic_stiffness, first_harmonic
from bench_sim.model.layout import Input, Mode, State
from bench_sim.model.plant import Plant


def _shut(plant: Plant) -> Plant:
    plant.inputs[[Input.LEFT_RESERVOIR_VALVE, Input.RIGHT_RESERVOIR_VALVE]] = 0.0
    return plant


@Claim("A01", "Static pressure is load over effective area", "equilibrium of forces").on(
    "plant", "2.058 / 5.577 bar gauge ±0.5 %"
)
def static_pressure(subject: Subject) -> CheckOutcome:
    """Gauge pressure at rest with closed valves; in the note, that of a bench filled by its leveling valves."""
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
    return CheckOutcome(
        f"AW0 {found['AW0'] / bar:.3f} bar, AW3 {found['AW3'] / bar:.3f} bar (gauge)",
        all(near(found[load], expected[load], 0.005) for load in LOADS),
        {f"pressure_{load}": p for load, p in found.items()} | {"leveled_height": height},
        f"Valves isolated. Filled by its leveling valves, the bench stays at {height / mm:.1f} mm, the edge of their"
        f" dead zone, with {100 * lower:+.1f} % of pressure.",
    )


@Claim("A02", "Very slow, sealed: K = p A²/(V_a+V_b) − p_g A_1", "derivative of p(V)·A(ζ), isothermal").on(
    "plant", "±1 % at 3e-4 Hz"
)
def slow_stiffness(subject: Subject) -> CheckOutcome:
    """Vertical stiffness in one cycle of an hour, ±1 mm."""
    found, expected = {}, {}
    for load in LOADS:
        plant = subject.resting(load, *BARE)
        par = plant.parameters
        expected[load] = closed_form(par, par.bellows_volume[0] + par.auxiliary_volume[0], 1.0)
        found[load] = dynamic_stiffness(plant, 1 * mm, 3e-4, 1, longest_step=10e-3)[0].real
    return _against_closed_form(found, expected, 0.01)


@Claim("A03", "Very fast: K = κ p A²/V_b − p_g A_1", "derivative of p(V)·A(ζ), adiabatic").on(
    "plant", "±1 % at 20 Hz, no pipe, cold start, 60 cycles"
)
def fast_stiffness(subject: Subject) -> CheckOutcome:
    """Vertical stiffness at 20 Hz and 5 mm; in the note, at 1 mm."""
    found, expected, small = {}, {}, 0.0
    for load in LOADS:
        plant = subject.resting(load, *BARE)
        par = plant.parameters
        expected[load] = closed_form(par, par.bellows_volume[0], par.heat_capacity_ratio)
        found[load] = dynamic_stiffness(plant, 5 * mm, 20.0, 60)[0].real
        less = dynamic_stiffness(subject.resting(load, *BARE), 1 * mm, 20.0, 60)[0].real
        small = min(small, less / expected[load] - 1.0)
    note = f"At 5 mm. The smaller the motion, the less an orifice shuts: at 1 mm {100 * small:+.1f} %."
    return _against_closed_form(found, expected, 0.01, note)


def _against_closed_form(
    found: dict[str, float], expected: dict[str, float], share: float, note: str = ""
) -> CheckOutcome:
    parts = [
        f"{load} {found[load] / 1e3:.1f} kN/m ({100 * (found[load] / expected[load] - 1):+.2f} %)"
        for load in found
    ]
    return CheckOutcome(
        ", ".join(parts),
        all(near(found[load], expected[load], share) for load in found),
        {f"stiffness_{load}": K for load, K in found.items()}
        | {f"closed_form_{load}": K for load, K in expected.items()},
        note,
    )


@Claim("A04", "Orifice shut, no heat: K = κ p A²/V_b − p_g A_1", "derivative of p(V)·A(ζ), adiabatic").on(
    "plant", "+0.01 % at 1 mm, +0.21 % at 5 mm (geometry), K''/K < 1e-6; 0.1 and 10 Hz"
)
def shut_orifice(subject: Subject) -> CheckOutcome:
    """Vertical stiffness and loss with closed reservoir valves: gas and membrane alone, no heat."""
    excess: dict[int, list[float]] = {1: [], 5: []}
    loss = 0.0
    for load in LOADS:
        for amplitude, found in excess.items():
            for f in (0.1, 10.0):
                plant = _shut(subject.resting(load, *BARE, "heat"))
                par = plant.parameters
                expected = closed_form(par, par.bellows_volume[0], par.heat_capacity_ratio)
                K, _ = dynamic_stiffness(plant, amplitude * mm, f, 3)
                found.append(K.real / expected - 1.0)
                loss = max(loss, abs(K.imag / K.real))
    small, large = max(excess[1]), max(excess[5])
    return CheckOutcome(
        f"K {100 * small:+.3f} % at 1 mm, {100 * large:+.2f} % at 5 mm; K''/K {loss:.1e}",
        min(map(min, excess.values())) > -1e-4 and small < 2e-4 and large < 2.5e-3 and loss < 1e-6,
        {"excess_1mm": small, "excess_5mm": large, "loss": loss},
    )


@Claim(
    "A05", "Orifice wide open, no heat: K = κ p A²/(V_a+V_b) − p_g A_1", "derivative of p(V)·A(ζ), adiabatic"
).on("plant", "K' ±0.5 %, K''/K ≤ 1.5 % up to 2 Hz")
def wide_orifice(subject: Subject) -> CheckOutcome:
    """Vertical stiffness and loss with an orifice of 60 mm: gas and membrane alone, no heat."""
    worst = loss = 0.0
    for load in LOADS:
        for f in (0.5, 2.0):
            plant = subject.resting(load, *BARE, "heat", orifice_diameter=60 * mm)
            par = plant.parameters
            volume = par.bellows_volume[0] + par.auxiliary_volume[0]
            K, _ = dynamic_stiffness(plant, 5 * mm, f, 6, longest_step=2.5e-4)
            worst = max(worst, abs(K.real / closed_form(par, volume, par.heat_capacity_ratio) - 1.0))
            loss = max(loss, K.imag / K.real)
    return CheckOutcome(
        f"K' within {100 * worst:.2f} %, K''/K up to {100 * loss:.2f} %",
        worst < 0.005 and within(loss, 0.0, 0.015),
        {"deviation": worst, "loss": loss},
        "What loss there is comes from the linear flow law above a pressure ratio of 0.9995.",
    )


@Claim("A06", "Closed chamber: n*(iω) = (1+iωτκ)/(1+iωτ)", "first law, linearised").on(
    "plant", "deviation < 0.01"
)
def polytropic_exponent(subject: Subject) -> CheckOutcome:
    """Complex polytropic exponent of the closed bellows, from first harmonics of pressure and volume."""
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
    return CheckOutcome(f"largest deviation {worst:.1e}", worst < 0.01, {"deviation": worst})
