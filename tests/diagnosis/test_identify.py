"""Identification: unknown springs are identified from their records with the stated accuracy; the rest is reported."""

from dataclasses import replace

import numpy as np
import pytest

from astb.identify import IdentificationRequest, drawn_as, identify_data, show
from astb.rig_file import Simulation
from astb.session import simulated_parameters
from astb.tables import plain_console
from bench_protocol.units import Hz, litre, mm, mrad
from bench_sim.model.spring import volume
from bench_sim.parameters import load
from bench_sim.parameters.model_file import load_model
from diagnosis.contracts import Experiment
from diagnosis.engine.identify import believed, expected, identify
from diagnosis.estimates import Z95
from diagnosis.systems.air_spring.identified import (
    ASKED,
    UnknownSpring,
    names_of_shape,
    quantity,
    shape,
    uncertain_shape,
)
from test_plans.loads import AW3
from test_plans.programmes.motions import Part, Programme, Stretch, Wave
from test_plans.specimen import DRAWING, ordinary

UPRIGHT = (Wave("vertical", 3 * mm, 2.5 * Hz, 6), Wave("vertical", 8 * mm, 0.5 * Hz, 3))
SIDEWAYS = (Wave("lateral", 12 * mm, 0.5 * Hz, 3), Wave("roll", 8 * mrad, 0.5 * Hz, 3))
LATERAL = {name for name in ASKED if "lateral" in name or "membrane" in name}


def drawn(seed):
    """Values of unknown springs, each within two standard deviations of its prior."""
    chance, parameters, values = np.random.default_rng(seed), load("astb"), {}
    for name, asked in ASKED.items():
        away = np.clip(chance.standard_normal(2), -2.0, 2.0)
        value = parameters.entries[name].value
        values[name] = value * (1.0 + asked.spread * (away if asked.each else away[0]))
    return values


def truth(values, name):
    return float(values[quantity(name)][int(name.startswith("right."))])


def motion(name, lateral):
    """Both springs go up and down by 6 mm at 1 Hz, and sideways by as much if ``lateral``."""
    time = 5e-3 * np.arange(300)
    way = 6 * mm * np.sin(2 * np.pi * time) * np.clip(time, 0.0, 1.0)
    begin = {f"{side}.bellows_pressure": 2.06e5 for side in ("left", "right")}
    inputs = {"left.height": way, "right.height": way, "shear": way if lateral else 0.0 * way}
    return Experiment(name, time, inputs, begin, minutes=1.0)


def shares(found):
    return {
        one.parameter.name: one.share for one in found.parameters if quantity(one.parameter.name) in ASKED
    }


def test_predictions_for_runs_match_their_results(laboratory):
    here = laboratory(samples=400)
    first, *others = here.experiments()[:3]
    data = here.measure(3)
    found = identify(replace(data, runs=data.runs[:3]), here.simulator, workers=1)
    alone = believed(here.simulator, [first], workers=1)
    foretold = believed(here.simulator, [first, *others], workers=1)
    later = expected(alone, others)
    for one, before, then, all_at_once in zip(
        *(which.parameters for which in (found, alone, later, foretold)), strict=True
    ):
        assert then.deviation <= 1.001 * before.deviation <= 1.002 * before.parameter.spread
        assert then.deviation == pytest.approx(all_at_once.deviation, rel=0.02)
        assert one.deviation == pytest.approx(all_at_once.deviation, rel=0.5)
        assert one.parameter.name == then.parameter.name


@pytest.mark.slow
def test_constant_signals_identify_no_cause_and_a_sufficient_run_is_predicted():
    upright = believed(UnknownSpring(load("astb")), [motion("up and down", lateral=False)])
    before, after = shares(upright), shares(expected(upright, [motion("sideways", lateral=True)]))
    assert all(before[name] > 0.9 for name in LATERAL)
    assert before["left.effective_area"] < 0.1
    assert all(after[name] < 1.01 * before[name] for name in before)
    assert after["shell_stiffness_lateral"] < 0.5 < before["shell_stiffness_lateral"]


@pytest.mark.slow
def test_intervals_of_an_oscillator_hold_with_their_stated_probability(laboratory):
    """For specimens with parameters drawn from the prior, 95 % of the intervals hold; noise is AR(1)."""
    here, away = laboratory(samples=400), []
    for seed in range(16):
        data = here.measure(seed, colour=0.5)
        known = here._drawn(np.random.default_rng(seed), per_run=False)
        for one in identify(data, here.simulator, workers=1).parameters:
            away.append((one.value - known[one.parameter.name]) / one.deviation)
    assert np.mean(np.abs(away) < Z95) > 0.87  # three standard deviations of a count of 64 below 95 %
    assert 0.75 < np.sqrt(np.mean(np.square(away))) < 1.25


def test_the_shape_of_a_bellows_is_that_of_the_model_and_its_width_that_of_many_drawn_ones():
    values = drawn(2)
    par = load("astb").with_values(**values).record
    own = np.array([truth(values, name) for name in names_of_shape("right")])
    for height, shear in ((0.0, 0.0), (12 * mm, 0.0), (-15 * mm, 20 * mm), (4 * mm, -9 * mm)):
        area, inside = shape(own, height, shear)
        assert inside == pytest.approx(volume(par, 1, height, shear), rel=1e-12)
        further, less = shape(own, height + 1e-4, shear)[1], shape(own, height - 1e-4, shear)[1]
        assert area == pytest.approx((further - less) / 2e-4, rel=1e-9)

        chance = np.random.default_rng(1)
        mixed = chance.standard_normal((6, 6))
        covariance = 1e-6 * np.outer(own, own) * (mixed @ mixed.T)
        many = chance.multivariate_normal(own, covariance, size=2000)
        scattered = np.std([shape(one, height, shear) for one in many], axis=0)
        assert uncertain_shape(own, covariance, height, shear)[1] == pytest.approx(scattered, rel=0.06)


@pytest.fixture(scope="module")
def unknown(bench_record):
    """A record of springs that are drawn, and their values."""
    values = drawn(5)
    return bench_record("unknown springs", [Stretch(UPRIGHT), Stretch(SIDEWAYS)], **values).directory, values


@pytest.mark.slow
def test_springs_that_were_drawn_are_identified_and_their_file_is_a_model(
    unknown, tmp_path, capsys, monkeypatch
):
    directory, values = unknown
    further = Programme(
        "further", "Further", (Part(AW3, (Stretch(SIDEWAYS, condition=()),)),), "Another load."
    )
    monkeypatch.setattr("astb.identify.IDENTIFICATION", further)
    path = tmp_path / "identified.toml"
    request = IdentificationRequest([directory], None, "astb", None, None)
    answer = identify_data(request, path, plain_console(stderr=True))
    told = [row for row in answer.rows if row.told]
    assert len(told) > 20
    assert [doubt.partition(":")[0] for doubt in answer.doubts] == ["2 runs"]
    scale = {one.name: one.scale for one in UnknownSpring(load("astb")).nuisances}
    held = [row.low <= truth(values, row.name) / scale[row.name] <= row.high for row in answer.rows]
    assert sum(held) >= len(held) - 5, [r.name for r, one in zip(answer.rows, held, strict=True) if not one]
    # The result is reported, not the prior.
    assert np.mean([row.left for row in told]) < 0.15

    places = {(one.side, one.height, one.shear) for one in answer.shapes}
    assert {("left", 0.0, 0.0), ("right", 0.0, 10.0), ("left", 0.0, -10.0)} <= places
    for one in answer.shapes:
        own = np.array([truth(values, name) for name in names_of_shape(one.side)])
        area, inside = shape(own, one.height * mm, one.shear * mm)
        assert one.area == pytest.approx(area, abs=2.0 * one.area_width)
        assert one.volume == pytest.approx(inside / litre, abs=2.0 * one.volume_width)

    model = load_model(path)
    assert model.finding["kind"] == "identification"
    assert set(model.finding["deviations"]) == {row.name for row in answer.rows}
    run = simulated_parameters(Simulation(parameters=str(path)))
    for row in answer.rows:
        found = float(run.entries[quantity(row.name)].value[int(row.name.startswith("right."))])
        assert found / scale[row.name] == pytest.approx(row.value, rel=1e-5)
    assert {"torsional_stiffness", "torsional_stiffness_slope"} & {
        one.name for one in answer.rows if not one.told
    }
    # Under one load, parts without pressure and parts with it cannot be separated.
    untold = [one.name for one in answer.rows if not one.told]
    assert len(answer.further) == len(untold)
    for name, text in zip(untold, answer.further, strict=True):
        assert text.startswith(f"{name} is not determined") and "astb run further" in text
    show(answer, path, plain_console())
    assert "left.effective_area" in capsys.readouterr().out


def test_a_drawing_goes_over_the_model_that_is_believed():
    other = replace(ordinary(), bellows_volume=0.026)
    assert drawn_as(load("astb"), other).entries["bellows_volume"].value == pytest.approx([0.026, 0.026])
    assert set(DRAWING) <= set(ASKED), "what a drawing states is identified"
