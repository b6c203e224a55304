"""Many jobs in one call: the same outputs as one by one, and nothing integrated twice."""

from types import MappingProxyType, SimpleNamespace

import numpy as np
import pytest

from bench_protocol.units import mm
from bench_sim.model.effects import CATALOGUE
from bench_sim.parameters import load
from diagnosis.contracts import (
    Channel,
    Dataset,
    Experiment,
    Job,
    MeasuredRun,
    Nuisance,
)
from diagnosis.engine.fitting.point import base_point
from diagnosis.engine.fitting.replay import Replay
from diagnosis.engine.footprints import candidates, footprints
from diagnosis.engine.runs import measured_channels
from diagnosis.systems.air_spring import batch
from diagnosis.systems.air_spring.simulator import AirSpring


def shaken(name, seconds=2.0, rate=1.0, inputs=None, **settings):
    """Both springs shaken, each by its own motion, from rest and without a jump of the acceleration."""
    time = 5e-3 * np.arange(round(200 * seconds))
    tau, begun = 2.0 * np.pi * rate * time, np.clip(2.0 * time, 0.0, 1.0)
    fade = begun**3 * (10.0 - 15.0 * begun + 6.0 * begun**2)
    motion = {
        "left.height": fade * (3 * mm * np.sin(tau) + 1 * mm * np.sin(5.0 * tau)),
        "right.height": fade * (3 * mm * np.sin(tau) - 2 * mm * np.sin(0.6 * tau)),
        "shear": fade * 3 * mm * np.sin(0.9 * tau),
        "lateral.give": fade * 0.1 * mm * np.sin(0.9 * tau),
    }
    begin = {"left.bellows_pressure": 2.06e5, "right.bellows_pressure": 2.06e5, **settings}
    return Experiment(name, time, motion | (inputs or {}), begin)


@pytest.fixture(scope="module")
def bench():
    simulator = AirSpring(load("astb"), effects=CATALOGUE)
    noise = np.array([np.hypot(c.noise, c.resolution / np.sqrt(12.0)) for c in simulator.channels])
    return SimpleNamespace(simulator=simulator, noise=noise)


@pytest.fixture
def integrated(monkeypatch):
    """Sides and parameter records of all springs that are integrated from here on."""
    found = []
    integrate = batch.integrate_springs

    def counted(springs):
        found.extend(springs)
        return integrate(springs)

    monkeypatch.setattr(batch, "integrate_springs", counted)
    return found


def everything(simulator, experiment):
    """One job for each nuisance, each point of each effect's grid, and some of each surface's coefficients."""
    yield "base", Job(experiment, {}, {})
    for one in simulator.nuisances:
        yield one.name, Job(experiment, {one.name: one.nominal + one.difference}, {})
    for name, effect in simulator.catalogue.items():
        for point in effect.grid:
            values = {effect.amplitude.name: effect.amplitude.nominal + 0.3 * effect.amplitude.spread}
            values |= {shape.name: value for shape, value in zip(effect.shapes, point, strict=True)}
            yield name, Job(experiment, {}, {name: values})
    for surface in simulator.surfaces:
        for coefficient in surface.coefficients[1::5]:
            yield surface.name, Job(experiment, {}, {surface.name: {coefficient.name: coefficient.spread}})


#: Where air passes between the sides, and in and out by the leveling valves.
AIR = {
    "none": ({}, {}),
    "between the sides": ({"dpv": np.ones(240)}, {"left.bellows_pressure": 4.2e5}),
    "from the supply": (
        {
            "left.height": np.full(240, -11 * mm),
            "left.leveling": 0.5 * np.ones(240),
            "right.leveling": np.ones(240),
        },
        {},
    ),
}


@pytest.mark.parametrize("air", AIR)
def test_the_whole_catalogue_is_the_same_in_many_as_in_one(bench, air):
    inputs, settings = AIR[air]
    simulator = AirSpring(load("astb"), effects=CATALOGUE)
    names, jobs = zip(*everything(simulator, shaken("first", 1.2, inputs=inputs, **settings)), strict=True)
    base = None
    for name, job, outputs in zip(names, jobs, simulator.run_many(jobs), strict=True):
        alone = bench.simulator.run(job.experiment, job.parameters, job.effects)
        base = alone if base is None else base
        apart = np.abs(outputs - alone).max(axis=0) / bench.noise
        moved = np.abs(alone - base).max(axis=0) / bench.noise
        assert apart.max() < 1e-4 + 1e-5 * moved.max(), name
    assert simulator.effort["alone"] == 0
    if inputs:
        shut = {name: motion for name, motion in inputs.items() if name.endswith("height")}
        still = simulator.run(shaken("first", 1.2, inputs=shut, **settings), {}, {})
        assert (np.abs(base - still) / bench.noise).max() > 10.0, "air does pass"


def test_differences_of_rough_runs_are_those_of_good_ones(bench):
    """Over the whole catalogue: all within two hundredths, most within a thousandth; too quick ones excluded."""
    names, jobs = zip(*everything(bench.simulator, shaken("rough", 3.0)), strict=True)
    fine = list(bench.simulator.run_many(jobs))
    rough = list(bench.simulator.run_roughly(jobs))
    error = np.abs(rough[0] - fine[0]).max(axis=0) / bench.noise
    assert 0.01 < error.max() < 1.0, "the longer step has additional errors"
    apart, alone = {}, set()
    for name, one, other in zip(names[1:], fine[1:], rough[1:], strict=True):
        if other is None:
            alone.add(name)
            continue
        column, again = (one - fine[0]) / bench.noise, (other - rough[0]) / bench.noise
        if np.linalg.norm(column) > 1.0:
            apart[name] = max(np.linalg.norm(again - column) / np.linalg.norm(column), apart.get(name, 0.0))
    quick = {
        "pipe_inertia",
        "force_latency",
        "pressure_latency",
        "displacement_latency",
        "clock_skew",
        "sample_and_hold",
        "fractional",
    }
    assert alone == quick
    assert max(apart.values()) < 0.02, apart
    assert np.median(list(apart.values())) < 1e-3


@pytest.mark.parametrize(
    "effects",
    [
        {"maxwell": {"ratio": 0.1, "time": 4e-3}},
        {"flow_surface": {"c_4_1": 5.0}},
    ],
)
def test_what_a_longer_step_cannot_follow_is_not_done_roughly(bench, effects):
    """Rubber that relaxes within a step, and a passage of air so wide that pressures are equal within one."""
    experiment = shaken("stiff")
    assert list(bench.simulator.run_roughly([Job(experiment, {}, effects)])) == [None]
    (outputs,) = bench.simulator.run_many([Job(experiment, {}, effects)])
    assert np.isfinite(outputs).all()


def test_samples_that_are_close_enough_already_are_not_done_more_roughly(bench):
    close = shaken("close", 1.0)
    close = Experiment("close", 0.4 * close.time, close.inputs, close.settings)
    jobs = [Job(close, {}, {}), Job(close, {}, {"leak.left": {"area": 1e-7}})]
    for one, other in zip(bench.simulator.run_many(jobs), bench.simulator.run_roughly(jobs), strict=True):
        assert np.array_equal(one, other)


def test_what_no_lane_can_do_is_replayed_as_ever(bench, integrated):
    experiment = shaken("odd", 0.5, pipe_length=1.0)
    jobs = [
        Job(experiment, {}, {}),
        Job(experiment, {"load_cell.1.offset": 5.0}, {"leak.left": {"area": 1e-7}}),
    ]
    for job, outputs in zip(jobs, bench.simulator.run_many(jobs), strict=True):
        assert np.array_equal(outputs, bench.simulator.run(job.experiment, job.parameters, job.effects))
    assert not integrated


@pytest.mark.parametrize(
    ("pressure", "leak", "packs"), [(2.1e5, False, 1), (2.1e5, True, 1), (5.2e5, False, 2)]
)
def test_springs_are_separate_while_the_valve_between_them_is_shut(bench, pressure, leak, packs):
    """A differential pressure valve that is connected but shut joins nothing; open or leaking, it does.

    That it opens shows when both springs have been integrated apart; from then on they go together, and not roughly.
    """
    begin = {"left.bellows_pressure": pressure}
    experiment = shaken("joined", 0.5, inputs={"dpv": np.ones(100)}, **begin)
    simulator = AirSpring(load("astb"), effects=CATALOGUE)
    job = Job(experiment, {}, {"dpv_leak": {"area": 1e-6}} if leak else {})
    (many,) = simulator.run_many([job])
    one = simulator.run(experiment, {}, job.effects)
    assert (np.abs(many - one) / bench.noise).max() < 1e-4
    assert (simulator.effort["packs"], simulator.effort["alone"]) == (packs, 0)
    other = Job(experiment, {"left.bellows_volume": 0.031}, job.effects)
    together = list(simulator.run_many([other, job]))
    assert np.array_equal(together[1], many), "bit for bit, in any batch"
    assert simulator.effort["packs"] == packs + 1
    assert [outputs is None for outputs in simulator.run_roughly([job])] == [leak or packs > 1]


def test_a_valve_opened_by_one_job_does_not_affect_others(bench):
    """Each job decides whether it opens. Bit for bit, after any previous job, in any batch."""
    begin = {"left.bellows_pressure": 3.235e5}
    experiment = shaken("nearly", 1.0, inputs={"dpv": np.ones(200)}, **begin)
    shut = [Job(experiment, {}, effects) for effects in ({}, {"leak.left": {"area": 1e-7}})]
    more = {"left.initial_pressure": 2e3}, {"right.initial_pressure": -2e3}
    opened = [Job(experiment, parameters, {}) for parameters in more]
    found = []
    for order in ([0, 1, 2, 3, 0], [2, 0, 1, 3, 0]):
        simulator = AirSpring(load("astb"), effects=CATALOGUE)
        jobs = [(shut + opened)[k] for k in order]
        outputs = dict(zip(order, simulator.run_many(jobs), strict=True))
        found.append([outputs[k] for k in range(4)])
        assert [out is None for out in simulator.run_roughly(shut + opened)] == [False, False, True, True]
        assert simulator.effort["alone"] == 0
    for one, other, job in zip(*found, shut + opened, strict=True):
        assert np.array_equal(one, other)
        alone = bench.simulator.run(job.experiment, job.parameters, job.effects)
        assert (np.abs(one - alone) / bench.noise).max() < 1e-4


@pytest.mark.parametrize("pressure", [3.24469e5, 3.24475e5, 3.24482e5])
def test_a_peak_just_below_the_opening_pressure_is_taken_alike(bench, pressure):
    """The valve opens on a straight line, which goes 10 Pa further than the peak: of these three, for two."""
    begin = {"left.bellows_pressure": pressure}
    experiment = shaken("peak", 1.0, 2.0, inputs={"dpv": np.ones(200)}, **begin)
    simulator = AirSpring(load("astb"), effects=CATALOGUE)
    (many,) = simulator.run_many([Job(experiment, {}, {})])
    one = bench.simulator.run(experiment, {}, {})
    assert (np.abs(many - one) / bench.noise).max() < 1e-4
    assert simulator.effort["packs"] == (1 if pressure < 3.2447e5 else 2)


def test_a_rough_job_tells_itself_that_the_valve_opens(bench):
    experiment = shaken("opening", 0.5, inputs={"dpv": np.ones(100)}, **{"left.bellows_pressure": 5.2e5})
    simulator = AirSpring(load("astb"), effects=CATALOGUE)
    assert list(simulator.run_roughly([Job(experiment, {}, {})])) == [None]
    assert list(simulator.run_roughly([Job(experiment, {}, {})])) == [None]
    assert simulator.effort["packs"] == 1, "and it is tried once"


def test_only_changed_springs_are_integrated(bench, integrated):
    one, other = shaken("one", 0.5), shaken("other", 0.5, 1.3)
    base = [Job(one, {}, {}), Job(other, {}, {})]
    assert len(list(bench.simulator.run_many(base))) == 2
    assert [spring.side for spring in integrated] == [0, 1, 0, 1]
    integrated.clear()
    sensors = (
        {"load_cell.1.offset": 3.0},
        {"vertical_left.force.drag": 50.0},
        {"vertical_left.displacement.seat": 1e-6},
    )
    effects = (
        {"force_lag": {"lag": 1e-3}},
        {"crosstalk": {"share": 0.01}},
        {"force_surface": {"c_1_1": 20.0}},
    )
    jobs = [Job(one, parameters, {}) for parameters in sensors] + [
        Job(other, {}, effect) for effect in effects
    ]
    assert len(list(bench.simulator.run_many(jobs))) == 6
    assert not integrated
    jobs = [Job(one, {"left.bellows_volume": 0.031}, {}), Job(one, {}, {"leak.right": {"area": 1e-7}})]
    jobs += [jobs[0], Job(one, {"left.bellows_volume": 0.031}, {"force_gain": {"gain": 0.01}})]
    first, _, third, _ = bench.simulator.run_many(jobs)
    assert [spring.side for spring in integrated] == [0, 1]
    assert np.array_equal(first, third)


def test_the_effort_is_counted():
    simulator = AirSpring(load("astb"), effects=CATALOGUE)
    experiment, piped = shaken("counted", 0.5), shaken("piped", 0.5, pipe_length=1.0)
    effects = (
        {},
        {},
        {"leak.left": {"area": 1e-7}},
        {"force_lag": {"lag": 1e-3}},
        {"pipe_inertia": {"length": 1.0}},
    )
    jobs = [*(Job(experiment, {}, effect) for effect in effects), Job(piped, {}, {})]
    assert len(list(simulator.run_many(jobs))) == 6
    assert simulator.effort == {"jobs": 6, "packs": 1, "springs": 5, "readings": 5, "alone": 1}


def test_outputs_do_not_depend_on_the_batch(bench):
    """Bit for bit, so that a fit takes the same way however its jobs are shared out."""
    names, jobs = zip(*everything(bench.simulator, shaken("batched", 0.5)), strict=True)
    together = list(bench.simulator.run_many(jobs))
    fresh = AirSpring(load("astb"), effects=CATALOGUE)
    for k in range(0, len(jobs), 7):
        (alone,) = fresh.run_many([jobs[k]])
        assert np.array_equal(alone, together[k]), names[k]


class Line:
    """y = a t + b, one by one; it counts its calls."""

    name = "line"
    channels = (Channel("y", "1"),)
    nuisances = (Nuisance("a", "1", 0.0, 1.0), Nuisance("b", "1", 0.0, 1.0, per_run=True))
    catalogue = MappingProxyType({})
    surfaces = ()

    def __init__(self):
        self.calls = []

    def run(self, experiment, parameters, effects):
        self.calls.append(1)
        return (parameters["a"] * experiment.time + parameters["b"])[:, None]


class ManyLines(Line):
    least_batch = 4

    def run_many(self, jobs):
        self.calls.append(len(jobs))
        return (Line().run(job.experiment, job.parameters, job.effects) for job in jobs)


@pytest.mark.parametrize("workers", [1, 2, 3])
def test_a_replay_asks_for_many_where_it_can(workers):
    time = np.linspace(0.0, 1.0, 11)
    outputs = np.zeros((11, 1))
    still = np.zeros(11, bool)
    runs = tuple(MeasuredRun(Experiment(f"{k}", time, {}), outputs, ~still, still) for k in range(3))
    one, many = Line(), ManyLines()
    point = base_point(Line.nuisances, ["0", "1", "2"])
    point = point.at(np.array([1.0, 2.0, 3.0, 4.0]))
    answers = []
    for simulator in (one, many):
        replay = Replay(simulator, runs, workers)
        predictions = replay.predictions(point)
        answers.append((predictions, replay.sensitivities(point, predictions)))
    for got, expected in zip(answers[1][0], answers[0][0], strict=True):
        assert np.array_equal(got, expected)
    for got, expected in zip(answers[1][1], answers[0][1], strict=True):
        columns = [[of_run.along(unit) for unit in np.eye(2)] for of_run in (got, expected)]
        assert np.array_equal(*columns)
        assert columns[0] == pytest.approx(np.vstack([time, np.ones(11)]), abs=1e-5)
    assert sum(many.calls) == sum(one.calls) == 3 + 6 + 6
    # Three predictions, then six differences ahead and behind: four are the fewest that are worth a batch of their own.
    assert sorted(many.calls) == ([3, 6, 6] if workers == 1 else [2, 2, 3, 4, 4])


class RoughLines(ManyLines):
    """Rough outputs are off by a constant; where the slope is larger than ``most`` there are none."""

    most = np.inf
    too_alike = frozenset()

    def __init__(self):
        super().__init__()
        self.slopes = set()

    def run_roughly(self, jobs):
        for job in jobs:
            self.slopes.add(job.parameters["a"])
            outputs = Line().run(job.experiment, job.parameters, job.effects) + 100.0
            yield outputs if job.parameters["a"] < self.most else None


@pytest.mark.parametrize("workers", [1, 2])
@pytest.mark.parametrize("most", [np.inf, 1.005, -np.inf])
def test_differences_are_between_two_rough_outputs_or_two_good_ones(workers, most, monkeypatch):
    monkeypatch.setattr("diagnosis.engine.fitting.replay.LEAST_ROUGH", 2)
    time = np.linspace(0.0, 1.0, 11)
    still = np.zeros(11, bool)
    runs = tuple(
        MeasuredRun(Experiment(f"{k}", time, {}), np.zeros((11, 1)), ~still, still) for k in range(3)
    )
    point = base_point(Line.nuisances, ["0", "1", "2"])
    point = point.at(np.array([1.0, 2.0, 3.0, 4.0]))
    simulator = RoughLines()
    simulator.most = most
    replay = Replay(simulator, runs, workers)
    for columns in replay.sensitivities(point, replay.predictions(point)):
        assert [columns.along(unit) for unit in np.eye(2)] == pytest.approx(
            np.vstack([time, np.ones(11)]), abs=1e-5
        )


@pytest.mark.parametrize(("too_alike", "slopes"), [((), 3), (("a",), 1)])
def test_what_is_too_alike_is_never_rough(too_alike, slopes, monkeypatch):
    """The slope differs by a step to either side, or rough outputs know it as it is."""
    monkeypatch.setattr("diagnosis.engine.fitting.replay.LEAST_ROUGH", 2)
    still = np.zeros(11, bool)
    run = MeasuredRun(Experiment("0", np.linspace(0.0, 1.0, 11), {}), np.zeros((11, 1)), ~still, still)
    simulator = RoughLines()
    simulator.too_alike = frozenset(too_alike)
    point = base_point(Line.nuisances, ["0"])
    replay = Replay(simulator, (run,), 1)
    (columns,) = replay.sensitivities(point, replay.predictions(point))
    assert len(simulator.slopes) == slopes
    expected = np.vstack([run.experiment.time, np.ones(11)])
    assert [columns.along(unit) for unit in np.eye(2)] == pytest.approx(expected, abs=1e-5)


def test_the_discharge_coefficient_shows_above_tolerances_of_both_sides(bench):
    """It is their sum, except for the prior of these: rough differences, wrong by a fiftieth, hide that."""
    experiment = shaken("orifice", seconds=5.0)
    nothing = np.zeros(len(experiment.time), np.bool_)
    run = MeasuredRun(experiment, bench.simulator.run(experiment, {}, {}), ~nothing, nothing)
    replay = Replay(bench.simulator, (run,), 1)
    point = base_point(bench.simulator.nuisances, ["orifice"])
    around = footprints(replay, point, candidates([bench.simulator.catalogue["discharge"]]))
    places = [
        point.places_of("orifice").index(i)
        for i, c in enumerate(point.coordinates)
        if "discharge" in c.parameter.name
    ]
    both, whole = around.parameter_columns[0].chosen(places), around.candidate_columns[0]
    left = whole.gram - whole.against(both) @ np.linalg.solve(both.gram, both.against(whole))
    assert 0.0 < left[0, 0] < 2e-5 * whole.gram[0, 0]  # three times as much where they are rough


def test_a_simulator_of_which_fewer_channels_were_measured_still_does_many_jobs_at_once(bench, integrated):
    """The channels of the data choose columns; who measured nothing but pressures is not made to wait for that."""
    experiment = shaken("few", seconds=1.0)
    kept = [k for k, channel in enumerate(bench.simulator.channels) if channel.kind == "pressure"]
    nothing = np.zeros(len(experiment.time), np.bool_)
    run = MeasuredRun(experiment, bench.simulator.run(experiment, {}, {})[:, kept], ~nothing, nothing)
    data = Dataset(tuple(bench.simulator.channels[k] for k in kept), (run,))
    _, few = measured_channels(data, bench.simulator)
    (outputs,) = few.run_many([Job(experiment, {}, {})])
    assert len(integrated) == 2
    assert np.abs((outputs - run.outputs) / bench.noise[kept]).max() < 1e-3
    assert few.unseen_errors == bench.simulator.unseen_errors
    (outputs,) = few.run_roughly([Job(experiment, {}, {})])
    assert outputs.shape == run.outputs.shape


def test_a_run_may_seem_shifted_sideways_as_by_the_zero_of_its_transducer(bench):
    experiment = shaken("seat", seconds=0.5)
    zero, seat = ({f"lateral.displacement.{name}": 4e-6} for name in ("offset", "seat"))
    plain, one, other = bench.simulator.run_many([Job(experiment, values, {}) for values in ({}, zero, seat)])
    assert (one == other).all()
    assert np.abs(one - plain).max() > 0.1
    assert bench.simulator.run(experiment, seat, {}) == pytest.approx(other, abs=0.01)
