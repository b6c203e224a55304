"""Notes are added to a run and touch nothing of it; a letterhead stands above a report, and only a sound one."""

import base64
import hashlib
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from bench_records.checksums import broken_files, write_sums
from bench_records.index import RunIndex
from bench_records.layout import RecordError
from bench_records.letterhead import CHOSEN, Letterhead, read_letterhead
from bench_records.notes import NOTES, Note, add_note, is_as_added, notes_of
from bench_records.recorder import Recorder
from bench_records.report import write_report
from bench_records.result import check, conclude
from tests.refusals import refuses

#: One transparent pixel.
PNG = base64.b64decode(
    "iVBORw0KGgoAAAANSUhEUgAAAAEAAAABCAYAAAAfFcSJAAAADUlEQVR42mNk+M9QDwADhgGAWjR9awAAAABJRU5ErkJggg=="
)


@pytest.fixture
def signed(tmp_path: Path) -> Path:
    directory = tmp_path / "runs" / "aw0"
    with Recorder(directory, [], {"plan": "aw0"}, start_ns=0) as recorder:
        recorder.event(1_000_000_000, "state", "ACTIVE")
    conclude("aw0", "Title", "Text", [check("K", 1.0, "N", low=0.0)], rig="hall").write(directory)
    write_report(directory)
    write_sums(directory)
    return directory


def content(directory: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in directory.iterdir() if path.is_file()}


def test_a_note_changes_no_signed_file(signed: Path, tmp_path: Path) -> None:
    before = content(signed)
    photo = tmp_path / "bellows.png"
    photo.write_bytes(PNG)
    first = add_note(signed, "A scratch on the left bellows. <b>", "A. Tester", photo)
    add_note(signed, "It was there before.", "B. Miller")
    assert content(signed) == before and broken_files(signed) == []
    assert [(one.by, one.file) for one in notes_of(signed)] == [
        ("A. Tester", "0001-bellows.png"), ("B. Miller", ""),
    ]  # fmt: skip
    assert first.sha256 == hashlib.sha256(PNG).hexdigest() and len(first.at) == 20
    page = write_report(signed).read_text(encoding="utf-8")
    behind = page[page.index("<h2>Signatures</h2>") :]
    assert "Later notes" in behind and "on the left bellows. &lt;b&gt;" in behind and first.sha256 in behind
    (signed / NOTES / first.file).write_bytes(b"another picture")
    assert not is_as_added(signed, first) and is_as_added(signed, notes_of(signed)[1])


def test_the_index_follows_the_notes(signed: Path) -> None:
    index = RunIndex(signed.parent)
    assert [one.notes for one in index.runs()] == [0] and index.notes("aw0") == []
    add_note(signed, "first", "A. Tester")
    assert [one.notes for one in index.runs()] == [1]
    add_note(signed, "second", "A. Tester")
    assert [one.text for one in index.notes("aw0")] == ["first", "second"]
    (signed / NOTES / "0003.json").write_text("{")
    assert index.notes("aw0")[2] == Note(at="", by="", text="0003.json cannot be read as a note")


def test_simultaneous_writers_lose_no_entries(signed: Path) -> None:
    with ThreadPoolExecutor(8) as pool:
        list(pool.map(lambda n: add_note(signed, f"note {n}", "A. Tester"), range(24)))
    assert {one.text for one in notes_of(signed)} == {f"note {n}" for n in range(24)}
    assert not list((signed / NOTES).glob("*.part"))


@pytest.mark.parametrize(
    ("text", "by", "file", "why"),
    [
        ("x", " ", None, "author"),
        (" ", "A", None, "text"),
        ("x", "A", "no", "cannot"),
    ],
)
def test_an_invalid_note_is_refused_without_a_file(signed: Path, text, by, file, why) -> None:
    with refuses(RecordError, why):
        add_note(signed, text, by, file and signed / file)
    assert not (signed / NOTES).exists()


def test_a_letterhead_stands_above_the_report(signed: Path, tmp_path: Path, monkeypatch) -> None:
    plain = (signed / "report.html").read_bytes()
    (tmp_path / "logo.png").write_bytes(PNG)
    head = tmp_path / "head.toml"
    head.write_text('laboratory = "Hall 7"\ncustomer = "Rail & Co"\norder = "4500-1"\nlogo = "logo.png"\n')
    page = write_report(signed, read_letterhead(head)).read_text(encoding="utf-8")
    for told in ("Hall 7", "<dd>Rail &amp; Co</dd>", "<dd>4500-1</dd>", base64.b64encode(PNG).decode()):
        assert told in page
    assert page.index("Hall 7") < page.index("<h1>")
    assert write_report(signed).read_bytes() == plain
    monkeypatch.setenv(CHOSEN, str(head))
    assert write_report(signed).read_text(encoding="utf-8") == page


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("custmer = 'x'", "custmer is not a key here; did you mean 'customer'"),
        ("order = 4500", "order = 4500; use a text"),
        ("logo = 'head.toml'", "is not a picture; use a file with the suffix .png"),
        ("logo = 'none.png'", "none.png cannot be read"),
        ("logo = 'fake.png'", "is not a .png picture"),
        ("order = ", "TOML"),
    ],
)
def test_a_letterhead_that_cannot_be_is_refused(tmp_path: Path, text: str, why: str) -> None:
    (tmp_path / "fake.png").write_bytes(b"<script>")
    (tmp_path / "head.toml").write_text(text)
    with pytest.raises(RecordError, match=f"letterhead .*head.toml.*{why}"):
        read_letterhead(tmp_path / "head.toml")
    assert Letterhead() == Letterhead("", "", "", "")
