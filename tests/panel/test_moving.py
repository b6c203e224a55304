"""Runs get other names, go to the archive and come back; plans are rehearsed from the page, one at a time."""

import io
import time
from types import SimpleNamespace

import pytest

from astb.panel import rehearsals
from astb.panel.watch import Status
from bench_records.checksums import broken_files, write_sums


def names(page) -> list[str]:
    return sorted(run["directory"] for run in page.get("/api/kept").json()["runs"])


def test_a_run_is_renamed_archived_and_restored_unchanged(client, parts, keep):
    page = client()
    for name in ("one", "two"):
        keep(parts.out, name, 0.004)
    write_sums(parts.out / "one")
    before = {path.name: path.read_bytes() for path in (parts.out / "one").iterdir()}
    parts.runs._record = str(parts.out / "one")  # the last run of the panel
    assert page.post("/api/kept/rename", json={"run": "one", "name": "Spring 7, née"}).status_code == 409
    assert (
        page.post("/api/kept/rename", json={"run": "one", "name": "spring 7 new"}).json()["done"]
        == "spring 7 new"
    )
    assert names(page) == ["spring 7 new", "two"]
    assert parts.runs.state()["last"]["record"] == "spring 7 new", "its report is found under the new name"
    assert page.post("/api/kept/archive", json={"run": "spring 7 new"}).status_code == 200
    assert names(page) == ["archive/spring 7 new", "two"]
    assert page.get("/kept/report", params={"run": "archive/spring 7 new"}).status_code == 200
    assert page.post("/api/kept/restore", json={"run": "archive/spring 7 new"}).status_code == 200
    assert names(page) == ["spring 7 new", "two"]
    after = parts.out / "spring 7 new"
    assert {path.name: path.read_bytes() for path in after.iterdir()} == before
    assert not broken_files(after)


@pytest.mark.parametrize(
    ("run", "name", "words"),
    [
        ("one", "two", "exists already"),
        ("one", "", "is not a valid name"),
        ("one", "../three", "is not a valid name"),
        ("one", "..", "is not a valid name"),
        ("one", "a/b", "is not a valid name"),
        ("one", "archive", "is not a valid name"),
        ("one", "x" * 61, "is not a valid name"),
        ("none", "three", "holds no run"),
        ("../one", "three", "holds no run"),
    ],
)
def test_an_invalid_name_is_refused_without_changes(client, parts, keep, run, name, words):
    page = client()
    for each in ("one", "two"):
        keep(parts.out, each, 0.004)
    answer = page.post("/api/kept/rename", json={"run": run, "name": name})
    assert answer.status_code == 409
    assert words in answer.json()["error"]
    assert names(page) == ["one", "two"]
    assert client(command=False).post("/api/kept/archive", json={"run": "one"}).status_code == 403


SAID = """  12 % of the way to left height, upper 90 mm: 6 mm
aw0: CLEAR: no limit trips
  page: {}/aw0-rehearsal/rehearsal.html
"""


def test_a_plan_is_rehearsed_and_its_page_is_shown(client, parts, monkeypatch):
    commands, ended = [], []

    def popen(command, **_):
        commands.append(command)
        text = io.StringIO(SAID.format(parts.out))
        return SimpleNamespace(
            stdout=text, poll=lambda: ended[0] if ended else None, wait=lambda: 0, returncode=0
        )

    monkeypatch.setattr(rehearsals.subprocess, "Popen", popen)
    page = client()
    asked = {"plan": "endurance", "set": {"cycles": "nonsense"}}
    assert page.post("/api/rehearsal/start", json=asked).status_code == 409
    assert page.post("/api/rehearsal/start", json={"plan": "aw0", "specimen": "none.toml"}).status_code == 409
    assert client(command=False).post("/api/rehearsal/start", json={"plan": "aw0"}).status_code == 403
    assert page.get("/api/rehearsal").json() == {"plan": "", "going": False}
    assert not commands
    assert page.post("/api/rehearsal/start", json={"plan": "aw0"}).status_code == 200
    assert commands[0][-6:] == ["rehearse", "aw0", "--rig", str(parts.watch.path), "--out", str(parts.out)]
    assert page.get("/api/rehearsal").json() == {"plan": "aw0", "going": True}
    assert "is being rehearsed" in page.post("/api/rehearsal/start", json={"plan": "aw3"}).json()["error"]
    ended.append(0)
    time.sleep(0.05)
    told = page.get("/api/rehearsal").json()
    assert (told["words"], told["page"]) == ("CLEAR: no limit trips", "aw0-rehearsal")
    folder = parts.out / "aw0-rehearsal"
    folder.mkdir()
    (folder / "rehearsal.html").write_text("the page of it")
    assert page.get("/kept/rehearsal", params={"of": "aw0-rehearsal"}).text == "the page of it"
    for of in ("../aw0-rehearsal", "aw0", "", "aw0-rehearsal/.."):
        assert page.get("/kept/rehearsal", params={"of": of}).status_code == 404
    parts.watch.status = Status(link="", state="ACTIVE", pid=1)
    assert "a run is in progress" in page.post("/api/rehearsal/start", json={"plan": "aw0"}).json()["error"]


def test_a_kept_run_goes_on_otherwise_from_an_instant(client, parts, keep, monkeypatch):
    commands = []

    def popen(command, **_):
        commands.append(command)
        text = "aw0: CLEAR: no limit trips\n"
        text += "  up to 4 s the run is identical with one; after that:\n    x parts at 4.1 s\n"
        return SimpleNamespace(stdout=io.StringIO(text), poll=lambda: 0, wait=lambda: 0, returncode=0)

    monkeypatch.setattr(rehearsals.subprocess, "Popen", popen)
    keep(parts.out, "one", 0.004)
    page, path = client(), "/api/rehearsal/from"
    asked = {"run": "one", "at": 4, "effect": " leak.left=0.5mm2", "change": "", "fault": "stuck_dpv at=open"}
    assert client(command=False).post(path, json=asked).status_code == 403
    for wrong in ({"run": "none"}, {"run": "../one"}, {"at": "4"}, {"at": True}, {"effect": 3}):
        assert page.post(path, json=asked | wrong).status_code in (400, 404, 409), wrong
    assert not commands
    assert page.post(path, json=asked).status_code == 200
    options = [one for one in commands[0] if one.startswith("--")]
    assert options == [
        f"--from={parts.out / 'one'}@4.000s",
        "--fault=stuck_dpv at=open",
        "--effect=leak.left=0.5mm2",
        "--rig",
        "--out",
    ]
    time.sleep(0.05)
    told = page.get("/api/rehearsal").json()
    assert (told["plan"], told["words"]) == ("aw0", "CLEAR: no limit trips")
    assert told["otherwise"] == ["x parts at 4.1 s"]
