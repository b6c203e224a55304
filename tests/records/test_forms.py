"""The tables of forms agree with each other, with the page of readers and with what a name can say."""

from collections import Counter
from pathlib import Path

from bench_protocol.file_forms import FileForm, form_of
from bench_records.tables import forms as tables
from drivers.can_files import reading
from tools.generate.readers_page import readers_page


def test_an_ending_says_one_form_of_tables_and_one_of_logs() -> None:
    for forms in (tables.FORMS, reading.FORMS):
        assert max(Counter(ending for one in forms for ending in one.endings).values()) == 1
        for one in forms:
            for ending in one.endings:
                for name in (f"a{ending}", f"a.b{ending.upper()}", f"a{ending}.gz"):
                    assert form_of(Path(name), forms) is one


def test_what_is_read_has_its_forms_on_the_page() -> None:
    page = readers_page()
    for one in (*tables.FORMS, *reading.FORMS):
        assert one.read is None or one.name.lower() in page.lower()


def test_a_file_is_known_by_what_is_in_it_before_its_ending(tmp_path) -> None:
    own = FileForm("own", (), recognises=lambda path: path.read_bytes().startswith(b"own"))
    path = tmp_path / "a.csv"
    path.write_bytes(b"own 1")
    assert form_of(path, [*tables.FORMS, own]) is own
    path.write_bytes(b"time_s\n1\n")
    assert form_of(path, [*tables.FORMS, own]) is tables.FORMS[0]
