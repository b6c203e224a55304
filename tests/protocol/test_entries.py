"""Every kind of file refuses the same wrong entries, and takes the same right ones."""

from pathlib import Path

import pytest

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
    "no unit": ("unit = ", "units = ", "it needs"),
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
