"""`astb paper`: its computations without the bench, its judgements, and the files of a whole run."""

import csv
import io
import json
import re
from dataclasses import replace
from itertools import count
from types import SimpleNamespace
from xml.etree import ElementTree

import numpy as np
import pytest
from click.testing import CliRunner

from astb.cli import commands
from astb.exit_codes import BLOCKED, MISUSE
from astb_studies.paper import page, plant_curves, sensitivity, stated, study
from astb_studies.paper.bench_results import BenchResults, NoBenchResult, Points
from astb_studies.paper.checks.catalogue import CHECKS
from astb_studies.paper.checks.lateral import T1, T2, T3
from astb_studies.paper.claims import CLAIMS
from astb_studies.paper.comparisons.comparison import ClaimComparison, compared
from astb_studies.paper.experiments import OTHER_RIDES
from astb_studies.paper.figures.catalogue import GLOBAL, SECTIONS
from astb_studies.paper.laws import closed_secant, closed_stiffness, closed_tangent, fitted_lateral_area
from astb_studies.paper.subject import LOADS, Subject, remembered
from bench_protocol.units import bar, mm, ms
from bench_records.curves import Axis, curve
from tests.pictures import MARKUP
from tests.refusals import refuses

slow = pytest.mark.slow
KN = 1e3


def sweep(group, name, xs, ys):
    return curve(name, Axis("x"), Axis("y"), xs, ys, kind="sweep", group=group)


def bench(pressures=None, **plans):
    """A bench that found the given curves: one list of curves per rig and plan."""
    results = {plan: [SimpleNamespace(curves=curves) for curves in rigs] for plan, rigs in plans.items()}
    return BenchResults(results, pressures or {}, (np.zeros(2), np.zeros(2)))


def lateral_bench(law):
    """Lateral stiffness over pressure as a law says: (load, amplitude, gauge pressures) -> N/m."""
    gauge = {"AW0": np.linspace(1.6, 2.4, 5) * bar, "AW3": np.linspace(5.0, 6.1, 5) * bar}
    return bench(
        **{
            f"lateral_pressure_{load.lower()}": [
                [
                    sweep(f"Lateral stiffness K' per spring, {load}", f"{a:g} mm", p, law(load, a * mm, p))
                    for a in (2.5, 5.0, 10.0)
                ]
            ]
            for load, p in gauge.items()
        }
    )


# -- the bench's curves --------------------------------------------------------------------------------------------


def test_several_rigs_are_their_mean_between_the_lowest_and_the_highest():
    one, other = sweep("g", "n", [1.0, 2.0], [10.0, 20.0]), sweep("g", "n", [1.2, 2.2], [14.0, 16.0])
    found = bench(plan=[[one], [other]]).points("plan", "g", "n")
    assert found.x.tolist() == pytest.approx([1.1, 2.1])
    assert (found.y.tolist(), found.low.tolist(), found.high.tolist()) == ([12, 18], [10, 16], [14, 20])
    assert found[found.x > 2].y.tolist() == [18]


def test_a_curve_that_is_not_there_is_named():
    with refuses(NoBenchResult, "curve 'm' 'g'"):
        bench(plan=[[sweep("g", "n", [1.0], [1.0])]]).points("plan", "g", "m")


def test_the_pressure_is_that_of_the_phases_that_are_asked_for():
    phases = [
        ("vertical sine 1 Hz", 1.0),
        ("lateral sine 1 Hz", 9.0),
        *(("vertical sine", p) for p in (2.0, 3.0, 7.0)),
    ]
    read = bench({"plan": phases})
    assert read.pressure("plan", "vertical sine") == pytest.approx(13 / 4)
    assert read.pressure("plan", "vertical sine", 1, 2) == pytest.approx(2.5)
    with refuses(NoBenchResult, "'roll'"):
        read.pressure("plan", "roll")


# -- closed forms --------------------------------------------------------------------------------------------------


def test_the_closed_tangent_is_the_slope_of_the_secant():
    y = np.linspace(0.0, 60.0, 601) * mm
    for load in LOADS:
        secant, tangent = closed_secant(load, y), closed_tangent(load, y)
        force = np.concatenate([[0.0], np.cumsum(0.5 * (tangent[1:] + tangent[:-1]) * np.diff(y))])
        np.testing.assert_allclose(force[1:], (secant * y)[1:], rtol=1e-4)
        assert tangent[0] == pytest.approx(secant[0], rel=1e-6)


@pytest.mark.parametrize("area", [0.07, 0.0835, 0.12])
def test_the_lateral_area_comes_back_from_a_bench_that_obeys_the_closed_form(area):
    made = lateral_bench(lambda load, a, p: closed_stiffness(load, p, lateral_area=area))
    assert fitted_lateral_area(made) == pytest.approx(area, rel=1e-9)


# -- what would look like rubber -----------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def alike():
    f = np.array([0.6, 1.2, 10.0])
    return f, plant_curves.lookalikes(Subject(), "AW0", np.array(5 * mm), f)


def more(found, name):
    return found[name].imag / found["orifice"].imag - 1.0


def test_at_one_frequency_rubber_lag_and_coefficient_look_alike(alike):
    _, found = alike
    for name in ("rubber", "lag", "coefficient"):
        assert 0.03 < more(found, name)[1] < 0.09, name


def test_the_frequency_sweep_tells_them_apart(alike):
    f, found = alike
    assert more(found, "coefficient")[0] > 0.05 and more(found, "coefficient")[2] < -0.03
    assert more(found, "lag")[2] > 2.0
    assert 0.08 < more(found, "rubber")[2] < 0.2
    # A displacement that is read late turns K by ωτ: K″ grows by ωτ K′.
    late = 2 * np.pi * f * 5 * ms * found["orifice"].real
    np.testing.assert_allclose(found["lag"].imag - found["orifice"].imag, late, rtol=1e-9)


def test_in_the_force_without_the_gas_only_rubber_and_lag_are_left():
    f = np.array([0.6, 1.2, 5.0])
    left = plant_curves.residuals(Subject(), "AW0", 5 * mm, f)
    rubber, lag, orifice = (left[name].imag / KN for name in ("rubber", "lag", "coefficient"))
    assert np.ptp(rubber) < 0.5 * rubber.mean() and rubber.min() > 8.0
    assert lag[2] > 8 * lag[0]
    assert np.abs(orifice).max() < 2.5


# -- sensitivity ---------------------------------------------------------------------------------------------------


def test_the_indices_of_a_sum_are_the_shares_of_its_variance():
    weights = np.arange(1.0, len(sensitivity.PAPER) + 1)
    centre = dict.fromkeys(sensitivity.PAPER, 1.0)
    table = sensitivity.sets(centre, 512)
    assert np.abs(table - 1.0).max() <= sensitivity.SPREAD
    found = sensitivity.indices("paper", weights[None] @ table, 512)
    share = weights**2 / np.sum(weights**2)
    np.testing.assert_allclose(found.first[0], share, atol=0.02)
    np.testing.assert_allclose(found.total[0], share, atol=0.02)
    assert np.all(found.total_low <= found.total + 1e-12) and np.all(found.total <= found.total_high + 1e-12)


def test_a_parameter_that_is_not_read_has_no_index():
    table = sensitivity.sets(sensitivity.nominal(Subject(), "paper"), 64)
    found = sensitivity.indices("paper", sensitivity.evaluate("paper", table), 64)
    at_the_centre = dict(
        zip(found.parameters, found.total[found.outputs.index("lateral K at 0 mm")], strict=True)
    )
    assert at_the_centre["volume_growth"] == pytest.approx(0.0, abs=1e-12)
    assert at_the_centre["lateral_area"] > 0.5


def test_the_plant_answers_for_every_set_by_itself():
    values = sensitivity.nominal(Subject(), "plant")
    table = np.array(list(values.values()))[:, None] * np.array([1.0, 1.05])
    both = sensitivity.evaluate("plant", table)
    assert both.shape == (len(sensitivity.PLANT_OUTPUTS), 2)
    np.testing.assert_array_equal(both[:, 1:], sensitivity.evaluate("plant", table[:, 1:]))


# -- judgement -----------------------------------------------------------------------------------------------------


def study_with(made):
    """A study with a bench and with closed forms that meet every claim."""
    entries = [
        {"id": check.id, "layer": check.layer, "measured": "", "holds": True, "note": ""} for check in CHECKS
    ]
    return SimpleNamespace(bench=made, entries=entries)


def test_a_bench_that_softens_under_pressure_loses_the_first_claim():
    as_claimed = study_with(lateral_bench(lambda load, a, p: 1e5 + 0.3 * p - 3e6 * a))
    assert [compared(as_claimed, one, "figure-06").verdict for one in (T1, T2, T3)] == ["holds in both"] * 3
    softening = study_with(lateral_bench(lambda load, a, p: 3e5 - 0.1 * p + 1e6 * a))
    assert [compared(softening, one, "figure-06").verdict for one in (T1, T2, T3)] == ["closed form only"] * 3


def test_every_claim_of_the_paper_has_one_figure():
    shown = [(one.id, figure) for one in CLAIMS for figure in one.by_figure]
    assert {figure for _, figure in shown} == {one.name for one in SECTIONS}
    assert sorted(id_ for id_, _ in shown if id_) == sorted(f"T{n}" for n in range(1, 12))
    assert {one.id for one in CLAIMS if one.id.startswith("T")} == {id_ for id_, _ in shown if id_}


@pytest.mark.parametrize(
    ("bench_holds", "closed_holds", "words"),
    [
        (True, True, "holds in both"),
        (True, False, "bench only"),
        (False, True, "closed form only"),
        (False, False, "does not hold"),
        (True, None, "holds"),
        (False, None, "does not hold"),
    ],
)
def test_a_verdict_says_where_a_claim_holds(bench_holds, closed_holds, words):
    found = ClaimComparison("T0", "", "", "", "", bench_holds, closed_holds)
    assert found.verdict == words
    if words == "bench only":
        assert replace(found, by="plant").verdict == "plant only"


# -- the pieces of the page ----------------------------------------------------------------------------------------


def test_every_check_is_evaluated_once_and_shared_experiments_stay_together():
    groups = study.claim_groups()
    ids = [one for group in groups for one in group]
    assert sorted(ids) == sorted({check.id for check in CHECKS})
    where = {one: k for k, group in enumerate(groups) for one in group}
    for check in CHECKS:
        for other in CHECKS:
            if check.shares and check.shares == other.shares:
                assert where[check.id] == where[other.id]
    assert "A27" in groups[0], "the longest comes first"


def test_tables_and_topologies_depend_on_their_named_files():
    rows = {
        (table["title"].split(".")[0], row["name"]): row for table in stated.tables() for row in table["rows"]
    }
    assert rows["Table 1", "preload, AW3"]["value"] == "145"
    assert rows["Table 2", "track_wavelength"]["unit"] == "m"
    assert all(
        row["source"] and row["provenance"] in ("measured", "data sheet", "assumed") for row in rows.values()
    )
    empty, full = stated.topologies()
    K, K_e = float(full["diaphragm"]), float(full["emergency"])
    # Each is rounded to 1 kN/m.
    assert float(full["series"]) == pytest.approx(1.0 / (1.0 / K + 1.0 / K_e), abs=1.0)
    assert float(full["parallel"]) == pytest.approx(K + K_e, abs=1.5)
    assert (empty["load"], full["load"]) == tuple(LOADS)


def test_gusts_are_less_alike_the_further_and_the_faster():
    rows = [[float(cell) for cell in row[1:]] for row in stated.spatial_correlation()["rows"]]
    assert all(np.all(np.diff(row[:-1]) <= 0.0) for row in rows)
    assert all(np.all(np.diff(column) <= 0.0) for column in zip(*rows, strict=True))


def test_numbers_get_a_minus_and_words_keep_their_hyphens():
    assert page.signed("-1.5 and (-2) at 1e-4, non-decreasing, A-B") == (
        "\u22121.5 and (\u22122) at 1e\u22124, non-decreasing, A-B"
    )


def test_the_table_leaves_out_what_is_not_known():
    ride = study.ComfortRow("paper", "AW0", 10.0, 0.05, float("nan"), float("nan"), 0.4, *[float("nan")] * 3)
    (row,) = csv.DictReader(io.StringIO(page.comfort_csv(SimpleNamespace(rides=[ride]))))
    assert (row["load"], row["comfort_index"], row["comfort_half_width"]) == ("AW0", "0.4", "")


def test_the_error_bars_are_those_of_the_rigs():
    from matplotlib.figure import Figure

    from astb_studies.paper.figures.style import draw_points

    axes = Figure().subplots()
    y = np.array([2.0, 3.0])
    draw_points(axes, Points(np.arange(2.0), y, y - 0.5, y + 1.0), 1.0, 1.0, "black")
    (bars,) = axes.collections
    assert [segment[:, 1].tolist() for segment in bars.get_segments()] == [[1.5, 3.0], [2.5, 4.0]]


# -- the command ---------------------------------------------------------------------------------------------------


def test_a_blocked_bench_ends_with_3_and_says_why(tmp_path, monkeypatch):
    def blocked(*args, **kwargs):
        raise NoBenchResult("roll_angle_aw0 on rig 0 was blocked: the rig: emergency stop")

    monkeypatch.setattr("astb_studies.paper.make.make", blocked)
    done = CliRunner().invoke(
        commands, ["paper", "--quick", "--out", str(tmp_path / "out")], standalone_mode=False
    )
    assert done.return_value == BLOCKED
    assert "was blocked: the rig: emergency stop" in done.output


def test_a_directory_that_cannot_be_made_is_misuse(tmp_path):
    (tmp_path / "file").write_text("")
    out = str(tmp_path / "file" / "out")
    done = CliRunner().invoke(commands, ["paper", "--quick", "--out", out], standalone_mode=False)
    assert done.return_value == MISUSE
    assert "cannot be written" in done.output


@slow
@pytest.mark.timeout(900)
def test_a_quick_run_leaves_every_figure_table_and_claim(quick_study):
    from matplotlib.image import imread

    out = quick_study.parent
    names = [one.name for one in (*SECTIONS, GLOBAL)]
    for name in names:
        ink = imread(out / f"{name}.png")[..., :3].min(axis=2)
        assert 0.005 < np.mean(ink < 0.9) < 0.4, f"{name} is empty, or full"
        drawing = ElementTree.parse(out / f"{name}.svg").getroot()
        assert len(list(drawing.iter("{http://www.w3.org/2000/svg}path"))) > 30, name
        words = " ".join(text.text or "" for text in drawing.iter("{http://www.w3.org/2000/svg}text"))
        assert "nan" not in words and not MARKUP.search(words), name

    entries = json.loads((out / page.CLAIMS).read_text())
    assert [(one["id"], one["layer"]) for one in entries] == [(check.id, check.layer) for check in CHECKS]
    for one in entries:
        assert {"id", "claim", "layer", "measured", "criterion", "holds", "note"} <= set(one)
        assert isinstance(one["holds"], bool) and one["measured"] and one["criterion"]
    held = {(one["id"], one["layer"]) for one in entries if one["holds"]}
    # Values that a conservative bellows, or one without friction, cannot have are reported.
    assert {("T6", "plant"), ("T8", "plant"), ("T9", "plant"), ("T2", "paper")}.isdisjoint(held)
    assert {("T1", "plant"), ("T1", "paper"), ("T3", "plant"), ("T10", "plant")} <= held

    text = quick_study.read_text()
    assert text.count('class="plot"') == len(names)
    assert text.count('class="schematic"') == 5
    assert not re.search(r"<script|<link|src=|@import|url\(http", text), "the page must load no other file"
    for id_ in {check.id for check in CHECKS}:
        assert f'<td class="id">{id_}</td>' in text
    for link in re.findall(r'href="([^"#]+)"', text):
        assert link.startswith("https://doi.org/") or (out / link).exists(), link
    assert "One rig instead of three" in text

    rows = list(csv.DictReader(io.StringIO((out / page.TABLE).read_text())))
    others = sum(len(loads) for loads, *_ in OTHER_RIDES.values())
    assert len(rows) == 4 * 2 * len(LOADS) + 2 * others
    assert all(float(row["acceleration_rms"]) > 0.0 for row in rows)

    from bench_sim.parameters import load

    fitted, shipped = load(out / study.IDENTIFIED), load("astb")
    assert fitted.digest() != shipped.digest()
    assert float(fitted.entries["effective_area"].value.flat[0]) == pytest.approx(0.26, rel=0.01)


def test_an_experiment_that_is_asked_for_in_other_words_is_not_made_again():
    made = []

    @remembered
    def experiment(subject, load, other="", *without, cycles=12, **changes):
        made.append((load, other, without, cycles, changes))
        return len(made)

    here = Subject()
    same = [experiment(here, "AW0"), experiment(here, "AW0", ""), experiment(here, load="AW0", cycles=12)]
    assert same == [1, 1, 1]
    others = [("AW3",), ("AW0", "x"), ("AW0", "", "friction")]
    assert [experiment(here, *one) for one in others] == [2, 3, 4]
    assert [experiment(here, "AW0", cycles=3), experiment(here, "AW0", pressure=1.0)] == [5, 6]
    assert experiment(Subject(), "AW0") == 7, "another subject has others"


def test_progress_is_reported_once_for_each_part():
    from concurrent.futures import Future

    received, futures = [], [Future() for _ in range(3)]
    study._watch("kind", futures, lambda *news: received.append(news))
    for future, value in zip(futures, count(), strict=False):
        future.set_result(value)
    assert received == [("kind", k, 3) for k in range(4)]
