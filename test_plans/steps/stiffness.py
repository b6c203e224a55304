"""Steps that measure the vertical stiffness of each spring and the lateral stiffness of the pair, by slow loops and by
sines.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import TYPE_CHECKING, Final, Literal

from bench_protocol.words import SIDES
from test_plans.analysis import (
    HEIGHTS,
    SHEAR_CELLS,
    VERTICAL_CELLS,
    Samples,
    Stiffness,
    dynamic_stiffness,
    harmonic,
    without_inertia,
)
from test_plans.analysis.cells import CELLS, cells_under, upward_force
from test_plans.analysis.geometry import Rig
from test_plans.check_names import CheckName
from test_plans.description import lag_of, lags
from test_plans.loads import Band, Load
from test_plans.steps.carrying import hold_the_height, restore_state
from test_plans.steps.shaking import (
    LATERAL,
    LATERAL_NEEDS,
    LOOP_FREQUENCY,
    VERTICAL,
    MeasuredStiffness,
    Values,
    check_secant,
    check_stiffness,
    keep_loop,
    keep_sweep,
    lateral_motion,
    shake,
    spring_motion,
    vertical_needs,
)

if TYPE_CHECKING:
    from test_plans.run import Run

#: Of a slow loop, by its way: with all air, with it although it could be shut off, with the bellows alone.
VERTICAL_SECANT: Final = {
    "slow": CheckName(
        "{side} vertical stiffness, slow",
        "Force over displacement of a slow motion, all volumes connected: "
        "with the load it gives the natural frequency.",
    ),
    "open": CheckName(
        "{side} vertical stiffness, open",
        "Force over displacement with the auxiliary volume connected: a wrong volume behind the bellows shows here.",
    ),
    "closed": CheckName(
        "{side} vertical stiffness, closed",
        "Force over displacement with the auxiliary volume closed off: only a wrong volume of the bellows shows here.",
    ),
}
VERTICAL_STORAGE: Final = CheckName(
    "{side} vertical K' at {frequency:g} Hz",
    "Vertical stiffness at this frequency: it determines how the car bounces, and a clogged orifice increases it.",
)
VERTICAL_DAMPING: Final = CheckName(
    "{side} vertical c at {frequency:g} Hz",
    "Vertical damping at this frequency: it comes from the orifice, and calms the bouncing of the car.",
)
BALANCE: Final = CheckName(
    "actuators without inertia over load cells at {frequency:g} Hz",
    "Ratio of two measurements of one force: if it is not near 1, no stiffness of this run can be trusted.",
)
LATERAL_SECANT: Final = CheckName(
    "lateral stiffness, slow",
    "Force over displacement of a slow lateral motion: it determines how far the car shifts in curves and wind.",
)
LATERAL_STORAGE: Final = CheckName(
    "lateral K' at {frequency:g} Hz",
    "Lateral stiffness at this frequency: with the mass of the car it determines the frequency of its sway.",
)
LATERAL_DAMPING: Final = CheckName(
    "lateral c at {frequency:g} Hz",
    "Lateral damping at this frequency: it comes from rubber and friction, and changes as they age.",
)
VERTICAL_SINES: Final = (VERTICAL_STORAGE, VERTICAL_DAMPING)
LATERAL_SINES: Final = (LATERAL_STORAGE, LATERAL_DAMPING)
#: Checks of loops and sweeps.
STIFFNESS: Final = (
    VERTICAL_SECANT["slow"],
    *VERTICAL_SINES,
    BALANCE,
    LATERAL_SECANT,
    *LATERAL_SINES,
)

#: Chain of measurement: load cells against actuators, each good for 1 % of the force that a shaken spring makes.
BALANCE_TOLERANCE: Final = 0.04
ACTUATORS: Final = tuple(f"vertical_{side}.force" for side in SIDES)
BALANCED_BY: Final = (
    *VERTICAL,
    *VERTICAL_CELLS,
    "bolster_mass",
    *CELLS,
    *lags((*HEIGHTS, *ACTUATORS, *VERTICAL_CELLS)),
)


def vertical_loop(run: Run, load: Load, way: Literal["slow", "open", "closed"] = "slow") -> None:
    """Measure and check the quasi-static vertical stiffness of each spring, by a slow triangle of ± 5 mm.

    ``way`` selects the check and its limits. With "closed", the caller must have shut off the auxiliary volumes.
    """
    names = {side: VERTICAL_SECANT[way].of(side=side) for side in SIDES}
    sides = [side for side in SIDES if run.can(names[side], needs=vertical_needs(run.rig, side))]
    if not sides:
        return
    with run.phase("vertical triangle"):
        secant = load.limits.band("vertical_secant_closed" if way == "closed" else "vertical_secant")
        _, values = shake(run, "vertical", LOOP_FREQUENCY, VERTICAL, "triangle")
        for side in sides:
            check_secant(run, names[side], values, partial(spring_motion, side=side), secant)
            motion, force = spring_motion(values, run.rig, side)
            keep_loop(run, way, f"{side} spring", motion, force)


def vertical_sweep(run: Run, load: Load) -> None:
    """Measure and check vertical stiffness and damping of each spring at several frequencies, by sines of 5 mm."""
    sweep = list(load.sweep("vertical"))
    sides = [
        side
        for side in SIDES
        if run.can(*_names(VERTICAL_SINES, sweep, side), needs=vertical_needs(run.rig, side))
    ]
    highest = max(one for one, *_ in sweep)
    balance = BALANCE.of(frequency=highest)
    balanced = run.can(balance, needs=BALANCED_BY)
    if not sides:
        return
    found: dict[str, list[MeasuredStiffness]] = {side: [] for side in sides}
    for frequency, storage, damping in sweep:
        if run.hold_point(f"before the vertical sine of {frequency:g} Hz"):
            restore_state(run, load, hold_the_height)
        with run.phase(f"vertical sine {frequency:g} Hz"):
            times, values = shake(run, "vertical", frequency, VERTICAL)
            for side in sides:
                stiffness = partial(_vertical, times, frequency, side)
                stiff, damped = (one.of(side=side, frequency=frequency) for one in VERTICAL_SINES)
                judged = check_stiffness(run, stiffness, values, {stiff: storage}, {damped: damping})
                found[side].append(judged)
                motion, force = spring_motion(values, run.rig, side)
                one = times < times[0] + 1 / frequency
                keep_loop(run, f"{frequency:g} Hz", f"{side} spring", motion[one], force[one])
            if balanced and frequency == highest:
                _check_balance(run, balance, times, values, frequency)
    for side in sides:
        keep_sweep(run, f"{side} spring", "vertical", found[side], sweep)


def _names(
    names: Sequence[CheckName], sweep: Sequence[tuple[float, Band, Band]], side: str = ""
) -> list[CheckName]:
    """Return the names of the checks of a ``sweep``: each of ``names`` (stiffness, damping) at each frequency."""
    return [one.of(side=side, frequency=frequency) for frequency, *_ in sweep for one in names]


def _vertical(times: Samples, frequency: float, side: str, rig: Rig, values: Values) -> Stiffness:
    motion, force = spring_motion(values, rig, side)
    late = lag_of(rig, f"{side}.height"), lag_of(rig, *cells_under(rig, side))
    return dynamic_stiffness(times, motion, force, frequency, lags=late)


def _lateral(times: Samples, frequency: float, rig: Rig, values: Values) -> Stiffness:
    motion, force = lateral_motion(values, rig)
    late = lag_of(rig, "lateral.displacement"), lag_of(rig, *SHEAR_CELLS)
    return dynamic_stiffness(times, motion, force, frequency, lags=late)


def _check_balance(run: Run, name: str, times: Samples, values: Values, frequency: float) -> None:
    ratio = run.measured(partial(_balance, times, frequency), run.rig, values)
    run.check(name, ratio, "1", low=1 - BALANCE_TOLERANCE, high=1 + BALANCE_TOLERANCE)


def _balance(times: Samples, frequency: float, rig: Rig, values: Values) -> float:
    """Return the ratio of the force by the actuators to the force by the load cells.

    The actuators also accelerate the bolster: ΣF_cells = ΣF_act − m ẍ (downward).
    """
    actuators = values["vertical_left.force"] + values["vertical_right.force"]
    motion = -0.5 * (values["left.height"] + values["right.height"])
    cells = upward_force(values, rig)
    x = harmonic(rig, times, motion, frequency, *HEIGHTS)
    F = harmonic(rig, times, actuators, frequency, *ACTUATORS)
    S = harmonic(rig, times, cells, frequency, *VERTICAL_CELLS)
    return abs(without_inertia(F, x, rig["bolster_mass"], frequency) / S)


def lateral_loop(run: Run, load: Load) -> None:
    """Measure and check the quasi-static lateral stiffness of the pair, by a slow triangle of ± 5 mm."""
    if not run.can(LATERAL_SECANT, needs=LATERAL_NEEDS):
        return
    with run.phase("lateral triangle"):
        secant = load.limits.band("lateral_secant")
        _, values = shake(run, "lateral", LOOP_FREQUENCY, LATERAL, "triangle")
        check_secant(run, LATERAL_SECANT, values, lateral_motion, secant)
        motion, force = lateral_motion(values, run.rig)
        keep_loop(run, "slow", "lateral", motion, force)


def lateral_sweep(run: Run, load: Load) -> None:
    """Measure and check lateral stiffness and damping of the pair at several frequencies, by sines of 5 mm."""
    sweep = list(load.sweep("lateral"))
    if not run.can(*_names(LATERAL_SINES, sweep), needs=LATERAL_NEEDS):
        return
    found: list[MeasuredStiffness] = []
    for frequency, storage, damping in sweep:
        if run.hold_point(f"before the lateral sine of {frequency:g} Hz"):
            restore_state(run, load, hold_the_height)
        with run.phase(f"lateral sine {frequency:g} Hz"):
            times, values = shake(run, "lateral", frequency, LATERAL)
            stiffness = partial(_lateral, times, frequency)
            stiff, damped = (one.of(frequency=frequency) for one in LATERAL_SINES)
            found.append(check_stiffness(run, stiffness, values, {stiff: storage}, {damped: damping}))
            motion, force = lateral_motion(values, run.rig)
            one = times < times[0] + 1 / frequency
            keep_loop(run, f"{frequency:g} Hz", "lateral", motion[one], force[one])
    keep_sweep(run, "pair", "lateral", found, sweep)
