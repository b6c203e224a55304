"""Records of the virtual rig as runs to be replayed: what the phases, the settings and the samples of a record say."""

import numpy as np
import pytest

from astb.menu import experiments
from bench_protocol.rates import TICK
from bench_protocol.units import Hz, mm
from bench_records.layout import RecordedEvent
from bench_records.record import read
from bench_sim.model.layout import Sensor
from bench_sim.parameters import load
from diagnosis.contracts import DiagnosisError, Experiment
from diagnosis.systems.air_spring.gas import GAS, gas_that_was_read
from diagnosis.systems.air_spring.parameters import CHAMBERS
from diagnosis.systems.air_spring.simulator import OUTPUTS, AirSpring
from diagnosis.systems.counted import at_its_steps, while_it_moves
from diagnosis.systems.motion import sensor_noise
from diagnosis.systems.records import (
    STEP,
    SettingsOfRecord,
    _lateral_acceleration_is_unknown,
    _without_frame_dampers,
    read_records,
)
from drivers.memory import Faults
from test_plans.loads import AW0
from test_plans.programmes.motions import Part, Programme, RestPose, Stretch, Valves, Wave
from tests.refusals import refuses

SHORT = (
    Stretch((Wave("vertical", 3 * mm, 1.0 * Hz, 4), Wave("lateral", 3 * mm, 1.0 * Hz, 3))),
    Stretch(
        (RestPose(height=2 * mm, rest=2.0), RestPose()), valves=Valves(air="level", reservoirs="on", dpv="on")
    ),
)


@pytest.fixture(scope="module")
def recorded(bench_record):
    """Two short stretches on a healthy rig, and its parameter set."""
    return bench_record("healthy", SHORT)


@pytest.fixture(scope="module")
def dataset(recorded):
    return read_records([recorded.directory], AirSpring(recorded.parameters, effects={}))


def test_every_replay_phase_is_a_run(dataset):
    names = [run.experiment.name for run in dataset.runs]
    assert names == ["short 1 AW0", "short 2 AW0"]
    assert [channel.name for channel in dataset.channels] == list(OUTPUTS)
    assert {run.role for run in dataset.runs} == {"fit"}
    for run in dataset.runs:
        n = len(run.experiment.time)
        assert np.diff(run.experiment.time) == pytest.approx(STEP, abs=1e-12)
        assert run.outputs.shape == (n, len(OUTPUTS))
        assert all(
            values.shape == (n,) and np.isfinite(values).all() for values in run.experiment.inputs.values()
        )
        assert run.experiment.minutes == pytest.approx(n * STEP / 60.0, rel=1e-3)


def test_samples_have_the_times_of_the_rig(recorded, dataset):
    record = read(recorded.directory)
    times, values = record.series("left.bellows_pressure")
    phase = next(phase for phase in record.phases if phase.name.startswith("replay"))
    inside = (times >= phase.start) & (times < phase.end)
    assert dataset.runs[0].outputs[:, 0] == pytest.approx(values[inside], abs=0.0)


def test_a_coarse_reading_that_is_slow_counts_where_it_steps():
    """A thermometer is rounded to 0.05 K and noisy by 0.01 K: between its steps it says nothing new."""
    time = np.arange(0.0, 60.0, STEP)
    warm = sampled_thermometer(time, 295.0 - 0.1 * time)
    kept = at_its_steps(warm)
    there = np.isfinite(kept)
    assert 100 < there.sum() < 140
    assert kept[there] == pytest.approx(295.0 - 0.1 * time[there], abs=0.0051), (
        "half of what passes between samples"
    )


def test_a_coarse_reading_that_stays_near_its_step_says_so_once():
    """Noise makes it step to and fro for minutes; each step is wrong by the same."""
    time = np.arange(0.0, 300.0, STEP)
    noise = 0.01 * np.random.default_rng(1).standard_normal(len(time))
    cooling = 295.033 + 0.5 * np.exp(-time / 20.0)
    kept = at_its_steps(sampled_thermometer(time, cooling + noise))
    there = np.isfinite(kept)
    assert 8 <= there.sum() <= 12, "half a kelvin in steps of 0.05 K"
    assert np.sum(time[there] > 150.0) <= 1
    assert kept[there] == pytest.approx(cooling[there], abs=0.03)


def test_steps_on_both_sides_of_a_quick_stretch_are_two():
    """A signal that swings in between has been elsewhere."""
    time = np.arange(0.0, 120.0, STEP)
    swing = 0.5 * np.sin(2.0 * np.pi * 1.3 * time) * ((time > 40.0) & (time < 80.0))
    kept = at_its_steps(
        sampled_thermometer(
            time, 295.0 + np.interp(time, [0.0, 20.0, 100.0, 120.0], [0.0, 0.04, 0.04, 0.0]) + swing
        )
    )
    assert [np.isfinite(kept[part]).sum() for part in (time < 39.0, time > 81.0)] == [1, 1]


@pytest.mark.parametrize("hertz", [0.7, 1.3, 2.1, 3.3])
def test_a_coarse_thermometer_shows_the_full_wave(hertz):
    """Half-way between samples a wave is further out than half-way between their readings: each is used separately."""
    time = np.arange(0.0, 200.0, STEP)
    cooling, wave = 295.0 - 0.0037 * time, 0.2 * np.sin(2.0 * np.pi * hertz * time)
    kept = at_its_steps(sampled_thermometer(time, cooling + wave))
    there = np.isfinite(kept)
    seen, true = (kept - cooling)[there], wave[there]
    assert seen @ true / (true @ true) == pytest.approx(1.0, abs=0.005)
    assert np.std(seen - true) == pytest.approx(0.05 / np.sqrt(12.0), rel=0.1)


def sampled_thermometer(time, true):
    """Return the readings of a thermometer without noise, ten a second in steps of 0.05 K, NaN between."""
    readings = np.full(len(time), np.nan)
    every = round(0.1 / STEP)
    readings[::every] = 0.05 * np.rint(true[::every] / 0.05)
    return readings


@pytest.fixture(scope="module")
def rounded(bench_record):
    """A rig whose first load cell has a coarse converter, which no data sheet states."""
    return bench_record("rounded", SHORT[:1], sensor_resolution={Sensor.LOAD_CELL_1: 100.0})


def test_readings_show_a_coarser_step_than_the_data_sheet(rounded, dataset):
    """A hundred newtons, five times the noise. Where the cell rests its reading stays the same, and counts once."""
    simulator = AirSpring(load("astb"), effects={})
    data = read_records([rounded.directory], simulator)
    place = list(OUTPUTS).index("load_cell.1")
    assert data.channels[place].resolution == pytest.approx(100.0)
    others = [k for k in range(len(data.channels)) if k != place]
    assert [data.channels[k] for k in others] == [simulator.channels[k] for k in others]
    fine, coarse = (np.isfinite(one.runs[0].outputs[:, place]) for one in (dataset, data))
    rest, moving = data.runs[0].rest, data.runs[0].scored & ~data.runs[0].rest
    assert fine[rest].all()
    assert coarse[rest].sum() < 0.03 * rest.sum()
    assert coarse[moving].sum() > 0.06 * moving.sum()


def test_a_constant_section_is_represented_by_its_middle():
    still, quick = [300.0] * 8 + [400.0] + [300.0] * 12, [600.0, 900.0, 1200.0, 1200.0, 800.0]
    values = np.array([*still, *quick, np.nan])
    kept = while_it_moves(values, 100.0)
    assert np.flatnonzero(np.isfinite(kept)).tolist() == [10, *range(21, 26)]
    assert kept[10] == 300.0
    assert kept[21:26].tolist() == quick


@pytest.mark.slow
def test_a_planned_record_counts_what_the_record_of_the_bench_then_counts(bench_record):
    """Forces where the bolster moves slowly, thermometers where they step; nothing before friction has forgotten."""
    stretch = Stretch(
        (
            Wave("vertical", 8 * mm, 0.1 * Hz, 3),
            Wave("vertical", 2 * mm, 8.0 * Hz, 60),
            Wave("lateral", 3 * mm, 8.0 * Hz, 40),
        )
    )
    planned = Programme("short", "Short motions", (Part(AW0, (stretch,)),), "To be replayed.")
    (experiment,) = experiments({"short": planned})
    recorded = bench_record("planned", (stretch,))
    simulator = AirSpring(recorded.parameters, effects={})
    (run,) = read_records([recorded.directory], simulator).runs
    assert experiment.name == run.experiment.name
    told = simulator.counted(experiment, simulator.run(experiment, {}, {})).sum(axis=0)
    for k, (channel, samples) in enumerate(zip(simulator.channels, run.counted.sum(axis=0), strict=True)):
        tolerance = 0.3 if channel.name.endswith("temperature") else 0.03
        assert told[k] == pytest.approx(samples, rel=tolerance), channel.name
    pressure, forces = (
        told[list(OUTPUTS).index(name)] for name in ("left.bellows_pressure", "vertical_left.force")
    )
    assert forces < 0.8 * pressure < 0.8 * len(experiment.time)


def test_conditioning_is_not_scored_and_rest_is_reported(dataset):
    run = dataset.runs[0]
    height = run.experiment.inputs["left.height"]
    first = int(np.argmax(run.scored))
    assert run.scored[first:].all()
    # One second of rest, five cycles vertically and five laterally: eleven seconds and what the generator takes.
    assert 10.9 < first * STEP < 11.3
    assert np.ptp(height[:first]) > 15 * mm
    assert np.ptp(height[run.rest & (run.experiment.time > first * STEP)]) < 0.2 * mm
    assert run.rest[0] and run.rest[-1] and not run.rest.all()


def test_settings_in_force_become_constants_and_valves(recorded, dataset):
    locked, leveled = (run.experiment for run in dataset.runs)
    for experiment in (locked, leveled):
        assert experiment.settings["nominal_preload"] == pytest.approx(53.5e3)
        assert experiment.settings["orifice_diameter"] == pytest.approx(13e-3, rel=1e-6)
        assert "pipe_length" not in experiment.settings
        assert (experiment.inputs["left.reservoir"] == 1.0).all()
    assert (locked.inputs["right.leveling"] == 0.0).all()
    assert (locked.inputs["dpv"] == 0.0).all()
    assert (leveled.inputs["right.leveling"] == 1.0).all()
    assert (leveled.inputs["dpv"] == 1.0).all()


def test_a_run_knows_how_long_the_rig_has_been_on(recorded, dataset):
    record = read(recorded.directory)
    times, ticks = record.series("rig.tick")
    phase = next(phase for phase in record.phases if phase.name.startswith("replay"))
    began = np.interp(phase.start, times, ticks * TICK)
    assert dataset.runs[0].experiment.settings["start"] == pytest.approx(began, abs=2 * STEP)


def test_a_run_begins_with_what_its_sensors_read(dataset):
    run = dataset.runs[0]
    for name in ("left.bellows_pressure", "right.auxiliary_pressure"):
        first = run.outputs[:100, [c.name for c in dataset.channels].index(name)]
        assert abs(run.experiment.settings[name] - first.mean()) < 100.0


@pytest.mark.slow
def test_lost_frames_are_gaps_in_outputs_and_bridges_in_inputs(recorded, dataset, bench_record):
    lossy = bench_record("lossy", SHORT[:1], faults=Faults(lose=0.1))
    run = read_records([lossy.directory], AirSpring(lossy.parameters, effects={})).runs[0]
    assert 0.05 < np.isnan(run.outputs[:, 0]).mean() < 0.15
    assert np.isfinite(run.experiment.inputs["left.height"]).all()
    scored = run.scored
    still = dataset.runs[0].scored
    span = min(scored.sum(), still.sum()) - 100
    difference = (
        run.experiment.inputs["left.height"][scored][:span]
        - dataset.runs[0].experiment.inputs["left.height"][still][:span]
    )
    # The two rigs stand some micrometres apart and were shaken alike.
    assert np.std(difference) < 0.2 * mm


def test_records_distinguish_runs_of_one_name(recorded):
    twice = read_records([recorded.directory, recorded.directory], AirSpring(recorded.parameters, effects={}))
    assert len(twice.runs) == 4
    assert all(str(recorded.directory) in run.experiment.name for run in twice.runs)


def test_a_record_without_anything_to_replay_is_refused(bench_record):
    empty = bench_record("empty", ())
    with refuses(DiagnosisError, "'replay"):
        read_records([empty.directory], AirSpring(empty.parameters, effects={}))


class EventsOnly:
    """A record of events alone."""

    def __init__(self, *events):
        self.events = [RecordedEvent(round(time * 1e9), "setting", "", data) for time, data in events]

    def time_of(self, event):
        return event.time_ns / 1e9


class Sampled:
    """A record of samples alone, NaN where one was lost."""

    def __init__(self, **signals):
        self.signals = {name.replace("__", "."): values for name, values in signals.items()}

    def series(self, name):
        values = self.signals[name]
        known = np.isfinite(values)
        return STEP * np.arange(len(values))[known], values[known]


def test_the_acceleration_is_unknown_where_samples_are_lost():
    """A gap of two samples is bridged; a longer one hides what happens in it, however smoothly it is bridged."""
    par, grid = load().record, STEP * np.arange(400)
    wave = 5.0 * np.sin(2.0 * np.pi * 2.0 * grid)
    seen = wave.copy()
    seen[100:102] = np.nan
    seen[200:205] = np.nan
    inputs = {"lateral.acceleration": wave}
    told = _lateral_acceleration_is_unknown(Sampled(lateral__acceleration=seen), grid, inputs, par)
    assert np.flatnonzero(told).tolist() == [200, 201, 202, 203, 204]
    assert _lateral_acceleration_is_unknown(Sampled(), grid, {}, par) is None


def test_a_dead_accelerometer_is_not_used():
    par, grid = load().record, STEP * np.arange(400)
    record = Sampled(lateral__acceleration=np.zeros(400))
    flat = {"lateral.acceleration": np.full(400, 1e-4 * sensor_noise("lateral.acceleration", par))}
    assert _lateral_acceleration_is_unknown(record, grid, flat, par) is None


def test_a_held_piston_reads_as_if_its_frame_had_no_damper():
    """F = k q + c dq/dt: at 12.5 Hz q is behind F/k by an angle of atan(ωc/k)."""
    simulator = AirSpring(load(), effects={})
    par, grid = simulator.parameters.record, STEP * np.arange(2000)
    omega = 2.0 * np.pi * 12.5
    k, c = float(par.frame_stiffness[0]), float(par.frame_damping[0])
    force = 20e3 * np.sin(omega * grid)
    behind = 20e3 / np.hypot(k, omega * c) * np.sin(omega * grid - np.arctan2(omega * c, k))
    place = [channel.name for channel in simulator.channels].index("vertical_left.displacement")
    outputs = np.zeros((len(grid), len(simulator.channels)))
    outputs[:, place] = 1e-3 - behind  # The vertical ones push down.
    record = Sampled(vertical_left__force=force)
    settings = SettingsOfRecord(
        EventsOnly((0.0, {"vertical.control": "displacement"}), (5.0, {"vertical.control": "force"}))
    )
    inside, force_controlled = slice(200, 980), slice(1005, 2000)
    before = outputs.copy()
    _without_frame_dampers(outputs, record, grid, settings, simulator)
    wrong = before[inside, place] - (1e-3 - force[inside] / k)
    assert np.abs(wrong).max() > 5e-6
    assert np.abs(outputs[inside, place] - (1e-3 - force[inside] / k)).max() < 0.05 * np.abs(wrong).max()
    assert np.array_equal(outputs[force_controlled], before[force_controlled])
    assert not np.delete(outputs, place, axis=1).any()


def test_residuals_are_not_scored_after_a_service_valve_acted():
    settings = SettingsOfRecord(
        EventsOnly(
            (0.0, {"air.left_mode": "hold"}),
            (2.0, {"air.left_mode": "fill"}),
            (3.0, {"air.left_mode": "hold"}),
        )
    )
    grid = np.array([0.5, 1.5, 2.5, 3.5])
    assert settings.predictable(grid).tolist() == [True, True, False, False]


def test_a_pipe_that_is_fitted_has_its_length():
    settings = SettingsOfRecord(EventsOnly((0.0, {"rig.pipe": "on", "rig.nominal_preload": 145e3})))
    assert settings.constants(1.0) == {"nominal_preload": 145e3, "pipe_length": 1.5}


def test_springs_were_shimmed_before_a_record_for_what_it_first_says():
    settings = SettingsOfRecord(
        EventsOnly((0.0, {"rig.nominal_preload": 53.5e3}), (9.0, {"rig.nominal_preload": 145e3}))
    )
    assert settings.preload(np.array([-600.0, 0.5, 9.5])).tolist() == [53.5e3, 53.5e3, 145e3]
    assert SettingsOfRecord(EventsOnly()).preload(np.zeros(1)).tolist() == [0.0]
    assert settings.constants(-1.0) == {}


@pytest.mark.parametrize("joined", [True, False])
def test_the_gas_at_the_start_is_free_of_what_its_sensors_are_off_by(joined):
    """Zero, drift since the bench was switched on, gain and a fitted offset: each shifts what a run begins from."""
    par = load().record.copy()
    true = dict.fromkeys(GAS, 5e5) | {name: 290.0 + k for k, name in enumerate(GAS[4:])}
    true |= {} if joined else {"left.auxiliary_pressure": 3e5, "right.auxiliary_pressure": 4e5}
    offsets = {f"{name}.offset": 300.0 if "pressure" in name else 0.4 for name in GAS}
    for name in GAS:
        sensor = OUTPUTS[name]
        par.sensor_bias[sensor], par.sensor_drift[sensor], par.sensor_gain[sensor] = 0.2, 0.01, 0.002
    read = {
        name: 1.002 * value + 0.2 + 0.01 * 90.0 + offsets[f"{name}.offset"] for name, value in true.items()
    }
    still = np.ones(2)
    inputs = {f"{side}.reservoir": still * joined for side in ("left", "right")}
    gas = gas_that_was_read(
        Experiment("one", np.array([0.0, 1.0]), inputs, read | {"start": 90.0}), offsets, par
    )
    pressures = [
        true[f"{side}.{chamber}_pressure"]
        for chamber in ("bellows", "auxiliary")
        for side in ("left", "right")
    ]
    assert gas.pressure - par.atmospheric_pressure == pytest.approx(pressures, abs=1e-6)
    assert gas.temperature == pytest.approx(
        [true[f"{chamber}_temperature"] for chamber in CHAMBERS], abs=1e-9
    )
