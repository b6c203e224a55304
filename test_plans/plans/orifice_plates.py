"""Orifice plates: stiffness and damping of the springs with each plate of the set."""

from functools import partial
from typing import Final, Literal

from bench_protocol.units import Hz, mm, s
from bench_protocol.words import SIDES
from test_plans import steps
from test_plans.check_names import CheckName
from test_plans.plan import plan
from test_plans.preconditions import on_the_bench
from test_plans.run import Run
from test_plans.steps.fittings import PLATE, fit_plate, put_down
from test_plans.steps.poses import COOL, go_home
from test_plans.steps.shaking import MeasuredStiffness, check_stiffness
from test_plans.steps.tables import DAMPING, STORAGE, keep
from test_plans.steps.waves import VERTICAL_WAVES, shake, stiffness_of_side

FREQUENCY: Final = 1.2 * Hz
AMPLITUDE: Final = 5 * mm
LEAD: Final = 2 * s
STIFF: Final = CheckName(
    "{side} K' with {plate:g} mm",
    "Stiffness with this plate: a small bore cuts off the auxiliary volume and makes the spring stiff.",
)
DAMPED: Final = CheckName(
    "{side} c with {plate:g} mm",
    "Damping with this plate: it shows whether the bore is as marked, and whether the plate is mounted tightly.",
)
OF_PLATES: Final = ("bore of the plates", "mm")


def leave_as_found(run: Run) -> None:
    """Make the bench safe, then fit its original plates again, or ask the operator to do so."""
    steps.make_safe(run)  # if that fails, the operator is not sent to a spring that may be under air
    _fit(run, PLATE)


@plan(
    setup=put_down,
    needs=(*steps.CARRYING, *VERTICAL_WAVES),
    teardown=leave_as_found,
    lasts=204 * s,
    requires=on_the_bench("load"),
    checks=(STIFF, DAMPED),
)
def orifice_plates(run: Run, *, load: Literal["AW0", "AW3"] = "AW0") -> None:
    """Orifice plates: vertical stiffness and damping of each spring with each pair of plates.

    For each pair of plates in the specimen's file, the springs are vented and the plates are fitted. If the bench
    cannot change the plates itself, it asks the operator. Then the springs carry the `load` on their leveling valves at
    design height, and all valves are shut. The bolster moves by 5 mm at 1.2 Hz, near the peak of damping of the
    ordinary plate.

    A spring passes if stiffness and damping with each plate are within the limits of the specimen's file. A plate that
    was not fitted is not judged. The ordinary plates of 13 mm are fitted at the end.
    """
    limits = run.specimen.load(load).limits
    stiffness, damping = (
        limits.curve(f"orifice_plates.{what}", unit)
        for what, unit in (("stiffness", "kN/m"), ("damping", "kN*s/m"))
    )
    found: dict[float, dict[str, MeasuredStiffness]] = {}
    for plate in stiffness:
        names = {side: [one.of(side=side, plate=plate / mm) for one in (STIFF, DAMPED)] for side in SIDES}
        if found:
            run.hold_point(f"before the plates of {plate / mm:g} mm are fitted")
            put_down(run)
        if not _fit(run, plate, *names["left"], *names["right"]):
            continue
        steps.carry(load)(run)
        go_home(run)
        run.bench.wait(COOL)
        steps.lock_the_air(run)
        with run.phase(f"vertical sine, {plate / mm:g} mm"):
            times, values = shake(run, "vertical", FREQUENCY, AMPLITUDE, lead=LEAD)
        found[plate] = {}
        for side, (stiff, damped) in names.items():
            evaluate = partial(stiffness_of_side, times, frequency=FREQUENCY, side=side)
            judged = check_stiffness(
                run, evaluate, values, {stiff: stiffness[plate]}, {damped: damping[plate]}
            )
            found[plate][side] = judged
    for side in SIDES:
        of_side = [one[side] for one in found.values()]
        for quantity, ys in (
            (STORAGE, [one.storage for one in of_side]),
            (DAMPING, [one.damping for one in of_side]),
        ):
            keep(run, side, f"Vertical {quantity[0]} over plates", OF_PLATES, quantity, list(found), ys)


def _fit(run: Run, plate: float, *checks: str) -> bool:
    """Fit orifice plates of the diameter ``plate`` (m), or ask the operator to do so. Return whether they are fitted.
    The springs must be without air.
    """
    if run.bench.has("rig.orifice_diameter"):
        fit_plate(run, plate)
        return True
    return run.confirm(
        f"Fit the orifice plates of {plate / mm:g} mm on both sides; the springs are without air.", *checks
    )
