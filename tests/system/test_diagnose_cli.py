"""`astb diagnose` and `astb investigate` for a user: their refusals."""

import os
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import msgspec
import numpy as np
import pytest

from astb.diagnose import chosen_effects, with_roles
from astb.exit_codes import BLOCKED, MISUSE, PASS
from astb.extend import write_extended
from astb.rig_file import Simulation
from astb.run import connected
from astb.session import build_rig, virtual_session
from bench_protocol.units import Hz, mm
from bench_sim.model.effects import CATALOGUE
from bench_sim.model.layout import Sensor
from bench_sim.parameters import load
from bench_sim.parameters.model_file import Model, write_model
from diagnosis.contracts import Channel, Dataset, DiagnosisError, Experiment, MeasuredRun
from diagnosis.finding import Cause, Estimate, Finding, Models, Provenance, Shift, Verdict
from diagnosis.systems.air_spring.simulator import AirSpring
from test_plans.execution import execute
from test_plans.loads import AW0
from test_plans.programmes.motions import Part, Programme, RestPose, Stretch, Wave
from test_plans.programmes.perform import programme_plan
from tests.refusals import refuses

ROOT = Path(__file__).parents[2]
SIMULATED = 'name = "test"\ntime = "virtual"\n[simulation]\nseed = 1\n'
REAL = 'name = "hall"\n'


@pytest.fixture
def cli(astb_here, tmp_path):
    """Run ``astb`` with arguments in an empty directory: exit code, stdout, stderr."""
    return lambda *arguments: astb_here(tmp_path, *arguments)


@pytest.fixture
def refused(cli, tmp_path):
    """Assert that a command is misuse, prints one sentence, and leaves no files; return the sentence."""

    def run(*arguments: str) -> str:
        before = set(tmp_path.iterdir())
        code, out, err = cli(*arguments)
        assert (code, out) == (MISUSE, ""), err
        assert "Traceback" not in err
        assert {path.name for path in set(tmp_path.iterdir()) - before} <= {"out"}
        return err

    return run


ON_A_RIG = "investigate --out out --rig rig.toml"


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("diagnose --out out", "Missing argument 'DATA...'"),
        ("diagnose nowhere", "Missing option '--out'"),
        ("diagnose nowhere --out out", "nowhere does not exist"),
        (
            "diagnose data.csv --out out",
            "data.csv is not the folder of a run; for other files, give --map FILE",
        ),
        ("diagnose empty --out out", "empty holds no record.parquet"),
        ("diagnose empty --out data.csv", "'data.csv' is a file"),
        ("diagnose empty --out data.csv/out", "cannot be used for the results: Not a directory"),
        ("diagnose empty --out out --model nosuch", "nosuch"),
        ("diagnose empty --out out --seed -1", "-1 is not in the range"),
        ("diagnose data.csv --out out --map nomap.toml", "nomap.toml cannot be read"),
        ("diagnose data.csv --out out --simulator nowhere:Gain", "there is no module nowhere in"),
        ("diagnose data.csv --out out --simulator nowhere", "does not name a class or function of a module"),
        (
            "diagnose data.csv --out out --simulator nowhere:Gain --model my.toml",
            "--model my.toml and --simulator nowhere:Gain name two different models",
        ),
        (
            "diagnose data.csv --out out --map data.csv",
            "data.csv is not TOML: line 1, time,x: the key has no value",
        ),
        ("identify nowhere --out out/model.toml", "nowhere does not exist"),
        ("identify --out model.toml", "--out model.toml needs data"),
        ("identify empty --out out/model.toml", "empty holds no record.parquet"),
        ("identify data.csv", "data.csv is not the folder of a run"),
        (
            "identify empty --expect safety",
            "--expect 'safety' is not possible; possible plans: identification",
        ),
        ("identify empty --specimen nosuch", "nosuch"),
        ("identify empty --model nosuch", "nosuch"),
        ("identify empty --model data.csv --out data.csv", "data.csv"),
        (f"{ON_A_RIG} --budget soon", "--budget = 'soon' is not a number with its unit"),
        (
            f"{ON_A_RIG} --budget 20mm",
            "--budget = '20mm' has a missing or wrong unit; use s or ms or min or h",
        ),
        (f"{ON_A_RIG} --budget 2min", "budget = 2 min, but screening alone takes 9"),
        (f"{ON_A_RIG} --model nosuch", "nosuch"),
        (
            f"{ON_A_RIG} --effect leek.left=1mm2",
            "leek.left is not an effect; did you mean 'leak.",
        ),
        (f"{ON_A_RIG} --effect leak.left", "leak.left has no value"),
        (f"{ON_A_RIG} --sealed nofile.toml", "nofile.toml"),
        ("investigate --out out --rig hall.toml --effect leak.left=1mm2", "hall.toml describes a real rig"),
        ("investigate --out out --rig hall.toml --virtual", "no [simulation] table"),
        ("investigate --out data.csv --rig rig.toml", "'data.csv' is a file"),
        ("investigate --rig rig.toml", "Missing option '--out'"),
    ],
)
def test_what_cannot_be_is_refused_in_one_sentence(refused, tmp_path, line, words):
    (tmp_path / "data.csv").write_text("time,x\n0,1\n")
    (tmp_path / "empty").mkdir()
    (tmp_path / "rig.toml").write_text(SIMULATED)
    (tmp_path / "hall.toml").write_text(REAL)
    assert words in refused(*line.split())


@pytest.mark.slow
def test_a_record_without_anything_to_replay_is_refused_with_the_plan_that_makes_some(cli, refused):
    code, _, _ = cli("run", "leak_down", "--virtual", "--rig", "virtual")
    assert code == PASS
    words = refused("diagnose", "runs/leak_down", "--out", "out")
    assert "holds no phase whose name begins with 'replay '" in words
    assert "`screening`" in words
    words = refused("diagnose", "runs/leak_down", "--out", "out", "--effects", "leek.left")
    assert "replay" in words  # data first


AFTER = {
    "left.effective_area": 0.2612345678901234,
    "right.discharge_coefficient": 0.6312345678,
    "membrane_length": 0.3612345678,
    "load_cell.3.offset": 12.34567891,
    "right.bellows_pressure.offset": 300.1234567,
}
EFFECTS = {
    "leak.left": {"area": 0.2123456789e-6},
    "maxwell": {"ratio": 0.1123456789, "time": 0.5123456789},
    "force_surface": {f"c_{i}_{j}": 12.3456789 * (i - 3.3) * (j + 0.2) for i in range(8) for j in range(4)},
    "flow_surface": {f"c_{i}_{j}": 1.23456789e-4 * (i + j) for i in range(8) for j in range(4)},
}


def found(after, effects, **facts):
    return Finding(
        verdict=Verdict.UNRESOLVED,
        sentence='said "so"',
        causes=[],
        threshold=4.0,
        alpha=0.01,
        provenance=Provenance(simulator="", seed=3, fit=[], select=[], report=[], digest="abc"),
        models=Models(before={}, after=after, effects=effects),
        **facts,
    )


def shaken(**settings):
    """Both springs shaken by 10 mm at 1 Hz for three seconds."""
    time = 5e-3 * np.arange(600)
    height = 10e-3 * np.sin(2 * np.pi * time) * np.clip(time, 0.0, 1.0)
    begin = {"left.bellows_pressure": 2.06e5, "right.bellows_pressure": 2.06e5, **settings}
    return Experiment(
        "shaken", time, {"left.height": height, "right.height": -height, "shear": height}, begin
    )


def test_a_fitted_model_is_written_as_a_file_that_predicts_the_same(tmp_path):
    """What rounding for people takes away is far below what the sensors can see."""
    path = tmp_path / "extended.toml"
    write_extended(path, found(AFTER, EFFECTS), "astb")
    model = load(path)
    assert set(model.effects) == {"leak.left", "maxwell"}
    np.testing.assert_allclose(model.entries["effective_area"].value, [0.261235, 0.26], rtol=1e-12)
    np.testing.assert_allclose(model.entries["discharge_coefficient"].value, [0.62, 0.631235], rtol=1e-12)
    bias = model.entries["sensor_bias"].value
    assert {Sensor(k).name for k in np.flatnonzero(bias)} == {"LOAD_CELL_3", "RIGHT_BELLOWS_PRESSURE"}
    simulator = AirSpring(load("astb"), effects=CATALOGUE)
    noise = [channel.noise for channel in simulator.channels]
    fitted = simulator.run(shaken(), AFTER, EFFECTS)
    written = AirSpring(model, effects=CATALOGUE).run(shaken(), {}, {})
    assert (np.abs(written - fitted) / noise).max() < 0.02
    # Each surface does something that is seen.
    for name in ("force_surface", "flow_surface"):
        without = simulator.run(shaken(), AFTER, {k: v for k, v in EFFECTS.items() if k != name})
        assert (np.abs(written - without) / noise).max() > 2.0


def test_an_extended_model_can_be_extended_from_where_the_next_one_lies(tmp_path):
    path = tmp_path / "extended.toml"
    write_extended(path, found(AFTER, EFFECTS), "astb")
    (tmp_path / "next").mkdir()
    again = tmp_path / "next" / "extended.toml"
    more = {"heat": {"change": 0.1}, "force_surface": {"c_0_0": 100.0}}
    write_extended(again, found({"load_cell.3.offset": 1.0}, more), str(path))
    before, after = load(path), load(again)
    third = Sensor.LOAD_CELL_3
    assert after.record.sensor_bias[third] == pytest.approx(before.record.sensor_bias[third] + 1.0, rel=1e-5)
    assert set(after.effects) == {*before.effects, "heat"}
    added = after.record.force_surface - before.record.force_surface
    assert added[0, 0] == pytest.approx(100.0, rel=1e-4)
    assert np.abs(added).sum() == pytest.approx(100.0, rel=1e-4)


def test_the_written_model_says_how_sure_its_numbers_are(tmp_path):
    path = tmp_path / "extended.toml"
    shift = Shift(
        name="left.effective_area",
        unit="m2",
        before=0.26,
        after=0.2612,
        sd_before=1e-3,
        sd_after=1e-3,
        sigmas=1.2,
    )
    area = Estimate(name="area", unit="mm2", value=0.212, sd=0.01, low=0.1924, high=0.2316)
    leak = Cause(
        effect="leak.left",
        title="",
        family="gas",
        parameters=[area],
        strength=None,
        score=None,
        bic_gain=None,
        lpd_gain=None,
    )
    told = found(AFTER, EFFECTS, shifts=[shift])
    write_extended(path, msgspec.structs.replace(told, causes=[leak]), "astb")
    text = path.read_text()
    assert '# left 95 %: 0.2592 to 0.2632 m2\neffective_area = ["0.261235 m2", "0.26 m2"]' in text
    assert '# 95 %: 0.192 to 0.232 mm2\narea = "0.212346 mm2"' in text
    assert 'data = "abc"' in text


@pytest.fixture(scope="module")
def leaking(tmp_path_factory):
    """A directory with the record of a leaking rig, two stretches of half a minute, and a model that has that leak."""
    directory = tmp_path_factory.mktemp("leaking")
    stretches = tuple(
        Stretch(
            (
                Wave("vertical", size, 0.5 * Hz, 3, "triangle"),
                Wave("vertical", size, 1.25 * Hz, 7),
                RestPose(height=6 * mm, rest=8.0),
                RestPose(),
            )
        )
        for size in (5 * mm, 3 * mm)
    )
    programme = Programme("short", "Short.", (Part(AW0, stretches),), "To be replayed.")
    simulation = Simulation(seed=3, effects={"leak.left": "0.3 mm2"})
    with virtual_session(build_rig(simulation), simulation) as session, connected(session):
        result = execute(programme_plan(programme), session.bench, directory / "record", seed=3)
    assert result.verdict == "pass", result.reason
    write_model(directory / "leaky.toml", Model("astb", effects={"leak.left": {"area": 0.3e-6}}))
    return directory


@pytest.mark.slow
@pytest.mark.timeout(600)
def test_effects_in_the_base_model_are_not_found_again(astb_here, leaking):
    def diagnose(out, *options):
        code, said, err = astb_here(leaking, "diagnose", "record", "--out", out, *options)
        assert code == PASS, err
        return Finding.from_json((leaking / out / "finding.json").read_bytes()), said

    before, _ = diagnose("before", "--effects", "leak.left,heat")
    assert (before.verdict, list(before.names)) == (Verdict.NAMED, ["leak.left"])
    after, said = diagnose("after", "--effects", "leak,heat", "--model", "leaky.toml")
    assert after.verdict is Verdict.NO_EFFECT
    assert {score.effect for score in after.scores} == {"leak.right", "heat"}
    assert after.provenance.simulator == "air springs on the bench with leak.left"
    assert after.provenance.simulator in said
    assert after.provenance.simulator in (leaking / "after" / "report.html").read_text()
    # The model that the first diagnosis has written is as good a base.
    again, _ = diagnose("again", "--effects", "leak,heat", "--model", "before/extended.toml")
    assert again.verdict is Verdict.NO_EFFECT


def test_an_effect_that_the_model_has_cannot_be_asked_for(astb_here, leaking):
    code, _, err = astb_here(
        leaking, "diagnose", "record", "--out", "out", "--effects", "leak.left", "--model", "leaky.toml"
    )
    assert code == MISUSE
    assert "--effects: the model contains leak.left already" in err


def dataset(*names):
    time = np.arange(20) * 0.005
    runs = tuple(
        MeasuredRun(Experiment(name, time, {}), np.zeros((20, 1)), time >= 0, time < 0) for name in names
    )
    return Dataset((Channel("x", "m"),), runs)


#: The state of the process after a command has done its work, or refused to.
_THREADS = """
import atexit, os, pathlib, sys
def tell():
    import numpy, scipy.linalg
    numpy.ones((500, 500)) @ numpy.ones((500, 500))
    print(len(os.listdir("/proc/self/task")))
atexit.register(tell)
sys.argv = ["astb", *sys.argv[1:]]
"""
_ENTRIES = {
    "astb": "from astb.cli import main; main()",
    "python -m astb": "import runpy; runpy.run_module('astb', run_name='__main__')",
    "python -m astb_studies.benchmarks.diagnosis": (
        "import runpy; runpy.run_module('astb_studies.benchmarks.diagnosis', run_name='__main__')"
    ),
}


@pytest.mark.slow
@pytest.mark.skipif(not Path("/proc/self/task").exists(), reason="threads are counted in Linux' /proc")
@pytest.mark.skipif((os.cpu_count() or 1) < 2, reason="on one core nobody makes threads")
@pytest.mark.parametrize(
    ("entry", "arguments"),
    [
        ("astb", ["diagnose", "nowhere", "--out", "out"]),
        ("python -m astb", ["diagnose", "nowhere", "--out", "out"]),
        ("astb", ["investigate", "--rig", "rig.toml", "--out", "out", "--budget", "1min"]),
        ("python -m astb_studies.benchmarks.diagnosis", ["--help"]),
    ],
)
def test_where_diagnoses_are_made_the_algebra_keeps_to_one_core(tmp_path, entry, arguments):
    (tmp_path / "rig.toml").write_text(SIMULATED)
    environment = {k: v for k, v in os.environ.items() if k != "OPENBLAS_NUM_THREADS"}

    def threads(code, **given):
        done = subprocess.run(
            [sys.executable, "-c", _THREADS + code, *arguments],
            check=False,
            capture_output=True,
            text=True,
            cwd=tmp_path,
            env={**environment, "PYTHONPATH": str(ROOT), **given},
            timeout=100,
        )
        return int(done.stdout.split()[-1]), done.stderr

    alone, said = threads(_ENTRIES[entry])
    assert alone == 1, said
    assert threads("", OPENBLAS_NUM_THREADS="2")[0] > 1  # this is how threads of the algebra show


def screening(*loads, record=""):
    return [f"screening {k} {load}{record}" for k, load in enumerate(loads, 1)]


@pytest.mark.parametrize(
    "loads",
    [
        ["AW0"] * 3 + ["AW3"] * 3,
        ["AW0"] * 2 + ["AW3"] * 2,
        ["AW0"] * 3 + ["AW3"] * 2,
        ["AW0"] * 3 + ["AW3"],
        ["AW0", "AW2", "AW2", "AW3"],
        ["AW0"] * 3 + ["AW2"] * 3 + ["AW3"] * 3,
        ["AW0"] * 6,
        ["AW0"] * 2,
        ["AW0", "AW0", "AW3"],
    ],
    ids=" ".join,
)
def test_a_screening_is_fitted_under_every_load_and_keeps_two_runs_back(loads):
    runs = with_roles(dataset(*screening(*loads))).runs
    assert [run.experiment.name for run in runs] == screening(*loads)
    assert {run.experiment.name.split()[2] for run in runs if run.role == "fit"} == set(loads)
    kept = [run.role for run in runs if run.role != "fit"]
    spare = len(loads) - len(set(loads))
    assert sorted(kept) == ["report", "select"][: min(spare, 2)]


def test_validation_runs_are_chosen_under_other_loads():
    names = screening(*["AW0"] * 3, *["AW3"] * 3)
    roles = {run.experiment.name: run.role for run in with_roles(dataset(*names)).runs}
    kept = {role: name for name, role in roles.items() if role != "fit"}
    assert kept == {"select": "screening 3 AW0", "report": "screening 5 AW3"}


def test_of_one_stretch_under_each_load_one_tells_the_gain():
    roles = [run.role for run in with_roles(dataset(*screening("AW0", "AW3"))).runs]
    assert roles == ["fit", "report"]


def test_each_screening_keeps_two_runs_back():
    loads = ["AW0"] * 3 + ["AW3"] * 3
    names = [*screening(*loads, record=" (runs/a)"), *screening(*loads, record=" (runs/b)")]
    roles = {run.experiment.name: run.role for run in with_roles(dataset(*names)).runs}
    assert {name for name, role in roles.items() if role == "select"} == {
        "screening 3 AW0 (runs/a)",
        "screening 3 AW0 (runs/b)",
    }
    assert {name for name, role in roles.items() if role == "report"} == {
        "screening 5 AW3 (runs/a)",
        "screening 5 AW3 (runs/b)",
    }


def test_runs_made_to_decide_are_fitted_and_move_no_other():
    names = screening(*["AW0"] * 3, *["AW3"] * 3)
    alone = with_roles(dataset(*names))
    both = with_roles(dataset(*names[:3], "two_speed_loops 1 AW0", *names[3:], "bump_stop 1 AW0"))
    content = {run.experiment.name: run.role for run in both.runs}
    assert content["two_speed_loops 1 AW0"] == content["bump_stop 1 AW0"] == "fit"
    assert {run.experiment.name: run.role for run in alone.runs} == {name: content[name] for name in names}


def test_causes_are_chosen_by_name_with_or_without_their_place():
    simulator = SimpleNamespace(name="it", catalogue=dict.fromkeys(["leak.left", "leak.right", "maxwell"]))
    assert chosen_effects(None, simulator) is None
    assert chosen_effects("leak, maxwell", simulator) == ("leak.left", "leak.right", "maxwell")
    assert chosen_effects("leak.right,leak.right", simulator) == ("leak.right",)
    with refuses(DiagnosisError, "'maxwel' 'maxwell'"):
        chosen_effects("leak,maxwel", simulator)
    with refuses(DiagnosisError, "leak.left leak.right"):
        chosen_effects("", simulator)


@pytest.mark.slow
def test_a_rig_that_cannot_be_screened_ends_blocked_with_the_reason(cli, tmp_path):
    (tmp_path / "rig.toml").write_text(SIMULATED + '[simulation.change]\nsupply_pressure = "1.5 bar"\n')
    code, out, _ = cli("investigate", "--rig", "rig.toml", "--out", "out")
    assert code == BLOCKED
    blocked = next(line for line in out.splitlines() if "screening blocked: the rig: " in line)
    assert "filled to 2.208 bar: not reached within" in blocked
    assert "the supply pressure is 1.5" in blocked
    assert "open the supply until it has" in blocked
    assert (tmp_path / "out" / "investigation.json").exists()
