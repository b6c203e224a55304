"""Whatever does not fit into a map, a rig file, a transport or `--table`: the key, its value, and our own words."""

import copy
import random
from pathlib import Path
from typing import Any

import msgspec
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from astb import rig_file
from astb.campaigns.campaign_file import CampaignFile
from bench_protocol.misfit import Misfits, converted, misfit
from bench_records.importing import import_keys
from bench_records.layout import RecordError
from diagnosis.contracts import DiagnosisError
from diagnosis.systems.map_file import Map, read_map
from drivers.errors import WiringError
from drivers.wiring.modbus.keys import read_keys
from tests.refusals import refuses

MAP = {
    "system": "piston",
    "columns": {"x": {"column": "a", "unit": "mm", "sign": 1, "group": 3}, "p": {"column": 2, "unit": "bar"}},
    "time": {"column": "t", "unit": "ms", "date": "d"},
    "file": {"decimal": ",", "header": True, "skip_rows": 2},
    "runs": {"cut": "time", "length": "1 s", "role": [{"role": "fit", "runs": [1, 2]}]},
    "file_settings": [{"files": "a*", "settings": {"bore": "25 mm"}}],
}
WRONG = (3, -3, 2.5, True, "word", ["a"], {"b": {"c": 1}}, [[]])
OF_THE_LIBRARY = ("Expected", "Object", "got ", "`", "$", "Invalid", "enum", "msgspec", "array", "null")


def changed(content: dict[str, Any], rng: random.Random) -> tuple[dict[str, Any], str]:
    """Something else at one place, or a key that there is not, or one less; and the last key of the place."""
    content = copy.deepcopy(content)
    table: Any = content
    key: Any = rng.choice(list(table))
    while isinstance(table[key], dict | list) and table[key] and rng.random() < 0.8:
        table = table[key]
        key = rng.choice(list(table)) if isinstance(table, dict) else rng.randrange(len(table))
    kind = rng.random()
    if kind < 0.15 and isinstance(table, dict):
        table["colour"] = 1
        return content, "colour"
    if kind < 0.3 and isinstance(table, dict):
        del table[key]
    else:
        table[key] = rng.choice(WRONG)
    return content, str(key)


@pytest.mark.parametrize("kind", [Map, CampaignFile, rig_file.RigFile])
def test_unsuitable_values_raise_our_error(kind: Any) -> None:
    contents = {
        Map: MAP,
        CampaignFile: {"plans": ["air"], "seeds": [3], "specimens": ["a"], "variants": [{"name": "a"}]},
        rig_file.RigFile: {"name": "a", "can": {"port": 3}, "modbus": {"unit": 1}, "simulation": {"seed": 1}},
    }
    rng, told = random.Random(7), 0
    for _ in range(600):
        content, key = changed(contents[kind], rng)
        try:
            msgspec.convert(content, kind)
        except msgspec.ValidationError as error:
            said = misfit(error, content, kind)
            words = said.replace(", null,", ",")  # a key of a map
            assert not [word for word in OF_THE_LIBRARY if word in words], f"{error}: {said}"
            assert key in said, f"{error}: {said}"
            told += 1
    assert told > 100


def test_the_sentence_says_key_value_and_what_would_be_right(tmp_path: Path) -> None:
    path = tmp_path / "map.toml"
    path.write_text(
        'system = "piston"\n[columns.x]\ncolumn = 1\nunit = "mm"\n[columns.p]\ncolumn = 1.5\nunit = "m"\n'
    )
    with refuses(DiagnosisError, "map.toml columns.p.column 1.5"):
        read_map(path)
    with refuses(RecordError, "--table raw 'maybe'"):
        import_keys(["raw=maybe"])
    with refuses(RecordError, "--table decimal ';'"):
        import_keys(["decimal=;"])
    with refuses(WiringError, "plc unit 'x'"):
        read_keys("plc", {"kind": "modbus", "host": "h", "points": {}, "unit": "x"})


#: Where something is wrong in a map, and the key that its error names.
MISTAKES = {
    "columns.x.unti": 1,
    "columns.x.unit": 5,
    "columns.p.sign": 7,
    "columns.p.resolution": 2,
    "time.longest": "3 s",
    "runs.cut": "sometimes",
    "runs.skip": 2.5,
    "colour": "red",
}


@settings(max_examples=60, deadline=None)
@given(st.sets(st.sampled_from(sorted(MISTAKES)), min_size=1))
def test_every_mistake_is_reported_once_and_no_other(wrong: set[str]) -> None:
    content = copy.deepcopy(MAP)
    for name in wrong:
        table: Any = content
        *way, last = name.split(".")
        for key in way:
            table = table[key]
        table[last] = MISTAKES[name]
    with pytest.raises(Misfits) as found:
        converted(content, Map)
    assert {text.split(" ")[0] for text in found.value.texts} == wrong
    assert len(found.value.texts) == len(wrong)
    assert converted(MAP, Map) == msgspec.convert(MAP, Map)
