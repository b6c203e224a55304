"""Dynamic stiffness: K', K'' and loss angle of the springs over frequency and over amplitude, vertically."""

from cmath import phase
from collections.abc import Mapping
from typing import Final, Literal

from bench_protocol.units import Hz, mm, s
from test_plans import steps
from test_plans.analysis import Stiffness
from test_plans.analysis.geometry import Rig
from test_plans.analysis.uncertainty import Measured
from test_plans.check_names import CheckName
from test_plans.loads import Band, Load
from test_plans.plan import plan
from test_plans.preconditions import on_the_bench
from test_plans.run import Run
from test_plans.steps.fittings import leave_connected
from test_plans.steps.poses import COOL, go_home
from test_plans.steps.shaking import check_band
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

    The springs carry the `load` on their leveling valves and stand at design height; all valves are shut. The vertical
    actuators move the bolster in sines of 5 mm at each frequency of the specimen's file, then of 1 Hz with each
    amplitude that it states. What the orifice does depends on both: its damping has a peak over frequency and over
    amplitude.

    Good is what the specimen's file says: stiffness, damping c = K''/ω and loss angle over frequency, stiffness and
    damping over amplitude.
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
        check_band(run, STIFF.of(frequency=frequency), found[0], "kN/m", storage)
        check_band(run, DAMPED.of(frequency=frequency), found[1], "kN*s/m", loss)
        check_band(run, LOST.of(frequency=frequency), found[2], "deg", angles[frequency])
        over_frequency.append((K, found))
    over_amplitude = []
    for amplitude in stiffness:
        K, found = _sine(run, case, OF_AMPLITUDES, amplitude)
        stiff, damped = (
            one.of(amplitude=amplitude / mm) for one in (STIFF_BY_AMPLITUDE, DAMPED_BY_AMPLITUDE)
        )
        check_band(run, stiff, found[0], "kN/m", stiffness[amplitude])
        check_band(run, damped, found[1], "kN*s/m", damping[amplitude])
        over_amplitude.append((K, found))
    of_frequency = {STORAGE: [band for _, band, _ in sweep], ANGLE: [angles[place] for place, _, _ in sweep]}
    _keep(run, load, FREQUENCY, [K.frequency for K, _ in over_frequency], over_frequency, of_frequency)
    of_amplitude = {STORAGE: list(stiffness.values())}
    _keep(run, load, AMPLITUDE, [K.amplitude for K, _ in over_amplitude], over_amplitude, of_amplitude)


def _sine(run: Run, case: Load, frequency: float, amplitude: float) -> tuple[Stiffness, tuple[Measured, ...]]:
    """Return the stiffness, and with their uncertainties K', c and loss angle."""
    what = f"vertical sine {frequency:g} Hz, {amplitude / mm:g} mm"
    if run.hold_point(f"before the {what}"):
        steps.stand_again(run, case, go_home, COOL)
    with run.phase(what):
        times, values = shake(run, "vertical", frequency, amplitude, lead=LEAD)

    def found(rig: Rig, values: Values) -> tuple[float, float, float]:
        K = vertical_stiffness(times, rig, values, frequency)
        return K.storage, K.damping, phase(K.value)

    return vertical_stiffness(times, run.rig, values, frequency), run.measure(found, run.rig, values)


def _keep(
    run: Run,
    load: str,
    over: Quantity,
    places: list[float],
    found: list[tuple[Stiffness, tuple[Measured, ...]]],
    limits: Mapping[Quantity, list[Band]],
) -> None:
    for quantity, ys in (
        (STORAGE, [known[0] for _, known in found]),
        (LOSS, [K.loss for K, _ in found]),
        (ANGLE, [known[2] for _, known in found]),
        (TANGENT, [K.loss / K.storage for K, _ in found]),
    ):
        group = f"Vertical {quantity[0]} over {over[0]}"
        keep(run, load, group, over, quantity, places, ys, limits.get(quantity, ()))
