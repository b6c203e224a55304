"""Dynamic stiffness: K', K'' and loss angle of the springs over frequency and over amplitude, vertically."""

from collections.abc import Mapping
from functools import partial
from typing import Final, Literal

from bench_protocol.units import Hz, mm, s
from test_plans import steps
from test_plans.analysis import Samples, Stiffness
from test_plans.analysis.geometry import Rig
from test_plans.check_names import CheckName
from test_plans.loads import Band, Load
from test_plans.plan import plan
from test_plans.preconditions import on_the_bench
from test_plans.run import Run
from test_plans.steps.fittings import leave_connected
from test_plans.steps.poses import COOL, go_home
from test_plans.steps.shaking import MeasuredStiffness, check_band, measure_stiffness
from test_plans.steps.tables import AMPLITUDE, FREQUENCY, LOSS, STORAGE, TANGENT, Quantity, keep
from test_plans.steps.waves import VERTICAL_WAVES, Values, shake, vertical_stiffness

#: Limits over frequency are those of one amplitude, limits over amplitude those of one frequency.
OF_FREQUENCIES: Final = 5 * mm
OF_AMPLITUDES: Final = 1 * Hz
LEAD: Final = 2 * s
STIFF: Final = CheckName(
    "K' at {frequency:g} Hz",
    "Stiffness over frequency: it determines the natural frequency of "
    "the car, and rises as the orifice blocks the air.",
)
DAMPED: Final = CheckName(
    "c at {frequency:g} Hz",
    "Damping over frequency: near the natural frequency it calms the car, above it transmits noise from the track.",
)
LOST: Final = CheckName(
    "loss angle at {frequency:g} Hz",
    "Phase lead of the force over the motion: the ratio of loss to stiffness, which scale errors do not change.",
)
STIFF_BY_AMPLITUDE: Final = CheckName(
    "K' at {amplitude:g} mm",
    "Stiffness over amplitude: in a large motion less air passes the orifice, and the spring is stiffer.",
)
DAMPED_BY_AMPLITUDE: Final = CheckName(
    "c at {amplitude:g} mm",
    "Damping over amplitude: an orifice of the wrong bore has its damping peak at another amplitude.",
)
ANGLE: Final = ("loss angle", "deg")


@plan(
    setup=steps.carry_load,
    needs=(*steps.CARRYING, *VERTICAL_WAVES),
    teardown=leave_connected,
    lasts=86 * s,
    requires=on_the_bench("load"),
    checks=(STIFF, DAMPED, LOST, STIFF_BY_AMPLITUDE, DAMPED_BY_AMPLITUDE),
)
def dynamic_stiffness(run: Run, *, load: Literal["AW0", "AW3"] = "AW0") -> None:
    """Dynamic stiffness: storage K', loss K'' and loss angle, per spring, first harmonic.

    The springs carry the `load` on their leveling valves at design height. Then all valves are shut. The vertical
    actuators move the bolster in sines of 5 mm at each frequency of the specimen's file, then in sines of 1 Hz with
    each amplitude of the file. The damping of the orifice depends on both: it has a peak over frequency and a peak over
    amplitude.

    The specimen's file has the limits: over frequency for stiffness, damping c = K''/ω and loss angle; over amplitude
    for stiffness and damping.
    """
    case = run.specimen.load(load)
    limits = case.limits
    angles = limits.curve("vertical_loss_angle")
    stiffness, damping = (limits.curve(f"vertical_{what}_by_amplitude") for what in ("stiffness", "damping"))
    go_home(run)
    run.bench.wait(COOL)
    steps.lock_the_air(run)

    over_frequency, sweep = [], list(run.specimen.load(load).sweep("vertical"))
    for frequency, storage, loss in sweep:
        K, found = _sine(run, case, frequency, OF_FREQUENCIES)
        check_band(run, STIFF.of(frequency=frequency), found.storage, "kN/m", storage)
        check_band(run, DAMPED.of(frequency=frequency), found.damping, "kN*s/m", loss)
        check_band(run, LOST.of(frequency=frequency), found.angle, "deg", angles[frequency])
        over_frequency.append((K, found))
    over_amplitude = []
    for amplitude in stiffness:
        K, found = _sine(run, case, OF_AMPLITUDES, amplitude)
        stiff, damped = (
            one.of(amplitude=amplitude / mm) for one in (STIFF_BY_AMPLITUDE, DAMPED_BY_AMPLITUDE)
        )
        check_band(run, stiff, found.storage, "kN/m", stiffness[amplitude])
        check_band(run, damped, found.damping, "kN*s/m", damping[amplitude])
        over_amplitude.append((K, found))
    of_frequency = {STORAGE: [band for _, band, _ in sweep], ANGLE: [angles[place] for place, _, _ in sweep]}
    _record_curves(
        run, load, FREQUENCY, [K.frequency for K, _ in over_frequency], over_frequency, of_frequency
    )
    of_amplitude = {STORAGE: list(stiffness.values())}
    _record_curves(
        run, load, AMPLITUDE, [K.amplitude for K, _ in over_amplitude], over_amplitude, of_amplitude
    )


def _sine(run: Run, case: Load, frequency: float, amplitude: float) -> tuple[Stiffness, MeasuredStiffness]:
    """Move the bolster in a vertical sine. Return the stiffness, and its parts with their uncertainties."""
    what = f"vertical sine {frequency:g} Hz, {amplitude / mm:g} mm"
    if run.hold_point(f"before the {what}"):
        steps.restore_state(run, case, go_home, COOL)
    with run.phase(what):
        times, values = shake(run, "vertical", frequency, amplitude, lead=LEAD)

    stiffness = partial(_stiffness, times, frequency)
    return stiffness(run.rig, values), measure_stiffness(run, stiffness, values)


def _stiffness(times: Samples, frequency: float, rig: Rig, values: Values) -> Stiffness:
    return vertical_stiffness(times, rig, values, frequency)


def _record_curves(
    run: Run,
    load: str,
    over: Quantity,
    places: list[float],
    found: list[tuple[Stiffness, MeasuredStiffness]],
    limits: Mapping[Quantity, list[Band]],
) -> None:
    for quantity, ys in (
        (STORAGE, [one.storage for _, one in found]),
        (LOSS, [one.loss for _, one in found]),
        (ANGLE, [one.angle for _, one in found]),
        (TANGENT, [one.tangent for _, one in found]),
    ):
        group = f"Vertical {quantity[0]} over {over[0]}"
        keep(run, load, group, over, quantity, places, ys, limits.get(quantity, ()))
