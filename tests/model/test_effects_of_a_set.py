"""Effects in a parameter set: read as people write them, refused in words, and applied once to every copy."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bench_protocol.units import WRITTEN_UNITS
from bench_protocol.written_values import fitting_unit, write_value
from bench_sim.model.effects import CATALOGUE
from bench_sim.model.layout import Input, Sensor, State
from bench_sim.model.plant import Plant
from bench_sim.parameters import ParameterError, load
from bench_sim.parameters.effects import read_effect_text, with_effects
from bench_sim.parameters.loading import read_value
from tests.refusals import refuses

BASE = load("astb")
NAMES = [
    f"{effect.name}.{place}" if place else effect.name
    for effect in CATALOGUE.values()
    for place in effect.places or ("",)
]


def parse_effect(text):
    """Return name and values of an effect like ``leak.left=0.2mm2``."""
    name, _, values = text.partition("=")
    return name.strip(), read_effect_text(name.strip(), values)


def at_once():
    """A set with every effect of the catalogue, at every place."""
    sizes = {name: CATALOGUE[name.partition(".")[0]].amplitude for name in NAMES}
    return with_effects(BASE, {name: {one.name: one.typical} for name, one in sizes.items()})


def test_all_effects_fit_into_one_bench_which_runs_on():
    plant = Plant.at_rest(at_once().record)
    plant.inputs[[Input.LEFT_LEVELING, Input.RIGHT_LEVELING, Input.DPV_CONNECTED]] = 1.0
    start = plant.inputs[Input.VERTICAL_LEFT_COMMAND]
    for k in range(500):
        plant.inputs[Input.VERTICAL_LEFT_COMMAND] = start + 500.0 * np.sin(0.04 * k)
        plant.inputs[Input.PLATFORM_LATERAL] = 2e-3 * np.sin(0.02 * k)
        plant.step()
        readings = plant.measure()
        assert np.all(np.isfinite(readings)) and np.all(np.isfinite(plant.state)), f"step {k}"
    assert np.all(plant.state[[State.BELLOWS_MASS, State.BELLOWS_MASS + 1]] > 0.0)


def test_rubber_that_finds_no_room_is_refused():
    full = BASE.with_values(extra_friction=10.0)
    with refuses(ParameterError, "friction"):
        with_effects(full, {"friction": {"force": 100.0}})


def test_every_quantity_has_a_unit_that_can_be_written():
    for effect in CATALOGUE.values():
        for one in effect.parameters:
            assert WRITTEN_UNITS[one.display][:2] == (one.unit, one.scale), f"{effect.name}: {one.name}"


@pytest.mark.parametrize("name", NAMES)
def test_what_is_written_is_read(name):
    effect = CATALOGUE[name.partition(".")[0]]
    amplitude = effect.amplitude
    text = f"{name}={amplitude.typical / amplitude.scale!r} {amplitude.display}"
    found, values = parse_effect(text)
    assert found == name
    assert values == {amplitude.name: pytest.approx(amplitude.typical)}
    parameters = with_effects(BASE, {name: values})
    assert parameters.digest() != BASE.digest()
    assert parameters.effects[name] == {one.name: one.nominal for one in effect.shapes} | values
    assert with_effects(BASE, {name: {amplitude.name: 0.0}}).digest() == BASE.digest()


def test_shapes_follow_the_amplitude_and_spaces_do_not_matter():
    expected = "maxwell", {"ratio": 0.1, "time": pytest.approx(0.5)}
    assert parse_effect("maxwell=0.1,time=0.5s") == expected
    assert parse_effect(" maxwell = 10 % , time = 500 ms ") == expected
    assert parse_effect("leak.left=0.2mm2") == ("leak.left", {"area": pytest.approx(2e-7)})


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("leek.left=1mm2", "leek.left 'leak"),
        ("xyzzy=1", "effect"),
        ("leak=1mm2", "'leak"),
        ("leak.top=1mm2", "leak.top 'leak"),
        ("heat.left=10%", "heat.left 'heat'"),
        ("leak.left=1", "leak.left area '1' m2 mm2 cm2"),
        ("leak.left=1 mm", "leak.left area '1 mm' m2 mm2 cm2"),
        ("leak.left=wide", "leak.left area 'wide' m2 mm2 cm2"),
        ("leak.left=", "leak.left area ''"),
        ("leak.left=-1mm2", "leak.left area -1 mm2 0 mm2 20 mm2"),
        ("leak.left=300mm2", "leak.left area 300 mm2 0 mm2 20 mm2"),
        ("leak.left=nan mm2", "leak.left area nan mm2"),
        ("leak.left=inf mm2", "leak.left area 'inf mm2'"),
        ("leak.left=1mm2,2mm2", "leak.left '1mm2,2mm2' NAME[.PLACE]"),
        ("leak.left=1mm2,area=2mm2", "cannot be read"),
        ("maxwell=0.1,tmie=1s", "'time'"),
        ("maxwell=0.1,time=1000s", "maxwell time 1000 s 0.005 s 30 s"),
    ],
)
def test_invalid_effects_are_refused(text, reason):
    with refuses(ParameterError, reason):
        name, values = parse_effect(text)
        with_effects(BASE, {name: values})


def test_an_effect_needs_its_amplitude_and_is_given_once():
    with refuses(ParameterError, "amplitude"):
        with_effects(BASE, {"maxwell": {"time": 1.0}})
    once = with_effects(BASE, {"heat": {"change": 0.1}})
    with refuses(ParameterError):
        with_effects(once, {"heat": {"change": 0.1}})
    both = with_effects(once, {"crosstalk": {"share": 0.01}})
    assert list(both.effects) == ["heat", "crosstalk"]


def test_together_effects_and_values_stay_within_the_ranges_of_the_parameters():
    near = BASE.with_values(sensor_bias={Sensor.LEFT_BELLOWS_PRESSURE: 4.9e5})
    with refuses(ParameterError, "pressure_offset.left sensor_bias[left_bellows_pressure] 590000 Pa"):
        with_effects(near, {"pressure_offset.left": {"offset": 1e5}})


def test_every_copy_has_the_effects_once():
    healthy = BASE.as_built(5).record.sensor_bias
    effect = {"pressure_offset.left": {"offset": 900.0}}
    for copy in (
        with_effects(BASE, effect).as_built(5),
        with_effects(BASE.as_built(5), effect),
        with_effects(BASE, effect).as_built(5).under("AW0"),
        with_effects(BASE, effect).as_built(5).with_values(orifice_diameter=0.013),
    ):
        change = np.zeros(len(Sensor))
        change[Sensor.LEFT_BELLOWS_PRESSURE] = 900.0
        np.testing.assert_allclose(copy.record.sensor_bias - healthy, change, atol=1e-9)
    assert BASE.effects == {}


@given(
    st.sampled_from(sorted(WRITTEN_UNITS)),
    st.floats(min_value=-1e12, max_value=1e12, allow_nan=False),
)
def test_a_number_is_read_as_it_was_written(unit, number):
    si = WRITTEN_UNITS[unit].si
    for written in (write_value(number, si, unit), write_value(number, si, fitting_unit(number, si))):
        assert read_value("x", written, si) == number


def test_numbers_are_written_in_units_that_people_read():
    assert write_value(2e-7, "m2", "mm2") == "0.2 mm2"
    assert [
        write_value(x, si, fitting_unit(x, si)) for x, si in ((13 * 1e-3, "m"), (206e3, "Pa"), (0.63, "1"))
    ] == [
        "13.0 mm",
        "2.06 bar",
        "0.63",
    ]
