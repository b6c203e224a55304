"""`astb diagnose` and `astb investigate` as a user meets them: what they refuse, and in which words."""

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from astb.cli import BLOCKED, MISUSE, PASS
from astb.diagnose import chosen_effects, with_roles
from astb.extend import write_extended
from bench_sim.model.layout import Sensor
from bench_sim.parameters import load
from diagnosis.contracts import Channel, Dataset, DiagnosisError, Experiment, MeasuredRun
from diagnosis.finding import Finding, Models, Provenance, Verdict

ROOT = Path(__file__).parents[2]
SIMULATED = 'name = "test"\ntime = "virtual"\n[simulation]\nseed = 1\n'
REAL = 'name = "hall"\n'


@pytest.fixture
def cli(astb_here, tmp_path):
    """Run ``astb`` with arguments in an empty directory: exit code, stdout, stderr."""
    return lambda *arguments: astb_here(tmp_path, *arguments)


@pytest.fixture
def refused(cli, tmp_path):
    """Assert that a command is misuse, tells why in one sentence, and leaves nothing behind; return the sentence."""

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
            "data.csv is no directory of a run on the bench; files of other origin need",
        ),
        ("diagnose empty --out out", "empty holds no record.parquet"),
        ("diagnose empty --out data.csv", "'data.csv' is a file"),
        ("diagnose empty --out data.csv/out", "cannot be used for the results: Not a directory"),
        ("diagnose empty --out out --model nosuch", "nosuch"),
        ("diagnose empty --out out --seed -1", "-1 is not in the range"),
        ("diagnose data.csv --out out --map nomap.toml", "nomap.toml: cannot be read"),
        ("diagnose data.csv --out out --map data.csv", "data.csv: "),
        (f"{ON_A_RIG} --budget soon", "--budget = 'soon' is not a number with its unit"),
        (f"{ON_A_RIG} --budget 20mm", "--budget = '20mm' is not in s or ms or min or h"),
        (f"{ON_A_RIG} --budget 2min", "budget = 2 min: screening alone takes 9"),
        (f"{ON_A_RIG} --model nosuch", "nosuch"),
        (
            f"{ON_A_RIG} --effect leek.left=1mm2",
            "leek.left is no effect; leak.left or leak.right would be one",
        ),
        (f"{ON_A_RIG} --effect leak.left", "leak.left has no amplitude"),
        (f"{ON_A_RIG} --sealed nofile.toml", "nofile.toml"),
        ("investigate --out out --rig hall.toml --effect leak.left=1mm2", "hall.toml describes a real rig"),
        ("investigate --out out --rig hall.toml --virtual", "without a [simulation] table"),
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


def test_a_record_without_anything_to_replay_is_refused_with_the_plan_that_makes_some(cli, refused):
    code, _, _ = cli("run", "leak_down", "--virtual", "--rig", str(ROOT / "rigs" / "virtual.toml"))
    assert code == PASS
    words = refused("diagnose", "runs/leak_down", "--out", "out")
    assert "holds no phase whose name begins with 'replay '" in words
    assert "`screening`" in words
    words = refused("diagnose", "runs/leak_down", "--out", "out", "--effects", "leek.left")
    assert "replay" in words  # data first


def test_a_fitted_model_is_written_as_a_file_that_loads_to_the_same_numbers(tmp_path):
    found = Finding(
        verdict=Verdict.UNRESOLVED,
        sentence='said "so"',
        causes=[],
        threshold=4.0,
        alpha=0.01,
        provenance=Provenance(simulator="", seed=3, fit=[], select=[], report=[], digest="abc"),
        models=Models(
            before={},
            after={
                "left.effective_area": 0.2612345678901234,
                "right.discharge_coefficient": 0.63,
                "membrane_length": 0.36,
                "load_cell.3.offset": 12.0,
                "right.bellows_pressure.offset": 300.0,
            },
            effects={"leak.left": {"area": 0.2e-6}, "maxwell": {"ratio": 0.1, "time": 0.5}},
        ),
    )
    path = tmp_path / "extended.toml"
    write_extended(path, found, "astb")
    model = load(path)
    assert model.effects == {name: dict(values) for name, values in found.models.effects.items()}
    assert model.entries["effective_area"].value.tolist() == [0.2612345678901234, 0.26]
    assert model.entries["discharge_coefficient"].value.tolist() == [0.62, 0.63]
    assert model.entries["membrane_length"].value.tolist() == [0.36, 0.36]
    bias = model.entries["sensor_bias"].value
    assert {Sensor(k).name: bias[k] for k in np.flatnonzero(bias)} == {
        "LOAD_CELL_3": 12.0,
        "RIGHT_BELLOWS_PRESSURE": 300.0,
    }
    # A model that is itself an extension is found from where the next one lies.
    (tmp_path / "next").mkdir()
    again = tmp_path / "next" / "extended.toml"
    more = Finding(
        verdict=Verdict.UNRESOLVED,
        sentence="",
        causes=[],
        threshold=4.0,
        alpha=0.01,
        provenance=found.provenance,
        models=Models(before={}, after={"load_cell.3.offset": 1.0}),
    )
    write_extended(again, more, str(path))
    assert load(again).entries["sensor_bias"].value[Sensor.LOAD_CELL_3] == 13.0
    assert load(again).effects == model.effects


def dataset(*names):
    time = np.arange(20) * 0.005
    runs = tuple(
        MeasuredRun(Experiment(name, time, {}), np.zeros((20, 1)), time >= 0, time < 0) for name in names
    )
    return Dataset((Channel("x", "m"),), runs)


@pytest.mark.parametrize("seed", range(5))
def test_runs_made_to_decide_are_fitted_and_the_screening_is_split(seed):
    names = [f"screening {k} AW0" for k in range(1, 7)]
    alone = with_roles(dataset(*names), seed)
    both = with_roles(dataset(*names[:3], "two_speed_loops 1 AW0", *names[3:], "bump_stop 1 AW0"), seed)
    told = {run.experiment.name: run.role for run in both.runs}
    assert told["two_speed_loops 1 AW0"] == told["bump_stop 1 AW0"] == "fit"
    # A decision does not move the runs on which models are chosen and the gain is told.
    assert {run.experiment.name: run.role for run in alone.runs} == {name: told[name] for name in names}
    assert {"fit", "select", "report"} == {told[name] for name in names}
    assert [run.experiment.name for run in both.runs] == [
        *names[:3],
        "two_speed_loops 1 AW0",
        *names[3:],
        "bump_stop 1 AW0",
    ]


def test_causes_are_chosen_by_name_with_or_without_their_place():
    simulator = SimpleNamespace(name="it", catalogue=dict.fromkeys(["leak.left", "leak.right", "maxwell"]))
    assert chosen_effects(None, simulator) is None
    assert chosen_effects("leak, maxwell", simulator) == ("leak.left", "leak.right", "maxwell")
    assert chosen_effects("leak.right,leak.right", simulator) == ("leak.right",)
    with pytest.raises(DiagnosisError, match="'maxwel' is no effect of it; maxwell would be one"):
        chosen_effects("leak,maxwel", simulator)
    with pytest.raises(DiagnosisError, match=r"there are leak\.left, leak\.right, maxwell"):
        chosen_effects("", simulator)


def test_a_rig_that_cannot_be_screened_ends_blocked_with_the_reason(cli, tmp_path):
    (tmp_path / "rig.toml").write_text(SIMULATED + '[simulation.change]\nsupply_pressure = "1.5 bar"\n')
    code, out, _ = cli("investigate", "--rig", "rig.toml", "--out", "out")
    assert code == BLOCKED
    assert "screening blocked: the rig: left filled to 2.208 bar" in out
    assert (tmp_path / "out" / "investigation.json").exists()
