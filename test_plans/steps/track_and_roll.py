"""The answer to the track under constant preload, and rolling by unequal preload."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from bench_protocol.units import Hz, kN, s
from bench_protocol.words import SIDES
from test_plans.analysis import first_harmonic
from test_plans.geometry import SPRING_HALF_SPACING
from test_plans.loads import Load
from test_plans.readings import GENERATOR
from test_plans.steps.carrying import FREE_SIDEWAYS, PRELOAD_WITHIN
from test_plans.steps.shaking import AMPLITUDE, SAMPLE_RATE, check_band, generator_cycles

if TYPE_CHECKING:
    from test_plans.run import Run

_TRACK: Final = ("left.height", "right.height", "platform.vertical")
TRACK_FREQUENCY: Final = 1.2 * Hz
TRACK_CYCLES: Final = 3
ROLL_RATE: Final = 20 * kN / s
ROLL_WAIT: Final = 1.5 * s
ROLL_AVERAGE: Final = 0.5 * s


def track_excitation(run: Run) -> None:
    """Move the platform as a track would, a unilateral cosine of 5 mm, under constant preload; look at the bolster."""
    bench = run.bench
    passed_on, peak = "bolster over platform at 1.2 Hz", "peak of the bolster"
    if not run.can(
        passed_on, peak, needs=(*_TRACK, *GENERATOR, "platform.vertical_setpoint", "generator.axis")
    ):
        return
    with run.phase("unilateral cosine"):
        with bench.capture(*_TRACK, *GENERATOR) as capture:
            bench.generator.run(
                "platform_vertical",
                "unilateral_cosine",
                amplitude=AMPLITUDE,
                frequency=TRACK_FREQUENCY,
                cycles=TRACK_CYCLES,
            )
        times, values = capture.aligned(SAMPLE_RATE)
        platform = values["platform.vertical"] - values["platform.vertical"][0]
        spring = 0.5 * (values["left.height"] + values["right.height"])
        bolster = platform + spring - spring[0]
        steady = generator_cycles(times, values, 1, TRACK_CYCLES - 1, TRACK_FREQUENCY)
        response = first_harmonic(times[steady], bolster[steady], TRACK_FREQUENCY)
        excitation = first_harmonic(times[steady], platform[steady], TRACK_FREQUENCY)
        limits = run.specimen.limits
        ratio = abs(response / excitation)
        check_band(run, passed_on, ratio, "1", limits.band("track_transmissibility"))
        check_band(run, peak, float(bolster.max()), "mm", limits.band("track_peak"))


def roll_by_unequal_preload(run: Run, load: Load) -> None:
    """Load the two sides unequally, first the left more, then the right; the air stays locked."""
    bench = run.bench
    stiff, parting = "roll stiffness", "pressure difference by rolling"
    # A bolster that is held sideways rolls about another axis: a quarter to a third stiffer.
    if not run.can(stiff, parting, needs=FREE_SIDEWAYS):
        return
    with run.phase("roll"):
        names = [f"{side}.{what}" for side in SIDES for what in ("height", "bellows_pressure")]
        names += [f"vertical_{side}.force" for side in SIDES]
        # Differences between the two rolls: what a transducer is off by falls out.
        moments, angles, differences = [], [], []
        for more in (load.roll_load, -load.roll_load):
            force = load.actuator_force
            bench.vertical.preload(force + more, force - more, rate=ROLL_RATE, within=PRELOAD_WITHIN)
            bench.wait(ROLL_WAIT)
            mean = bench.averages(*names, over=ROLL_AVERAGE)
            moments.append(SPRING_HALF_SPACING * (mean["vertical_right.force"] - mean["vertical_left.force"]))
            angles.append((mean["left.height"] - mean["right.height"]) / (2 * SPRING_HALF_SPACING))
            differences.append(mean["left.bellows_pressure"] - mean["right.bellows_pressure"])
        bench.vertical.preload(
            load.actuator_force, load.actuator_force, rate=ROLL_RATE, within=PRELOAD_WITHIN
        )
        stiffness = (moments[1] - moments[0]) / (angles[1] - angles[0])
        check_band(run, stiff, stiffness, "kN*m/rad", load.limits.band("roll_stiffness"))
        swing = 0.5 * (differences[0] - differences[1])
        limit = run.specimen.limits.band("roll_pressure_difference")
        check_band(run, parting, swing, "bar", limit)
