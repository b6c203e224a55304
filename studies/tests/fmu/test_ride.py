"""A third-party car on our springs, both FMUs in a third-party tool: it moves as on the bench."""

import re
from dataclasses import dataclass

import numpy as np
import pytest

from astb.rig_in_memory import RigInMemory
from astb_studies.paper.hybrid.car import STEP
from astb_studies.paper.hybrid.floor import COMPARED, ridden
from astb_studies.paper.hybrid.simulated_ride import SimulatedRide
from astb_studies.paper.plans.ride import AGREES, CAR, RISE, RUN_IN, car_mass, wind_force
from bench_sim.parameters import load
from bench_sim.rig.rig import Rig
from test_plans.description import ours
from test_plans.discovery import plans
from test_plans.execution import execute
from test_plans.instruments import ordinary as instruments
from test_plans.specimen import ordinary
from test_plans.steps.wind import fade
from tests.fmu.asked import HERE, build

pytestmark = pytest.mark.slow

WIND, DURATION = 10.0, 60.0
BOTH = re.compile(r"bench (?P<bench>\S+), simulation (?P<alone>\S+), U of the difference (?P<U>\S+)")


@dataclass(frozen=True)
class OnTheBench:
    """What plan `ride` found: by quantity, what the car did on the bench and alone, and U of their difference."""

    bench: dict[str, float]
    alone: dict[str, float]
    expanded: dict[str, float]


@pytest.fixture(scope="module")
def on_the_bench(tmp_path_factory: pytest.TempPathFactory) -> OnTheBench:
    """The plan in virtual time, through the wires."""
    given = {"load": "AW0", "wind": f"{WIND:g} m/s", "duration": f"{DURATION:g} s"}
    with RigInMemory(Rig(load(), seed=1)).bench(seed=1) as bench:
        bench.instruments = instruments()
        result = execute(
            plans()["ride"].given(given), bench, tmp_path_factory.mktemp("ride"), rig="virtual", seed=1
        )
    notes = {one.name: one.note for one in result.checks}
    read = {what: BOTH.search(notes[AGREES.of(what=what)] or "") for what in COMPARED if "index" not in what}
    factor = {what: 1e-3 if what == "mean lean" else 1.0 for what in read}
    columns = [
        {what: factor[what] * float(found[key].rstrip(",")) for what, found in read.items() if found}
        for key in ("bench", "alone", "U")
    ]
    return OnTheBench(*columns)


def driven(step: float, whole: float) -> np.ndarray:
    """Wind (N) and track (m, m, m/s, m/s) of each communication step: the plan's own."""
    times, force = wind_force(WIND, whole, 1)
    at = step * np.arange(round(whole / step) + 1)
    share = np.interp(at, times, fade(times))
    track = share * [CAR.track(float(t))[0] for t in at]
    rate = np.diff(track) / step
    sideways, up = CAR.track_lateral, CAR.track_vertical
    blows = np.interp(at[:-1] + 0.5 * step, times, force)
    return np.stack([blows, sideways * track[:-1], up * track[:-1], sideways * rate, up * rate], axis=1)


def felt(rows: np.ndarray, step: float, whole: float) -> dict[str, float]:
    """What the floor did, by quantity, as the plan judges it."""
    each = np.repeat(rows, round(step / STEP), axis=0)
    columns = dict(zip(("acceleration", "rising", "bump_stop", "roll"), each.T, strict=True))
    found = ridden(SimulatedRide(columns), RUN_IN, whole - RISE)
    return {what: found[check] for what, check in COMPARED.items() if check in found}


#: Which car, its communication step, and how far it may be from the car alone, which takes no such steps: its forces
#: and places are right to the second order in the step, and its track is joined by straight lines.
RIDES = [("strange", 1e-3, 0.003), ("strange", 5e-3, 0.008), ("ours", 1e-3, 0.003), ("ours", 5e-3, 0.008)]


@pytest.mark.parametrize(("whose", "step", "far"), RIDES)
def test_it_gives_the_figures_of_the_ride(
    spring_fmus, car_fmus, isolated, on_the_bench, tmp_path, whose, step, far
):
    """From the bench's within the uncertainty that the plan itself states, and nearer to the car's alone."""
    case, rig = ordinary().load("AW0"), ours()
    car = build(HERE / "models" / "RidingCar.py", tmp_path, 3) if whose == "strange" else car_fmus[3]
    whole = DURATION + RUN_IN + RISE
    to = tmp_path / "rows.npy"
    isolated(
        spring_fmus[3],
        "ride",
        car=str(car),
        strange=whose == "strange",
        mass=car_mass(case, rig),
        step=step,
        # Its car is integrated by Runge and Kutta; ours by ticks, speeds first, which is half a tick sooner.
        share=0.5 if whose == "strange" else 0.5 * (1.0 - STEP / step),
        driven=driven(step, whole),
        to=str(to),
    )
    found = felt(np.load(to), step, whole)
    assert set(found) == set(on_the_bench.bench) == {"acceleration", "vertical acceleration", "mean lean"}
    for what, value in found.items():
        assert abs(value - on_the_bench.bench[what]) <= on_the_bench.expanded[what], what
        assert value == pytest.approx(on_the_bench.alone[what], rel=far), what
