"""The oscillator: closed forms, effects that are linear where small, and the how-to about it, run as it stands."""

import re
from pathlib import Path

import numpy as np
import pytest

from astb_studies.oscillator import (
    NUISANCES,
    Laboratory,
    Oscillator,
    ar1_noise,
    coefficients_of,
    force_surface,
)
from diagnosis.contracts import Experiment

PAGE = Path(__file__).parents[2] / "docs" / "how-to" / "diagnose-other-data.md"
NOMINAL = {nuisance.name: nuisance.nominal for nuisance in NUISANCES}


def driven(drive, *, dt=1e-3, **effects):
    """Displacement and force (n, 2) under a drive (n,)."""
    time = dt * np.arange(len(drive))
    return Oscillator().run(Experiment("run", time, {"drive": drive}), {}, effects)


def test_a_constant_force_is_held_by_the_spring():
    found = driven(np.full(20_000, 40.0))
    assert found[-1] == pytest.approx([40.0 / NOMINAL["stiffness"], 40.0], rel=1e-6)


def test_a_sine_is_answered_as_the_closed_form_says():
    dt, omega = 1e-3, 2.0 * np.pi * 3.0
    time = dt * np.arange(30_000)
    found = driven(np.sin(omega * time), dt=dt)[-5000:, 0]
    response = 1.0 / (NOMINAL["stiffness"] - NOMINAL["mass"] * omega**2 + 1j * omega * NOMINAL["damping"])
    assert found == pytest.approx(
        np.imag(response * np.exp(1j * omega * time[-5000:])), abs=1e-4 * abs(response)
    )


def test_the_step_is_of_fourth_order():
    def end(dt):
        time = dt * np.arange(round(2.0 / dt) + 1)
        return driven(20.0 * time, dt=dt, cubic={"amplitude": 1e6})[-1, 0]

    exact = end(1.25e-3)
    coarse, fine = abs(end(2e-2) - exact), abs(end(1e-2) - exact)
    assert np.log2(coarse / fine) == pytest.approx(4.0, abs=0.35)


@pytest.mark.parametrize("effect", Oscillator().catalogue.values(), ids=lambda effect: effect.name)
def test_an_effect_is_absent_at_zero_and_linear_from_there(effect):
    drive = 30.0 * np.sin(0.03 * np.arange(1000))
    shapes = {shape.name: shape.nominal for shape in effect.shapes}
    step = 1e-4 * effect.amplitude.spread

    def at(amplitude):
        return driven(drive, dt=0.01, **{effect.name: {"amplitude": amplitude, **shapes}})

    nothing = driven(drive, dt=0.01)
    assert np.array_equal(at(0.0), nothing)
    once, twice = at(step) - nothing, at(2.0 * step) - nothing
    assert np.max(np.abs(once)) > 0.0
    assert twice == pytest.approx(2.0 * once, rel=0.02, abs=0.02 * np.max(np.abs(once)))


def test_an_even_surface_is_a_constant_force():
    ones = coefficients_of(np.full((8, 4), 3.0))
    assert ones.keys() == {parameter.name for parameter in force_surface().coefficients}
    drive = 30.0 * np.sin(0.03 * np.arange(1000))
    assert driven(drive + 3.0, force=ones)[:, 0] == pytest.approx(driven(drive)[:, 0], abs=1e-12)


def test_a_seed_makes_the_same_specimen_again_and_its_noise_has_the_size_of_the_data_sheet():
    one, again = (Laboratory(samples=400).measure(5) for _ in range(2))
    for a, b in zip(one.runs, again.runs, strict=True):
        assert a.outputs.tobytes() == b.outputs.tobytes()
    quiet = Laboratory(samples=400).measure(5, loud=0.0)
    noise = np.concatenate([a.outputs - b.outputs for a, b in zip(one.runs, quiet.runs, strict=True)])
    assert noise.std(axis=0) == pytest.approx([channel.noise for channel in one.channels], rel=0.06)


@pytest.mark.parametrize("coefficient", [0.0, 0.9])
def test_noise_has_the_stated_correlation(coefficient):
    noise = ar1_noise(np.random.default_rng(2), 50_000, coefficient)
    assert noise.std() == pytest.approx(1.0, abs=0.05)
    assert np.mean(noise[1:] * noise[:-1]) == pytest.approx(coefficient, abs=0.05)


@pytest.mark.slow
def test_the_how_to_runs_as_it_stands(tmp_path, monkeypatch, capsys):
    codes = re.findall(r"```python\n(.*?)```", PAGE.read_text(), flags=re.DOTALL)
    (code,) = [one for one in codes if "write_report" in one]
    monkeypatch.chdir(tmp_path)
    exec(compile(code, str(PAGE), "exec"), {})
    assert "maxwell" in capsys.readouterr().out
    assert "oscillator" in (tmp_path / "report.html").read_text()
