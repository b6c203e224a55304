"""Lateral stiffness: slow sines of any amplitude about any offset, under the empty or the full car."""

from typing import Annotated, Final, Literal

from bench_protocol.units import Hz, mm, s
from test_plans import steps
from test_plans.analysis.geometry import PLACING, stop_travel_max
from test_plans.check_names import CheckName
from test_plans.loads import Band
from test_plans.parameters import ParameterRefused, Range
from test_plans.plan import plan
from test_plans.preconditions import on_the_bench
from test_plans.run import Run
from test_plans.steps.fittings import leave_connected
from test_plans.steps.poses import go_home, take_pose
from test_plans.steps.shaking import check_stiffness
from test_plans.steps.waves import SLOW_LATERAL_WAVES, shake
from test_plans.steps.waves import lateral_stiffness as stiffness_of

#: Slow enough for a quasi-static spring; friction loses the memory of the way to the offset within the lead.
FREQUENCY: Final = 0.5 * Hz
LEAD: Final = 10 * s
STIFF: Final = CheckName(
    "lateral stiffness K'",
    "Lateral stiffness at this amplitude and offset: it determines how far the car shifts in a curve.",
)
DAMPED: Final = CheckName(
    "lateral damping c",
    "Lateral damping at this amplitude and offset: it comes from friction and rubber, and calms the sway of the car.",
)


def take_up(run: Run, load: str, amplitude: float, offset: float) -> None:
    """Load the springs. Raises ParameterRefused for a motion that would reach the bump stop."""
    gap = run.rig["stop_gap"]
    travel = min(abs(offset), stop_travel_max(run.rig)) + amplitude
    if travel > gap:
        raise ParameterRefused(
            f"amplitude = {amplitude / mm:g} mm about offset = {offset / mm:g} mm takes the bolster "
            f"{travel / mm:.3g} mm to the side; its stop begins at {gap / mm:g} mm, so reduce "
            "amplitude or offset"
        )
    steps.carry_load(run, load)


@plan(
    setup=take_up,
    needs=(*steps.CARRYING, *SLOW_LATERAL_WAVES, *PLACING),
    teardown=leave_connected,
    lasts=50 * s,
    requires=on_the_bench("load"),
    checks=(STIFF, DAMPED),
)
def lateral_stiffness(
    run: Run,
    *,
    load: Literal["AW0", "AW3"] = "AW0",
    amplitude: Annotated[float, Range(2 * mm, 20 * mm, "mm")] = 10 * mm,
    offset: Annotated[float, Range(-40 * mm, 40 * mm, "mm")] = 0 * mm,
) -> None:
    """Lateral stiffness and damping of the springs, of any amplitude about any offset.

    The springs carry the `load` on their leveling valves; then height and pressure are held. Bolster and platform shear
    the springs to the `offset`. If the bump stop would limit the shear, bolster and platform are rolled together. About
    this offset, the lateral actuator moves the springs by the `amplitude` in a sine of 0.5 Hz. Stiffness and damping
    are those of the first harmonic, half of the values of the pair.

    The specimen's file has the limits of stiffness and damping over amplitude, and a factor for the stiffness over
    offset. The plan interpolates between the values of the file, but does not judge beyond them.
    """
    limits = run.specimen.load(load).limits
    left = limits.curve_at("lateral_left_at_offset", abs(offset))
    stiffness = limits.curve_at("lateral_stiffness_by_amplitude", amplitude)
    damping = limits.curve_at("lateral_damping_by_amplitude", amplitude)
    home = go_home(run)
    with run.phase("sine"):
        take_pose(run, home, shear=offset)
        times, values = shake(run, "lateral", FREQUENCY, amplitude, lead=LEAD)
    take_pose(run, home)
    low, high = (end * share for end, share in zip(stiffness, left, strict=True))
    check_stiffness(
        run,
        lambda rig, values: stiffness_of(times, rig, values, FREQUENCY),
        values,
        {STIFF: Band(low, high)},
        {DAMPED: Band(*damping)},
    )
