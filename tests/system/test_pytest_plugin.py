"""The plugin of pytest: the page's tests run as printed, and what the bench spoils is blocked, not failed."""

import re
import subprocess
import sys
from importlib.metadata import entry_points
from pathlib import Path

import pytest

from bench_records.result import Outcome, read_result

ROOT = Path(__file__).parents[2]
PAGE = ROOT / "docs" / "how-to" / "use-python.md"
#: How a test can end, one of each.
ENDINGS = '''
import pytest

from drivers.errors import LinkLost, RigFault
from test_plans.plan import plan
from test_plans.steps import power_up


def light(low):
    @plan(setup=lambda run: None, teardown=lambda run: None)
    def look(run):
        """Look: the left actuator does not press."""
        run.check("force", run.bench.vertical_left.force, "kN", low=low, high=1e3)

    return look


@plan
def broken(run):
    """Broken: somebody pulls the plug."""
    raise LinkLost("the plug is out")


def test_passes(run):
    assert run(light(-1e3)).verdict == "pass"


def test_fails(run):
    assert run(light(500.0)).verdict == "pass"


def test_is_blocked_by_its_plan(run):
    run(broken)


def test_is_blocked_by_the_rig(bench):
    raise RigFault("it does not want to")


def test_fails_by_itself(bench):
    raise ValueError("a mistake in the test")


def test_without_a_bench():
    raise RigFault("no bench was asked for")


def test_knows_the_plans(run):
    run("aw7")


held = []


def test_leaves_it_armed(bench):
    bench.arm()
    held.append(bench)


def test_finds_it_safe():
    (bench,) = held
    assert not bench._connected
'''


def pytest_run(directory: Path, *options: str) -> tuple[int, str]:
    # In a real separate session: this one's settings turn every warning into an error.
    command = [sys.executable, "-m", "pytest", "-p", "astb.pytest_plugin", "-v", "-p", "no:cacheprovider"]
    done = subprocess.run(
        [*command, *options], cwd=directory, capture_output=True, text=True, timeout=100, check=False
    )
    assert not done.stderr
    return done.returncode, done.stdout


@pytest.fixture(scope="module")
def ended(tmp_path_factory) -> str:
    directory = tmp_path_factory.mktemp("endings")
    (directory / "test_endings.py").write_text(ENDINGS)
    code, said = pytest_run(directory, "--rig-records", "runs")
    assert code == pytest.ExitCode.TESTS_FAILED
    assert read_result(directory / "runs" / "look").verdict is Outcome.PASS
    assert read_result(directory / "runs" / "look-2").verdict is Outcome.FAIL
    assert (directory / "runs" / "look-2" / "report.html").exists()
    return said


@pytest.mark.slow
def test_the_page_runs_as_printed(tmp_path):
    blocks = re.findall(r"^```python\n(.*?)^```", PAGE.read_text(), flags=re.MULTILINE | re.DOTALL)
    (code,) = (block for block in blocks if "def test_" in block)
    (tmp_path / "test_springs.py").write_text(code)
    status, said = pytest_run(tmp_path)
    assert status == 0, said
    assert "3 passed" in said


@pytest.mark.slow
@pytest.mark.parametrize(
    ("test", "ending"),
    [
        ("passes", "PASSED"),
        ("fails", "FAILED"),
        ("is_blocked_by_its_plan", "BLOCKED"),
        ("is_blocked_by_the_rig", "BLOCKED"),
        ("fails_by_itself", "FAILED"),
        ("without_a_bench", "FAILED"),
        ("knows_the_plans", "ERROR"),
        ("leaves_it_armed", "PASSED"),
        ("finds_it_safe", "PASSED"),
    ],
)
def test_a_test_ends_as_it_should(ended, test, ending):
    assert re.search(rf"::test_{test} {ending}", ended)


@pytest.mark.slow
def test_the_catalogue_is_a_test_for_each_plan_that_judges_and_each_of_its_choices(tmp_path):
    from test_plans.discovery import plans

    options = ("--pyargs", "astb.catalogue", "--collect-only", "-q", "--plan-set", "amplitude=5mm")
    code, said = pytest_run(tmp_path, *options)
    assert code == 0, said
    named = {name.partition(" ")[0] for name in re.findall(r"test_plan\[(.*?)\]", said)}
    assert named == {one.name for one in plans().values() if one.judges}
    assert not {one.name for one in plans().values() if not one.judges} & named
    assert said.count("test_plan[lateral_stiffness load=") == 2
    assert said.count("test_plan[lateral_stiffness load=AW3,amplitude=5 mm,offset=0 mm]") == 1


@pytest.mark.slow
def test_a_plan_that_there_is_not_is_an_error_with_a_suggestion(tmp_path):
    (tmp_path / "test_it.py").write_text("def test_it(run):\n    run('leakdown')\n")
    code, said = pytest_run(tmp_path, "test_it.py")
    assert code == 1
    assert "1 error" in said and "failed" not in said
    assert "did you mean 'leak_down'?" in said
    assert "Traceback" not in said and "find_plan" not in said


@pytest.mark.slow
def test_a_plan_of_the_catalogue_passes_on_a_sound_rig_and_leaves_its_record(tmp_path):
    options = ("--pyargs", "astb.catalogue", "-k", "tightness", "--plan-set", "hold=20s")
    code, said = pytest_run(tmp_path, *options, "--rig-records", "runs")
    assert code == 0, said
    assert "1 passed" in said
    assert read_result(tmp_path / "runs" / "tightness").parameters == {"hold": "20 s"}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("setting", "told"), [("hald=20s", "no plan has a parameter hald"), ("hold=1s", "hold = 1 s")]
)
def test_a_wrong_parameter_of_the_catalogue_is_refused_before_any_plan(tmp_path, setting, told):
    command = [sys.executable, "-m", "pytest", "--pyargs", "astb.catalogue", "--plan-set", setting]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=100, check=False)
    assert done.returncode == pytest.ExitCode.INTERRUPTED
    assert told in done.stdout + done.stderr


@pytest.mark.slow
def test_blocked_runs_have_a_reason(ended):
    assert "test_is_blocked_by_its_plan (call): broken: the link to the rig: the plug is out" in ended
    assert "test_is_blocked_by_the_rig (call): the rig: it does not want to" in ended
    assert "did you mean 'aw" in ended
    assert "force = -" in ended, "the checks of a plan that failed are shown"


@pytest.mark.slow
def test_a_rig_that_is_not_there_blocks(tmp_path):
    (tmp_path / "hall.toml").write_text('name = "hall"\n[can]\nbus = "tcp"\nport = 1\n[modbus]\nport = 1\n')
    (tmp_path / "test_it.py").write_text("def test_it(bench):\n    pass\n")
    code, said = pytest_run(tmp_path, "--rig", "hall.toml")
    assert code == pytest.ExitCode.TESTS_FAILED
    assert "test_it (setup): the link to the rig: no Modbus device answers at 127.0.0.1:1" in said
    _, said = pytest_run(tmp_path, "--rig", "halll")
    assert "--rig: there is no rig 'halll'" in said


def test_an_unused_plugin_is_not_imported():
    loaded = "import sys, astb.pytest_plugin; print(*sys.modules)"
    done = subprocess.run([sys.executable, "-c", loaded], capture_output=True, text=True, check=True)
    assert not {"numpy", "msgspec", "click", "drivers", "bench_protocol"} & set(done.stdout.split())


def test_pytest_finds_it():
    found = {point.name for point in entry_points(group="pytest11") if point.value == "astb.pytest_plugin"}
    if not found:
        pytest.skip("this environment is older than the plugin: install ASTB anew")
    assert found == {"astb.pytest_plugin"}, "so that pytest loads it once, however it is named"
