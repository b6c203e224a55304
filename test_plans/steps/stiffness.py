"""Vertical stiffness of each spring and lateral stiffness of the pair: slow loops and sines, first harmonic."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from math import tau
from typing import TYPE_CHECKING, Final, Literal

import numpy as np

from bench_protocol.words import SIDES
from test_plans.analysis import Samples, Stiffness, dynamic_stiffness, first_harmonic, without_inertia
from test_plans.geometry import BOLSTER_MASS
from test_plans.loads import Load
from test_plans.readings import LASER_LAG, LOAD_CELL_LAG, TRANSDUCER_LAG, VERTICAL_CELLS
from test_plans.steps.carrying import hold_the_height, stand_again
from test_plans.steps.shaking import (
    LATERAL,
    LATERAL_NEEDS,
    LOOP_FREQUENCY,
    VERTICAL,
    VERTICAL_NEEDS,
    Values,
    check_secant,
    check_stiffness,
    keep_loop,
    keep_sweep,
    lateral_motion,
    shake,
    spring_motion,
)
from test_plans.uncertainty import Measured

if TYPE_CHECKING:
    from test_plans.run import Run

#: Chain of measurement: load cells against actuators, each good for 1 % of the force that a shaken spring makes.
BALANCE_TOLERANCE: Final = 0.04


def vertical_loop(run: Run, load: Load, way: Literal["slow", "open", "closed"] = "slow") -> None:
    """Measure the quasi-static vertical stiffness of each spring: a slow triangle of 5 mm to either side.

    ``closed``: with the auxiliary volumes shut off, which is somebody else's doing.
    """
    names = {side: f"{side} vertical stiffness, {way}" for side in SIDES}
    sides = [side for side in SIDES if run.can(names[side], needs=VERTICAL_NEEDS[side])]
    if not sides:
        return
    with run.phase("vertical triangle"):
        secant = load.limits.band("vertical_secant_closed" if way == "closed" else "vertical_secant")
        _, values = shake(run, "vertical", LOOP_FREQUENCY, VERTICAL, "triangle")
        for side in sides:
            check_secant(run, names[side], values, partial(spring_motion, side=side), secant)
            motion, force = spring_motion(values, side)
            keep_loop(run, way, f"{side} spring", motion, force)


def vertical_sweep(run: Run, load: Load) -> None:
    """Measure vertical stiffness and damping of each spring, first harmonic, 5 mm."""
    sweep = list(load.sweep("vertical"))
    sides = [
        side
        for side in SIDES
        if run.can(*_names(f"{side} vertical", [one for one, *_ in sweep]), needs=VERTICAL_NEEDS[side])
    ]
    highest = max(one for one, *_ in sweep)
    balance = f"actuators without inertia over load cells at {highest:g} Hz"
    balanced = run.can(balance, needs=VERTICAL)
    if not sides:
        return
    found: dict[str, list[Stiffness]] = {side: [] for side in sides}
    known: dict[str, list[tuple[Measured, Measured]]] = {side: [] for side in sides}
    for frequency, storage, damping in sweep:
        if run.hold_point(f"before the vertical sine of {frequency:g} Hz"):
            stand_again(run, load, hold_the_height)
        with run.phase(f"vertical sine {frequency:g} Hz"):
            times, values = shake(run, "vertical", frequency, VERTICAL)
            for side in sides:
                stiffness = partial(_vertical, times, frequency, side)
                found[side].append(stiffness(values))
                stiff, damped = _names(f"{side} vertical", [frequency])
                judged = check_stiffness(run, stiffness, values, {stiff: storage}, {damped: damping})
                known[side].append(judged)
                motion, force = spring_motion(values, side)
                one = times < times[0] + 1 / frequency
                keep_loop(run, f"{frequency:g} Hz", f"{side} spring", motion[one], force[one])
            if balanced and frequency == highest:
                _check_balance(run, balance, times, values, frequency)
    for side in sides:
        keep_sweep(run, f"{side} spring", "vertical", found[side], known[side], sweep)


def _names(what: str, frequencies: Sequence[float]) -> list[str]:
    """Return what the checks of a sweep are called: stiffness and damping of each of its ``frequencies`` (Hz)."""
    return [f"{what} {quantity} at {frequency:g} Hz" for frequency in frequencies for quantity in ("K'", "c")]


def _vertical(times: Samples, frequency: float, side: str, values: Values) -> Stiffness:
    motion, force = spring_motion(values, side)
    return dynamic_stiffness(times, motion, force, frequency, motion_lag=LASER_LAG - LOAD_CELL_LAG)


def _lateral(times: Samples, frequency: float, values: Values) -> Stiffness:
    motion, force = lateral_motion(values)
    return dynamic_stiffness(times, motion, force, frequency, motion_lag=TRANSDUCER_LAG - LOAD_CELL_LAG)


def _check_balance(run: Run, name: str, times: Samples, values: Values, frequency: float) -> None:
    ratio = run.measured(partial(_balance, times, frequency), values)
    run.check(name, ratio, "1", low=1 - BALANCE_TOLERANCE, high=1 + BALANCE_TOLERANCE)


def _balance(times: Samples, frequency: float, values: Values) -> float:
    """Compare load cells with actuators, which also move the bolster: ΣF_cells = ΣF_act − m ẍ (downward)."""
    actuators = values["vertical_left.force"] + values["vertical_right.force"]
    motion = -0.5 * (values["left.height"] + values["right.height"])
    cells = np.sum([values[cell] for cell in VERTICAL_CELLS], axis=0)
    x = first_harmonic(times, motion, frequency) * (1 + 1j * tau * frequency * LASER_LAG)
    F = first_harmonic(times, actuators, frequency) * (1 + 1j * tau * frequency * TRANSDUCER_LAG)
    S = first_harmonic(times, cells, frequency) * (1 + 1j * tau * frequency * LOAD_CELL_LAG)
    return abs(without_inertia(F, x, BOLSTER_MASS, frequency) / S)


def lateral_loop(run: Run, load: Load) -> None:
    """Measure the quasi-static lateral stiffness of the pair: a slow triangle of 5 mm to either side."""
    name = "lateral stiffness, slow"
    if not run.can(name, needs=LATERAL_NEEDS):
        return
    with run.phase("lateral triangle"):
        secant = load.limits.band("lateral_secant")
        _, values = shake(run, "lateral", LOOP_FREQUENCY, LATERAL, "triangle")
        check_secant(run, name, values, lateral_motion, secant)
        motion, force = lateral_motion(values)
        keep_loop(run, "slow", "lateral", motion, force)


def lateral_sweep(run: Run, load: Load) -> None:
    """Measure lateral stiffness and damping of the pair, first harmonic, 5 mm."""
    sweep = list(load.sweep("lateral"))
    if not run.can(*_names("lateral", [one for one, *_ in sweep]), needs=LATERAL_NEEDS):
        return
    found: list[Stiffness] = []
    known: list[tuple[Measured, Measured]] = []
    for frequency, storage, damping in sweep:
        if run.hold_point(f"before the lateral sine of {frequency:g} Hz"):
            stand_again(run, load, hold_the_height)
        with run.phase(f"lateral sine {frequency:g} Hz"):
            times, values = shake(run, "lateral", frequency, LATERAL)
            stiffness = partial(_lateral, times, frequency)
            found.append(stiffness(values))
            stiff, damped = _names("lateral", [frequency])
            known.append(check_stiffness(run, stiffness, values, {stiff: storage}, {damped: damping}))
            motion, force = lateral_motion(values)
            one = times < times[0] + 1 / frequency
            keep_loop(run, f"{frequency:g} Hz", "lateral", motion[one], force[one])
    keep_sweep(run, "pair", "lateral", found, known, sweep)
