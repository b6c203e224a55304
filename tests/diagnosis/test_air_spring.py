"""The air spring as a system: a healthy rig is recognised down to its noise, and a hidden effect by its own name."""

import tomllib
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from bench_protocol.units import Hz, bar, mm, mrad
from bench_sim.model.effects import CATALOGUE
from bench_sim.model.layout import EXTRA_BRANCHES
from bench_sim.parameters import load
from bench_sim.parameters.effects import with_effects
from diagnosis.contracts import DiagnosisError, Experiment
from diagnosis.engine.columns import packing_of
from diagnosis.engine.fitting.fit import fit
from diagnosis.engine.fitting.point import base_point, effect_coordinates
from diagnosis.engine.fitting.replay import Replay
from diagnosis.engine.noise import white
from diagnosis.systems.air_spring.parameters import SOUND
from diagnosis.systems.air_spring.simulator import OUTPUTS, AirSpring
from diagnosis.systems.air_spring.surfaces import TERMS
from diagnosis.systems.records import read_records
from test_plans.programmes.motions import RestPose, Stretch, Wave
from tests.refusals import refuses

MEDLEY = (
    Stretch(
        (
            Wave("vertical", 5 * mm, 0.5 * Hz, 3, "triangle"),
            Wave("vertical", 5 * mm, 1.2 * Hz, 4),
            Wave("vertical", 1 * mm, 5.0 * Hz, 10),
            RestPose(height=6 * mm, rest=6.0),
            RestPose(),
            Wave("lateral", 6 * mm, 0.5 * Hz, 3, "triangle"),
            Wave("roll", 4 * mrad, 0.7 * Hz, 3),
        )
    ),
)
DIRECT = [name for name in OUTPUTS if "pressure" in name or "load_cell" in name]


def system(record, effects=CATALOGUE):
    """Simulator and runs of a record."""
    simulator = AirSpring(record.parameters, effects=effects)
    return simulator, read_records([record.directory], simulator).runs


def fitted(simulator, runs, cause=None, start=0.0):
    """The base model at its best fit, with one effect if its name is given."""
    point = base_point(simulator.nuisances, [run.experiment.name for run in runs])
    if cause:
        effect = simulator.catalogue[cause]
        point = point.extended(effect_coordinates(effect), (start, *effect.grid[0]))
    noise = white([np.hypot(c.noise, c.resolution / np.sqrt(12.0)) for c in simulator.channels])
    return fit(Replay(simulator, runs, 2), noise, point)


def leftover(model, runs):
    """Whitened residuals of the first run by channel, only what counts."""
    whole = model.linearisation.blocks[0].residual
    packing = packing_of(runs[0])
    return {c.name: whole[packing.channel(k)] for k, c in enumerate(model.replay.simulator.channels)}


@pytest.fixture(scope="module")
def healthy(bench_record):
    simulator, runs = system(bench_record("healthy medley", MEDLEY))
    return SimpleNamespace(simulator=simulator, runs=runs, model=fitted(simulator, runs))


# -- a healthy rig -----------------------------------------------------------------------------------------------------


def test_a_healthy_rig_leaves_only_noise(healthy):
    """χ²/N is 1, neighbours do not resemble each other, and no block of a twentieth of the run lies apart."""
    for name, error in leftover(healthy.model, healthy.runs).items():
        if name not in DIRECT:
            continue
        n = len(error)
        assert np.mean(error**2) == pytest.approx(1.0, abs=0.12), name
        assert abs(np.corrcoef(error[:-1], error[1:])[0, 1]) < 0.08, name
        blocks = np.array([block.mean() for block in np.array_split(error, 20)]) * np.sqrt(n / 20)
        assert np.std(blocks) < 2.2, name


def test_a_healthy_rig_has_healthy_springs(healthy):
    """The rig has exactly the springs of its parameter set: every fitted value is within its own uncertainty of it."""
    covariance = healthy.model.covariance()
    for k, coordinate in enumerate(healthy.model.point.coordinates):
        name = coordinate.parameter.name
        if ".offset" in name or "initial" in name:
            continue
        assert abs(healthy.model.point.numbers[k]) < 5.0 * np.sqrt(covariance[k, k]), name


def test_the_biases_that_the_rig_was_built_with_are_found(healthy):
    """Both lateral cells carry one force; their difference is drawn from the rig's seed."""
    drawn = load("astb").as_built(1).record.sensor_bias
    found = dict(
        zip(
            (c.parameter.name for c in healthy.model.point.coordinates),
            healthy.model.point.values(),
            strict=True,
        )
    )
    difference = found["load_cell.5.offset"] - found["load_cell.6.offset"]
    expected = drawn[OUTPUTS["load_cell.5"]] - drawn[OUTPUTS["load_cell.6"]]
    assert difference == pytest.approx(expected, abs=2.0)


# -- hidden effects ----------------------------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize(
    ("cause", "amplitude"),
    [
        ("leak.left", {"area": 1e-7}),
        ("pressure_lag", {"lag": 2e-3}),
        ("force_lag", {"lag": 5.713e-3}),
        ("displacement_latency", {"delay": 5e-3}),
        ("asymmetric_orifice", None),
        ("crosstalk", None),
    ],
)
def test_a_hidden_effect_is_measured_by_the_right_candidate(bench_record, healthy, cause, amplitude):
    effect = CATALOGUE[cause.partition(".")[0]]
    values = amplitude or {effect.amplitude.name: 0.5 * effect.amplitude.typical}
    simulator, runs = system(bench_record(f"hidden {cause}", MEDLEY, effects={cause: values}))
    without = fitted(simulator, runs)
    within = fitted(simulator, runs, cause)
    truth = values[effect.amplitude.name]
    place = within.point.place(effect_coordinates(simulator.catalogue[cause])[0])
    deviation = within.deviation(within.point.coordinates[place])
    assert within.point.values()[place] == pytest.approx(truth, abs=5.0 * deviation)
    assert deviation < 0.3 * truth
    # The base model cannot explain it away, and with the effect the residual is as small as a healthy one.
    assert without.linearisation.penalised_chi2 - within.linearisation.penalised_chi2 > 50.0
    assert within.linearisation.chi2 < 1.02 * healthy.model.linearisation.chi2


# -- contracts ---------------------------------------------------------------------------------------------------------


def short(name="made", seconds=3.0, **settings):
    """Both springs shaken by 3 mm at 1 Hz for a few seconds."""
    time = 5e-3 * np.arange(round(200 * seconds))
    height = 3 * mm * np.sin(2 * np.pi * time) * np.clip(time, 0.0, 1.0)
    begin = {"left.bellows_pressure": 2.06e5, "right.bellows_pressure": 2.06e5, **settings}
    return Experiment(name, time, {"left.height": height, "right.height": height}, begin)


@pytest.fixture(scope="module")
def made():
    simulator = AirSpring(load("astb"), effects=CATALOGUE)
    experiment = short()
    return SimpleNamespace(simulator=simulator, experiment=experiment, base=simulator.run(experiment, {}, {}))


@pytest.mark.parametrize("name", [name for name, effect in CATALOGUE.items() if effect.diagnosable])
def test_a_missing_effect_changes_no_value(made, name):
    for label, effect in made.simulator.catalogue.items():
        if label.partition(".")[0] != name:
            continue
        for point in effect.grid:
            values = {effect.amplitude.name: 0.0}
            values |= {shape.name: value for shape, value in zip(effect.shapes, point, strict=True)}
            assert np.array_equal(made.simulator.run(made.experiment, {}, {label: values}), made.base)


@pytest.mark.parametrize("name", TERMS)
def test_a_missing_surface_is_zero_and_a_flat_one_constant(made, name):
    surface = next(surface for surface in made.simulator.surfaces if surface.name == name)
    assert len(surface.coefficients) == len(surface.centres) == 32
    assert np.array_equal(made.simulator.run(made.experiment, {}, {name: {}}), made.base)
    flat = {c.name: 10.0 for c in surface.coefficients}
    moved = made.simulator.run(made.experiment, {}, {"force_surface": flat}) - made.base
    cells = [
        k for k, c in enumerate(made.simulator.channels) if c.name in {f"load_cell.{n}" for n in range(1, 5)}
    ]
    # Ten newtons on each of two springs, less what the emergency spring gives to the gas.
    assert moved[:, cells].sum(axis=1) == pytest.approx(20.0, rel=0.35)


def test_effects_of_the_set_are_part_of_the_base_and_no_candidates(made):
    """Whether an effect or a surface comes with the set or with the call is all one, also where a spring differs."""
    held = {
        "leak.left": {"area": 2e-7},
        "bellows_volume": {"change": 0.2},
        "maxwell": {"ratio": 0.1, "time": 0.3},
    }
    more = {"heat": {"change": 0.3}, "force_surface": {"c_3_1": 40.0}}
    surface = {f"c_{i}_2": 25.0 for i in range(8)}
    springs = {"left.bellows_volume": 0.031, "right.effective_area": 0.262, "load_cell.1.offset": 3.0}
    term = TERMS["force_surface"].changes(load("astb").record, surface)
    base = AirSpring(with_effects(load("astb").with_values(**term), held), effects=CATALOGUE)
    both = {**held, **more, "force_surface": {**surface, "c_3_1": 40.0}}
    assert base.name == "air springs on the bench with leak.left, bellows_volume, maxwell"
    assert set(made.simulator.catalogue) - set(base.catalogue) == set(held)
    assert all(not set(held) & {*one.confusers, *one.richer} for one in base.catalogue.values())
    for name, values in ({}, {}), ({"orifice_diameter": 0.02}, springs):
        experiment = short(**name)
        np.testing.assert_array_equal(
            base.run(experiment, values, more), made.simulator.run(experiment, values, both)
        )
    assert np.abs(base.run(made.experiment, {}, {}) - made.base).max() > 100.0


def test_an_effect_for_which_the_set_leaves_no_room_is_no_candidate():
    """Of the further branches two are left; one is another effect, and fractional rubber would need six."""
    rubber = {name: CATALOGUE[name] for name in ("maxwell", "maxwell_two", "fractional", "friction")}
    taken = np.where(np.arange(EXTRA_BRANCHES) < EXTRA_BRANCHES - 2, 0.01, 0.0)
    full = load("astb").with_values(extra_branch_ratio=taken)
    assert set(AirSpring(full, effects=rubber).catalogue) == {"maxwell", "maxwell_two", "friction"}
    fuller = with_effects(full, {"maxwell": {"ratio": 0.1}})
    assert set(AirSpring(fuller, effects=rubber).catalogue) == {"friction"}


def test_every_cause_refers_to_causes_that_there_are(made):
    catalogue = made.simulator.catalogue
    assert {"leak.left", "leak.right", "maxwell", "force_lag"} <= set(catalogue)
    assert "quantisation" not in catalogue
    for name, effect in catalogue.items():
        assert effect.name == name
        assert set(effect.confusers) | set(effect.richer) <= set(catalogue)
        assert all(len(point) == len(effect.shapes) for point in effect.grid)
        place = name.partition(".")[2]
        if place in {"left", "right"}:
            other = {"left": ".right", "right": ".left"}[place]
            assert not any(confuser.endswith(other) for confuser in effect.confusers)


def test_what_sound_benches_show_is_known_for_each_point_of_the_grids_of_today():
    """Another grid needs another table: one of another length would count for nothing, and say nothing."""
    table = tomllib.loads(SOUND.read_text(encoding="utf-8"))
    assert {name: len(amplitudes) for name, amplitudes in table["imitated"].items()} == {
        name: len(CATALOGUE[name].grid) for name in table["imitated"]
    }
    assert set(table["imitated"]) <= set(table["overdispersion"]) <= set(CATALOGUE)
    assert all(1.0 <= factor < 3.0 for factor in table["overdispersion"].values())


def test_offsets_add_and_springs_differ_by_side(made):
    names = [channel.name for channel in made.simulator.channels]
    offset = made.simulator.run(made.experiment, {"load_cell.2.offset": 7.0}, {})
    assert np.delete(offset - made.base, names.index("load_cell.2"), axis=1).any() == False  # noqa: E712
    assert offset[:, names.index("load_cell.2")] == pytest.approx(
        made.base[:, names.index("load_cell.2")] + 7.0
    )
    wider = made.simulator.run(made.experiment, {"left.effective_area": 0.27}, {})
    assert np.abs(wider - made.base)[:, names.index("left.bellows_pressure")].max() > 100.0
    assert np.abs(wider - made.base)[:, names.index("right.bellows_pressure")].max() < 1e-6
    # Values varied in between are not stored instead.
    assert np.array_equal(made.simulator.run(made.experiment, {}, {}), made.base)


def test_the_offset_of_the_lateral_transducer_shears_the_springs(made):
    """K_y is between one and three hundred kN/m for both springs: a tenth of a millimetre is worth 10 to 30 N."""
    names = [channel.name for channel in made.simulator.channels]
    moved = made.simulator.run(made.experiment, {"lateral.displacement.offset": 1e-4}, {}) - made.base
    lateral = moved[:, names.index("load_cell.5")] + moved[:, names.index("load_cell.6")]
    assert (lateral > 10.0).all()
    assert (lateral < 30.0).all()
    assert np.abs(moved[:, names.index("left.bellows_pressure")]).max() < 1.0


def test_a_bias_that_the_set_knows_does_not_move_the_gas():
    """A transducer that reads 10 mbar too much at the beginning reads 10 mbar too much all the time: no more."""
    biased = load("astb").with_values(sensor_bias={OUTPUTS["left.bellows_pressure"]: 1000.0})
    true = AirSpring(load("astb"), effects={}).run(short(), {}, {})
    read = AirSpring(biased, effects={}).run(short(**{"left.bellows_pressure": 2.07e5}), {}, {})
    difference = read - true
    assert difference[:, 0] == pytest.approx(1000.0, abs=1e-6)
    assert np.abs(difference[:, 1:]).max() < 1e-6


@pytest.mark.parametrize("opened", [0.0, 1.0])
def test_an_auxiliary_chamber_that_is_shut_off_has_a_pressure_of_its_own(made, opened):
    begin = {"left.bellows_pressure": 2.06e5, "left.auxiliary_pressure": 2.0e5}
    run = short(**begin)
    run = replace(run, inputs={**run.inputs, "left.reservoir": np.full(len(run.time), opened)})
    names = [channel.name for channel in made.simulator.channels]
    base = made.simulator.run(run, {}, {})
    start = base[0, names.index("left.auxiliary_pressure")]
    assert start == pytest.approx(2.06e5 if opened else 2.0e5, abs=1.0)

    def moved(by):
        return (made.simulator.run(run, {by: 50.0}, {}) - base)[0]

    own, joint = moved("left.auxiliary.initial_pressure"), moved("left.initial_pressure")
    auxiliary = names.index("left.auxiliary_pressure")
    assert own[auxiliary] == pytest.approx(0.0 if opened else 50.0, abs=1e-6)
    assert joint[auxiliary] == pytest.approx(50.0 if opened else 0.0, abs=1e-6)
    assert joint[names.index("left.bellows_pressure")] == pytest.approx(50.0, abs=1e-6)
    assert np.abs(np.delete(own, auxiliary)).max() < 1e-6


@pytest.mark.parametrize(
    ("name", "low"),
    [("left.fill_conductance", 2.2e-8), ("left.lever_offset", -9 * mm), ("supply.pressure.offset", 1e4)],
)
def test_what_is_uncertain_of_leveling_valves_counts_where_they_are_connected(made, name, low):
    """The lever hangs 8 mm low and calls for air."""
    low_lever = {"left.lever_offset": -8 * mm}
    shut = short()
    open_ = replace(shut, inputs={**shut.inputs, "left.leveling": np.ones(len(shut.time))})
    assert np.array_equal(made.simulator.run(shut, low_lever | {name: low}, {}), made.base)
    pressure = [channel.name for channel in made.simulator.channels].index("left.auxiliary_pressure")
    fed = made.simulator.run(open_, low_lever, {})[-1, pressure]
    assert fed > made.base[-1, pressure] + 1e3
    moved = made.simulator.run(open_, low_lever | {name: low}, {})[-1, pressure] - fed
    # A larger uncertain value admits more air, except for a gauge: its supply is lower than its reading.
    assert -moved > 10.0 if name.startswith("supply") else moved > 10.0


def test_the_walls_temperature_is_a_setting_of_a_run(made):
    """Air that began at the hall's 293.15 K takes up heat from walls of 303.15 K; without sensors it begins as warm."""

    def outputs(**settings):
        columns = made.simulator.run(short(**settings), {}, {}).T
        return dict(zip((channel.name for channel in made.simulator.channels), columns, strict=True))

    as_the_hall = made.simulator.run(short(wall_temperature=293.15), {}, {})
    assert np.array_equal(as_the_hall, made.base)
    chambers = [f"{side}.{chamber}" for side in ("left", "right") for chamber in ("bellows", "auxiliary")]
    cool = outputs(**{f"{chamber}_temperature": 293.15 for chamber in chambers})
    warmed = outputs(wall_temperature=303.15, **{f"{chamber}_temperature": 293.15 for chamber in chambers})
    for quantity in ("bellows_pressure", "bellows_temperature"):
        assert (warmed[f"left.{quantity}"][-100:] > cool[f"left.{quantity}"][-100:]).all()
    assert outputs(wall_temperature=303.15)["left.bellows_temperature"][0] == pytest.approx(303.15)


def test_parity_signals_depend_only_on_their_subsystem(made):
    def moved(effects):
        now = made.simulator.run(made.experiment, {}, effects)
        before = made.simulator.parity(made.experiment, made.base)
        after = made.simulator.parity(made.experiment, now)
        return {name: float(np.abs(after[name] - before[name]).max()) for name in before}

    leak = moved({"leak.left": {"area": 2e-7}})
    assert leak["left mass of air, g"] > 0.1
    assert leak["right mass of air, g"] < 1e-6
    rubber = moved({"maxwell": {"ratio": 0.5, "time": 0.3}})
    assert rubber["left force less pressure times area, N"] > 10.0
    assert rubber["left mass of air, g"] < 0.02
    frame = CATALOGUE["frame_compliance"].amplitude
    give = moved({"frame_compliance": {frame.name: frame.typical}})
    assert give["left actuator less laser, mm"] > 1e-3
    assert give["left mass of air, g"] < 1e-9


def test_a_softer_frame_gives_less_shear_if_its_compliance_is_stated(made):
    frame, lateral = {"frame_compliance": {"compliance": 2e-8}}, "load_cell.5"
    place = [channel.name for channel in made.simulator.channels].index(lateral)
    shear = 5 * mm * np.sin(np.linspace(0.0, 6.0, len(made.experiment.time)))

    def read(effects, **inputs):
        run = Experiment(
            "sheared", made.experiment.time, made.experiment.inputs | inputs, made.experiment.settings
        )
        return made.simulator.run(run, {}, effects)[:, place]

    give = {"lateral.give": 0.04 * shear}
    stiff = read({}, shear=shear)
    assert read(frame, shear=shear) == pytest.approx(stiff, abs=1e-9)
    assert read({}, shear=shear, **give) == pytest.approx(stiff, abs=1e-9)
    # c k = 0.8 of a give of 4 % of the shear.
    softer = read(frame, shear=shear, **give)
    assert softer == pytest.approx(read({}, shear=(1.0 - 0.8 * 0.04) * shear), abs=1e-6)
    assert np.abs(softer - stiff).max() > 20.0


@pytest.mark.parametrize("give", [0.0, 0.1])
def test_late_displacements_have_earlier_spring_readings(made, give):
    """The springs have the history of the later readings, the pistons' transducers are late, the rest is unchanged."""
    delay, skip = 7.5e-3, 20
    time = made.experiment.time
    move = {"left.height": 5 * mm, "right.height": -3 * mm, "shear": 6 * mm, "platform.vertical": 2 * mm}

    def seen(at):
        wave = np.sin(2.0 * np.pi * 1.5 * at) * np.clip(at, 0.0, 1.0) ** 3
        moved = {name: size * wave for name, size in move.items()}
        # Of a force: never late.
        frame = give * mm * np.sin(2.0 * np.pi * 1.5 * time) * np.clip(time, 0.0, 1.0) ** 3
        return moved | {"shear": moved["shear"] - frame, "lateral.give": frame}

    def read(at, effects):
        run = Experiment("moved", time, made.experiment.inputs | seen(at), made.experiment.settings)
        return made.simulator.run(run, {}, effects)

    right = read(time, {})
    told = read(np.maximum(time - delay, 0.0), {"displacement_latency": {"delay": delay}})
    wrong = read(np.maximum(time - delay, 0.0), {})
    wrong_kinds = set()
    for channel, as_told, expected, unaware in zip(
        made.simulator.channels, told.T, right.T, wrong.T, strict=True
    ):
        off = np.abs(unaware - expected)[skip:-skip].max()
        late = channel.kind == "displacement"
        due = CubicSpline(time, expected)(np.maximum(time - delay, 0.0)) if late else expected
        assert np.abs(as_told - due)[skip:-skip].max() < 0.03 * (channel.noise + off), channel.name
        if off > 3.0 * channel.noise:
            wrong_kinds.add(channel.kind)
    assert wrong_kinds >= {"pressure", "force"}


def test_missing_inputs_and_settings_are_named(made):
    lone = Experiment(
        "lone", made.experiment.time, {"left.height": made.experiment.inputs["left.height"]}, {}
    )
    with refuses(DiagnosisError, "right.height"):
        made.simulator.run(lone, {}, {})
    dry = Experiment("dry", made.experiment.time, made.experiment.inputs, {})
    with refuses(DiagnosisError, "left.bellows_pressure"):
        made.simulator.run(dry, {}, {})


@pytest.mark.parametrize("place", [0, 1])
def test_a_height_offset_leaves_no_trace_on_the_other_spring(place):
    """Seen too high, it is another spring: of the misfit nothing stays but constants, which pass for zeros."""
    simulator = AirSpring(load("astb"), effects={})
    time = 5e-3 * np.arange(400)
    moved = 5 * mm * np.minimum(time, 1.0) * np.sin(2.0 * np.pi * 1.5 * time)
    inputs = {"left.height": moved, "right.height": -moved, "shear": 2.0 * moved}
    begin = {"left.bellows_pressure": 2.06 * bar, "right.bellows_pressure": 2.06 * bar}
    true = simulator.run(Experiment("true", time, inputs, begin), {}, {})
    side, error = ("left", "right")[place], simulator.unseen_errors[place]
    zero = float(simulator.parameters.record.sensor_accuracy[place]) / np.sqrt(3.0)
    seen = Experiment("seen", time, inputs | {f"{side}.height": inputs[f"{side}.height"] + zero}, begin)
    nominal = {nuisance.name: nuisance.nominal for nuisance in simulator.nuisances}
    another = {name: nominal[name] + shift for name, shift in error.items()}
    left = [np.std(simulator.run(seen, values, {}) - true, axis=0) for values in ({}, another)]
    noise = np.array([channel.noise for channel in simulator.channels])
    pressures = [
        k for k, c in enumerate(simulator.channels) if c.name.startswith(side) and c.kind == "pressure"
    ]
    assert (left[1][pressures] < 0.05 * left[0][pressures]).all()
    assert (left[1] < 0.002 * noise).all()
    assert (left[0] > 0.004 * noise).any()
