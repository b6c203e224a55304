"""Limits that depend on the bench. Those of the roll depend on the spacing of the springs, those of the track on the
mass of the bolster.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from bench_protocol.dimensions import DIMENSIONS
from test_plans.analysis.uncertainty import EVEN, Measured
from test_plans.loads import Band

if TYPE_CHECKING:
    from test_plans.analysis.geometry import Rig
    from test_plans.run import Run

SPACING: Final = "spring_half_spacing"
MASS: Final = "bolster_mass"
#: Largest relative difference in spacing and bolster mass for which limits are used without conversion.
ALIKE: Final = {SPACING: 0.02, MASS: 0.05}


def stated(run: Run, name: str, *checks: str) -> bool:
    """Return whether specimen and rig both state a dimension. If not, record the ``checks`` as *not available*, with
    the reason.
    """
    if name not in run.specimen.bench:
        run.not_available(
            checks,
            f"specimen {run.specimen.file} does not state for which bench.{name} its limits hold",
        )
        return False
    return run.can(*checks, needs=(name,))


def check_roll_stiffness(run: Run, name: str, value: Measured, band: Band, note: str = "") -> None:
    """Check a roll stiffness (N·m/rad) of the pair against the limits of the specimen.

    The vertical springs contribute 2 b² k, so the limits are scaled by the square of the spacing. The rest (2 K_φ, 3 %)
    is small against the limits.
    """
    if not stated(run, SPACING, name):
        return
    b, known = run.rig[SPACING], run.rig.stated(SPACING)
    wide = band.times((b / run.specimen.bench[SPACING]) ** 2)
    off = known.uncertainty if known else 0.0
    found = value.with_uncertainty(SPACING.replace("_", " "), 2 * abs(float(value)) * EVEN * off / b)
    run.check(name, found, "kN*m/rad", low=wide.low, high=wide.high, note=note)


def of_the_stated_mass(ratio: complex, rig: Rig, mass: float) -> complex:
    """Convert the ratio of bolster motion to platform motion from the mass of the rig's bolster to another ``mass``
    (kg).

    Under constant preload it is K/(K − m ω²/2), so m ω²/(2K) = 1 − 1/ratio is proportional to the mass.
    """
    return 1 / (1 - mass / rig[MASS] * (1 - 1 / ratio))


def bench_mismatch(run: Run) -> str:
    """Return a text on how the rig differs from the bench for which limits are stated; "" if the differences
    are small.
    """
    differences = []
    for name, within in ALIKE.items():
        here, there = run.rig[name], run.specimen.bench.get(name)
        if there is None or abs(here / there - 1) > within:
            unit = DIMENSIONS[name]
            of = "what nobody states" if there is None else f"{there:g} {unit}"
            differences.append(f"{name.replace('_', ' ')} {here:g} {unit} instead of {of}")
    return f"its limit holds for another bench: {', '.join(differences)}" if differences else ""
