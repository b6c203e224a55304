"""The plans of the menu as experiments: the motions of the springs, computed before the bench runs them."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np

from bench_protocol.units import ATMOSPHERE, Hz, minutes
from bench_protocol.words import SIDES
from diagnosis.contracts import Array, Experiment
from diagnosis.finding import Finding
from test_plans.description import Description, ours
from test_plans.programmes.motions import Programme, Stretch
from test_plans.programmes.perform import lasts
from test_plans.programmes.trajectory import RATE, trajectory
from test_plans.specimen import Specimen, ordinary

#: Temperature of the gas (K) when the valves close: the temperature of the hall.
TEMPERATURE: Final = 293.15
#: Accelerations of faster motion cannot be computed accurately from a record.
BANDWIDTH: Final = 16 * Hz


@dataclass(frozen=True, slots=True)
class Offer:
    """A plan of the menu, with its duration, and the predicted BIC gap between the rival causes from all its runs."""

    plan: str
    minutes: float
    bic_gap: float


def experiments(
    menu: Mapping[str, Programme], specimen: Specimen | None = None, rig: Description | None = None
) -> tuple[Experiment, ...]:
    """Return the experiments of all runs of all plans on a ``specimen`` and a ``rig``, by default those of the bench.

    They have the names of the runs in records. The cost of each is its share of the duration of the plan (min).
    """
    spring, built = specimen or ordinary(), rig or ours()
    return tuple(run for programme in menu.values() for run in _runs(programme, spring, built))


def offers(finding: Finding, menu: Mapping[str, Programme]) -> list[Offer]:
    """Return the plans of the menu that the finding ranks, the one with the largest gap per minute first.

    Runs are independent, so the gap of a plan is the sum over its runs.
    """
    gaps: dict[str, float] = {}
    for run in finding.next_runs:
        plan = run.experiment.partition(" ")[0]
        if plan in menu and run.bic_gap is not None:
            gaps[plan] = gaps.get(plan, 0.0) + run.bic_gap
    found = [Offer(plan, lasts(menu[plan]) / minutes, gap) for plan, gap in gaps.items()]
    return sorted(found, key=lambda one: (-one.bic_gap / one.minutes, one.plan))


def _runs(programme: Programme, spring: Specimen, rig: Description) -> Iterator[Experiment]:
    runs = [(part.load, stretch) for part in programme.parts for stretch in part.stretches]
    share = lasts(programme) / minutes / len(runs)
    for number, (load, stretch) in enumerate(runs, 1):
        yield planned(f"{programme.name} {number} {load}", spring, rig, load, stretch, share)


def planned(
    name: str, spring: Specimen, rig: Description, load: str, stretch: Stretch, cost: float
) -> Experiment:
    """Return the experiment for a motion of the springs (``stretch``) under a load; ``cost`` is in minutes."""
    asked = trajectory(stretch, rig)
    still = np.zeros_like(asked.time)
    heights = {side: _band_limited(height) for side, height in asked.heights.items()}
    settings = {"nominal_preload": spring.load(load).preload, "conditioned": asked.conditioned}
    for side in SIDES:
        pressure = _pressure(spring, load, float(heights[side][0]))
        for chamber in ("bellows", "auxiliary"):
            settings[f"{side}.{chamber}_pressure"] = pressure
            settings[f"{side}.{chamber}_temperature"] = TEMPERATURE
    return Experiment(
        name,
        asked.time,
        {
            **{f"{side}.height": height for side, height in heights.items()},
            "shear": _band_limited(asked.shear),
            "platform.vertical": still,
            "platform.lateral": still,
            "platform.roll": _band_limited(asked.platform_roll),
            **{f"{side}.leveling": asked.leveling for side in SIDES},
            **{f"{side}.reservoir": asked.reservoirs for side in SIDES},
            "dpv": asked.dpv,
        },
        settings,
        cost,
    )


def _band_limited(asked: Array) -> Array:
    """Return set-points (n,) without components above `BANDWIDTH`, which rounds their corners.

    An actuator cannot follow a sharp corner, and the diagnosis smooths the recorded motion.
    """
    from scipy.signal import butter, sosfiltfilt

    return np.asarray(asked[0] + sosfiltfilt(butter(4, BANDWIDTH, fs=RATE, output="sos"), asked - asked[0]))


def _pressure(spring: Specimen, load: str, height: float) -> float:
    """Return the gauge pressure (Pa) of a closed spring at ``height`` (m).

    It was closed at design height under its load.
    """
    volume = spring.bellows_volume + spring.auxiliary_volume
    filled = spring.load(load).fill_pressure + ATMOSPHERE
    absolute = filled * volume / (volume + spring.effective_area * height)
    return absolute - ATMOSPHERE
