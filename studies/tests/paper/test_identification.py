"""Identification: closed forms, honest intervals, and the plant's own parameters out of what the bench recorded."""

from math import log, pi
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import bench_sim.parameters
from astb_studies.paper.identification.area_and_volume import fit_area_and_volume, fit_paper_law
from astb_studies.paper.identification.curves import Isolated, Sheared, isolated
from astb_studies.paper.identification.fits import Fit, NotIdentified, fit
from astb_studies.paper.identification.lateral import (
    fit_lateral_stiffness,
    friction_stiffness,
    lateral_stiffness,
)
from astb_studies.paper.identification.parameter_file import (
    FittedValue,
    Known,
    fitted_values,
    write_parameters,
)
from astb_studies.paper.identification.spring import FITTED, FITTED_LATERAL, identify
from bench_protocol.units import ATMOSPHERE
from bench_records.result import Outcome, read_result
from bench_sim.parameters import load
from test_plans.discovery import plans
from test_plans.execution import execute
from test_plans.loads import AW0, AW3
from test_plans.specimen import ordinary

BASE = (Path(bench_sim.parameters.__file__).parent / "astb.toml").read_text(encoding="utf-8")
KNOWN = Known(BASE)
RNG = np.random.default_rng(7)
STAIRS = np.array([0, 20, 40, 60, 40, 20, 0, -20, -40, -60, -40, -20, 0, 0, 0, 0, 0]) * 1e-3
HEIGHTS = np.array([0.0] * 13 + [8e-3, 0.0, -8e-3, 0.0])
TRUTH = {
    "effective_area": 0.25,
    "bellows_volume": 0.033,
    "membrane_length": 0.30,
    "membrane_length_slope": 5.0,
}


def isolated_by_the_law(preload, noise=0.0, rng=RNG, **truth):
    """What a bench would read of a spring that follows the plant's law with ``truth``, cooling as it goes."""
    v = TRUTH | truth
    k_z, k_y, ys = 6e6, 2e6, 0.2
    T = 293.0 + 3 * np.sin(np.arange(17))
    z_b, y_b = HEIGHTS.copy(), STAIRS.copy()
    start = preload / v["effective_area"] + ATMOSPHERE
    for _ in range(60):
        Y = y_b**2 / (1 + (y_b / ys) ** 2)
        V = v["bellows_volume"] + (v["effective_area"] - 0.1 * z_b) * z_b
        V = V - 0.5 * (v["membrane_length"] + v["membrane_length_slope"] * z_b) * Y
        p = start * v["bellows_volume"] / V * T / 293.0 - ATMOSPHERE
        F = p * (v["effective_area"] - 0.2 * z_b - 0.5 * v["membrane_length_slope"] * Y) - 40e3 * z_b
        F_y = 100e3 * y_b
        z_b, y_b = HEIGHTS + (F - preload) / k_z, STAIRS - F_y / k_y
    n = p.size
    return Isolated(
        preload,
        HEIGHTS.copy(),
        STAIRS.copy(),
        p,
        T + noise * rng.normal(0, 1e-4 * 293, n),
        F + noise * rng.normal(0, 25.0, n),
        F_y,
        np.arange(n) < 13,
    )


def sheared_by_the_law(noise=0.0, rng=RNG, **truth):
    names = ("membrane_length", *FITTED_LATERAL)
    value = {name: KNOWN[name] for name in names} | truth
    p, a = (grid.ravel() for grid in np.meshgrid(np.linspace(1.6e5, 6.1e5, 8), [2.5e-3, 5e-3, 10e-3]))
    K = lateral_stiffness(value, p, a, 0.5, KNOWN)
    return value, Sheared(p, a, K + noise * 300 * (rng.normal(size=p.size) + 1j * rng.normal(size=p.size)))


# -- closed forms --------------------------------------------------------------------------------------------------


@settings(deadline=None)  # the first call imports scipy
@given(st.floats(0.2e-3, 60e-3), st.floats(10.0, 5e3), st.floats(0.5e-3, 20e-3))
def test_friction_loses_what_bergs_closed_form_loses(a, limit, x2):
    K = friction_stiffness(np.array([a]), np.array([limit]), x2)[0]
    F_0 = limit / (2 * x2) * ((x2**2 + a**2 + 6 * x2 * a) ** 0.5 - x2 - a)
    mu = F_0 / limit
    lost = 2 * limit * (2 * a - x2 * (1 + mu) ** 2 * log((x2 * (1 + mu) + 2 * a) / (x2 * (1 + mu))))
    assert pi * K.imag * a**2 == pytest.approx(lost, rel=2e-3)
    assert 0 < K.real < 1.3 * F_0 / a


def test_without_friction_and_emergency_spring_stiffness_is_membrane_and_shell():
    base = BASE.replace(
        "emergency_stiffness_lateral = { value = 2.0", "emergency_stiffness_lateral = { value = 99000.0"
    )
    value = {"membrane_length": 0.35, "shell_stiffness_lateral": 45e3, "friction_lateral": 0.0}
    value |= {"friction_lateral_slope": 0.0, "friction_lateral_travel": 4e-3}
    K = lateral_stiffness(value, np.array([2e5]), np.array([1e-6]), 1e-6, Known(base))
    assert K[0] == pytest.approx(0.35 * 2e5 + 45e3, rel=1e-4)


@settings(deadline=None)  # the first call imports scipy
@given(st.floats(-20, 20), st.floats(-60, 60), st.floats(0.1, 0.4))
def test_the_papers_law_comes_back(alpha, beta, area):
    y = np.linspace(-60e-3, 60e-3, 13)
    found = fit_paper_law(y, area * (1 - alpha * y**2), 1 + beta * y**2)
    assert found["alpha"] == pytest.approx(alpha, abs=1e-3)
    assert found["beta"] == pytest.approx(beta, abs=1e-3)
    assert found["alpha_centre"] == pytest.approx(area, rel=1e-6)


def test_a_straight_line_has_the_textbook_interval():
    x = np.arange(10.0)
    y = 2.0 + 0.5 * x + RNG.normal(0, 0.1, 10)
    found = fit(lambda v: (y - v["level"] - v["slope"] * x) / 0.01, {"level": 1.0, "slope": 1.0})
    slope, covariance = np.polyfit(x, y, 1, cov=True)  # scaled by its residuals, as the misfit here exceeds 1
    assert found["slope"] == pytest.approx(slope[0], rel=1e-6)
    assert found.sigma("slope") == pytest.approx(covariance[0, 0] ** 0.5, rel=1e-4)
    low, high = found.interval("slope")
    assert (high - low) / 2 / found.sigma("slope") == pytest.approx(
        2.306, abs=1e-3
    )  # Student, 8 degrees of freedom


# -- the fits ------------------------------------------------------------------------------------------------------


def test_another_spring_is_found_from_the_base_of_this_one():
    found = fit_area_and_volume([isolated_by_the_law(P) for P in (53.5e3, 145e3)], KNOWN)
    for name, truth in TRUTH.items():
        assert found[name] == pytest.approx(truth, rel=1e-4), name
    value, made = sheared_by_the_law(
        membrane_length=0.30, shell_stiffness_lateral=60e3, friction_lateral=500.0
    )
    lateral = fit_lateral_stiffness([made], KNOWN)
    for name, truth in value.items():
        assert lateral[name] == pytest.approx(truth, rel=1e-3), name


def bootstrap(make, fitter, names, rounds=40):
    rng = np.random.default_rng(11)
    fits = [fitter(make(rng)) for _ in range(rounds)]
    return {name: np.array([[one[name], one.sigma(name)] for one in fits]) for name in names}


def test_the_intervals_of_area_and_volume_are_as_wide_as_a_bootstrap():
    seen = bootstrap(
        lambda rng: [isolated_by_the_law(P, 1.0, rng) for P in (53.5e3, 145e3)],
        lambda steps: fit_area_and_volume(steps, KNOWN),
        FITTED,
    )
    for name in FITTED:
        values, sigmas = seen[name].T
        assert abs(values.mean() - TRUTH[name]) < 2 * sigmas.mean()
        # Zeros of transducers are allowed for but were not drawn: the interval is never narrower than the scatter.
        assert values.std() < 1.2 * sigmas.mean(), name
    # What no zero can change scatters as the interval says.
    values, sigmas = seen["membrane_length_slope"].T
    assert values.std() == pytest.approx(sigmas.mean(), rel=0.35)


def test_the_intervals_of_shell_and_friction_are_as_wide_as_a_bootstrap():
    names = ("membrane_length", *FITTED_LATERAL)
    truth, _ = sheared_by_the_law()
    seen = bootstrap(
        lambda rng: [sheared_by_the_law(1.0, rng)[1]], lambda s: fit_lateral_stiffness(s, KNOWN), names
    )
    for name in names:
        values, sigmas = seen[name].T
        assert abs(values.mean() - truth[name]) < 0.6 * sigmas.mean(), name
        assert values.std() == pytest.approx(sigmas.mean(), rel=0.4), name


def test_what_the_record_does_not_hold_is_said():
    with pytest.raises(NotIdentified, match="no curve 'AW0' of 'Isolated bellows sheared: height'"):
        isolated([], ordinary().load(AW0))
    with pytest.raises(NotIdentified, match=r"do not tell a, b apart"):
        fit(lambda v: np.array([v["a"] + v["b"] - 1.0] * 3), {"a": 1.0, "b": 1.0})
    with pytest.raises(NotIdentified, match="has no membrane_travel"):
        fit_area_and_volume([isolated_by_the_law(P) for P in (53.5e3, 145e3)], Known("[gas]\n"))


# -- the parameter file --------------------------------------------------------------------------------------------

SOME = {
    "effective_area": FittedValue(0.25, 0.249, 0.251),
    "bellows_volume": FittedValue(0.033, 0.0329, 0.0331),
    "shell_stiffness_lateral": FittedValue(47e3, 46e3, 48e3),
    "friction_lateral_slope": FittedValue(1.1e-3, 1.0e-3, 1.2e-3),
    "friction_lateral_travel": FittedValue(4.4e-3, 4.3e-3, 4.5e-3),
}


def test_the_file_loads_with_the_fitted_values_and_says_where_they_come_from(tmp_path):
    path = write_parameters(tmp_path / "fitted.toml", BASE, SOME, 'record runs\\"hall" of 21 November')
    loaded, old = load(path), load("astb")
    for name, one in loaded.entries.items():
        if name in SOME:
            assert one.value == pytest.approx(SOME[name].value, rel=1e-6)
            assert one.provenance == "measured"
            assert "hall" in one.source
            assert "95 %" in one.source
        else:
            assert np.array_equal(one.value, old.entries[name].value), name
            assert (one.provenance, one.source) == (old.entries[name].provenance, old.entries[name].source)
    changed = [
        a for a, b in zip(BASE.splitlines(), path.read_text("utf-8").splitlines(), strict=True) if a != b
    ]
    assert len(changed) == len(SOME)


@pytest.mark.parametrize(
    ("fitted", "said"),
    [
        ({"effective_area": FittedValue(0.7, 0.6, 0.8)}, "0.7 m2 is outside 0.1 to 0.5 m2"),
        ({"effective_aera": FittedValue(0.2, 0.1, 0.3)}, "no effective_aera"),
        ({"effective_area": FittedValue(float("nan"), 0.1, 0.3)}, "nan m2 is outside"),
    ],
)
def test_what_does_not_fit_is_refused_and_nothing_written(tmp_path, fitted, said):
    with pytest.raises(NotIdentified, match=said):
        write_parameters(tmp_path / "no.toml", BASE, fitted, "x")
    assert not (tmp_path / "no.toml").exists()


# -- through the bytes of a record ---------------------------------------------------------------------------------


PLANS = ("lateral_offset", "lateral_pressure_aw0", "lateral_pressure_aw3")


def identified(directories):
    """Identify a virtual rig from the files that three plans have left: their curves, and what was found."""
    results = [read_result(one) for one in directories]
    assert Outcome.BLOCKED not in {one.verdict for one in results}
    curves = dict(zip(PLANS, (one.curves for one in results), strict=True))
    return curves, identify(*curves.values(), BASE)


def away(found: Fit, name: str, truth: float) -> float:
    """How far the truth lies from the value, in half widths of its 95 % interval."""
    low, high = found.interval(name)
    return abs(found[name] - truth) / ((high - low) / 2)


@pytest.mark.slow
@pytest.mark.parametrize("seed", [0, 1, 2])
def test_the_plants_own_parameters_lie_within_their_intervals(sound_run, tmp_path, seed):
    curves, found = identified([sound_run(name, seed).directory for name in PLANS])
    # Of 32 intervals on eight rigs one missed, by a quarter: 97 %. One of a rig's four may, by no more than a lateral.
    assert sum(away(found.area_and_volume, name, KNOWN[name]) >= 1.0 for name in FITTED) <= 1
    for name in FITTED:
        assert away(found.area_and_volume, name, KNOWN[name]) < 1.6, name
        assert found.area_and_volume[name] == pytest.approx(KNOWN[name], rel=0.005), name
        assert found.area_and_volume.sigma(name) < 0.01 * KNOWN[name], name
    # Stiffness against pressure, which is another experiment, finds the same membrane.
    assert away(found.lateral, "membrane_length", KNOWN["membrane_length"]) < 1.0
    for name in FITTED_LATERAL:
        assert away(found.lateral, name, KNOWN[name]) < 1.6, name  # loops that still settle: within 5 %
        assert found.lateral[name] == pytest.approx(KNOWN[name], rel=0.05), name
    path = write_parameters(
        tmp_path / "fitted.toml", BASE, found.parameters, "lateral_offset, lateral_pressure"
    )
    loaded = load(path)
    assert loaded.entries["membrane_length"].value == pytest.approx(found.area_and_volume["membrane_length"])
    # The paper's law on the same curves: area falls, and the volume falls too.
    groups = {(one.group, one.name): one for one in curves["lateral_offset"]}
    area, volume = (groups[group, AW3] for group in ("Effective area", "Volume"))
    law = fit_paper_law(*(np.array(series) for series in (area.xs, area.ys, volume.ys)))
    assert law["alpha"] == pytest.approx(7.2, rel=0.15)
    assert law["beta"] < -4.0


@pytest.mark.slow
def test_another_spring_on_the_bench_is_not_taken_for_this_one(bench_composed, tmp_path):
    changes = {
        "effective_area": 0.252,
        "bellows_volume": 0.032,
        "membrane_length": 0.31,
        "membrane_length_slope": 4.8,
    }
    for name in PLANS:
        with bench_composed(3, **changes) as made:
            execute(plans()[name], made.bench, tmp_path / name)
    _, found = identified([tmp_path / name for name in PLANS])
    for name, truth in changes.items():
        assert away(found.area_and_volume, name, truth) < 1.0, name
        assert away(found.area_and_volume, name, KNOWN[name]) > 3.0, name


def test_fitted_values_carry_the_interval():
    made = Fit(("a",), np.array([2.0]), np.array([[0.01]]), 1.0, 10_000)
    assert fitted_values(made, ["a"])["a"].low == pytest.approx(2.0 - 1.96 * 0.1, abs=1e-3)
    with pytest.raises(NotIdentified, match="b was not fitted; there is a"):
        made["b"]
    assert made.sigma("a") == pytest.approx(0.1)
