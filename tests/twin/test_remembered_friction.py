"""What friction remembers of a motion before a stretch, against a replay that had that motion."""

import numpy as np

from bench_sim.model.effects import CATALOGUE
from bench_sim.parameters import load
from diagnosis.contracts import Experiment, Job, MeasuredRun
from diagnosis.systems.air_spring.simulator import AirSpring
from diagnosis.twin.innovations import Bins, columns_of, parameters_of

STEP = 5e-3
PRESSURE = 4.0e5
#: The bolster has come back from one side at this time (s), has rested since, and now goes up and down.
FROM = 40.0
TIME = STEP * np.arange(round((FROM + 5.0) / STEP))
ASIDE = np.interp(TIME, [0.0, 2.0, 4.0, 6.0], [0.0, 6e-3, 0.0, 0.0])
HEIGHT = np.where(TIME > FROM, 9e-3 * np.sin(2.0 * np.pi * (TIME - FROM)), 0.0)


def moved(shear, first=0):
    return Experiment(
        "up and down after a motion aside",
        TIME[first:] - TIME[first],
        {"left.height": HEIGHT[first:], "right.height": HEIGHT[first:], "shear": shear[first:]},
        {"left.bellows_pressure": PRESSURE, "right.bellows_pressure": PRESSURE},
    )


def test_remembered_lateral_force_is_proportional_to_pressure():
    simulator = AirSpring(load("astb"), effects=CATALOGUE)
    had, had_not = simulator.run_many([Job(moved(ASIDE), {}, {}), Job(moved(0.0 * ASIDE), {}, {})])
    first = round(FROM / STEP)
    some = np.ones(len(TIME) - first, np.bool_)
    run = MeasuredRun(moved(0.0 * ASIDE, first), had_not[first:], some, ~some)
    columns = columns_of(run, simulator.channels, simulator)
    force = [channel.name for channel in simulator.channels].index("lateral.force")
    parameter = [one.name for one in parameters_of(simulator)].index("lateral.friction.force")
    remembered = Bins(run).mean((had - had_not)[first:])[:, force]
    share = remembered / columns.parameters[:, force, parameter]
    assert abs(remembered.mean()) > 100.0  # N
    assert np.ptp(remembered) > 10.0
    np.testing.assert_allclose(share, share.mean(), rtol=0.01)
