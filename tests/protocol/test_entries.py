"""Every kind of file refuses the same wrong entries, and takes the same right ones."""

import re
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from bench_protocol.dimensions import DimensionsError, read_dimensions
from bench_protocol.entries import EntryError, read_entry
from bench_protocol.named_files import named_files
from bench_sim import parameters
from bench_sim.parameters import ParameterError, load
from test_plans.instruments import InstrumentsError, read_instruments
from test_plans.specimen import SpecimenError, read_specimen
from tests.refusals import refuses

#: Of each kind of file: its reader, its error, and the line of one entry.
FILES = {
    "dimensions": (read_dimensions, DimensionsError, named_files("dimensions")["local"], "bolster_mass = "),
    "instruments": (read_instruments, InstrumentsError, named_files("instruments")["local"], "offset = "),
    "specimen": (read_specimen, SpecimenError, named_files("specimens")["astb"], "bellows_volume = "),
    "parameters": (
        load,
        ParameterError,
        Path(parameters.__file__).with_name("astb.toml"),
        "orifice_diameter = ",
    ),
}
#: The change of the entry, and the error's text.
WRONG = {
    "unit": ('unit = "', 'unit = "k', "wrong unit"),
    "no unit": ("unit = ", "units = ", "units is not a key of this entry; use"),
    "provenance": ('provenance = "', 'provenance = "un', "use one of measured, data sheet"),
    "source": ('source = "', 'source = " "  # ', "source is empty"),
    "number": ("value = ", 'value = "x"  # ', "x"),
}


def text_of(kind):
    """Return the file of a kind, and the line of its entry."""
    _, _, path, begins = FILES[kind]
    text = path.read_text(encoding="utf-8")
    (line, *_) = (line for line in text.splitlines() if line.startswith(begins))
    return text, line


@pytest.mark.parametrize("wrong", WRONG)
@pytest.mark.parametrize("kind", FILES)
def test_a_wrong_entry_is_refused_with_file_and_key(kind, wrong, tmp_path):
    reader, error, _, begins = FILES[kind]
    text, line = text_of(kind)
    old, new, told = WRONG[wrong]
    before, mark, rest = line.partition(old)
    assert mark
    # The rest of the old part is a comment no more: it ends at the next comma.
    part, comma, after = rest.partition(", ") if "#" in new else (rest, "", "")
    changed = before + (new.partition("  #")[0] + (comma + after or " }") if "#" in new else new + part)
    path = tmp_path / "mine.toml"
    path.write_text(text.replace(line, changed, 1), encoding="utf-8")
    with pytest.raises(error) as refused:
        reader(path)
    assert "mine.toml" in str(refused.value)
    assert begins.removesuffix(" = ") in str(refused.value)
    assert told in str(refused.value)


@pytest.mark.parametrize("raw", [3, [], "3 mm", None, {}, {"value": 3}])
def test_what_is_no_entry_is_refused(raw):
    with refuses(EntryError, "table.key"):
        read_entry("table.key", raw, "m")


@pytest.mark.parametrize("value", [True, "3", float("nan"), float("inf"), [3.0]])
def test_what_is_no_finite_number_is_refused(value):
    entry = read_entry("key", {"value": value, "unit": "mm", "provenance": "measured", "source": "tape"}, "m")
    with refuses(EntryError, "key.value"):
        entry.si()


def test_a_value_is_converted_to_si():
    raw = {"value": 3, "unit": "mm", "provenance": "measured", "source": "tape"}
    assert read_entry("key", raw, "m").si() == pytest.approx(3e-3, rel=1e-15)


#: A number of an entry, with its key.
_STATED = re.compile(r"\b(value|uncertainty|low|high|expected|tolerance|min|max) = (-?[0-9.]+)(?=,)")
#: Every number of the supplied files: kind, file, and place of the number in its text.
NUMBERS = [
    (kind, path, found.span(2))
    for kind, paths in {
        **{kind: (FILES[kind][2],) for kind in ("dimensions", "instruments", "parameters")},
        "specimen": named_files("specimens").values(),
    }.items()
    for path in paths
    for found in _STATED.finditer(path.read_text(encoding="utf-8"))
]
_BOTH_SIGNS = st.sampled_from((-1.0, 1.0))
_EXTREME = st.sampled_from((0.0, 5e-324, 1e-30, 1e-9, 1e9, 1e30, 1e300, 1.7e308, float("inf"), float("nan")))


def _check_number(kind, path, place, number, folder):
    """Check that the file with another number is read, or refused with the names of the file and the key."""
    reader, error, _, _ = FILES[kind]
    text = path.read_text(encoding="utf-8")
    begin, end = place
    mine = folder / "mine.toml"
    mine.write_text(text[:begin] + repr(number) + text[end:], encoding="utf-8")
    try:
        found = reader(mine)
    except error as refused:
        assert "mine.toml" in str(refused)
    else:
        if kind == "specimen":
            assert all(found.pressure_for(load.preload) > 0.0 for load in found.loads.values())


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None, max_examples=40)
@given(st.sampled_from(NUMBERS), _BOTH_SIGNS, _EXTREME | st.floats())
def test_a_file_with_any_number_is_read_or_refused_by_its_name(tmp_path, entry, sign, number):
    _check_number(*entry, sign * number, tmp_path)


@pytest.mark.parametrize("limit", ["10.0", "1.7e308"])
def test_a_parameter_that_is_too_large_for_si_is_refused(limit, tmp_path):
    text = FILES["parameters"][2].read_text(encoding="utf-8")
    line = 'dpv_opening = { value = 1.2, unit = "bar", min = 0.01, max = 10.0,'
    changed = line.replace("1.2", "1.7e308").replace("10.0", limit)
    assert line in text
    (tmp_path / "mine.toml").write_text(text.replace(line, changed), encoding="utf-8")
    with pytest.raises(ParameterError, match=r"mine\.toml.*dpv_opening"):
        load(tmp_path / "mine.toml")


@pytest.mark.parametrize("number", [-1.0, 0.0, 1e300])
@pytest.mark.parametrize(
    "key", ["bellows_volume", "effective_area", "emergency_stiffness_lateral", "preload"]
)
def test_an_impossible_property_of_a_specimen_is_refused_with_key_and_value(key, number, tmp_path):
    text = named_files("specimens")["astb"].read_text(encoding="utf-8")
    changed, count = re.subn(rf"^({key} = {{ value = )[0-9.]+", rf"\g<1>{number}", text, flags=re.MULTILINE)
    assert count
    (tmp_path / "mine.toml").write_text(changed, encoding="utf-8")
    with pytest.raises(SpecimenError, match=rf"mine\.toml: .*{key} = {number:g} .*use ".replace("+", r"\+")):
        read_specimen(tmp_path / "mine.toml")
