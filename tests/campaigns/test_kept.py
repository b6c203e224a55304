"""What a campaign keeps: complete parts only, each row once, whatever happens between two of them."""

import pandas as pd
import pytest

from astb.campaigns.kept import PARTS, KeptError, KeptRows, read_rows
from tests.refusals import refuses


def test_rows_come_back_with_the_columns_of_all_of_them(tmp_path):
    rows = [
        {"key": "a", "number": 1, "checks": [{"name": "x", "low": None}], "none": {}},
        {"key": "b", "number": 1.5, "checks": [{"name": "y", "low": 2.0, "note": "n"}], "more": "text"},
    ]
    with KeptRows(tmp_path) as kept:
        for row in rows:
            kept.add(row)
    first, second = read_rows(tmp_path)
    assert first["number"] == 1 and second["number"] == 1.5
    assert first["checks"] == [{"name": "x", "low": None, "note": None}]
    assert second["checks"] == rows[1]["checks"]
    assert (first["more"], second["more"], first["none"]) == (None, "text", None)
    assert list(pd.read_parquet(tmp_path)["key"]) == ["a", "b"]  # by an independent library


def test_a_row_is_on_the_disk_when_it_has_been_added(tmp_path):
    with KeptRows(tmp_path) as kept:
        for number in range(3):
            kept.add({"key": str(number)})
            assert [row["key"] for row in read_rows(tmp_path)] == [str(n) for n in range(number + 1)]


def test_many_parts_become_one_and_keep_every_row(tmp_path):
    with KeptRows(tmp_path) as kept:
        for number in range(PARTS + 3):
            kept.add({"key": f"{number:04}", "number": number})
        assert len(list(tmp_path.glob("part-*"))) < 5
    assert [row["number"] for row in read_rows(tmp_path)] == list(range(PARTS + 3))
    assert len(list(tmp_path.glob("part-*"))) == 1


def test_a_part_that_was_not_finished_is_never_read(tmp_path):
    with KeptRows(tmp_path) as kept:
        kept.add({"key": "a"})
        (tmp_path / ".part-000007.parquet").write_bytes(b"PAR1 half of")
        assert [row["key"] for row in read_rows(tmp_path)] == ["a"]
    assert list(pd.read_parquet(tmp_path)["key"]) == ["a"]
    with KeptRows(tmp_path) as kept:
        assert kept.keys == {"a"}
    assert not list(tmp_path.glob(".part-*"))


def test_joining_that_was_cut_short_leaves_each_row_once(tmp_path):
    with KeptRows(tmp_path) as kept:
        kept.add({"key": "a", "n": 1})
        kept.add({"key": "b", "n": 2})
        old = {path.name: path.read_bytes() for path in tmp_path.glob("part-*")}
    for name, content in old.items():  # as if the parts had been joined and not yet removed
        (tmp_path / name).write_bytes(content)
    assert [(row["key"], row["n"]) for row in read_rows(tmp_path)] == [("a", 1), ("b", 2)]
    with KeptRows(tmp_path):
        assert len(pd.read_parquet(tmp_path)) == 2


def test_one_campaign_at_a_time(tmp_path):
    with KeptRows(tmp_path), refuses(KeptError, "campaign"):
        KeptRows(tmp_path)
    KeptRows(tmp_path).close()


def test_an_unrelated_directory_is_refused_and_unchanged(tmp_path):
    (tmp_path / "part-000000.parquet").write_text("my own notes")
    with refuses(KeptError, "campaign"):
        KeptRows(tmp_path)
    assert (tmp_path / "part-000000.parquet").read_text() == "my own notes"


@pytest.mark.parametrize(
    ("row", "said"), [({"key": "b", "n": "text"}, "types"), ({"key": "b", "n": object()}, "stored")]
)
def test_a_row_that_does_not_fit_is_refused_in_words(tmp_path, row, said):
    with KeptRows(tmp_path) as kept:
        kept.add({"key": "a", "n": 1})
        with refuses(ValueError, said):
            kept.add(row)
    assert [row["key"] for row in read_rows(tmp_path)] == ["a"]


def test_a_third_party_data_set_is_refused_and_unchanged(tmp_path):
    theirs = tmp_path / "part-000.parquet"
    pd.DataFrame({"temperature": [293.0]}).to_parquet(theirs)
    with refuses(KeptError, "campaign"):
        KeptRows(tmp_path)
    assert list(pd.read_parquet(theirs)["temperature"]) == [293.0]


def test_unrelated_files_are_ignored(tmp_path):
    (tmp_path / "part-of-my-thesis.parquet").write_text("notes")
    with KeptRows(tmp_path) as kept:
        kept.add({"key": "a"})
    assert [row["key"] for row in read_rows(tmp_path)] == ["a"]
    assert (tmp_path / "part-of-my-thesis.parquet").read_text() == "notes"
