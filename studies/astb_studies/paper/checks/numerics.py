"""Numerics: drift at rest, and half the time step."""

from typing import Any

import numpy as np

from astb_studies.paper.claims import CheckOutcome, Claim
from astb_studies.paper.subject import LOADS, Subject
from bench_protocol.units import mm
from bench_sim.model.experiments import dynamic_stiffness
from bench_sim.model.plant import Plant
from bench_sim.model.vehicle import Vehicle


@Claim("A29", "Without wind and excitation everything stays at rest", "equilibrium").on(
    "plant", "drift < 1e-8 over 60 s"
)
def rest(subject: Subject) -> CheckOutcome:
    """Drift of the states of bench and car in a minute without any excitation."""
    drift = 0.0
    for load in LOADS:
        plant = Plant.at_rest(subject.parameters(load).record)
        car = Vehicle(subject.parameters(load).record, subject.vehicle.with_values(track_shape=0).record)
        for state, go in ((plant.state, plant.step), (car.state, _ride_on(car))):
            before = state.copy()
            go(60_000)
            scale = np.where(before != 0.0, np.abs(before), 1.0)
            drift = max(drift, float(np.max(np.abs(state - before) / scale)))
    return CheckOutcome(
        f"drift {drift:.1e} in 60 s", drift < 1e-8, {"drift": drift}, "The bench, and a car on its springs."
    )


def _ride_on(car: Vehicle) -> Any:
    return lambda steps: car.ride(0.0, steps * car.dt, every=steps)


@Claim("A30", "Half the time step gives the same K', K''", "convergence of the Runge-Kutta step").on(
    "plant", "change < 0.2 %"
)
def halved_step(subject: Subject) -> CheckOutcome:
    """Change of the complex vertical stiffness when the step is 0.5 ms instead of 1 ms."""
    worst = 0.0
    for load in LOADS:
        coarse, fine = (
            dynamic_stiffness(subject.resting(load), 5 * mm, 1.2, 10, longest_step=step)[0]
            for step in (1e-3, 0.5e-3)
        )
        worst = max(worst, abs(coarse.real / fine.real - 1.0), abs(coarse.imag / fine.imag - 1.0))
    return CheckOutcome(f"largest change {100 * worst:.1e} %", worst < 2e-3, {"change": worst})
