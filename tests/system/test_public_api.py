"""`import astb`: the page runs as printed, devices show themselves whatever the wires do, and names are complete."""

import csv
import doctest
import math
import pydoc
import re
import socket
import subprocess
import sys
import threading
from pathlib import Path

import numpy as np
import pytest

import astb
from astb.api import find_plan
from astb.rig_file import RigFileError, find_rig
from bench_protocol import units
from bench_protocol.table import TABLE
from bench_protocol.units import s
from bench_records.checksums import broken_files
from bench_records.result import Outcome
from bench_sim.parameters import ParameterError
from diagnosis.contracts import DiagnosisError
from drivers.errors import NotAvailable
from test_plans.plan import plan
from test_plans.run import PlanError
from test_plans.suspension import Suspension

PAGE = Path(__file__).parents[2] / "docs" / "how-to" / "use-python.md"


def blocks(language: str) -> list[str]:
    return re.findall(rf"^```{language}\n(.*?)^```", PAGE.read_text(), flags=re.MULTILINE | re.DOTALL)


def free_port() -> int:
    with socket.create_server(("127.0.0.1", 0)) as server:
        return server.getsockname()[1]


class Readings(doctest.OutputChecker):
    """Compares words; a reading is another one in each library's version."""

    def check_output(self, want: str, got: str, optionflags: int) -> bool:
        return super().check_output(
            *(re.sub(r"-?\d+\.\d+", "0.0", text) for text in (want, got)), optionflags
        )


def addresses(can: int, modbus: int) -> str:
    return f'name = "here"\n[can]\nbus = "tcp"\nport = {can}\n[modbus]\nport = {modbus}\n'


@pytest.mark.slow
@pytest.mark.parametrize("number", [0, 1])
def test_the_sessions_of_the_page_go_as_printed(tmp_path, monkeypatch, number):
    monkeypatch.chdir(tmp_path)
    text = blocks("pycon")[number]
    session = doctest.DocTestParser().get_doctest(text, {}, "page", str(PAGE), 0)
    said: list[str] = []
    runner = doctest.DocTestRunner(Readings())
    results = runner.run(session, out=said.append)
    assert results.failed == 0, "".join(said)
    assert results.attempted >= 10


@pytest.mark.slow
@pytest.mark.real_time
def test_the_program_of_the_page_runs_as_printed(tmp_path):
    (tmp_path / "rigs").mkdir()
    (tmp_path / "rigs" / "local.toml").write_text(
        addresses(free_port(), free_port()) + "[simulation]\nseed = 0\n"
    )
    program, *_ = blocks("python")
    done = subprocess.run(
        [sys.executable, "-c", program],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        timeout=100,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    rows = list(csv.reader(done.stdout.splitlines()))
    platform = [float(row[1]) for row in rows[1:]]
    assert max(platform) - min(platform) == pytest.approx(4, abs=0.5)


@pytest.mark.slow
def test_the_waves_of_the_page_go_together():
    _, together, *_ = blocks("python")
    with astb.open_bench("virtual") as bench:
        bench.arm()
        bench.lateral.control = "force"
        start = bench.platform.vertical
        with bench.capture("platform.vertical", "platform.lateral", "lateral.force") as capture:
            exec(together, {"bench": bench, **vars(units)})
        _, values = capture.aligned(50 * units.Hz)
        assert bench.platform.vertical == pytest.approx(start, abs=0.2 * units.mm)
    for one, size in (("platform.vertical", 5 * units.mm), ("platform.lateral", 5 * units.mm)):
        assert np.ptp(values[one]) == pytest.approx(size, rel=0.05)
    assert np.ptp(values["lateral.force"]) > 1.8 * units.kN


@pytest.mark.slow
@pytest.mark.real_time
def test_a_program_that_forgets_to_close_leaves_the_bench_disarmed(start_rig, tmp_path):
    rig = start_rig()
    (tmp_path / "rig.toml").write_text(addresses(rig.can_port, rig.modbus_port))
    program = "import astb; bench = astb.open_bench('rig.toml'); bench.arm(); print(bench.state)"
    done = subprocess.run(
        [sys.executable, "-c", program], cwd=tmp_path, capture_output=True, text=True, timeout=60, check=False
    )
    assert (done.stdout, done.stderr) == ("ACTIVE\n", "")
    with astb.open_bench(tmp_path / "rig.toml") as bench:
        assert bench.rig.state == "DISABLED"
        assert bench.rig.reason == "disabled by the commander"


def test_a_plan_that_a_program_runs_leaves_checksums_as_every_run_does(tmp_path):
    @plan(setup=lambda run: None, teardown=lambda run: None)
    def looks(run):
        """Look."""
        run.check("state", 1.0, "1", low=0.0)

    _, directory = astb.run_plan(looks, out=tmp_path, report=False)
    assert broken_files(directory) == []


def test_a_run_that_is_interrupted_in_a_program_leaves_a_whole_record_and_a_report(tmp_path):
    @plan(setup=lambda run: None, teardown=lambda run: None)
    def looks(run):
        """Look."""
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        astb.run_plan(looks, out=tmp_path)
    assert broken_files(tmp_path / "looks") == []
    assert "stopped by the operator" in (tmp_path / "looks" / "report.html").read_text()


def test_a_run_that_a_program_started_is_held_and_let_go_on_by_it(tmp_path):
    suspension = Suspension()

    @plan(setup=lambda run: None, teardown=lambda run: None)
    def looks(run):
        """Look."""
        suspension.request("the program")
        threading.Timer(0.1, suspension.resume).start()
        run.check("held", float(run.hold_point("here")), "1", low=0.5)

    result, _ = astb.run_plan(looks, out=tmp_path, report=False, suspension=suspension)
    assert result.verdict is Outcome.PASS


def test_modules_are_loaded_on_demand():
    look = "import sys, astb; print('numpy' in sys.modules, 'drivers' in sys.modules, *dir(astb))"
    done = subprocess.run([sys.executable, "-c", look], capture_output=True, text=True, check=True)
    numpy, drivers, *names = done.stdout.split()
    assert (numpy, drivers) == ("False", "False")
    assert set(astb.__all__) <= set(names)
    assert all(hasattr(astb, name) for name in astb.__all__)
    with pytest.raises(AttributeError, match=r"the attributes are analysis, .*open_bench"):
        astb.open_bnch  # noqa: B018


@pytest.fixture
def bench():
    with astb.open_bench("virtual") as bench:
        bench.wait(1 * s)
        yield bench


def test_every_signal_is_in_dir_and_help(bench):
    assert {device._name for device in bench.devices} <= set(dir(bench))
    for device in bench.devices:
        text = pydoc.plain(pydoc.render_doc(device))
        for line in device.declarations():
            signal = TABLE[line.full_name(device)]
            assert line.attribute in dir(device)
            assert signal.description.split()[0] in text
    assert "height" in pydoc.plain(pydoc.render_doc(bench.left))
    assert "The left air spring" in pydoc.plain(pydoc.render_doc(type(bench)))


def test_a_device_shows_itself_without_asking_the_rig(bench, monkeypatch):
    def asked(names):
        raise AssertionError(f"the rig was asked for {names}")

    monkeypatch.setattr(bench.wiring, "read", asked, raising=False)
    for device in (bench, *bench.devices):
        assert repr(device)
    assert "height = -5" in repr(bench.left)
    assert "left_mode = hold" in repr(bench.air), "read once, when the bench was opened"
    assert "lateness_50us: read when asked" in repr(bench.rig)
    assert "force_setpoint: not given" in repr(bench.lateral)


def test_what_is_absent_stale_or_closed_is_shown_as_that(bench):
    bench.wiring.absent = {"left.auxiliary_temperature": "no thermometer fitted", "rig.reason": "not told"}
    assert "auxiliary_temperature: absent (no thermometer fitted)" in repr(bench.left)
    assert "reason: absent (not told)" in repr(bench.rig)
    bench.wiring.absent = {}
    bench.wiring.carrier.can.lose("cut")
    bench.clock.sleep_until(bench.clock.now() + 10**9)
    assert re.search(r"height: stale for 1 s", repr(bench.left))
    assert math.isnan(bench.left.height)
    bench.close()
    assert "not connected" in repr(bench)


def test_what_is_absent_says_so_when_asked(bench):
    bench.wiring.absent = {"rig.lateness_50us": "it keeps no histogram"}
    with pytest.raises(NotAvailable, match=r"has no rig\.lateness_50us: it keeps no histogram"):
        bench.rig.lateness_50us  # noqa: B018


def test_misspelt_names_are_answered(bench, tmp_path, monkeypatch):
    with pytest.raises(AttributeError, match="bench has no attribute 'lefft'; did you mean 'left'"):
        bench.lefft  # noqa: B018
    with pytest.raises(PlanError, match="no plan 'leakdown'; did you mean 'leak_down'"):
        find_plan("leakdown")
    monkeypatch.chdir(tmp_path)
    with pytest.raises(RigFileError, match="no rig 'hal'; did you mean 'hall'"):
        find_rig("hal")


def test_a_rig_can_be_given_effects_and_a_real_one_cannot(tmp_path):
    with astb.open_bench("virtual", effects={"leak.left": "0.2 mm2"}) as bench:
        assert bench.about["effects"] == {"leak.left": "0.2 mm2"}
    with pytest.raises(ParameterError, match="leek"):
        astb.open_bench("virtual", effects={"leek.left": "0.2 mm2"})
    (tmp_path / "hall.toml").write_text(addresses(1, 1))
    with pytest.raises(RigFileError, match="here is a real rig"):
        astb.open_bench(tmp_path / "hall.toml", effects={"leak.left": "0.2 mm2"})


def test_what_cannot_be_diagnosed_is_refused_before_anything_is_computed(tmp_path):
    with pytest.raises(DiagnosisError, match="gone is not the folder of a run"):
        astb.diagnose_record(tmp_path / "gone")


def test_a_bench_that_is_closed_twice_or_never_connected_is_no_trouble(tmp_path):
    bench = astb.open_bench("virtual", seed=3)
    assert bench.about["seed"] == 3
    with bench:
        pass
    bench.close()
    (tmp_path / "gone.toml").write_text(addresses(1, 1))
    with pytest.raises(astb.errors.LinkLost, match=r"127\.0\.0\.1:1"):
        astb.open_bench(tmp_path / "gone.toml")
