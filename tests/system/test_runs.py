"""`astb run` from start to end: verdicts, bytes, broken rigs, killed processes, and remaining files."""

import json
import os
import re
import signal
import socket
import struct
import subprocess
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from astb.exit_codes import BLOCKED, FAIL, PASS
from bench_protocol.named_files import named_files
from bench_protocol.table import TABLE
from bench_protocol.units import bar
from bench_protocol.words import STATES
from bench_records.record import read
from drivers.errors import LinkLost
from drivers.modbus_port import open_modbus

FILES = ("SHA256SUMS", "junit.xml", "meta.json", "record.parquet", "report.html", "result.json")
VIRTUAL = 'name = "virtual"\ntime = "virtual"\n[simulation]\n'
LIVE = """name = "live"
[can]
bus = "tcp"
port = {can}
[modbus]
port = {modbus}
[simulation]
"""
#: Broken in the product, and in what the product needs.
WIDE_ORIFICE = VIRTUAL + '[simulation.change]\norifice_diameter = "18 mm"\n'
WEAK_SUPPLY = VIRTUAL + '[simulation.change]\nsupply_pressure = "1.2 bar"\n'


class Done:
    """A run of a plan that has ended: what it said, its exit code, its files."""

    def __init__(self, directory: Path, plan: str, said: str = "", code: int = -1) -> None:
        self.directory, self.plan, self.said, self.code = directory, plan, said, code

    def files(self) -> dict[str, bytes]:
        return {path.name: path.read_bytes() for path in (self.directory / "runs" / self.plan).iterdir()}

    def result(self) -> dict:
        return json.loads(self.files()["result.json"])

    def phases(self) -> list[str]:
        return [phase["name"] for phase in self.result()["phases"]]


class Started(Done):
    """`astb run` in the background."""

    def __init__(self, command: list[str], directory: Path, plan: str, **environment: str) -> None:
        super().__init__(directory, plan)
        pipe = subprocess.PIPE
        environment = {**os.environ, "COLUMNS": "200", **environment}
        # A separate session, so that only the test ends it.
        self.process = subprocess.Popen(
            command,
            cwd=directory,
            env=environment,
            stdout=pipe,
            stderr=pipe,
            text=True,
            start_new_session=True,
        )

    def end(self, within: float = 100) -> int:
        """Wait for its end; return the exit code, and keep what it said."""
        out, err = self.process.communicate(timeout=within)
        self.said, self.code = out + err, self.process.returncode
        return self.code


@pytest.fixture(scope="module")
def launch(tmp_path_factory, astb_command) -> Iterator[Callable[..., Started]]:
    """Start `astb run` in a separate directory; processes that still run at the end are killed."""
    launched: list[Started] = []

    def start(plan: str, *arguments: str, rig: str, **environment: str) -> Started:
        directory = tmp_path_factory.mktemp("run")
        (directory / "rig.toml").write_text(rig)
        command = [*astb_command, "run", "--rig", "rig.toml", plan, *arguments]
        launched.append(Started(command, directory, plan, **environment))
        return launched[-1]

    yield start
    for run in launched:
        run.process.kill()
        run.process.communicate()


# -- in virtual time ---------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def run_here(tmp_path_factory, astb_here) -> Callable[..., Done]:
    """Run `astb run` in this process."""

    def run(plan: str, *arguments: str, rig: str) -> Done:
        directory = tmp_path_factory.mktemp("run")
        (directory / "rig.toml").write_text(rig)
        code, out, err = astb_here(directory, "run", "--rig", "rig.toml", plan, *arguments)
        return Done(directory, plan, out + err, code)

    return run


@pytest.fixture(scope="module", params=["leak_down", pytest.param("aw0", marks=pytest.mark.slow)])
def seeded(request, launch, run_here) -> dict[str, Done]:
    """A plan with seed 3 here and in another process, whose sets have another order; and one with seed 4."""
    plan = request.param
    away = launch(plan, "--virtual", "--seed", "3", rig=VIRTUAL, PYTHONHASHSEED="1")
    runs = {
        "here": run_here(plan, "--virtual", "--seed", "3", rig=VIRTUAL),
        "away": away,
        "other": run_here(plan, "--virtual", "--seed", "4", rig=VIRTUAL),
    }
    away.end()
    for run in runs.values():
        assert run.code == PASS, run.said
    return runs


def test_the_same_seed_gives_the_same_bytes(seeded):
    first, second = seeded["here"], seeded["away"]
    assert sorted(first.files()) == sorted(FILES)
    for name in FILES:
        assert first.files()[name] == second.files()[name], name
    assert first.result()["seed"] == 3
    assert first.said == second.said


def test_another_seed_gives_other_bytes_and_the_same_verdict(seeded):
    first, other = seeded["here"], seeded["other"]
    for name in FILES:
        assert first.files()[name] != other.files()[name], name
    one, two = first.result(), other.result()
    assert [check["name"] for check in one["checks"]] == [check["name"] for check in two["checks"]]
    assert one["checks"] != two["checks"]


@pytest.mark.slow
def test_a_fault_of_the_product_fails(run_here):
    run = run_here("aw0", rig=WIDE_ORIFICE)
    assert run.code == FAIL, run.said
    assert "aw0: FAIL" in run.said
    bad = {check["name"] for check in run.result()["checks"] if check["verdict"] == "fail"}
    assert any(name.endswith("vertical c at 1 Hz") for name in bad), "damping is what an orifice is for"
    assert not any("pressure in" in name or "lateral" in name for name in bad), "and of nothing else"
    assert "tear-down" in run.phases()


def test_a_broken_precondition_blocks(run_here):
    """A supply of 1.2 bar fills no spring: that says nothing of the spring."""
    run = run_here("aw0", rig=WEAK_SUPPLY)
    assert run.code == BLOCKED, run.said
    assert "aw0: BLOCKED: not ready: supply pressure" in run.said
    assert "(1.21 bar; open the supply until it has 3.058 bar)" in run.said
    assert run.result()["verdict"] == "blocked"
    assert sorted(run.files()) == sorted(FILES), "a blocked run is recorded and reported too"
    states = [event.text for event in read(run.directory / "runs" / "aw0").events if event.kind == "state"]
    assert states[-1] == "rig.state: DISABLED", "nothing was armed"


def test_a_link_that_breaks_blocks(run_here, monkeypatch):
    """The bus in memory is cut after 20 s, in the midst of the plan."""
    from drivers.memory import InMemoryCan

    received = InMemoryCan.receive

    def receive(self, block):
        received(self, block)
        if block.size and block["time"][-1] > 20e9:
            self.lose("somebody cut the cable")

    monkeypatch.setattr(InMemoryCan, "receive", receive)
    run = run_here("aw0", rig=VIRTUAL)
    assert run.code == BLOCKED, run.said
    assert "aw0: BLOCKED: keep away from the springs until their gauges read zero" in run.said
    assert "the link to the rig: the CAN bus is lost: somebody cut the cable" in run.said
    assert sorted(run.files()) == sorted(FILES)
    assert "tear-down" in run.phases()
    assert 19 < read(run.directory / "runs" / "aw0").duration < 40


def test_the_report_can_be_made_anew(seeded, astb_here):
    run = seeded["here"]
    directory = run.directory / "runs" / run.plan
    before = run.files()
    (directory / "report.html").unlink()
    code, out, err = astb_here(run.directory, "report", f"runs/{run.plan}")
    assert (code, out, err) == (PASS, f"runs/{run.plan}/report.html\n", "")
    assert run.files() == before


@pytest.mark.slow
def test_what_the_bench_was_given_stands_in_terminal_and_report(run_here, tmp_path):
    (tmp_path / "sealed.toml").write_text('[effect."leak.right"]\narea = "0.3 mm2"\n')
    arguments = ("--effect", "leak.left=0.2mm2", "--sealed", tmp_path / "sealed.toml")
    run = run_here("leak_down", *arguments, rig=VIRTUAL + '[simulation.change]\norifice_diameter = "14 mm"\n')
    told = ["SIMULATED", "VIRTUAL TIME", "effect leak.left = 0.2 mm2", "changed orifice_diameter = 14 mm"]
    told += ["sealed effects (not shown)"]
    assert " · ".join(told) in run.said
    head = run.files()["report.html"].decode().partition('class="banner')[0]
    for words in told:
        assert f"<span>{words}</span>" in head
    assert (
        "leak.right" not in run.said + run.files()["report.html"].decode() + run.files()["meta.json"].decode()
    )


@pytest.mark.slow
def test_another_specimen_is_judged_by_its_own_limits_and_named(run_here, tmp_path):
    """The same bench, and a file that allows less air to be lost than the thermometers can resolve."""
    text = named_files("specimens")["astb"].read_text(encoding="utf-8")
    assert text.count("{ high = 0.2, unit") == text.count('serial_number = "virtual"') == 1
    strict = text.replace("{ high = 0.2, unit", "{ high = -0.5, unit").replace('"virtual"', '"4711"')
    (tmp_path / "strict.toml").write_text(strict, encoding="utf-8")
    run = run_here("leak_down", "--specimen", tmp_path / "strict.toml", rig=VIRTUAL)
    assert run.code == FAIL
    head = run.files()["report.html"].decode().partition("</header>")[0]
    assert "<dt>serial number</dt><dd>4711</dd>" in head
    assert b'value="4711"' in run.files()["junit.xml"]


@pytest.mark.slow
def test_a_run_never_overwrites_another(run_here, astb_here):
    first = run_here("leak_down", rig=VIRTUAL)
    before = first.files()
    for again in (2, 3):
        code, out, _ = astb_here(first.directory, "run", "--rig", "rig.toml", "leak_down")
        assert (code, f"report: runs/leak_down-{again}/report.html" in out) == (PASS, True)
    assert first.files() == before
    beside = Done(first.directory, "leak_down-2")
    assert beside.files() == before, "the same seed"


def test_a_run_that_is_stopped_has_a_report_and_tells_of_the_air(run_here, monkeypatch):
    """Ctrl-C in the midst of the plan, when the springs are full."""
    from bench_protocol.clock import VirtualClock

    passed, stopped = VirtualClock.sleep_until, []

    def sleep(self, until):
        passed(self, until)
        if until > 30e9 and not stopped:
            stopped.append(until)
            raise KeyboardInterrupt

    monkeypatch.setattr(VirtualClock, "sleep_until", sleep)
    run = run_here("aw0", rig=VIRTUAL)
    assert (run.code, bool(stopped)) == (BLOCKED, True), run.said
    assert "aw0: BLOCKED: stopped by the operator; the springs are without pressure (0." in run.said
    assert run.said.rstrip().endswith("interrupted")
    assert sorted(run.files()) == sorted(FILES)
    assert "the springs are without pressure" in run.files()["report.html"].decode()


# -- over sockets: processes that die ----------------------------------------------------------------------------------


@pytest.fixture
def ports() -> dict[str, int]:
    """Two ports of the loopback that were free just now."""
    with socket.create_server(("127.0.0.1", 0)) as one, socket.create_server(("127.0.0.1", 0)) as other:
        return {"can": one.getsockname()[1], "modbus": other.getsockname()[1]}


def words(ports: dict[str, int], signal: str, encoding: str, count: int) -> tuple[int, ...]:
    """Return ``count`` input registers of a signal of the rig at ``ports``, none if no rig is there."""
    register = next(r for r in TABLE.registers if r.signal == signal and r.encoding == encoding)
    try:
        modbus = open_modbus("127.0.0.1", ports["modbus"])
        found = tuple(modbus.read_input(register.address, count))
        modbus.close()
    except LinkLost:
        return ()
    return found


def state(ports: dict[str, int]) -> str:
    """Return the state of the rig at ``ports``, "" if none is there."""
    code = words(ports, "rig.state", "int16", 1)
    return STATES[code[0]] if code else ""


def pressure(ports: dict[str, int]) -> float:
    """Return the gauge pressure (Pa) of the left bellows of the rig at ``ports``, 0 if none is there."""
    found = words(ports, "left.bellows_pressure", "float32", 2)
    return struct.unpack(">f", struct.pack(">HH", *found))[0] if found else 0.0


@pytest.mark.slow
def test_a_killed_rig_blocks_the_run(launch, start_rig, eventually):
    rig = start_rig()
    ports = {"can": rig.can_port, "modbus": rig.modbus_port}
    run = launch("aw0", rig=LIVE.format(**ports))
    eventually(lambda: pressure(ports) > 1 * bar, within=100, what="air in the springs")
    rig.process.kill()
    start = time.monotonic()
    assert run.end() == BLOCKED
    assert time.monotonic() - start < 20
    assert re.search(r"aw0: BLOCKED: .*the link to the rig: .* is lost", run.said), run.said
    assert "tear-down" in run.phases()
    assert sorted(run.files()) == sorted(FILES)
    assert "Traceback" not in run.said


@pytest.mark.slow
def test_a_run_that_is_stopped_tears_down_and_takes_its_rig_along(launch, ports, eventually):
    """`astb run` starts the rig that does not answer; Ctrl-C in a terminal goes to the whole process group."""
    run = launch("aw0", rig=LIVE.format(**ports))
    eventually(lambda: state(ports) == "ACTIVE", within=100, what="ACTIVE")
    os.killpg(run.process.pid, signal.SIGINT)
    assert run.end() == BLOCKED
    assert "stopped by the operator" in run.result()["reason"]
    assert "in tear-down" not in run.result()["reason"]
    assert "the springs are without pressure (" in run.result()["reason"]
    assert sorted(run.files()) == sorted(FILES)
    assert "Traceback" not in run.said
    assert state(ports) == "", "the rig is gone"


@pytest.mark.slow
def test_a_terminated_run_tears_down_too(launch, ports, eventually):
    run = launch("aw0", rig=LIVE.format(**ports))
    eventually(lambda: state(ports) == "ACTIVE", within=100, what="ACTIVE")
    run.process.terminate()
    assert run.end() == BLOCKED
    assert "in tear-down" not in run.result()["reason"]
    assert "the springs are without pressure (" in run.result()["reason"]
    assert sorted(run.files()) == sorted(FILES)
    assert state(ports) == "", "the rig is gone"


@pytest.mark.slow
def test_a_rig_stops_when_its_parent_ends(launch, ports, eventually):
    run = launch("aw0", rig=LIVE.format(**ports))
    eventually(lambda: state(ports) == "ACTIVE", within=100, what="ACTIVE")
    run.process.kill()
    run.process.communicate()
    eventually(lambda: state(ports) == "", what="the end of the rig")


@pytest.mark.slow
@pytest.mark.real_time
def test_a_rig_that_cannot_be_started_blocks(run_here, ports):
    with socket.create_server(("127.0.0.1", ports["can"])):
        run = run_here("aw0", rig=LIVE.format(**ports))
    assert run.code == BLOCKED
    assert f"the rig could not be started: CAN port {ports['can']} on 127.0.0.1 cannot be opened" in run.said
    assert state(ports) == ""
