"""The other views, from the server's side: past runs and diagnoses, injected faults, the bus."""

import json
import re

import msgspec
import numpy as np
import pytest
from click.testing import CliRunner
from starlette.testclient import TestClient

from astb.cli import commands
from astb.panel.access import Access
from astb.panel.answers import Parts
from astb.panel.bus import Bus
from astb.panel.runs import Runs
from astb.panel.server import application
from astb.panel.watch import Watch
from astb.rig_file import RigFile, Simulation
from bench_protocol.clock import VirtualClock
from bench_protocol.frames import FRAME
from bench_protocol.units import NS
from bench_records.index import INDEX
from drivers.memory import InMemoryCan

TOKEN = "a token"
SIMULATED = RigFile("test", simulation=Simulation())


@pytest.fixture
def panel(tmp_path, monkeypatch):
    """Make a panel whose runs lie in ``tmp_path/runs``, and a page of it that may command."""

    def made(rig: RigFile = SIMULATED, *, command: bool = True) -> TestClient:
        clock = VirtualClock()
        clock.sleep_until(NS)
        watch = Watch(rig, tmp_path / "rig.toml")  # and not started: nothing is connected
        out = tmp_path / "runs"
        app = application(Parts(watch, Runs(watch, out), Access(TOKEN, 1, clock), out), host="127.0.0.1")
        one = TestClient(app, base_url="http://127.0.0.1:8137", headers={"X-ASTB-Page": "one"})
        if command:
            one.post("/api/enter", json={"token": TOKEN})
        return one

    return made


def test_past_runs_are_listed_with_their_checks_and_opened_as_pages(panel, keep, tmp_path) -> None:
    runs, page = tmp_path / "runs", panel(command=False)
    assert page.get("/api/kept").json()["runs"] == []
    for name, value in (("one", 0.004), ("two", 0.005), ("other spring", 0.006)):
        keep(runs, name, value, serial="8" if name.startswith("other") else "7")
    listed = page.get("/api/kept").json()["runs"]
    assert {run["directory"]: run["verdict"] for run in listed} == dict.fromkeys(
        ("one", "two", "other spring"), "pass"
    )
    (judged,) = page.get("/api/kept/checks", params={"run": "one"}).json()
    assert (judged["phase"], judged["verdict"]) == ("main", "pass")
    assert "Title" in page.get("/kept/report", params={"run": "one"}).text
    none = page.get("/api/kept/replay", params={"run": "one"})
    assert (none.status_code, "no reading that the drawing" in none.text) == (404, True)
    assert not (runs / "one" / "report.html").exists(), "who looks on writes nothing"
    beside = page.get("/kept/compare", params={"a": "one", "b": "two"}).text
    assert "A: " in beside and "height" in beside
    trend = page.get("/kept/trend", params={"run": "one", "place": 0})
    assert "two" in trend.text and "other spring" not in trend.text, "of this specimen alone"
    assert "default-src 'none'" in trend.headers["content-security-policy"]


def test_a_page_shows_the_trends_of_several_checks_and_the_command_line_the_same(panel, keep, tmp_path):
    runs = tmp_path / "runs"
    for name, value in (("one", 0.004), ("two", 0.005)):
        keep(runs, name, value, more=("width", "weight"))
    kept = panel(command=False)
    page = kept.get("/kept/trend", params={"run": "one", "place": [0, 2, 0]}).text
    assert re.findall(r'<section id="\w+">\s*<h2>(.*)</h2>', page) == ["height", "weight"]
    assert "<h1>2 checks, specimen 7" in page
    ids = re.findall(r'\bid="([^"]+)"', page)
    assert len(ids) == len(set(ids)), "drawings on one page keep apart"
    assert kept.get("/kept/trend", params={"run": "one", "place": [0, 9]}).status_code == 404

    def trend(*words):
        return CliRunner().invoke(commands, ["trend", *words, "--specimen", "7", "--out", str(runs)])

    told = trend("w*", "height", "--page", str(tmp_path / "page.html"), "--json")
    assert [one["name"] for one in json.loads(told.stdout)] == ["weight", "width", "height"]
    assert "<h1>3 checks" in (tmp_path / "page.html").read_text()
    assert json.loads(trend("height", "--json").stdout)["name"] == "height", "one name, one object"
    assert trend("height", "width").stdout.count("2 runs; mean 4.5") == 2
    wrong = trend("height", "hight")
    assert wrong.exit_code != 0 and "did you mean" in wrong.stderr.lower()


@pytest.mark.parametrize("name", ["..", "../secret", "nowhere", "/etc", ""])
@pytest.mark.parametrize(
    "path", ["/kept/report?run=", "/api/kept/checks?run=", "/kept/diagnosis?of=", "/kept/compare?a=one&b="]
)
def test_only_files_of_runs_are_opened(panel, keep, tmp_path, path: str, name: str) -> None:
    keep(tmp_path / "runs", "one", 0.001)
    keep(tmp_path, "secret", 0.001)
    answer = panel().get(path + name)
    assert answer.status_code == 404
    assert "holds no" in answer.text
    assert panel().get("/kept/trend?run=one").status_code == 400


def test_diagnoses_are_listed_with_what_they_found(panel, tmp_path) -> None:
    folder = tmp_path / "runs" / "found"
    folder.mkdir(parents=True)
    finding = {"verdict": "named", "sentence": "it leaks 2 mm2", "provenance": {"simulator": "the bench"}}
    (folder / "finding.json").write_bytes(msgspec.json.encode(finding))
    (folder / "report.html").write_text("the report")
    (tmp_path / "runs" / "none").mkdir()
    (tmp_path / "runs" / "none" / "finding.json").write_text("{}")
    (found,) = panel().get("/api/diagnoses").json()
    assert (found["directory"], found["verdict"], found["sentence"]) == ("found", "named", "It leaks 2 mm²")
    assert panel().get("/kept/diagnosis", params={"of": "found"}).text == "the report"


class Broken:
    """Instead of a rig's control socket."""

    def __init__(self) -> None:
        self.orders = []

    def __call__(self, path, line: bytes) -> bytes:
        self.orders.append(msgspec.json.decode(line))
        return b'{"error": "area is no number"}' if b"much" in line else b'{"on": []}'


def test_only_the_page_that_commands_breaks_and_mends_a_simulated_rig(panel, monkeypatch) -> None:
    rig = Broken()
    monkeypatch.setattr("astb.panel.faults.ask", rig)
    order = {"name": "leak", "values": {"area": "2 mm2"}, "for": "3 s"}
    for path in ("on", "off"):
        assert panel(command=False).post(f"/api/faults/{path}", json=order).status_code == 403
    assert rig.orders == []
    page = panel()
    assert page.post("/api/faults/on", json=order).json() == {"done": {"on": []}}
    assert page.post("/api/faults/off", json={"name": "leak.left"}).status_code == 200
    assert rig.orders == [{"do": "on", **order}, {"do": "off", "name": "leak.left"}]
    refused = page.post("/api/faults/on", json={"name": "leak", "values": {"area": "much"}})
    assert (refused.status_code, refused.json()["error"]) == (409, "area is no number")
    assert panel(command=False).get("/api/faults").json() == {"on": []}


def test_a_real_rig_is_not_broken_on_purpose(panel, monkeypatch) -> None:
    monkeypatch.setattr(
        "bench_sim.rig.control_socket.ask", lambda *_: pytest.fail("a real rig was told to break")
    )
    page = panel(RigFile("steel"))
    assert page.post("/api/faults/on", json={"name": "leak"}).status_code == 409
    assert page.get("/api/faults").json() == {
        "error": "steel is a real rig; faults can be inserted only into a simulated rig"
    }


def frames(*instants: tuple[int, int]) -> np.ndarray:
    found = np.zeros(len(instants), FRAME)
    found["time"], found["id"] = zip(*instants, strict=True)
    return found


def test_frames_are_counted_by_identifier_with_the_longest_gap_between_two(tmp_path, monkeypatch) -> None:
    monkeypatch.setattr("drivers.can_port.open_can", lambda *_, **__: InMemoryCan(lambda block: None))
    bus = Bus(Watch(SIMULATED, tmp_path / "rig.toml"))
    assert bus.look()["counts"] == {}
    bus.receive(frames((0, 0x181), (5, 0x181), (5, 0x201)))
    bus.receive(frames((105, 0x181), (108, 0x181)))
    told = bus.look()
    assert told["counts"] == {0x181: 4, 0x201: 1}
    assert told["gaps"][0x181] * NS == pytest.approx(100)
    bus.receive(frames(*((0, identifier) for identifier in range(1000, 2000))))
    told = bus.look()
    assert (len(told["counts"]), told["others"]) == (256, 746), "what a bus of others may have is bounded"
    bus.close()
    assert bus.look()["counts"] == {}
    bus.close()


def test_an_impossible_bus_is_reported(tmp_path) -> None:
    bus = Bus(Watch(RigFile("theirs", wiring="theirs.toml"), tmp_path / "rig.toml"))
    assert (
        bus.look()["error"]
        == "theirs has its own wiring; the bus view is only for rigs with the ASTB protocol"
    )
    bus.close()
    assert not (tmp_path / INDEX).exists()
