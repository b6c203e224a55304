"""Dimensions of a rig: contents of a file, that ours are the simulated ones, and readings computed with them."""

import re
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from astb.diagnose import read_data
from astb.menu import experiments
from astb.rig_in_memory import RigInMemory
from bench_protocol.dimensions import (
    NAMES,
    SPANS,
    UNKNOWN,
    Dimensions,
    DimensionsError,
    across,
    direction,
    lag,
    ordinary,
    read_dimensions,
)
from bench_protocol.named_files import named_files
from bench_protocol.table_signals import FURTHER
from bench_protocol.units import mm
from bench_protocol.words import SIDES
from bench_records.result import CheckVerdict, Outcome
from bench_sim.model.layout import Sensor
from bench_sim.parameters import ParameterError, load
from bench_sim.parameters.dimensions import built_as, dimensions_of
from bench_sim.rig.rig import Rig
from diagnosis.contracts import DiagnosisError
from diagnosis.systems.map_file import read_map
from drivers.errors import NotAvailable
from test_plans.analysis import VERTICAL_CELLS, cells, geometry
from test_plans.analysis.uncertainty import EVEN, measured
from test_plans.description import Description, ours
from test_plans.discovery import plans
from test_plans.execution import execute
from test_plans.instruments import ordinary as ordinary_instruments
from test_plans.plans.separating import MENU
from test_plans.programmes.motions import RestPose, Stretch
from test_plans.programmes.trajectory import trajectory
from test_plans.steps.track_and_roll import CONTRADICTED

slow = pytest.mark.slow
metres = st.floats(0.3, 2.5)


def test_ours_are_those_that_the_bench_is_simulated_with():
    built = dimensions_of(load("astb"))
    stated = {name: one.value for name, one in ordinary().known.items()}
    further = {name for name in NAMES if name.startswith(tuple(signal.name for signal in FURTHER))}
    assert stated.keys() == NAMES.keys() - further
    assert {name: stated[name] for name in built} == built
    assert ordinary().built(built) == ordinary()


def test_a_simulated_rig_has_the_dimensions_that_it_is_simulated_with():
    wide = dimensions_of(load("astb").with_values(spring_half_spacing=1.23, bolster_mass=2400.0))
    found = ordinary().built(wide).known
    assert found["spring_half_spacing"].value == found[across("left.height")].value == 1.23
    assert found[across("right.height")].value == -1.23
    assert found[across("vertical_left")].value == 1.0
    assert found["bolster_mass"].value == 2400.0


@pytest.mark.parametrize(
    ("changes", "told"),
    [
        ({r'unit = "kg"': 'unit = "m"'}, ["dimension.bolster_mass = 1200.0 m has the wrong unit; use kg"]),
        (
            {"bolster_mass": "boster_mass"},
            ["dimension.boster_mass is not a dimension of a rig; did you mean", "bolster_mass"],
        ),
        (
            {r"^bolster_mass = \{ value = 1200.0": "bolster_mass = { value = -3"},
            ["bolster_mass = -3 kg is not plausible"],
        ),
        (
            {r"uncertainty = 1.0,": "uncertainty = -1.0,"},
            ["dimension.bolster_mass.uncertainty = -1 kg is not plausible"],
        ),
        ({r"\[across\]": "[acros]"}, ["acros is not a key of a dimensions file; did you mean 'across'?"]),
        (
            {r"^vertical_left = \{ value = 1.0": "vertical_left = { value = -1.0"},
            ["across.vertical_left = -1 m is not on the left side; write positive values for the left"],
        ),
        (
            {r'provenance = "data sheet"': 'provenance = "hearsay"', "value = 1200.0": 'value = "heavy"'},
            [
                "provenance = 'hearsay'; use one of measured, data sheet, assumed",
                "bolster_mass.value = 'heavy' is not a number",
            ],
        ),
    ],
)
def test_what_cannot_be_is_refused_all_of_it_at_once(tmp_path, changes, told):
    text = named_files("dimensions")["local"].read_text(encoding="utf-8")
    for old, new in changes.items():
        text, count = re.subn(old, new, text, flags=re.MULTILINE)
        assert count
    (tmp_path / "mine.toml").write_text(text, encoding="utf-8")
    with pytest.raises(DimensionsError) as error:
        read_dimensions("mine.toml", tmp_path)
    for words in ("mine.toml", *told):
        assert words in str(error.value)


@pytest.mark.parametrize("name", SPANS)
def test_a_dimension_that_no_bench_can_have_is_refused_with_what_is_plausible(name, tmp_path):
    span = SPANS[name]
    text = 'provenance = "measured", source = "tape"'
    for value in (span.low, span.high, 0.5 * (span.low + span.high)):
        (tmp_path / "mine.toml").write_text(
            f'[dimension]\n{name} = {{ value = {value!r}, unit = "{span.si}", {text} }}\n'
        )
        assert read_dimensions("mine.toml", tmp_path).known[name].value == value
    for value in (1.001 * span.high, 1000 * span.high, span.low - 0.001 * span.high):
        (tmp_path / "mine.toml").write_text(
            f'[dimension]\n{name} = {{ value = {value!r}, unit = "{span.si}", {text} }}\n'
        )
        with pytest.raises(DimensionsError, match=rf"dimension\.{name} = .* is not plausible"):
            read_dimensions("mine.toml", tmp_path)


def test_a_spacing_in_the_wrong_unit_is_refused_with_the_right_one(tmp_path):
    text = named_files("dimensions")["local"].read_text(encoding="utf-8")
    wrong = text.replace("spring_half_spacing = { value = 1.0, ", "spring_half_spacing = { value = 1230.0, ")
    (tmp_path / "mine.toml").write_text(wrong, encoding="utf-8")
    with pytest.raises(
        DimensionsError,
        match=r"1230 m is not plausible; use 0\.2 to 3 m; 1230 mm is plausible: check the unit",
    ):
        read_dimensions("mine.toml", tmp_path)


def test_values_to_be_stated_have_no_default():
    rig = Description("hall", UNKNOWN)
    with pytest.raises(NotAvailable, match="hall has no bolster_mass: it is not stated"):
        rig["bolster_mass"]
    assert rig.lacks("bolster_mass", "gravity") and not ours().lacks(*ordinary().known)
    with pytest.raises(KeyError):
        ours()["boster_mass"]


# -- readings --------------------------------------------------------------------------------------------------


@st.composite
def rigs(draw):
    """A rig of any dimensions: springs, lasers, actuators and cells wherever they stand."""
    rig = dict(ours())
    for name in ("spring_half_spacing", "centre_height", "lateral_actuator_height", "column_height"):
        rig[name] = draw(metres)
    for place in ("left.height", "vertical_left", "load_cell.1", "load_cell.3"):
        rig[across(place)] = draw(metres)
    for place in ("right.height", "vertical_right", "load_cell.2", "load_cell.4"):
        rig[across(place)] = -draw(metres)
    return rig


small = st.floats(-0.05, 0.05)


@given(rigs(), small, small, small, small)
def test_rigid_bodies_are_drawn_in_their_pose(rig, middle, bolster, platform, centre):
    """The truth from the bodies' own motion: bolster up, both rolls, and the bolster's centre to the left."""
    springs = {side: (1 if side == "left" else -1) * rig["spring_half_spacing"] for side in SIDES}
    values = {
        f"{side}.height": np.array(middle + rig[across(f"{side}.height")] * (bolster - platform))
        for side in SIDES
    }
    values |= {
        "platform.roll": np.array(platform),
        "lateral.displacement": np.array(centre - rig["lateral_actuator_height"] * bolster),
        "lateral.force": np.array(0.0),
    }
    shear = centre + rig["centre_height"] * bolster + rig["column_height"] * platform
    assert geometry.roll_of(values, rig) == pytest.approx(bolster - platform, abs=1e-12)
    assert geometry.shear_of(values, rig) == pytest.approx(shear, abs=1e-12)
    for side, place in springs.items():
        height = geometry.height_of_spring(values, rig, side)
        assert height == pytest.approx(middle + place * (bolster - platform), abs=1e-12)


@given(rigs(), st.floats(-2e5, 2e5), st.floats(-2e5, 2e5), st.floats(0.0, 1.0), st.floats(0.0, 1.0))
def test_cells_at_any_place_give_the_load_on_each_spring(rig, left, right, front, share):
    """Any forces in the cells that balance those of the springs, in force and moment."""
    b = rig["spring_half_spacing"]
    y = np.array([rig[across(cell)] for cell in VERTICAL_CELLS])
    balanced = np.linalg.lstsq(
        np.stack([np.ones(4), y]), np.array([left + right, b * (left - right)]), rcond=None
    )[0]
    # What the platform's own stiffness adds makes neither force nor moment.
    free = np.linalg.svd(np.stack([np.ones(4), y]))[2][2:]
    forces = balanced + 1e4 * (front * free[0] + share * free[1])
    values = dict(zip(VERTICAL_CELLS, forces, strict=True))
    for side, load_of in zip(SIDES, (left, right), strict=True):
        assert cells.load_on(values, rig, side) == pytest.approx(load_of, abs=1e-6 * 4e5)


def test_a_pose_is_what_the_readings_then_say():
    rig = dict(ours()) | {across("vertical_left"): 1.4, "centre_height": 0.5, "column_height": 0.3}
    at = geometry.pose(rig, 40 * mm, 0.03)
    assert geometry.lifted(rig, at.bolster_roll)["vertical_left"] == pytest.approx(1.4 * at.bolster_roll)
    assert at.bolster_roll - at.platform_roll == pytest.approx(0.03)


def test_a_dimension_is_uncertain_as_a_reading_is():
    """Moment over roll of two lasers, one of whose places is known to 2 cm: u_K/K = u_y/(2 b)."""
    place, off = across("left.height"), 0.02
    known = dict(ordinary().known)
    known[place] = replace(known[place], uncertainty=off)
    rig = Description("vague", Dimensions("mine.toml", "", known))
    values = {f"{side}.height": np.full(400, s * 10e-3) for side, s in (("left", 1), ("right", -1))}
    values |= {cell: np.full(400, s * 50e3) for cell, s in zip(VERTICAL_CELLS, (-1, 1, -1, 1), strict=True)}

    def stiffness(rig, read):
        return float(cells.cell_moment(read, rig).mean() / geometry.roll_of(read, rig).mean())

    (one,) = measured(stiffness, rig, values, instruments=ordinary_instruments())
    assert one.value == pytest.approx(4 * 50e3 / 10e-3)
    assert one.parts[place] == pytest.approx(one.value * 0.5 * off * EVEN, rel=1e-3)
    assert one.u == pytest.approx(np.sqrt(sum(part**2 for part in one.parts.values())), rel=0.01)
    assert "bolster mass" not in one.parts  # which it was not computed of


# -- runs ----------------------------------------------------------------------------------------------------


def ran(tmp_path, plan, dimensions=None, **changes):
    memory = RigInMemory(Rig(load("astb").with_values(**changes), seed=0))
    with memory.bench() as bench:
        bench.instruments = ordinary_instruments()
        bench.dimensions = ordinary() if dimensions is None else dimensions
        return execute(plans()[plan], bench, tmp_path / plan, rig="virtual", seed=0)


def without(*names):
    known = {name: one for name, one in ordinary().known.items() if name not in names}
    return Dimensions("mine.toml", "", known)


def test_without_the_weight_of_the_bolster_the_load_is_zero(tmp_path):
    result = ran(tmp_path, "aw0", without("bolster_mass"))
    assert result.verdict is Outcome.BLOCKED
    assert "has no bolster_mass: it is not stated (mine.toml)" in result.reason


def test_what_a_description_lacks_is_not_available_and_the_rest_is_judged(tmp_path):
    lacking = (lag("left.height"), across("vertical_left"))
    result = ran(tmp_path, "aw0", without(*lacking))
    assert result.verdict is Outcome.INCOMPLETE
    absent = {one.name: one.note for one in result.checks if one.verdict is CheckVerdict.NOT_AVAILABLE}
    assert {name for name in absent if "left vertical K'" in name or "roll" in name} <= absent.keys()
    assert "roll stiffness" in absent and across("vertical_left") in absent["roll stiffness"]
    assert any(name.startswith("left vertical K'") for name in absent)
    assert not any(name.startswith("right vertical K'") for name in absent)
    assert all(any(name in why for name in lacking) for why in absent.values())
    assert all(one.passed for one in result.checks if one.name not in absent)


WIDE = {
    "spring_half_spacing": 1.23,
    "actuator_half_spacing": 1.23,
    "load_cell_y": 1.23,
    "bolster_mass": 2400.0,
}


@slow
def test_a_wide_and_heavy_bench_is_judged_by_its_own_dimensions(tmp_path):
    """b² of roll, and a bolster twice as heavy: with dimensions of ours it cannot pass."""
    described = ordinary().built(dimensions_of(load("astb").with_values(**WIDE)))
    own = ran(tmp_path, "aw0")
    right = ran(tmp_path / "right", "aw0", described, **WIDE)
    wrong = ran(tmp_path / "wrong", "aw0", **WIDE)
    assert (own.verdict, right.verdict, wrong.verdict) == (Outcome.PASS, Outcome.PASS, Outcome.FAIL)
    roll = {
        what: next(one for one in result.checks if one.name == "roll stiffness").number
        for what, result in (("own", own), ("right", right), ("wrong", wrong))
    }
    assert roll["right"] == pytest.approx(1.23**2 * roll["own"], rel=0.02)


@slow
@pytest.mark.parametrize(
    "plan",
    [
        "leak_down",
        "axial_stiffness",
        "dynamic_stiffness",
        "lateral_stiffness",
        "roll_coupling",
        "measuring_chain",
        "crosswind_gust",
    ],
)
def test_a_plan_requests_only_what_it_needs(tmp_path, plan):
    """With nothing known but what it says it needs, something is judged, and nothing falsely."""
    needs = set(plans()[plan].needs)
    only = ran(tmp_path / "only", plan, without(*(name for name in NAMES if name not in needs)))
    assert only.verdict in {Outcome.PASS, Outcome.INCOMPLETE}, only.reason
    assert all(one.passed or one.verdict is CheckVerdict.NOT_AVAILABLE for one in only.checks)
    assert any(one.passed for one in only.checks)
    assert all("the rig has no " in one.note for one in only.checks if not one.passed)


# -- and the other way round -----------------------------------------------------------------------------------


OTHERS = {
    **WIDE,
    "centre_height": 0.4,
    "frame_stiffness": (120e6, 120e6, 60e6),
    "sensor_lag": {Sensor.LEFT_HEIGHT: 0.004, Sensor.LOAD_CELL_3: 0.003},
}


def test_a_described_rig_is_simulated_as_it_is_built():
    ours_, theirs = load("astb"), load("astb").with_values(**OTHERS)
    assert built_as(ours_, dimensions_of(theirs)).digest() == theirs.digest()
    assert built_as(ours_, dimensions_of(ours_)).digest() == ours_.digest()
    further = built_as(ours_, {"stop_gap": 0.03}).entries["bump_stop_travel"].value
    assert further - ours_.entries["bump_stop_travel"].value == pytest.approx(np.full(further.shape, 0.005))
    with pytest.raises(ParameterError, match="same distance on both sides, and lasers at the springs"):
        built_as(ours_, {across("left.height"): 1.1})
    for wrong in (
        {across("load_cell.3"): 1.2},
        dict(zip(direction("load_cell.2"), (0.0, 0.1, 0.99), strict=True)),
    ):
        with pytest.raises(
            ParameterError, match="four vertical load cells at the corners of a rectangle, and two"
        ):
            built_as(ours_, wrong)


def test_a_map_names_the_dimensions_of_the_rig_that_was_measured_on(tmp_path):
    text = named_files("dimensions")["local"].read_text(encoding="utf-8")
    (tmp_path / "theirs.toml").write_text(text.replace("value = 1200.0", "value = 2400.0"), encoding="utf-8")
    (tmp_path / "map.toml").write_text('system = "air_spring"\ndimensions = "theirs.toml"\ncolumns = {}\n')
    _, system = read_map(tmp_path / "map.toml")
    theirs = load("astb").with_values(bolster_mass=2400.0)
    assert system.simulator({"ambient_pressure": 101_325.0}, ()).parameters.digest() == theirs.digest()
    (tmp_path / "map.toml").write_text('system = "air_spring"\ndimensions = "nobodys.toml"\ncolumns = {}\n')
    with pytest.raises(DiagnosisError, match=r"nobodys\.toml cannot be read"):
        read_map(tmp_path / "map.toml")


@slow
def test_a_record_brings_the_dimensions_of_its_rig(tmp_path):
    described = ordinary().built(dimensions_of(load("astb").with_values(**WIDE)))
    ran(tmp_path / "wide", "small_fast_sines", described, **WIDE)
    ran(tmp_path, "small_fast_sines")
    wide, own = tmp_path / "wide" / "small_fast_sines", tmp_path / "small_fast_sines"
    simulator, _ = read_data([wide], None, load("astb"))
    assert simulator.parameters.digest() == load("astb").with_values(**WIDE).digest()
    assert read_data([own], None, load("astb"))[0].parameters.digest() == load("astb").digest()
    with pytest.raises(DiagnosisError, match=r"have different dimensions.*: bolster_mass"):
        read_data([own, wide], None, load("astb"))


def test_further_runs_are_predicted_for_the_measured_rig():
    menu = {"leveling_on": MENU["leveling_on"]}
    wide = Description("wide", ordinary().built(dimensions_of(load("astb").with_values(**WIDE))))
    ours_, theirs = experiments(menu), experiments(menu, rig=wide)
    assert all(one.inputs.keys() == other.inputs.keys() for one, other in zip(ours_, theirs, strict=True))
    again = experiments(menu, rig=ours())
    for one, other in zip(ours_, again, strict=True):
        for name, series in one.inputs.items():
            np.testing.assert_array_equal(series, other.inputs[name])
    rolls = Stretch((), RestPose(roll=0.02), condition=())
    (at,) = {float(np.ptp([one[0] for one in trajectory(rolls, wide).heights.values()]))}
    assert at == pytest.approx(2 * 1.23 * 0.02)


@slow
@pytest.mark.parametrize(
    ("names", "named"),
    [
        ((), ""),
        (("spring_half_spacing",), "spring_half_spacing"),
        (tuple(across(f"{side}.height") for side in SIDES), "lasers"),
        (tuple(across(f"vertical_{side}") for side in SIDES), "vertical actuators"),
        (tuple(f"{cell} across" for cell in VERTICAL_CELLS), "load cells"),
    ],
)
def test_a_wrong_description_is_reported_and_rejects_no_sound_spring(names, named, tmp_path):
    built = load("astb").with_values(spring_half_spacing=1.23, actuator_half_spacing=1.1, bolster_mass=2400.0)
    sound = ordinary().built(dimensions_of(built))
    wrong = {name: replace(sound.known[name], value=1.05 * sound.known[name].value) for name in names}
    with RigInMemory(Rig(built, seed=1)).bench() as bench:
        bench.dimensions = replace(sound, known={**sound.known, **wrong})
        bench.instruments = ordinary_instruments()
        result = execute(plans()["aw0"], bench, tmp_path)
    told = [one for one in result.warnings if one.startswith(CONTRADICTED)]
    assert result.verdict is (Outcome.INCOMPLETE if names else Outcome.PASS)
    assert len(told) == bool(names) and all(named in one for one in told)
