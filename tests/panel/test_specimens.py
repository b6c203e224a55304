"""Specimens in the panel: files are checked before they are stored, and plans are listed and run for the chosen one."""

from types import SimpleNamespace

import pytest

from astb.panel import runs as runs_module
from astb.panel.specimens import FOLDER
from bench_protocol.named_files import named_files
from test_plans.specimen import PACKAGE, read_specimen

OURS = named_files(PACKAGE)["astb"].read_text(encoding="utf-8")
#: A spring for a lighter car: 45 kN at the pressure that bears them, and limits around them.
LIGHT = (
    OURS.replace('type = "diaphragm spring 575"', 'type = "light spring"')
    .replace("preload = { value = 53.5", "preload = { value = 45.0")
    .replace("fill_pressure = { value = 2.058", "fill_pressure = { value = 1.731")
    .replace("carried = { low = 52.6, high = 54.4", "carried = { low = 44.4, high = 45.6")
    .replace("pressure = { low = 1.98, high = 2.11", "pressure = { low = 1.66, high = 1.80")
)


@pytest.fixture
def page(client):
    return client()


def test_a_file_is_checked_stored_and_shown_with_its_plans(page, parts):
    assert (
        page.post("/api/specimens/add", json={"name": "light.toml", "text": LIGHT}).json()["done"]
        == "light.toml"
    )
    listed = {one["name"]: one for one in page.get("/api/specimens").json()}
    assert listed["light.toml"]["type"] == "light spring"
    assert listed["light.toml"]["loads"]["AW0"] == "45 kN"
    told = page.get("/api/specimens/one", params={"name": "light.toml"}).json()
    rows = {row["name"]: row["says"] for row in told["rows"]}
    assert rows["load case › AW0 › preload"] == "45 kN"
    assert rows["load case › AW0 › limits › carried"] == "44.4 to 45.6 kN"
    assert "Hz" in rows["load case › AW0 › limits › vertical stiffness"]
    kept = parts.out / FOLDER / "light.toml"
    assert read_specimen(kept).sha256 == told["sha256"], "as it was brought, byte for byte"

    def title(specimen: str) -> str:
        plans = page.get("/api/plans", params={"specimen": specimen}).json()["plans"]
        return next(one["title"] for one in plans if one["name"] == "aw0")

    assert "45 kN" in title("light.toml") and "53.5 kN" in title("")
    assert "light.toml" in page.get("/api/plans").json()["specimens"]
    assert page.get("/api/plans", params={"specimen": "none.toml"}).status_code == 404


@pytest.mark.parametrize(
    ("name", "text", "words"),
    [
        (
            "x.toml",
            OURS.replace("preload = { value = 53.5", "preload = { value = 45.0"),
            "x.toml: load_case.AW0.preload",
        ),
        ("x.toml", "type = 3", "x.toml"),
        ("x.toml", "", "no load case"),
        ("../x.toml", OURS, "is not a valid name for the file of a specimen"),
        (".x.toml", OURS, "is not a valid name"),
        ("x.txt", OURS, "is not a valid name"),
        ("x.toml\n", OURS, "is not a valid name"),
    ],
)
def test_what_is_no_specimen_is_refused_in_words_and_not_kept(page, parts, name, text, words):
    answer = page.post("/api/specimens/add", json={"name": name, "text": text})
    assert answer.status_code == 409
    assert words in answer.json()["error"]
    assert "/tmp" not in answer.json()["error"], "its temporary path is hidden"
    assert not list(parts.out.rglob("*.toml"))


def test_a_file_is_put_in_the_place_of_another_only_on_request(page, parts):
    def add(text, **more):
        return page.post("/api/specimens/add", json={"name": "mine.toml", "text": text, **more})

    assert add(OURS).status_code == add(OURS).status_code == 200, "the same twice is the same"
    assert "exists already with other contents" in add(LIGHT).json()["error"]
    kept = parts.out / FOLDER / "mine.toml"
    assert kept.read_text() == OURS
    assert add(LIGHT, instead=True).status_code == 200
    assert kept.read_text() == LIGHT
    kept.write_text("broken")
    told = next(one for one in page.get("/api/specimens").json() if one["name"] == "mine.toml")
    assert told["error"], "a damaged file is reported, and the others are listed"


def test_an_observer_publishes_no_data(client, parts):
    viewer = client(command=False)
    assert viewer.post("/api/specimens/add", json={"name": "x.toml", "text": OURS}).status_code == 403
    assert not (parts.out / FOLDER).exists()


def test_the_page_passes_specimen_operator_and_environment(page, parts, monkeypatch):
    commands = []

    def popen(command, **_):
        commands.append(command)
        return SimpleNamespace(poll=lambda: 0, pid=1)

    monkeypatch.setattr(runs_module.subprocess, "Popen", popen)
    page.post("/api/specimens/add", json={"name": "light.toml", "text": LIGHT})
    content = {"plan": "aw0", "specimen": "light.toml", "operator": "--pdf", "ambient": "21 °C, 1013 hPa"}
    assert page.post("/api/run/start", json=content).status_code == 200
    (command,) = commands
    assert command[-3:] == [
        f"--specimen={parts.out / FOLDER / 'light.toml'}",
        "--operator=--pdf",
        "--ambient=21 °C, 1013 hPa",
    ], "a name is a name, whatever it looks like"
    assert page.post("/api/run/start", json=content | {"twin": True}).status_code == 200
    assert commands.pop() == [*command, "--watch"]
    refused = page.post("/api/run/start", json=content | {"specimen": "../light.toml"})
    assert "there is no specimen" in refused.json()["error"]
    assert len(commands) == 1
