"""Benches of dimensions drawn from wide ranges: values are as uncertain as they say, and no sound spring fails.

``ASTB_GEOMETRIES`` is how many are drawn, one in the slow suite, and ``ASTB_GEOMETRIES_FROM`` the first of them.
"""

import os
from collections import Counter
from dataclasses import replace

import numpy as np
import pytest

from astb.acceptance.checking.moving import move_each
from astb.acceptance.checking.report import Plausibility
from astb.rig_in_memory import RigInMemory
from bench_protocol.dimensions import Dimensions, ordinary
from bench_records.result import CheckVerdict
from bench_sim.model.layout import Sensor
from bench_sim.model.wiring import sensor_of
from bench_sim.parameters import load
from bench_sim.parameters.dimensions import dimensions_of
from bench_sim.rig.rig import Rig
from test_plans.discovery import plans
from test_plans.execution import execute
from test_plans.instruments import ordinary as instruments
from tests.plans.truth import Ideal, with_truth

pytestmark = [pytest.mark.slow, pytest.mark.timeout(600)]
COUNT = int(os.environ.get("ASTB_GEOMETRIES", "1"))
FIRST = int(os.environ.get("ASTB_GEOMETRIES_FROM", "0"))
PLANS = ("aw0", "roll_coupling")


def drawn(rng: np.random.Generator) -> dict:
    """Parameters of a bench: springs, actuators and cells anywhere, light or heavy, stiff or soft, quick or slow."""
    mass = rng.uniform(600.0, 2600.0)
    late = {kind: rng.uniform(0.5e-3, 5e-3) for kind in ("HEIGHT", "LOAD_CELL", "FORCE", "DISPLACEMENT")}
    lags = {
        one: time
        for one in Sensor
        for kind, time in late.items()
        if one.name.endswith(kind) or kind in one.name
    }
    return {
        "spring_half_spacing": rng.uniform(0.75, 1.3),
        "actuator_half_spacing": rng.uniform(0.75, 1.3),
        "load_cell_y": rng.uniform(0.8, 1.4),
        "bolster_mass": mass,
        "bolster_inertia": 0.75 * mass,
        "centre_height": rng.uniform(0.1, 0.4),
        "lateral_actuator_height": rng.uniform(0.1, 0.5),
        "frame_stiffness": np.array([1.0, 1.0, 0.4]) * rng.uniform(80e6, 200e6),
        "sensor_lag": {one: time for one, time in lags.items() if not one.name.startswith("PLATFORM")},
    }


def described(rng: np.random.Generator, built: dict) -> Dimensions:
    """Measurements with tape and scale: the truth, off by no more than the stated uncertainty."""
    truth = ordinary().built(dimensions_of(load("astb").with_values(**built)))
    known = {
        name: replace(one, value=one.value + one.uncertainty * rng.uniform(-1, 1))
        for name, one in truth.known.items()
    }
    return Dimensions("drawn.toml", "", known)


def pieces(rng: np.random.Generator, parameters) -> dict:
    """The errors of one set of instruments, as their data sheets allow."""
    bias, gain, lag = (
        np.array(parameters.entries[f"sensor_{name}"].value) for name in ("bias", "gain", "lag")
    )
    for name, piece in instruments().pieces.items():
        k, one = sensor_of(name), piece.instrument
        bias[k], gain[k] = one.offset * rng.uniform(-1, 1), one.gain * rng.uniform(-1, 1)
        lag[k] += one.lag * rng.uniform(-1, 1)
    return {"sensor_bias": bias, "sensor_gain": gain, "sensor_lag": lag, "sensor_accuracy": 0.0}


def checks(bench, directory, known: Dimensions, plan: str):
    with bench:
        bench.instruments, bench.dimensions = instruments(), known
        return execute(plans()[plan], bench, directory, rig="virtual").checks


def doubted(parameters) -> list[str]:
    memory = RigInMemory(Rig(parameters, seed=1))
    with memory.bench() as bench:
        bench.instruments = instruments()
        return [one.what for one in move_each(bench) if one.verdict is Plausibility.DOUBTFUL]


def judged(seed: int, directory) -> Counter:
    """Count values, those whose truth lies within U, checks, those that failed, and unnoticed wrong dimensions."""
    rng = np.random.default_rng([36, seed])
    built = drawn(rng)
    there = load("astb").with_values(**built)
    known, real = described(rng, built), there.with_values(**pieces(rng, there))
    count = Counter()
    for plan in PLANS:
        ideal = Ideal(real, seed)
        with with_truth(ideal):
            found = checks(ideal.bench, directory / plan, known, plan)
        for one in found:
            count["checks"] += 1
            count["failed"] += one.verdict is CheckVerdict.FAIL
            if one.u:
                count["values"] += 1
                count["held"] += abs(one.number - ideal.known[one.number]) <= one.expanded
    ours = checks(RigInMemory(Rig(real, seed=1)).bench(), directory / "ours", ordinary(), "aw0")
    count["unnoticed"] = all(one.passed for one in ours) and not doubted(real)
    return count


def test_benches_of_any_dimensions_are_judged_rightly(tmp_path):
    """The truth of ideal sensors and exact dimensions lies within U; wrong dimensions are reported."""
    count = sum((judged(FIRST + k, tmp_path / str(k)) for k in range(COUNT)), Counter())
    print(COUNT, "benches:", dict(count))
    chance = 2.6 * np.sqrt(0.05 * 0.95 * count["values"])
    assert count["values"] > 40 * COUNT
    assert abs(count["held"] - 0.95 * count["values"]) <= 0.03 * count["values"] + chance
    assert count["failed"] <= 0.01 * count["checks"]
    assert count["unnoticed"] == 0
