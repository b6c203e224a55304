"""Stiffness and damping against frequency (figure 11), with and without the connecting pipe: a plan for each car."""

from astb_studies.paper.sweeps.frequency import SWEEP_CHECKS, frequency_sweep
from bench_protocol.units import s
from test_plans import steps
from test_plans.analysis.geometry import DRIVEN
from test_plans.loads import AW0, AW3
from test_plans.plan import plan_under
from test_plans.preconditions import on_the_bench
from test_plans.run import Run
from test_plans.steps.fittings import PLATES_AND_PIPE, leave_as_built
from test_plans.steps.waves import LATERAL_WAVES, VERTICAL_WAVES


def _frequency_sweep(run: Run, load: str) -> None:
    """Frequency sweep, {car} car: lateral and vertical stiffness and damping from 0.1 to 25 Hz.

    The motion is a sine of 5 mm at design height; values are of the first harmonic, per spring. Laterally the pressure
    is held, vertically all valves are shut. The vertical sweep is repeated with the connecting pipe (1.5 m, 50 mm) and
    plates of 30 mm, which do not throttle. A further sweep with 0.5 mm shows the surge of the air with small flows.
    Piston speed (0.6 m/s) and force (180 kN vertically, 25 kN laterally, on a bolster of 1200 kg) limit the amplitude:
    vertically from 16 Hz, laterally from 11 Hz down to 0.9 mm. The record has the amplitude and the temperature of the
    gas. A lateral sweep of 0.9 mm separates the effect of frequency from that of friction at a smaller amplitude.

    A good spring has its maximum of damping near the natural frequency and little damping at 10 Hz. With the pipe, its
    stiffness has a dip, then an overshoot, and then returns.
    """
    frequency_sweep(run, run.specimen.load(load))


frequency_sweep_aw0, frequency_sweep_aw3 = (
    plan_under(
        load,
        _frequency_sweep,
        name,
        setup=steps.carry(load),
        teardown=leave_as_built,
        lasts=370 * s,
        needs=(*steps.CARRYING, *LATERAL_WAVES, *VERTICAL_WAVES, *PLATES_AND_PIPE, *DRIVEN),
        requires=on_the_bench(load),
        checks=SWEEP_CHECKS,
    )
    for load, name in ((AW0, "frequency_sweep_aw0"), (AW3, "frequency_sweep_aw3"))
)
