"""Conservation of mass and energy of the gas, and forces that follow from one energy."""

from typing import Any, Final

import numpy as np

from astb_studies.paper.checks.criteria import near
from astb_studies.paper.claims import CheckOutcome, Claim
from astb_studies.paper.subject import BARE, LOADS, Subject, remembered
from bench_protocol.units import bar, mm, s
from bench_sim.model import spring
from bench_sim.model.algebraic import ALGEBRAICS, Algebraic
from bench_sim.model.experiments import LATERAL, VERTICAL, ImposedMotion, impose
from bench_sim.model.layout import State

#: Step in s that leaves little to the trapezoidal rule, which adds up heat and work.
_FINE: Final = 0.5e-3


@remembered
def _sealed_course(subject: Subject, load: str) -> Any:
    plant = subject.resting(load)
    motion = [ImposedMotion(VERTICAL, 10 * mm, 1.0), ImposedMotion(LATERAL, 20 * mm, 0.5)]
    return impose(plant, motion, 20 * s, dt=_FINE)


@Claim("A07", "Sealed springs keep their mass of air", "mass balance").on("plant", "drift < 1e-9")
def mass_balance(subject: Subject) -> CheckOutcome:
    """Drift of the mass in sealed springs over twenty seconds of vertical and lateral motion."""
    drift = 0.0
    for load in LOADS:
        states = _sealed_course(subject, load).states
        mass = states[:, State.BELLOWS_MASS] + states[:, State.AUXILIARY_MASS]
        drift = max(drift, float(np.ptp(mass) / mass[0]))
    return CheckOutcome(f"drift {drift:.1e} of the mass", drift < 1e-9, {"drift": drift})


@Claim("A08", "ΔU + ∫p dV = ∫Q̇ dt; what the orifice takes stays as heat", "first law").on(
    "plant", "relative < 1e-6; 199 J per cycle ±2 % (AW3, 10 mm, 1 Hz)"
)
def energy_balance(subject: Subject) -> CheckOutcome:
    """Energy of the gas compared with heat and work in the same motion, and the orifice loss per cycle from ten
    adiabatic cycles.
    """
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
    course = impose(plant, [ImposedMotion(VERTICAL, 10 * mm, 1.0)], 10.0, every=1000, rows=11)
    energy = course.states[:, State.BELLOWS_ENERGY] + course.states[:, State.AUXILIARY_ENERGY]
    warming = float(energy[9] - energy[0]) / 9.0
    return CheckOutcome(
        f"missing {worst:.1e} of the energy that was exchanged; orifice loss {warming:.0f} J per cycle",
        worst < 1e-6 and near(warming, 199.0, 0.02),
        {"missing": worst, "loss_per_cycle": warming},
    )


@Claim("A09", "∂F_z/∂y = ∂F_y/∂ζ = ∂²(p_g V)/∂ζ∂y at constant pressure", "forces by virtual work").on(
    "plant", "< 0.1 %"
)
def reciprocity(subject: Subject) -> CheckOutcome:
    """Cross derivatives of a bellows' forces at constant pressure, and those of p_g V, by central differences."""
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
    return CheckOutcome(f"largest difference {100 * worst:.1e} %", worst < 1e-3, {"difference": worst})
