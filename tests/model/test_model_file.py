"""Model files: a base, changes, effects and provenance; read as written, refused in words, loaded like a set."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bench_sim.model.effects import CATALOGUE
from bench_sim.model.layout import Sensor
from bench_sim.parameters import ParameterError, load
from bench_sim.parameters.model_file import Model, load_effects, load_model, write_model
from tests.refusals import refuses

BASE = load("astb")
FULL = Model(
    based_on="astb",
    changes={
        "discharge_coefficient": 0.6317,
        "bellows_volume": [30.1 * 1e-3, 29.8 * 1e-3],
        "sensor_bias": {"left_height": 2e-5, "load_cell_3": -12.5},
        "load_cell_crosstalk": 1e-3,
        "force_surface": np.linspace(-50.0, 50.0, 32).reshape(8, 4),
        "force_surface_displacement": [-0.02, 0.02],
        "force_surface_speed": [-0.1, 0.1],
    },
    effects={"leak.left": {"area": 2e-7}, "maxwell": {"ratio": 0.1, "time": 0.4999999999999999}},
    finding={
        "verdict": 'named: "leak.left"\n',
        "runs": 7,
        "lambda": 12.5,
        "sealed": False,
        "digests": ["a", "b"],
        "versions": {"astb": "1", "the other": 2.0},
    },
)


def test_a_model_is_read_as_it_was_written(tmp_path):
    path = tmp_path / "extended.toml"
    write_model(path, FULL)
    assert load_model(path) == FULL
    text = path.read_text(encoding="utf-8")
    for line in (
        'based_on = "astb"',
        'bellows_volume = ["30.1 litre", "29.8 litre"]',
        '[effect."leak.left"]\narea = "0.2 mm2"',
        '[change.sensor_bias]\nleft_height = "0.02 mm"\nload_cell_3 = "-12.5 N"',
        '[surface.force]\ncoefficients = [\n    ["-50.0 N", ',
        'displacement = ["-20.0 mm", "20.0 mm"]',
    ):
        assert line in text
    again = tmp_path / "again.toml"
    write_model(again, load_model(path))
    assert again.read_bytes() == path.read_bytes()


def test_numbers_are_rounded_and_notes_precede_them(tmp_path):
    path = tmp_path / "extended.toml"
    changes = {
        "effective_area": [0.2612345678901234, 0.25999999],
        "sensor_bias": {"left_height": 1.23456789e-5},
        "flow_surface": np.outer(np.linspace(1e-9, 1.23456789e-3, 8), np.ones(4)),
    }
    notes = {
        "change": {"effective_area": "as\nfitted"},
        "sensor_bias": {"left_height": "its offset"},
        "leak.left": {"area": "95 %: 0.1 to 0.3 mm2"},
        "flow_surface": {"coefficients": "flow without a name"},
    }
    effects = {"leak.left": {"area": 2.00000123e-7}}
    write_model(path, Model("astb", changes, effects), notes, digits=6)
    text = path.read_text(encoding="utf-8")
    for line in (
        '# as fitted\neffective_area = ["0.261235 m2", "0.26 m2"]',
        '# its offset\nleft_height = "0.0123457 mm"',
        '# 95 %: 0.1 to 0.3 mm2\narea = "0.2 mm2"',
        "# flow without a name\ncoefficients = [\n",
        '    ["1.23457 g/s", "1.23457 g/s", "1.23457 g/s", "1.23457 g/s"],\n]',
    ):
        assert line in text
    model = load_model(path)
    assert model.effects["leak.left"]["area"] == pytest.approx(2e-7, rel=1e-12)
    for name, value in Model("astb", changes).changes.items():
        if name != "sensor_bias":
            np.testing.assert_allclose(model.changes[name], value, rtol=5e-6)


def test_a_model_is_loaded_like_a_parameter_set(tmp_path):
    path = tmp_path / "extended.toml"
    write_model(path, FULL)
    parameters = load(path, "AW3")
    assert (parameters.name, parameters.load_case) == ("extended", "AW3")
    assert parameters.effects == FULL.effects
    record = parameters.record
    assert record.bellows_volume.tolist() == FULL.changes["bellows_volume"]
    assert record.sensor_bias[Sensor.LOAD_CELL_3] == -12.5
    assert record.nominal_preload.tolist() == [145e3, 145e3]
    assert record.leak_conductance[0] > 0.0 == record.leak_conductance[1]
    np.testing.assert_array_equal(record.load_cell_crosstalk, 1e-3 * (1.0 - np.eye(6)))
    np.testing.assert_array_equal(record.force_surface, FULL.changes["force_surface"])
    assert load(path).digest() == load(path).digest() != BASE.digest()
    drawn = BASE.as_built(3).record.sensor_bias.copy()
    drawn[Sensor.LEFT_HEIGHT], drawn[Sensor.LOAD_CELL_3] = 2e-5, -12.5
    np.testing.assert_array_equal(
        parameters.as_built(3).record.sensor_bias, drawn, "what is known is not drawn"
    )


def test_a_model_can_be_based_on_another_one_in_its_folder(tmp_path):
    write_model(tmp_path / "first.toml", Model("astb", {"bellows_volume": 0.031}, {"heat": {"change": 0.2}}))
    write_model(tmp_path / "second.toml", Model("first.toml", {}, {"crosstalk": {"share": 0.01}}))
    parameters = load(tmp_path / "second.toml")
    assert parameters.effects == {"heat": {"change": 0.2}, "crosstalk": {"share": 0.01}}
    assert parameters.record.bellows_volume.tolist() == [0.031, 0.031]


_NUMBERS = st.floats(min_value=1e-9, max_value=1e9)


@settings(max_examples=50)
@given(
    changes=st.dictionaries(
        st.sampled_from(["effective_area", "bellows_volume", "sensor_accuracy", "force_latency"]), _NUMBERS
    ),
    amplitudes=st.dictionaries(st.sampled_from([n for n, e in CATALOGUE.items() if not e.places]), _NUMBERS),
    finding=st.dictionaries(
        st.text(min_size=1).filter(str.isprintable),
        st.recursive(
            st.text(alphabet=st.characters(exclude_categories=["Cs"]))
            | st.booleans()
            | st.integers(-(2**62), 2**62)
            | st.floats(allow_nan=False, allow_infinity=False),
            lambda inner: st.lists(inner) | st.dictionaries(st.text(alphabet="ab c.", min_size=1), inner),
            max_leaves=6,
        ),
    ),
)
def test_any_model_survives(tmp_path_factory, changes, amplitudes, finding):
    path = tmp_path_factory.mktemp("models") / "any.toml"
    sensors = {name: {"left_height": value} for name, value in changes.items() if name == "sensor_accuracy"}
    effects = {name: {CATALOGUE[name].amplitude.name: value} for name, value in amplitudes.items()}
    model = Model("astb", changes | sensors, effects, finding)
    write_model(path, model)
    assert load_model(path) == model


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("based_on = 3", "based_on = 3 is not the name or the path of a parameter set"),
        (
            'based_on = "nowhere.toml"',
            "no parameter set '.*nowhere.toml': No such file or directory; check the path, or use astb",
        ),
        ('based_on = "model.toml"', "the model is based on itself"),
        ('based_on = "astb"\nchange = 3', "change = 3 is not a table"),
        ('based_on = "astb"\n[chnage]', "chnage is not a part of a model file; did you mean 'change'?"),
        (
            'based_on = "astb"\n[change]\norifice_diamter = "1 mm"',
            "orifice_diamter is not a parameter; did you mean 'orifice_diameter'",
        ),
        (
            'based_on = "astb"\n[change]\norifice_diameter = "13 bar"',
            "orifice_diameter = '13 bar' has a missing or wrong unit; use m or mm",
        ),
        (
            'based_on = "astb"\n[change]\norifice_diameter = "900 mm"',
            r"orifice_diameter\[0\] = 900 mm is outside 1 to 100 mm",
        ),
        (
            'based_on = "astb"\n[change]\nheat_density_exponent = true',
            "heat_density_exponent = True is not a number",
        ),
        (
            'based_on = "astb"\n[change]\nbellows_volume = ["1 m3", "1 m3", "1 m3"]',
            r"bellows_volume has shape \(3,\); use one number, or an array of shape \(2,\)",
        ),
        ('based_on = "astb"\n[change]\nsensor_lag = "1 ms"', "sensor_lag = '1 ms' is not a table by sensor"),
        (
            'based_on = "astb"\n[change.sensor_lag]\nleft_hight = "1 ms"',
            "left_hight is not a sensor; did you mean 'left_height'?",
        ),
        (
            'based_on = "astb"\n[change.sensor_bias]\nleft_height = "1 bar"',
            "sensor_bias.left_height = '1 bar' has a missing or wrong unit; use m or mm",
        ),
        ('based_on = "astb"\n[effect."leak.left"]', "leak.left has no area; add this amplitude"),
        (
            'based_on = "astb"\n[effect.leak]\nleft = "1 mm2"',
            "leak is not an effect; did you mean 'leak.",
        ),
        ('based_on = "astb"\n[effect]\nheat = "3 %"', "heat = '3 %' is not a table"),
        (
            'based_on = "astb"\n[effect.heat]\nchange = "3 K"',
            "heat: change = '3 K' has a missing or wrong unit; use 1 or % or ppm",
        ),
        ('based_on = "astb"\n[surface.fource]', "fource is not a surface; did you mean 'force'?"),
        (
            'based_on = "astb"\n[surface.force]\ntime = "1 s"',
            "force_surface_time is not a parameter; did you mean 'force_surface",
        ),
        ('based_on = "astb', "line 1, .*: the closing quotation mark of a text is missing"),
    ],
)
def test_what_does_not_fit_is_refused_with_the_files_name(tmp_path, text, reason):
    path = tmp_path / "model.toml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(ParameterError, match=f"model.toml.*: .*(?:{reason})"):
        load(path)


def test_effects_without_changes_make_a_file_for_sealing(tmp_path):
    path = tmp_path / "hidden.toml"
    path.write_text('[effect."leak.right"]\narea = "3 mm2"\n', encoding="utf-8")
    assert load_effects(path) == {"leak.right": {"area": pytest.approx(3e-6)}}
    for text, reason in (
        ("", r"hidden.toml: the file has nothing; use \[effect.NAME\] tables only"),
        ('based_on = "astb"\n[effect]', "hidden.toml: the file has based_on, effect;"),
        ('[effect.leek]\narea = "3 mm2"', "hidden.toml: leek is not an effect"),
    ):
        path.write_text(text, encoding="utf-8")
        with pytest.raises(ParameterError, match=reason):
            load_effects(path)
    with refuses(ParameterError, "effects"):
        load_effects(Path("nowhere"))


@pytest.mark.parametrize("value", [None, float("inf"), float("nan")])
def test_unsupported_values_of_a_model_file_are_refused(tmp_path, value):
    with pytest.raises(TypeError, match=f"a model file cannot hold {value}"):
        write_model(tmp_path / "x.toml", Model("astb", finding={"verdict": value}))
    assert not list(tmp_path.iterdir())
