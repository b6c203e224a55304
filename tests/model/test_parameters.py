"""Parameter files: complete, with provenance, and refused with name, value, unit and range."""

import tomllib
from importlib.resources import files

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bench_protocol.units import WRITTEN_UNITS
from bench_sim.model.layout import Sensor
from bench_sim.model.quantities import PARAMETERS, QUANTITIES
from bench_sim.parameters import PROVENANCES, ParameterError, load
from tests.refusals import refuses

TEXT = (files("bench_sim.parameters") / "astb.toml").read_text(encoding="utf-8")
BASE = load("astb")


@pytest.fixture
def written(tmp_path):
    """Write a changed copy of the standard set and return its path."""

    def write(old: str, new: str):
        assert TEXT.count(old) >= 1, old
        path = tmp_path / "changed.toml"
        path.write_text(TEXT.replace(old, new, 1), encoding="utf-8")
        return path

    return write


def test_every_quantity_has_its_entry():
    assert set(BASE.entries) == {quantity.name for quantity in QUANTITIES}
    for table in tomllib.loads(TEXT).values():
        for entry in table.values():
            if "provenance" in entry:
                assert entry["provenance"] in PROVENANCES
                assert len(entry["source"]) > 3


def test_units_are_converted_once():
    assert BASE.record.bellows_volume[0] == pytest.approx(0.030)
    assert BASE.record.orifice_diameter[1] == pytest.approx(0.013)
    assert BASE.record.sensor_accuracy[Sensor.LEFT_BELLOWS_PRESSURE] == pytest.approx(2500.0)
    assert BASE.record.sensor_high[Sensor.SUPPLY_PRESSURE] == pytest.approx(16.4e5)
    assert BASE.under("AW3").record.nominal_preload.tolist() == [145e3, 145e3]


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (
            "effective_area = { value = 0.26",
            "effective_area = { value = 0.9",
            r"effective_area\[0\] = 0.9 m2 is outside 0.1 to 0.5 m2",
        ),
        (
            'orifice_diameter = { value = 13.0, unit = "mm"',
            'orifice_diameter = { value = 13.0, unit = "bar"',
            "13.0 bar has the wrong unit; use m or mm",
        ),
        (
            'orifice_diameter = { value = 13.0, unit = "mm"',
            'orifice_diameter = { value = 13.0, unit = "inch"',
            "13.0 inch has the wrong unit; use m",
        ),
        (
            "orifice_diameter = {",
            "orifice_diametre = {",
            "orifice_diametre is not a parameter; did you mean 'orifice_diameter'?",
        ),
        ('provenance = "data sheet"', 'provenance = "rumour"', "provenance = 'rumour'"),
        (
            "effective_area = { value = 0.26",
            "effective_area = { value = nan",
            "effective_area.* = nan; use a finite number",
        ),
        (
            "effective_area = { value = 0.26",
            'effective_area = { value = "big"',
            "effective_area = 'big' is not a number",
        ),
        (
            "effective_area = { value = 0.26",
            "effective_area = { value = [0.26, 0.26, 0.26]",
            r"has shape \(3,\); use one number, or an array of shape \(2,\)",
        ),
        (
            "[load_case.AW0]",
            "[sensor.hight]\n[load_case.AW0]",
            "hight is not a kind of sensor; did you mean 'height'?",
        ),
        (
            "[load_case.AW0]",
            "[sensor.height]\nnose = 1\n[load_case.AW0]",
            r"sensor\.height\.nose is not a parameter; use one of accuracy.* noise",
        ),
        (
            "dpv_reclosing = { value = 1.0",
            "dpv_reclosing = { value = 1.3",
            "dpv_reclosing = 130000.0 exceeds dpv_opening = 120000.0",
        ),
        ("gas_constant = {", "# gas_constant = {", "gas_constant is missing"),
        ("[load_case.AW0]", "[load_case.AW0]\nmass = 3", "load case AW0 has"),
    ],
)
def test_invalid_parameters_are_refused(written, old, new, message):
    with pytest.raises(ParameterError, match=f"changed.toml.*{message}"):
        load(written(old, new))


def test_a_table_of_sensors_changes_only_its_own_entries(written):
    noise = '{ value = 0.02, unit = "mm", min = 0.0, max = 1.0, provenance = "assumed", source = "ours" }'
    changed = load(written("[load_case.AW0]", f"[sensor.height]\nnoise = {noise}\n[load_case.AW0]"))
    heights = [Sensor.LEFT_HEIGHT, Sensor.RIGHT_HEIGHT]
    assert changed.record.sensor_noise[heights] == pytest.approx(2e-5)
    assert changed.with_values(sensor_noise=BASE.record.sensor_noise).digest() == BASE.digest()


def test_unknown_set_and_load_case():
    with refuses(ParameterError, "parameter"):
        load("nowhere")
    with refuses(ParameterError, "AW7 load"):
        load("astb", "AW7")


def test_changed_copies():
    changed = BASE.with_values(orifice_diameter=0.014, bellows_volume=[0.030, 0.031])
    assert changed.record.orifice_diameter.tolist() == [0.014, 0.014]
    assert changed.record.bellows_volume.tolist() == [0.030, 0.031]
    assert BASE.record.orifice_diameter.tolist() == pytest.approx([0.013, 0.013])
    assert changed.digest() != BASE.digest()
    assert (
        changed.with_values(
            orifice_diameter=BASE.record.orifice_diameter, bellows_volume=BASE.record.bellows_volume
        ).digest()
        == BASE.digest()
    )
    assert BASE.under("AW3").digest() != BASE.digest()
    with refuses(ParameterError, "sensor_bias[left_height] 1 m -0.1 0.1 m"):
        BASE.with_values(sensor_bias={Sensor.LEFT_HEIGHT: 1.0})
    with refuses(ParameterError, "orifice_diamter 'orifice_diameter'"):
        BASE.with_values(orifice_diamter=0.014)


@given(
    st.sampled_from([q.name for q in QUANTITIES if q.name != "load_cell_crosstalk"]),
    st.floats(allow_nan=True, allow_infinity=True),
)
def test_a_value_is_either_inside_its_range_or_refused(name, value):
    entry = BASE.entries[name]
    try:
        record = BASE.with_values(**{name: value}).record
    except ParameterError as error:
        assert name in str(error)
        return
    assert np.all(record[name] == value)
    assert np.all(value >= entry.low) and np.all(value <= entry.high)


def test_a_rig_as_built_differs_within_the_accuracy_of_its_sensors():
    one, again, other = BASE.as_built(1), BASE.as_built(1), BASE.as_built(2)
    assert one.digest() == again.digest() != other.digest()
    assert np.all(np.abs(one.record.sensor_bias) <= BASE.record.sensor_accuracy)
    assert np.any(one.record.sensor_bias != 0.0)


def test_the_record_has_only_doubles_and_units_are_unambiguous():
    assert all(PARAMETERS[name].base == np.float64 for name in PARAMETERS.names)
    for unit, (si, factor, _) in WRITTEN_UNITS.items():
        assert factor > 0.0, unit
        assert WRITTEN_UNITS[si] == (si, 1.0, 0.0)
