"""The judge's own judgement: what counts as right, wrong and missed, and what a sealed bench gives away."""

import json
import math
import re

import numpy as np
import pytest
from click.testing import CliRunner
from hypothesis import given, settings
from hypothesis import strategies as st

from astb_studies.benchmarks.diagnosis import rate_page
from astb_studies.benchmarks.diagnosis.__main__ import main
from astb_studies.benchmarks.diagnosis.ground_truth import CONDITIONS, KINDS, GroundTruth, draw, visible
from astb_studies.benchmarks.diagnosis.judge import Judged, covered
from astb_studies.benchmarks.diagnosis.lambda_per_unit import LambdaPerUnit
from astb_studies.benchmarks.diagnosis.next_of_kin import NEAR, kin
from astb_studies.benchmarks.diagnosis.sealed import COLOURED, Coloured, parameters_of
from astb_studies.benchmarks.diagnosis.statistics import Rate
from astb_studies.benchmarks.diagnosis.uncatalogued_terms import UNCATALOGUED, roughness, together
from bench_sim.model.effects import CATALOGUE
from bench_sim.parameters import load
from bench_sim.rig.rig import Rig
from diagnosis.finding import Verdict

NAMED, NONE = Verdict.NAMED.value, Verdict.NO_EFFECT.value


def judged_case(hidden, causes, *, rivals=(), verdict=NAMED, kind="single", near=(), weakest=50.0, **more):
    return Judged(
        system="test",
        seed=0,
        kind=kind,
        condition="white",
        weakest=weakest,
        hidden=list(hidden),
        verdict=verdict,
        causes=list(causes),
        rivals=list(rivals),
        near=list(near),
        **more,
    )


@pytest.mark.parametrize(
    ("case", "exact", "reported", "wrong", "amiss"),
    [
        (judged_case(["leak.left"], ["leak.left"]), True, True, [], ""),
        (judged_case(["leak.left"], ["heat"]), False, False, ["heat"], "wrong cause"),
        (judged_case(["leak.left"], ["leak.right"]), False, False, ["leak.right"], "wrong cause"),
        (judged_case(["leak.left"], ["leak.left", "heat"]), False, True, ["heat"], "wrong cause"),
        (judged_case(["leak.left"], ["heat"], rivals=["leak.left"]), False, True, [], ""),
        (judged_case(["leak.left"], ["leak.left"], rivals=["heat"]), False, True, [], ""),
        (
            judged_case(["leak.left"], ["heat", "creep"], rivals=["leak.left"]),
            False,
            True,
            ["heat", "creep"],
            "wrong",
        ),
        (judged_case(["maxwell_two"], ["maxwell"], near=["maxwell"]), False, False, [], "not reported"),
        (judged_case(["leak.left"], [], verdict=NONE), False, False, [], "not seen"),
        (judged_case(["leak.left"], [], verdict=NONE, weakest=5.0), False, False, [], ""),
        (judged_case(["leak.left"], [], verdict=Verdict.UNRESOLVED.value), False, False, [], "not reported"),
        (
            judged_case(["leak.left"], [], verdict=Verdict.UNRESOLVED.value, suspects=["leak.left", "creep"]),
            False,
            True,
            [],
            "",
        ),
        (judged_case(["snag"], [], verdict=Verdict.UNKNOWN.value, kind="outside"), False, False, [], ""),
        (judged_case(["snag"], ["maxwell"], kind="outside"), False, False, ["maxwell"], "wrong cause"),
        (judged_case([], [], verdict=NONE, kind="null", weakest=0.0), True, True, [], ""),
        (
            judged_case([], [], verdict=Verdict.UNKNOWN.value, kind="null", weakest=0.0),
            True,
            True,
            [],
            "false alarm",
        ),
        (judged_case([], ["heat"], kind="null", weakest=0.0), False, True, ["heat"], "false alarm"),
        (judged_case(["leak.left"], ["leak.left"], deviations=[5.0]), True, True, [], "off by 5"),
    ],
)
def test_findings_are_judged_exact_reported_or_wrong(case, exact, reported, wrong, amiss):
    assert (case.exact, case.reported, case.wrong) == (exact, reported, wrong)
    assert case.amiss.startswith(amiss) if amiss != "off by 5" else "off by 5" in case.amiss
    assert bool(case.amiss) == bool(amiss)


@given(st.integers(0, 40), st.integers(1, 40))
@settings(deadline=None)
def test_an_exact_interval_has_tails_of_two_and_a_half_per_cent(hits, count):
    hits = min(hits, count)
    low, high = Rate(hits, count).interval

    def at_least(k, p):
        return sum(math.comb(count, i) * p**i * (1 - p) ** (count - i) for i in range(k, count + 1))

    assert low <= hits / count <= high
    assert low == 0.0 if hits == 0 else at_least(hits, low) == pytest.approx(0.025, abs=1e-9)
    assert high == 1.0 if hits == count else 1 - at_least(hits + 1, high) == pytest.approx(0.025, abs=1e-9)


def test_intervals_of_normal_deviations_hold_what_they_promise():
    deviations = np.random.default_rng(1).standard_normal(20_000).tolist()
    for level in (0.5, 0.8, 0.9, 0.95):
        assert covered(deviations, level) / len(deviations) == pytest.approx(level, abs=0.01)


@pytest.mark.parametrize("kind", KINDS)
def test_a_seed_hides_the_same_again_and_another_something_else(kind, tmp_path):
    drawn = [draw(seed, kind) for seed in range(4)]
    assert drawn == [draw(seed, kind) for seed in range(4)]
    assert len({json.dumps(one.base) for one in drawn}) == 4
    for one in drawn:
        parameters_of(one)  # all of it fits into the ranges of the bench
        one.write(tmp_path / "truth")
        assert GroundTruth.read(tmp_path / "truth") == one
        assert len(one.effects) == {"null": 0, "outside": 0, "pair": 2}.get(kind, 1)
        assert bool(one.outside) == (kind == "outside")


def test_every_visible_effect_is_hidden_by_some_seed_and_fits_the_bench():
    first: dict[str, GroundTruth] = {}
    for seed in range(300):
        one = draw(seed, "single", CONDITIONS[seed % len(CONDITIONS)])
        for name in one.effects:
            first.setdefault(name.partition(".")[0], one)
    per_unit = LambdaPerUnit.read()
    assert first.keys() == {name for name, effect in CATALOGUE.items() if visible(effect, per_unit)}
    assert first.keys() >= NEAR.keys()
    assert not first.keys() & {"leveling_delay", "quantisation"}
    assert "dpv_leak" in first
    for one in first.values():
        parameters_of(one)


def test_terms_outside_are_linear_in_their_size_and_add_up():
    one, two = (together(UNCATALOGUED["snag"](size), roughness(3, 1.0)) for size in (1.0, 2.0))
    snag = UNCATALOGUED["snag"](1.0)["force_surface"]
    assert np.allclose(two["force_surface"] - one["force_surface"], snag)
    assert 0.5 < snag.max() <= 1.0
    for name, term in UNCATALOGUED.items():
        load().with_values(**term(1e-6 if name == "flap" else 1.0))


def test_coloured_noise_has_its_colour_and_the_size_of_the_data_sheet():
    rig = Rig(load(), seed=1)
    par = rig.plant.parameter_array
    noise = par["sensor_noise"][0][COLOURED].copy()
    built = par["sensor_bias"][0][COLOURED].copy()
    coloured = Coloured(rig, 0.9, seed=4)
    assert not par["sensor_noise"][0][COLOURED].any()
    samples = []
    for _ in range(4000):
        coloured.run(5)
        samples.append((par["sensor_bias"][0][COLOURED] - built) / noise)
    series = np.array(samples)[100:]
    assert series.std() == pytest.approx(1.0, abs=0.1)
    assert np.mean(series[1:] * series[:-1]) / np.mean(series**2) == pytest.approx(0.9, abs=0.02)


def test_a_lambda_counts_the_noise_of_its_bench_and_related_causes():
    table = LambdaPerUnit.read()
    assert table.in_noise.keys() == {"AR 0.6", "AR 0.9", "12 bits"}
    for name, points in table.effects.items():
        shapes = points[0][0]
        slow, slower = (table.part_seen(name, shapes, condition) for condition in ("AR 0.6", "AR 0.9"))
        assert table.part_seen(name, shapes, "white") == 1.0
        assert table.part_seen(name, shapes, "frames lost") == pytest.approx(math.sqrt(0.9))
        # Correlated noise hides slow effects; a hold of 20 ms is faster and remains visible.
        assert slower <= slow <= 1.01 or name == "sample_and_hold"
        assert 0.0 < table.part_apart(name, shapes) <= 1.0
        assert (table.part_apart(name, shapes) < 1.0) == bool(kin(name))


def test_a_truth_is_as_large_as_its_noise_leaves_it():
    values = {"force_lag": {"lag": 2e-3}, "friction": {"force": 50.0, "travel": 5e-3}}
    truth = GroundTruth(
        seed=1,
        kind="pair",
        condition="AR 0.9",
        effects=values,
        lambdas={"force_lag": 100.0, "friction": 40.0},
    )
    table = LambdaPerUnit.read()
    lag, friction = (
        table.in_noise["AR 0.9"][name][place] for name, place in (("force_lag", 0), ("friction", 2))
    )
    assert truth.seen == pytest.approx({"force_lag": 100.0 * lag, "friction": 40.0 * friction})
    assert truth.apart == pytest.approx(100.0 * lag * table.apart["force_lag"][0][1])
    assert GroundTruth(seed=1, kind="null", condition="white").apart == 0.0


def test_no_page_is_written_without_data(tmp_path):
    """It would lose the figures of a system that was counted elsewhere, or long ago."""
    page = rate_page.PAGE.read_bytes()
    done = CliRunner().invoke(main, ["--page-only", "--kept", str(tmp_path)])
    assert done.exit_code == 1
    assert "has no results of oscillator, bench" in done.output
    assert rate_page.PAGE.read_bytes() == page


def test_drawings_are_written_where_the_page_shows_them():
    shown = re.findall(r"!\[[^]]*\]\(([^)]*)\)", rate_page.PAGE.read_text(encoding="utf-8"))
    assert shown
    assert {(rate_page.PAGE.parent / one).resolve().parent for one in shown} == {rate_page.DRAWINGS.resolve()}
