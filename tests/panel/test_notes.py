"""Notes in the panel: shown with a run, written by who has the token, and nothing else of the run is touched."""

import pytest

from bench_records.checksums import sha256_of
from bench_records.notes import NOTES, notes_of

PHOTO = b"\x89PNG\r\n\x1a\n and what follows"


@pytest.fixture
def kept(client, parts, keep):
    """A page that may command, one that watches, and a run in the folder of the panel."""
    keep(parts.out, "one", 0.004)
    return client(), client(command=False), parts.out / "one"


def added(page, file="", content=b"", **words):
    told = {"run": "one", "by": "A. Tester", "text": "", "file": file} | words
    return page.post("/api/kept/note", params=told, content=content)


def test_a_note_with_a_photo_is_stored_with_the_run_and_shown(kept):
    page, watching, run = kept
    before = {path: sha256_of(path) for path in run.rglob("*") if path.is_file()}
    assert added(page, text="a scratch on the left bellows").json() == {"done": None}
    assert added(page, "scratch 1.png", PHOTO).json() == {"done": None}
    assert added(page, "list.html", b"<script>alert(1)</script>").json() == {"done": None}
    assert {path: sha256_of(path) for path in before} == before
    comment, photo, other = watching.get("/api/kept/notes", params={"run": "one"}).json()
    assert (comment["text"], comment["by"], comment["file"]) == (
        "a scratch on the left bellows",
        "A. Tester",
        "",
    )
    assert photo["picture"] and photo["intact"] and not other["picture"]
    assert notes_of(run)[0].text == comment["text"], "as the command line prints it"
    seen = watching.get("/kept/note", params={"run": "one", "file": photo["file"]})
    assert (seen.content, seen.headers["content-type"]) == (PHOTO, "image/png")
    saved = watching.get("/kept/note", params={"run": "one", "file": other["file"]})
    assert saved.headers["content-type"] == "application/octet-stream"
    assert saved.headers["content-disposition"].startswith("attachment")
    assert all("sandbox" in one.headers["content-security-policy"] for one in (seen, saved))
    (listed,) = watching.get("/api/kept").json()["runs"]
    assert listed["notes"] == 3
    (run / NOTES / photo["file"]).write_bytes(b"another")
    assert not watching.get("/api/kept/notes", params={"run": "one"}).json()[1]["intact"]


@pytest.mark.parametrize(
    ("words", "status", "why"),
    [
        ({"by": " "}, 400, "author of the note is missing"),
        ({"text": ""}, 409, "a text or a file"),
        ({"text": "x" * 4001}, 413, "too long"),
        ({"file": "../out.png"}, 400, "not a valid file name"),
        ({"file": ".hidden"}, 400, "not a valid file name"),
        ({"file": "a\x00b"}, 400, "not a valid file name"),
        ({"run": "../one"}, 409, "holds no run"),
        ({"content": b"without a name"}, 413, "has no name"),
    ],
)
def test_unstorable_data_are_refused_without_a_file(kept, words, status, why):
    page, _, run = kept
    told = added(page, **({"text": "so"} | words))
    assert told.status_code == status and why in told.json()["error"]
    assert not (run / NOTES).exists() or not any((run / NOTES).iterdir())


def test_too_large_files_of_notes_are_refused(kept, monkeypatch):
    monkeypatch.setattr("astb.panel.notes.FILE_MAX", 1000)
    page, _, run = kept
    told = added(page, "film.mp4", (b"x" * 100 for _ in range(11)))
    assert told.status_code == 413 and not (run / NOTES).exists()


def test_an_observer_writes_no_file_and_only_notes_are_served(kept):
    page, watching, run = kept
    assert added(watching, text="so").status_code == 403 and not (run / NOTES).exists()
    assert added(page, text="so", file="a.txt", content=b"a").status_code == 200
    for name in ("0001.json", "../result.json", "result.json", "", "../notes/0001-a.txt"):
        assert watching.get("/kept/note", params={"run": "one", "file": name}).status_code == 404
