"""Generated and checked-in files equal the tables."""

import re

import pytest

from astb.plugins import offers, own_summaries
from bench_protocol.signals import Group
from bench_protocol.table_signals import BY_GROUP
from test_plans.instruments import ordinary, read_instruments
from tools.generate import instruments_file
from tools.generate.files import ROOT, commands_page, files


@pytest.mark.parametrize("path", files(), ids=lambda path: path.name)
def test_generated_files_are_up_to_date(path: object) -> None:
    assert path.read_text(encoding="utf-8") == files()[path], (
        f"run `make generate` ({path.relative_to(ROOT)})"
    )


def test_generation_leaves_the_commands_of_other_packages(monkeypatch):
    monkeypatch.setitem(offers(), "foreign-command", {"other-package": "nowhere:command"})
    before = dict(offers()), dict(own_summaries())
    assert "foreign-command" not in commands_page()
    assert (offers(), own_summaries()) == before


def test_what_the_file_of_instruments_lacks_comes_from_the_row_of_its_group(tmp_path, monkeypatch):
    whole = instruments_file.INSTRUMENTS_FILE.read_text(encoding="utf-8")
    assert instruments_file.lacking_instruments() == []
    table = re.search(r"\[instrument\.thermometer\]\n(?:\S.*\n)+\n", whole)[0]
    lines = "".join(re.findall(r'.*instrument = "thermometer".*\n', whole))
    path = tmp_path / "astb.toml"
    path.write_text(whole.replace(table, "").replace(lines, ""), encoding="utf-8")
    monkeypatch.setattr(instruments_file, "INSTRUMENTS_FILE", path)
    lacks = instruments_file.lacking_instruments()
    assert len(lacks) == 1 + len(BY_GROUP[Group.TEMPERATURE])
    assert all("row temperature" in one for one in lacks)
    path.write_text(instruments_file.instruments_file(), encoding="utf-8")
    assert instruments_file.lacking_instruments() == []
    numbers = ("offset", "gain", "lag", "resolution", "noise")
    for name, piece in read_instruments(path).pieces.items():
        before = ordinary().pieces[name].instrument
        for number in numbers:
            assert getattr(piece.instrument, number) == pytest.approx(getattr(before, number)), (name, number)
