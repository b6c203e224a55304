"""User plans in files outside packages: written, run, found in a folder, and refused."""

import json
import re
from types import SimpleNamespace

import pytest
from click.testing import CliRunner

from astb.api import find_plan
from astb.cli import commands
from astb.exit_codes import MISUSE, PASS
from astb.panel.server import _plans
from bench_protocol.units import mbar
from bench_records.result import Outcome
from test_plans.discovery import FOLDER, find_all, in_file, plans, unusable
from test_plans.execution import execute
from test_plans.new import _TEXT, write_new
from test_plans.proofreading import mistakes
from test_plans.run import PlanError, Run
from tests.refusals import refuses


def astb(*words):
    """Run the command and return its exit code and what it says."""
    done = CliRunner().invoke(commands, words)
    return done.exit_code, done.output


def test_a_new_plan_is_a_file_that_runs(tmp_path, bench_composed):
    """It judges, too: unlike springs fail it."""
    own = find_plan(str(write_new("alike", tmp_path, ())))
    assert own.title == "Alike: under the same load, both springs rest at the same pressure."
    with bench_composed() as made:
        result = execute(own, made.bench, tmp_path / "sound")
        assert result.verdict is Outcome.PASS
        assert 1 * mbar < result.checks[0].u < 50 * mbar
    with bench_composed(effective_area=[0.26, 0.24]) as made:
        assert execute(own, made.bench, tmp_path / "unlike").verdict is Outcome.FAIL


def test_the_command_writes_lists_and_describes_it(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    code, said = astb("plans", "new", "my_plan")
    assert (code, said) == (PASS, "my_plan.py: try it with `astb run my_plan.py --virtual`\n")
    code, said = astb("plans", "my_plan.py", "--json")
    assert [one["name"] for one in json.loads(said)] == ["my_plan"]
    assert "53.5 kN each" in json.loads(said)[0]["instruction"]
    code, said = astb("plans", "new", "my_plan")
    assert (code, "my_plan.py" in said) == (MISUSE, True)


def test_a_folder_of_plans_is_seen_by_name(tmp_path, monkeypatch):
    write_new("ours", tmp_path, ())
    monkeypatch.setenv(FOLDER, str(tmp_path))
    assert find_all.__wrapped__().plans["ours"].main.__name__ == "ours"


BROKEN = {
    "syntax.py": ("def f(:\n", "syntax.py, line 1"),
    "missing.py": ("\nimport nothing_of_this_name\n", "missing.py, line 2"),
    "division.py": ("\n\n1 / 0\n", "division.py, line 3"),
    "end.py": ("import sys\nsys.exit(0)\n", "end.py, line 2"),
    "bytes.py": (b"\xff\xfe\x00", "bytes.py"),
    "twice.py": (_TEXT.format(name="aw0", Title="Another"), "twice.py"),
}


@pytest.mark.parametrize("name", [*BROKEN, "no folder"])
def test_a_broken_file_costs_its_own_plans_only(tmp_path, monkeypatch, name):
    folder = tmp_path / "plans"
    if name != "no folder":
        write_new("ours", folder.mkdir() or folder, ())
        content, text = BROKEN[name]
        (folder / name).write_bytes(content if isinstance(content, bytes) else content.encode())
    else:
        text = f"ASTB_PLANS = {folder} is no folder"
    monkeypatch.setenv(FOLDER, str(folder))
    find_all.cache_clear()
    try:
        assert {"aw0", *({"ours"} if folder.exists() else ())} <= plans().keys()
        (one,) = unusable()
        assert text in one
        code, said = astb("plans")
        assert code == PASS and one in said and "  aw0 " in said
        done = CliRunner().invoke(commands, ["plans", "--json"])
        assert {plan["name"] for plan in json.loads(done.stdout)} == set(plans())
        assert one in done.stderr
        code, said = astb("run", "sytnax")
        assert (code, one in said) == (MISUSE, True)
        told_page = _plans(SimpleNamespace(out=tmp_path), "")
        assert told_page["unusable"] == [one]
        assert {plan["name"] for plan in told_page["plans"]} == set(plans())
    finally:
        find_all.cache_clear()


@pytest.mark.parametrize(
    ("text", "told"),
    [
        (None, "wrong.py"),
        ("def f(:\n", "wrong.py 1 SyntaxError"),
        ("\nimport nothing_of_this_name\n", "wrong.py 2 ModuleNotFoundError"),
        ("from test_plans.plans.under_load import aw0\n", "wrong.py"),
    ],
)
def test_an_invalid_plan_file_is_reported_with_its_line(tmp_path, text, told):
    path = tmp_path / "wrong.py"
    if text is not None:
        path.write_text(text, encoding="utf-8")
    with refuses(PlanError, told):
        in_file(path)


@pytest.mark.parametrize("name", ["2nd", "for", "new", "a-b", "aw0", ""])
def test_a_name_that_cannot_be_is_refused(tmp_path, name):
    with pytest.raises(PlanError, match=re.escape(name or "''")):
        write_new(name, tmp_path, plans())
    assert not list(tmp_path.iterdir())


def test_a_misspelt_plan_gets_a_suggestion():
    code, said = astb("run", "leakdown", "--virtual")
    assert (code, "there is no plan 'leakdown'; did you mean 'leak_down'?" in said) == (MISUSE, True)


HEAD = """
from bench_protocol.units import bar, s
from test_plans.plan import plan


@plan(lasts=1 * s)
def ours(run):
    \"\"\"Ours.\"\"\"
"""


@pytest.mark.parametrize(
    ("line", "told"),
    [
        ("run.check('pressure', 1 * bar, 'kPaa', low=0.0)", "'kPaa'"),
        ("run.check('pressure', 1 * bar, unit='baar', low=0.0)", "'bar'"),
        ("run.bench.averages('left.hight')", "'left.height'"),
        ("run.bench.left.hight", "'height'"),
        ("run.bench.leftt.height", "'left'"),
        ("run.bench.vertical.contrl = 'force'", "'control'"),
        ("run.mesured(max, {})", "'measured'"),
        ("max(lambda: bars > 1)", "'bar'"),
        ("[mbarr for _ in range(3)]", "'mbarr'"),
    ],
)
def test_a_detectable_mistake_is_reported_before_motion(tmp_path, line, told, bench_composed):
    path = tmp_path / "written_wrongly.py"
    path.write_text(f"{HEAD}    run.bench.wait(1 * s)\n    {line}\n", encoding="utf-8")
    own = find_plan(str(path))
    with bench_composed() as made:
        before = made.bench.clock.now()
        result = execute(own, made.bench, tmp_path / "run")
        assert made.bench.clock.now() == before
    assert result.verdict is Outcome.BLOCKED
    assert result.reason.startswith("the plan: written_wrongly.py, line 10: ")
    assert told in result.reason


@pytest.mark.parametrize(
    "line",
    [
        "run.check('pressure', 1 * bar, ''.join('kPaa'), low=0.0)",
        "run.check('pressure', 1 * bar, 'bar', low=3.0, high=1.0)",
        "getattr(run.bench, 'left.hight')",
        "run.bench.averages(*['left.hight'])",
        "run.bench.air.fill()",
    ],
)
def test_an_error_while_it_runs_names_the_line_of_the_users_file(tmp_path, line, bench_composed):
    path = tmp_path / "wrong_later.py"
    path.write_text(f"{HEAD}    run.bench.wait(1 * s)\n    {line}\n", encoding="utf-8")
    with bench_composed() as made:
        result = execute(find_plan(str(path)), made.bench, tmp_path / "run")
    assert result.verdict is Outcome.BLOCKED
    assert "wrong_later.py:10" in result.reason


def test_no_plan_of_ours_has_such_a_mistake(bench_composed, plan_of_the_user):
    with bench_composed() as made:
        run = Run(made.bench, None)
        assert [told for one in (*plans().values(), plan_of_the_user) for told in mistakes(one, run)] == []


@pytest.fixture
def plan_of_the_user(tmp_path):
    """A plan that names things in every lawful way that a careless reader might take for a mistake."""
    path = tmp_path / "lawful.py"
    path.write_text(
        f"""{HEAD}
    global made_later
    made_later = 1
    run.check("a", late() + made_later, f"{{'bar'}}", low=0.0)
    run.bench.settings.write({{"air.left_mode": "hold"}})
    other = run.bench
    other.anything, __name__, __file__
    [run.bench.left.height for name in dir()]


def late():
    return 1.0
""",
        encoding="utf-8",
    )
    return find_plan(str(path))
