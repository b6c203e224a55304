"""Roll and coupling: roll stiffness, lateral force due to a roll, and lateral stiffness of rolled springs."""

from typing import Annotated, Final, Literal

from bench_protocol.units import Hz, mrad, s
from test_plans import steps
from test_plans.analysis import GENERATOR, HEIGHTS, VERTICAL_CELLS, Samples, Stiffness, dynamic_stiffness
from test_plans.analysis.cells import CELLS, bearing, cell_moment
from test_plans.analysis.geometry import Rig, roll_of
from test_plans.check_names import CheckName
from test_plans.description import lag_of, lags
from test_plans.parameters import Range
from test_plans.plan import plan
from test_plans.preconditions import on_the_bench
from test_plans.run import Run
from test_plans.steps.carrying import FREE_SIDEWAYS, LATERAL_RATE
from test_plans.steps.fittings import leave_connected
from test_plans.steps.of_the_bench import check_roll_stiffness
from test_plans.steps.poses import COOL, POSING, go_home, take_pose
from test_plans.steps.rolled import ROLL_SHEAR, RollAngle
from test_plans.steps.shaking import SAMPLE_RATE, Values, check_band, generator_cycles
from test_plans.steps.waves import SLOW_LATERAL_WAVES

#: Slow, and as far as the load of `aw0` and `aw3` rolls the bolster; friction loses its memory during the lead.
SWING: Final = 10 * mrad
SWING_FREQUENCY: Final = 0.3 * Hz
LEAD: Final = 2
MEASURED: Final = 3
STIFF: Final = CheckName(
    "roll stiffness",
    "Moment over angle of a slow roll: it determines how far the car leans in curves and in wind.",
)
SIDEWAYS: Final = CheckName(
    "lateral force by roll",
    "The lateral force that a roll causes: it steers the bogie without a "
    "lateral load, and shows the position of the bellows.",
)
ROLLED: Final = CheckName(
    "lateral stiffness K', rolled over level",
    "How much lateral stiffness remains while the car leans: it must not become soft where it is needed most.",
)
#: Signals for the roll stiffness in addition to the lateral ones.
ROLLING: Final = (
    *HEIGHTS,
    *VERTICAL_CELLS,
    *GENERATOR,
    "generator.axis",
    "generator.roll_amplitude",
    *CELLS,
    *lags(VERTICAL_CELLS),
)


@plan(
    setup=steps.carry_load,
    needs=(*steps.CARRYING, *POSING, *SLOW_LATERAL_WAVES, "air.dpv"),
    teardown=leave_connected,
    lasts=170 * s,
    requires=on_the_bench("load"),
    checks=(STIFF, SIDEWAYS, ROLLED),
)
def roll_coupling(
    run: Run,
    *,
    load: Literal["AW0", "AW3"] = "AW0",
    roll: Annotated[float, Range(20 * mrad, 50 * mrad, "mrad")] = 40 * mrad,
) -> None:
    """Roll and coupling: roll stiffness, and the lateral force that a roll causes.

    The springs carry the `load` on their leveling valves at design height. Then all valves are shut, and the
    differential pressure valve is isolated. First the vertical actuators roll the bolster by ± 10 mrad in a sine of 0.3
    Hz, while it is free sideways. The roll stiffness is the moment in the load cells over the angle between the lasers.

    Then the springs are sheared by 20 mm to the left. They are level, rolled by half of the `roll`, and by the whole
    `roll`, to either side. At each angle, the lateral actuator moves them by 5 mm at 1 Hz. The coupling is half of the
    difference of the mean forces at opposite rolls. It changes sign with the roll, but friction and offsets do not. The
    first harmonic gives the lateral stiffness, as the ratio rolled over level.

    A spring passes if each result is within the limits of the specimen's file. The limits of the coupling force depend
    on the `roll`.
    """
    limits = run.specimen.load(load).limits
    stiffness = limits.band("roll_stiffness")
    coupling = limits.curve_at("roll_coupling.force", roll, "kN")
    rolled = limits.band("roll_coupling.lateral_over_level", "1")
    home = go_home(run)
    run.bench.wait(COOL)
    steps.lock_the_air(run)
    run.bench.air.isolate_dpv()
    if run.can(STIFF, needs=(*ROLLING, *FREE_SIDEWAYS)):
        with run.phase("roll"):
            times, values = _swing(run)
        found = _roll_stiffness(times, run.rig, values)
        lost = f"{found.loss / found.storage:.3f} of it lost, at {found.amplitude / mrad:.2f} mrad"
        storage = run.measured(lambda *read: _roll_stiffness(times, *read).storage, run.rig, values)
        check_roll_stiffness(run, STIFF, storage, stiffness, note=lost)
        take_pose(run, home)
    if run.hold_point("before the coupling"):
        home = steps.restore_state(run, run.specimen.load(load), go_home, COOL)
    with run.phase("coupling"):
        seen = RollAngle()
        seen.measure(run, home, (0.5 * roll, roll))  # half way the gas gives its heat off
        seen.keep(run, run.specimen.load(load), "isolated")
    odd, even = seen.judge(run, _odd_and_even, roll, -roll, 0.0)
    run.check(SIDEWAYS, odd, "kN", low=coupling[0], high=coupling[1])
    check_band(run, ROLLED, even, "1", rolled)


def _odd_and_even(secants: list[float], storages: list[float]) -> tuple[float, float]:
    """Return the lateral force (N) that changes sign with the roll, and the ratio of K' rolled to K' level.

    The arguments are the results at the roll, at the opposite roll, and level.
    """
    odd = 0.5 * ROLL_SHEAR * (secants[0] - secants[1])
    return odd, 0.5 * (storages[0] + storages[1]) / storages[2]


def _swing(run: Run) -> tuple[Samples, Values]:
    """Roll the bolster in a sine while it is free sideways. Return times and samples of whole cycles at full
    amplitude.
    """
    bench = run.bench
    bench.lateral.push(0.0, rate=LATERAL_RATE)
    with bench.capture(*HEIGHTS, *bearing(run.rig), *GENERATOR) as capture:
        bench.generator.run(
            "roll", roll_amplitude=SWING, frequency=SWING_FREQUENCY, cycles=LEAD + MEASURED + 1
        )
    bench.lateral.hold_position()
    times, values = capture.aligned(SAMPLE_RATE)
    steady = generator_cycles(times, values, LEAD, MEASURED, SWING_FREQUENCY)
    return times[steady], {name: series[steady] for name, series in values.items()}


def _roll_stiffness(times: Samples, rig: Rig, values: Values) -> Stiffness:
    """Return the roll stiffness, moment over angle (N·m/rad), from first harmonics."""
    late = lag_of(rig, *HEIGHTS), lag_of(rig, *VERTICAL_CELLS)
    angle, moment = roll_of(values, rig), cell_moment(values, rig)
    return dynamic_stiffness(times, angle, moment, SWING_FREQUENCY, lags=late)
