"""The paper's parameter file: complete, with provenance, refused as the plant's is, and in agreement with it."""

from dataclasses import fields
from importlib.resources import files

import numpy as np
import pytest

from astb_studies.paper.closed_form import PaperParameters, diaphragm_stiffness
from astb_studies.paper.parameters import load_paper
from astb_studies.paper.wind import Crosswind
from bench_sim.parameters import PROVENANCES, ParameterError, load
from tests.refusals import refuses

TEXT = (files("astb_studies.paper") / "paper.toml").read_text(encoding="utf-8")


def test_every_field_has_its_entry():
    base = load_paper()
    assert set(base.entries) == {one.name for kind in (PaperParameters, Crosswind) for one in fields(kind)}
    for entry in base.entries.values():
        assert entry.provenance in PROVENANCES
        assert len(entry.source) > 3
        assert entry.low <= entry.value <= entry.high


def test_units_are_converted_once():
    base = load_paper()
    assert base.spring.bellows_volume == pytest.approx(0.030)
    assert base.spring.orifice_diameter == pytest.approx(0.013)
    assert base.spring.roll_scale == pytest.approx(0.025)
    assert base.wind.train_speed == pytest.approx(100.0 / 3.6)
    assert base.wind.stall_angle == pytest.approx(np.pi / 3.0)
    assert base.load_case == "AW0"
    assert (
        base.under("AW3").spring.nominal_preload
        == load_paper(load_case="AW3").spring.nominal_preload
        == 145e3
    )


def test_common_parameters_of_both_layers_are_equal():
    """The same spring described twice."""
    plant, paper = load("astb").record, load_paper()
    for name in (
        "gas_constant",
        "heat_capacity_ratio",
        "atmospheric_pressure",
        "effective_area",
        "bellows_volume",
        "auxiliary_volume",
        "column_height",
        "orifice_diameter",
        "discharge_coefficient",
        "laminar_limit",
        "nominal_preload",
    ):
        np.testing.assert_array_equal(plant[name], paper.entries[name].value, err_msg=name)
    assert paper.spring.gas_temperature == plant["ambient_temperature"]


def test_arrays_for_sensitivity_studies():
    base = load_paper()
    spring = base.with_values(lateral_area=[0.07, 0.08, 0.09], volume_growth=np.full((4, 1), 30.0)).spring
    assert np.shape(diaphragm_stiffness(0.02, spring.pressure, spring)) == (4, 3)
    assert base.spring.lateral_area == 0.0835, "the base stays as it is"


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"lateral_area": 0.9}, "lateral_area 0.9 m2 0.01 0.3 m2"),
        ({"lateral_area": [0.1, 0.9]}, "lateral_area[1] 0.9 m2 0.01 0.3 m2"),
        ({"train_speed": 200.0}, "train_speed 720 km/h 0 500 km/h"),
        ({"stall_angle": np.nan}, "stall_angle nan 5 90 deg"),
        ({"side_area": [50.0, 60.0]}, "side_area (2,)"),
        ({"lateral_aera": 0.1}, "lateral_aera 'lateral_area'"),
    ],
)
def test_changes_that_do_not_fit(change, message):
    with refuses(ParameterError, message):
        load_paper().with_values(**change)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("value = 0.0835", "value = 0.5", "lateral_area 0.5 m2"),
        ('value = 7.0, unit = "1/m2"', 'value = 7.0, unit = "m2"', "lateral_area_decay 7.0 m2 1/m2"),
        ("lateral_area = {", "lateral_aera = {", "lateral_aera 'lateral_area'"),
        ("roll_scale = {", "roll_hardening = {", "table"),
        (
            'source = "stated in the paper" }\n\n[load_case.AW3]',
            'source = " " }\n\n[load_case.AW3]',
            "source",
        ),
        ("[load_case.AW3]\nnominal_preload", "[load_case.AW3]\npreload", "AW3 nominal_preload"),
        ("[gas]\n", "loose = 1\n[gas]\n", "outside"),
        ("[wind]\n", "[wind", "paper_changed.toml TOML 48"),
    ],
)
def test_files_that_do_not_fit(tmp_path, old, new, message):
    assert TEXT.count(old) == 1, old
    path = tmp_path / "paper_changed.toml"
    path.write_text(TEXT.replace(old, new), encoding="utf-8")
    with refuses(ParameterError, message) as error:
        load_paper(path)
    assert "paper_changed.toml" in str(error.value)


def test_missing_parts(tmp_path):
    with refuses(ParameterError, "'nowhere'"):
        load_paper("nowhere")
    with refuses(ParameterError, "AW7 load"):
        load_paper().under("AW7")
    with refuses(ParameterError, "AW7 load"):
        load_paper(load_case="AW7")
    path = tmp_path / "short.toml"
    path.write_text(TEXT.split("[load_case.AW0]", maxsplit=1)[0], encoding="utf-8")
    with refuses(ParameterError, "short.toml train_speed"):
        load_paper(path)
    path.write_text(
        TEXT.split("[load_case.AW0]", maxsplit=1)[0] + "[wind]" + TEXT.split("[wind]")[1], encoding="utf-8"
    )
    with refuses(ParameterError, "load"):
        load_paper(path)
