"""A user's simulator: the how-to as typed, its integrator and surfaces, and its refusals."""

import os
import re
import subprocess
import sys
import tomllib
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import pytest
from numba import njit

from astb_studies.oscillator import Laboratory, Oscillator, force_surface
from diagnosis.contracts import Channel, DiagnosisError, Experiment, Hypothesis, Nuisance, Parameter
from diagnosis.engine.contract_check import check_contract
from diagnosis.estimates import Z95
from diagnosis.finding import Finding
from diagnosis.systems.integration import integrate
from diagnosis.systems.mapping import read_mapped
from diagnosis.systems.own_simulator import load_system
from diagnosis.systems.splines import SplineAxis, TensorSplines, spline_value
from tests.refusals import refuses

ROOT = Path(__file__).parents[2]
PAGE = ROOT / "docs" / "how-to" / "diagnose-other-data.md"
TIME = 0.01 * np.arange(300)
PUSHED = Experiment("pushed", TIME, {"drive": np.sin(3.0 * TIME)})


# -- the page ----------------------------------------------------------------------------------------------------------


@pytest.fixture
def page(tmp_path: Path) -> Path:
    """A directory with the files of the page and a clone's `.venv`."""
    for name, text in re.findall(r"`(\w+\.py)`:\n\n```python\n(.*?)```", PAGE.read_text(), flags=re.DOTALL):
        (tmp_path / name).write_text(text)
    folder = tmp_path / ".venv" / "bin"
    folder.mkdir(parents=True)
    for name, what in (("astb", "-m astb"), ("python", "")):
        (folder / name).write_text(f'#!/bin/sh\nexec "{sys.executable}" {what} "$@"\n')
        (folder / name).chmod(0o755)
    return tmp_path


def typed(folder: Path, command: str) -> subprocess.CompletedProcess[str]:
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    return subprocess.run(
        ["bash", "-ec", command], cwd=folder, env=environment, capture_output=True, text=True, check=False
    )


@pytest.mark.slow
@pytest.mark.timeout(600)
def test_the_page_does_what_it_says(page: Path) -> None:
    text = PAGE.read_text()
    blocks = re.findall(r"```sh\n(.*?)```", text, flags=re.DOTALL)
    (commands,) = (block for block in blocks if "measure.py" in block)
    assert len((page / "my_oscillator.py").read_text().splitlines()) < 60
    done = typed(page, commands)
    assert done.returncode == 0, done.stderr
    (said,) = re.findall(r"```\n(The cause is found.*?)```", text, flags=re.DOTALL)
    lines = said.splitlines()
    parts = [line.partition(" …")[0] for line in lines if not line.startswith("  ")]
    shown = done.stdout.splitlines()
    assert all(any(one.startswith(part.strip()) for one in shown) for part in parts), done.stdout
    assert [line for line in lines if line.startswith(("  cause", "  fit runs"))] == [
        line for line in done.stdout.splitlines() if line.startswith(("  cause", "  fit runs"))
    ]
    assert next(line.split(maxsplit=1)[1] for line in done.stderr.splitlines()) == "reading the data"
    finding = Finding.from_json((page / "runs" / "mine" / "finding.json").read_bytes())
    (cause,) = finding.causes
    assert cause.effect == "friction" and cause.parameters[0].value == pytest.approx(1.5, abs=0.02)
    assert finding.models.after_runs.keys() == {*finding.provenance.fit, *finding.provenance.report}
    refused = typed(
        page, commands.replace("python measure.py", "python -c 0")
        + "sed -i s/low=1.0/low=0.0/ my_oscillator.py\n"
        + commands.splitlines()[1]
    )  # fmt: skip
    (error,) = re.findall(r"```\n(my oscillator: .*?)```", text, flags=re.DOTALL)
    assert refused.returncode == 2
    assert " ".join(error.split()) in refused.stderr


# -- the integrator and the surface ------------------------------------------------------------------------------------


def falling(state, inputs, p):
    x, v = state
    return v, inputs[0] - p[0] * x - p[1] * v * v


@pytest.mark.parametrize(
    "rates", [falling, pytest.param(njit(falling), marks=pytest.mark.slow)], ids=["plain", "compiled"]
)
def test_the_step_is_of_fourth_order_and_meets_an_independent_integrator(rates: Callable) -> None:
    from scipy.integrate import solve_ivp

    drive = np.interp(TIME, [0.0, 1.0, 3.0], [0.0, 2.0, -1.0])
    truth = solve_ivp(
        lambda t, y: falling(y, [np.interp(t, TIME, drive)], (40.0, 0.5)),
        (0.0, TIME[-1]), (0.1, 0.0), t_eval=TIME, rtol=1e-11, atol=1e-13, max_step=0.01,
    ).y.T  # fmt: skip
    errors = [
        np.abs(integrate(rates, (0.1, 0.0), (drive,), 0.01, (40.0, 0.5), parts=parts) - truth).max()
        for parts in (1, 2)
    ]
    assert errors[0] < 1e-5
    assert np.log2(errors[0] / errors[1]) == pytest.approx(4.0, abs=0.3)


def test_an_input_that_is_held_keeps_its_value_within_a_step() -> None:
    rng = np.random.default_rng(2)
    held, straight, rate = rng.standard_normal(300), rng.standard_normal(300), 3.0
    both = (held, straight)
    x = integrate(lambda x, u, p: (u[0] - rate * x[0],), (0.4,), both, 0.01, held=(True, False))[:, 0]
    exact = [0.4]
    for u in held[:-1]:
        exact.append(u / rate + (exact[-1] - u / rate) * np.exp(-rate * 0.01))
    assert x == pytest.approx(exact, abs=1e-8)
    y = integrate(lambda x, u, p: (u[1],), (0.0,), both, 0.01, held=(True, False))[:, 0]
    assert y[1:] == pytest.approx(np.cumsum(0.005 * (straight[1:] + straight[:-1])), abs=1e-12)
    with refuses(DiagnosisError, "held 1 2 input"):
        integrate(lambda x, u, p: (u[1],), (0.0,), both, 0.01, held=(True,))


def test_a_surface_is_the_same_inside_a_right_hand_side_and_over_states_that_are_known() -> None:
    rng = np.random.default_rng(3)
    axes = SplineAxis("x", "x", (-1.0, 0.0, 1.0, 2.0)), SplineAxis("v", "v", (0.0, 0.5, 1.0))
    splines = TensorSplines("force", "a force", *axes, "N", 1.0, frozenset())
    coefficients = {one.name: rng.standard_normal() for one in splines.surface.coefficients}
    x, v = rng.uniform(-2.0, 3.0, 400), rng.uniform(-1.0, 2.0, 400)
    table = splines.table(coefficients)
    one_by_one = [spline_value(table, a, b) for a, b in zip(x, v, strict=True)]
    assert one_by_one == pytest.approx(splines.value({"x": x, "v": v}, coefficients), abs=1e-10)
    assert spline_value(splines.table(None), 0.3, 0.3) == 0.0


# -- the contract ------------------------------------------------------------------------------------------------------


@dataclass
class Scale:
    """y = gain · drive + what an effect of amplitude ``a`` and shape ``s`` adds."""

    term: Callable[[float, float, np.ndarray], np.ndarray]
    low: float = -np.inf
    name: str = "scale"
    channels: tuple = (Channel("y", "V"),)
    nuisances: tuple = (Nuisance("gain", "V/N", 1.0, 0.1),)
    surfaces: tuple = ()
    catalogue: dict = field(init=False)

    def __post_init__(self) -> None:
        shape = Parameter("s", "s", 1.0, 0.5, 0.1, 10.0)
        amplitude = Parameter("a", "V", 0.0, 2.0, self.low)
        self.catalogue = {"odd": Hypothesis("odd", "family", "odd", amplitude, (shape,), ((1.0,), (2.0,)))}

    def run(self, experiment, parameters, effects):
        drive = experiment.inputs["drive"]
        y = parameters["gain"] * drive
        if "odd" in effects:
            y = y + self.term(effects["odd"]["a"], effects["odd"]["s"], drive)
        return y[:, np.newaxis]


def test_what_keeps_the_contract_passes() -> None:
    check_contract(Scale(lambda a, s, u: a * np.tanh(u / s)), PUSHED)
    check_contract(
        replace(Oscillator(), surfaces=(force_surface(),)), Laboratory(samples=300).experiments()[1]
    )


@pytest.mark.parametrize(
    ("term", "low", "message"),
    [
        (lambda a, s, u: a * u + 1e-9, -np.inf, "a 0 V s 1 1e-09"),
        (lambda a, s, u: np.sqrt(a) * u, 0.0, "effect a 0.01 V a 0.02 V s 1"),
        (lambda a, s, u: a * a * u, -np.inf, "proportional"),
        (lambda a, s, u: abs(a) * u, -np.inf, "effect a -0.02 V a 0.02 V s 1 0"),
        (lambda a, s, u: u * np.exp(-1.0 / max(a, 1e-3)) * (a > 0.0), 0.0, "0.02 V s 1 changes"),
        (lambda a, s, u: a / (10.0 - s) * u, -np.inf, "odd.a 2 V odd.s 10 s gain 1 V/N ZeroDivisionError"),
        (lambda a, s, u: a * u * np.log(s - 0.5), -np.inf, "nan 0 s odd.a 2 V odd.s 0.1 s"),
        (lambda a, s, u: a * u[:7], -np.inf, "odd.a 0"),
        (lambda a, s, u: a * np.random.default_rng().standard_normal(300), -np.inf, "proportional"),
    ],
    ids=["present", "root", "square", "kink", "flat", "zero division", "nan", "shape", "chance"],
)  # fmt: skip
def test_contract_violations_name_the_parameters(term, low: float, message: str) -> None:
    with refuses(DiagnosisError, message):
        check_contract(Scale(term, low), PUSHED)


def test_a_base_model_that_fails_or_ignores_state_or_shape_is_refused() -> None:
    plain = Scale(lambda a, s, u: a * u)
    with refuses(DiagnosisError, "inf 0 V/N"):
        check_contract(_Changed(plain, lambda y, p: y / p["gain"], nuisance_low=0.0), PUSHED)
    with refuses(DiagnosisError, "outputs"):
        calls = iter(range(1000))
        check_contract(_Changed(plain, lambda y, p: y + next(calls)), PUSHED)
    with refuses(DiagnosisError, "shape (300,) 300 1"):
        check_contract(_Changed(plain, lambda y, p: y[:, 0]), PUSHED)


class _Changed:
    def __init__(self, plain: Scale, change: Callable, nuisance_low: float = -np.inf) -> None:
        self.plain, self.change = plain, change
        self.name, self.channels, self.surfaces = plain.name, plain.channels, plain.surfaces
        self.catalogue = plain.catalogue
        self.nuisances = (replace(plain.nuisances[0], low=nuisance_low),)

    def run(self, experiment, parameters, effects):
        return self.change(self.plain.run(experiment, parameters, effects) + 1.0, parameters)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"amplitude": Parameter("a", "V", 1.0, 1.0)}, "value 1 0"),
        ({"grid": ((),)}, "grid 0"),
        ({"name": "other"}, "'other'"),
        ({"amplitude": Parameter("a", "V", 0.0, 0.0)}, "spread 0 0 V"),
    ],
)  # fmt: skip
def test_declarations_that_contradict_themselves_are_refused(change: dict, message: str) -> None:
    model = Scale(lambda a, s, u: a * u)
    model.catalogue = {"odd": replace(model.catalogue["odd"], **change)}
    with refuses(DiagnosisError, message):
        check_contract(model, PUSHED)


# -- the factory -------------------------------------------------------------------------------------------------------

OWN = """
import numpy as np
from diagnosis.contracts import Channel, Nuisance
class Gain:
    name, catalogue, surfaces = "amplifier", {}, ()
    inputs = {"drive": "V"}
    channels = Channel("y", "V", noise=0.1), Channel("z", "V")
    nuisances = (Nuisance("gain", "1", 2.0, 0.1),)
    def run(self, experiment, parameters, effects):
        y = parameters["gain"] * experiment.inputs["drive"]
        return np.column_stack((y, -y))
class Silent:
    name = "silent"
def broken():
    return 1 / 0
"""


@pytest.fixture
def own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.chdir(tmp_path)
    monkeypatch.delitem(sys.modules, "amplifier_of_mine", raising=False)
    (tmp_path / "amplifier_of_mine.py").write_text(OWN)
    (tmp_path / "needs.py").write_text("import nowhere_to_be_found")
    rows = [f"{t:.2f},{np.sin(t):.6f},{2.1 * np.sin(t):.6f}" for t in TIME]
    (tmp_path / "a.csv").write_text("time,drive,y\n" + "\n".join(rows))
    return tmp_path


def test_columns_named_like_the_signals_need_no_map(own: Path) -> None:
    simulator, dataset = read_mapped([own / "a.csv"], None, "amplifier_of_mine:Gain")
    (run,) = dataset.runs
    assert [(channel.name, channel.noise) for channel in dataset.channels] == [
        ("y", 0.1)
    ]  # z was not measured
    assert simulator.run(run.experiment, {"gain": 2.1}, {})[:, :1] == pytest.approx(run.outputs, abs=2e-6)


@pytest.mark.parametrize(
    ("of_class", "of_map", "stairs"),
    [
        ("", "", False),
        ("held = {'drive'}", "", True),
        ("", "true", True),
        ("held = {'drive'}", "false", False),
    ],
)
def test_an_input_is_held_as_the_simulator_or_the_map_says(
    own: Path, of_class: str, of_map: str, stairs: bool
) -> None:
    (own / "amplifier_of_mine.py").write_text(
        OWN.replace("    inputs =", f"    {of_class or 'pass'}\n    inputs =")
    )
    hold = f", hold = {of_map}" if of_map else ""
    (own / "map.toml").write_text(
        f'[time]\nstep = "5 ms"\n[columns]\ndrive = {{column = "drive", unit = "V"{hold}}}\n'
        'y = {column = "y", unit = "V"}\n'
    )
    _, data = read_mapped([own / "a.csv"], own / "map.toml", "amplifier_of_mine:Gain")
    (run,) = data.runs
    drive, between = run.experiment.inputs["drive"], np.round(np.sin(TIME), 6)
    assert (run.experiment.held == {"drive"}) is stairs
    assert drive[::2] == pytest.approx(between, abs=1e-12) and len(drive) == 599
    inside = between[:-1] if stairs else 0.5 * (between[:-1] + between[1:])
    assert drive[1::2] == pytest.approx(inside, abs=1e-12)
    (own / "amplifier_of_mine.py").write_text(
        OWN.replace("    inputs =", "    held = {'dive'}\n    inputs =")
    )
    sys.modules.pop("amplifier_of_mine")
    with refuses(DiagnosisError, "drive"):
        load_system("amplifier_of_mine:Gain", own)


def test_a_map_may_name_a_simulator_in_its_folder(own: Path) -> None:
    mapping = own / "map.toml"
    columns = (
        '[columns]\ndrive = {column = "drive", unit = "V"}\ny = {column = "y", unit = "V", noise = "0.2 V"}\n'
    )
    mapping.write_text('simulator = "amplifier_of_mine:Gain"\n' + columns)
    _, dataset = read_mapped([own / "a.csv"], mapping)
    assert [channel.noise for channel in dataset.channels] == [0.2]
    with refuses(DiagnosisError, "amplifier_of_mine:Gain"):
        read_mapped([own / "a.csv"], mapping, "other:one")
    mapping.write_text(columns)
    with refuses(DiagnosisError, "air_spring"):
        read_mapped([own / "a.csv"], mapping)
    mapping.write_text(
        'simulator = "amplifier_of_mine:Gain"\n[columns]\ndrive = {column = "drive", unit = "V"}'
    )
    with refuses(DiagnosisError, "amplifier"):
        read_mapped([own / "a.csv"], mapping)


def test_the_parameters_of_any_simulator_are_identified(own: Path) -> None:
    from astb.identify import IdentificationRequest as Asked
    from astb.identify import identify_data
    from astb.tables import plain_console

    rng, files = np.random.default_rng(5), []
    for run in range(6):
        y = 2.1 * np.sin(TIME + run) + 0.1 * rng.standard_normal(len(TIME))
        rows = [f"{t:.2f},{np.sin(t + run):.6f},{value:.6f}" for t, value in zip(TIME, y, strict=True)]
        files.append(own / f"run{run}.csv")
        files[-1].write_text("time,drive,y\n" + "\n".join(rows))
    asked = Asked(files, None, "astb", None, None, "amplifier_of_mine:Gain")
    answer = identify_data(asked, own / "found.toml", plain_console(stderr=True))
    (row,) = answer.rows
    assert row.told and not answer.doubts
    # As given by the sum of squares, or wider by the scatter of few runs.
    width, least = row.high - row.value, Z95 * 0.1 / np.sqrt(1800 * 0.5)
    assert abs(row.value - 2.1) < 1.5 * width and 0.9 * least < width < 2.5 * least
    assert tomllib.loads((own / "found.toml").read_text())["parameters"].keys() == {"gain"}


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("amplifier_of_mine", "class"),
        ("nothing_here:Gain", "nothing_here"),
        ("needs:Gain", "nowhere_to_be_found"),
        ("amplifier_of_mine:Gian", "'Gain'"),
        ("amplifier_of_mine:broken", "ZeroDivisionError amplifier_of_mine.py 15"),
        ("amplifier_of_mine:Silent", "nuisances"),
    ],
)
def test_a_factory_that_makes_no_simulator_is_refused(own: Path, name: str, message: str) -> None:
    with refuses(DiagnosisError, message):
        load_system(name, own)
