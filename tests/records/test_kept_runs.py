"""Two runs compared, and one check over the life of a specimen, against figures computed by hand."""

import math
import re

import msgspec
import numpy as np
import pytest

from bench_records.comparison import compare_runs
from bench_records.curves import Axis, curve
from bench_records.index import KeptCheck, KeptRun, RunIndex
from bench_records.kept_pages import comparison_row, trend_words, write_comparison, write_trends
from bench_records.result import check, conclude, unavailable
from bench_records.trend import trend_of


def run(directory, checks, **rest):
    conclude("aw0", "Title", "Text", checks, **rest).write(directory)
    return directory


HZ, STIFF = Axis("frequency", "Hz"), Axis("K'", "kN/m", 1e3)


def sweep(name: str, ys: list[float], xs=(0.0, 1.0, 2.0)):
    return curve(name, HZ, STIFF, xs, ys, kind="sweep")


def test_only_changes_are_reported(tmp_path) -> None:
    a = run(tmp_path / "a", [check("K", 100.0, "N", low=90.0, high=120.0)], rig="one", seed=1)
    b = run(tmp_path / "b", [check("K", 125.0, "N", low=90.0, high=121.0)], rig="one", seed=2)
    found = compare_runs(a, b)
    assert [(fact.what, fact.a, fact.b) for fact in found.facts] == [("seed", "1", "2")]
    (pair,) = found.checks
    assert (pair.change, pair.share) == (25.0, 0.25)
    assert pair.limits_changed and pair.verdict_changed
    assert found.verdicts == ("pass", "fail")
    row = comparison_row(pair)
    assert row.change == "+25.0\u2009N (+25.0\u2009%)"
    assert row.remark == "pass → fail; limits 90.0\u2009N … 120.0\u2009N → 90.0\u2009N … 121.0\u2009N"


def test_a_change_is_held_against_its_uncertainty(tmp_path) -> None:
    def measured(value: float, u: float | None) -> list:
        return [check("K", value, "N", low=0.0, u=u)]

    a = run(tmp_path / "here" / "aw0", measured(100.0, 3.0))
    small = run(tmp_path / "there" / "aw0", measured(108.0, 4.0))
    large = run(tmp_path / "large", measured(111.0, 4.0))
    bare = run(tmp_path / "bare", measured(200.0, None))
    found = {}
    for other in (small, large, bare):
        (pair,) = compare_runs(a, other).checks
        row = comparison_row(pair)
        found[other] = (pair.exceeds, row.uncertainty, row.remark)
    # Errors of 6 N and 8 N together: 10 N.
    assert found[small] == (False, "± 10\u2009N", "")
    assert found[large] == (True, "± 10\u2009N", "changed by more than its uncertainty")
    assert found[bare] == (None, "", "")
    write_comparison(compare_runs(a, small), tmp_path / "page.html")
    page = (tmp_path / "page.html").read_text()
    assert "A: here/aw0<br>B: there/aw0" in page and str(tmp_path) not in page
    assert compare_runs(a, large).names == ("aw0", "large")


def test_checks_of_one_name_are_paired_by_phase_and_order(tmp_path) -> None:
    def checks(*values):
        return [check("K", value, "N", low=0.0, phase=phase) for phase, value in values]

    a = run(tmp_path / "a", checks(("x", 1.0), ("y", 2.0), ("x", 3.0), ("z", 9.0)))
    b = run(tmp_path / "b", checks(("x", 10.0), ("x", 30.0), ("y", 20.0)))
    found = [(one.phase, one.a and one.a.value, one.b and one.b.value) for one in compare_runs(a, b).checks]
    assert found == [("x", 1.0, 10.0), ("y", 2.0, 20.0), ("x", 3.0, 30.0), ("z", 9.0, None)]


def test_what_one_run_could_not_measure_has_no_change(tmp_path) -> None:
    known = check("other", 1.0, "N", low=0.0)
    a = run(tmp_path / "a", [check("K", 1.0, "N", low=0.0), known])
    b = run(tmp_path / "b", [unavailable("K", "no transducer"), known])
    pair = compare_runs(a, b).checks[0]
    assert pair.change is None
    assert comparison_row(pair).remark.startswith("pass → not available")


def test_curves_lie_apart_by_their_root_mean_square(tmp_path) -> None:
    some = [check("K", 1.0, "N", low=0.0)]
    a = run(tmp_path / "a", some, curves=[sweep("same", [3e3, 4e3, 0.0]), sweep("alone", [1.0, 1.0, 1.0])])
    # B knows other places: between them it is interpolated, beyond them nothing is said.
    b = run(tmp_path / "b", some, curves=[sweep("same", [3.3e3, 4.4e3], (0.0, 1.0))])
    found = compare_runs(a, b)
    assert found.curves[0].apart == pytest.approx(0.1)
    assert found.lonely_curves == ["alone only in A"]
    write_comparison(found, tmp_path / "page.html")
    page = (tmp_path / "page.html").read_text()
    assert page.count("<svg") == 1
    assert "alone only in A" in page


def test_adjacent_curves_have_known_error_bars(tmp_path) -> None:
    some = [check("K", 1.0, "N", low=0.0)]

    def drawn(*sure: str) -> int:
        """Count the caps of the error bars that a page has: two of each."""
        for name in "ab":
            reach = [100.0, 200.0, 300.0] if name in sure else []
            one = curve("K'", HZ, STIFF, (0.0, 1.0, 2.0), [3e3, 4e3, 5e3], kind="sweep", expanded=reach)
            run(tmp_path / name, some, curves=[one])
        write_comparison(compare_runs(tmp_path / "a", tmp_path / "b"), tmp_path / "page.html")
        return (tmp_path / "page.html").read_text().count("h70")

    assert drawn("a") - drawn() == drawn("a", "b") - drawn("a") == 6


def kept(day: float, value: float | None, verdict: str = "pass") -> KeptCheck:
    began = f"2026-01-{1 + int(day):02d}T{round(day % 1 * 24):02d}:00:00Z"
    of = KeptRun(
        directory=f"run {day}", began=began, plan="aw0", title="", verdict=verdict, reason="", rig="", operator="",
        specimen="spring", serial_number="7", circumstances="SIMULATED", seed=None, duration=1.0, parameters={},
    )  # fmt: skip
    return KeptCheck(
        run=of, phase="", name="K", value=value, unit="kN/m", scale=1e3, low=0.0, high=None, verdict=verdict
    )


def test_a_drift_is_seen_with_its_interval_and_the_scatter_is_about_it() -> None:
    days = np.array([0.0, 1.0, 2.0, 3.0, 4.0])
    noise = np.array([1.0, -2.0, 0.0, 2.0, -1.0])  # sum 0, sum of squares 10, slope -0.0
    noise -= np.polyval(np.polyfit(days, noise, 1), days)
    trend = trend_of(
        "K", [kept(day, 100e3 + 5e3 * day + 100 * e) for day, e in zip(days, noise, strict=True)]
    )
    residual = math.sqrt(float(np.sum((100 * noise) ** 2)) / 3)
    assert trend.drift is not None and trend.drift.is_seen
    assert trend.drift.per_day == pytest.approx(5e3)
    assert trend.scatter == pytest.approx(residual)
    assert trend_words(trend)[-1].startswith("It drifts: 20.0\u2009kN/m from the first to the last, ± ")
    # Student's 97.5 % point with three degrees of freedom, from tables.
    assert trend.drift.half_width == pytest.approx(3.182446 * residual / math.sqrt(10.0), rel=1e-5)


def test_without_drift_none_is_seen_in_nineteen_of_twenty() -> None:
    rng = np.random.default_rng(5)
    seen = sum(
        trend_of("K", [kept(day, value) for day, value in enumerate(rng.normal(1e5, 1e3, 8))]).drift.is_seen
        for _ in range(400)
    )
    assert 8 <= seen <= 34  # 20 expected; outside by chance in 0.5 %


def test_too_little_tells_no_drift_and_a_missing_value_is_listed_only(tmp_path) -> None:
    trend = trend_of("K", [kept(0, 1e3), kept(1, None, "error"), kept(2, 3e3)])
    assert trend.drift is None
    assert trend.mean == 2e3
    assert len(trend.checks) == 3
    assert "95 %" not in " ".join(trend_words(trend)), "no drift is printed"
    hasty = trend_of(
        "K", [kept(minute / 1440, value) for minute, value in ((0, 1e3), (60, -3e3), (120, 2e3))]
    )
    assert trend_words(hasty)[-1] == (  # of two hours: for a day it is unknown
        "No drift is seen: 1\u2009kN/m from the first to the last, ± 66\u2009kN/m (95 %)."
    )
    write_trends([trend], "7", tmp_path / "page.html")
    page = (tmp_path / "page.html").read_text()
    assert "run 1" in page
    assert "<span>SIMULATED</span>" in page
    assert trend_words(trend_of("K", [kept(0, None, "error")])) == ["None of 1 runs gave a value."]


def test_a_trend_shows_how_sure_each_value_is_and_names_its_limits(tmp_path) -> None:
    sure = [msgspec.structs.replace(kept(day, 1e5 + day), expanded=2.5e3, high=1.2e5) for day in range(4)]
    write_trends([trend_of("K", sure)], "7", tmp_path / "sure.html")
    page = (tmp_path / "sure.html").read_text()
    assert page.count('<td class="n">± 2.5</td>') == 4
    words = re.findall(r"<text[^>]*>([^<]*)</text>", page)
    assert {"lower limit 0", "upper limit 120"} <= set(words)
    write_trends([trend_of("K", [kept(0, 1e5), kept(1, 1e5)])], "7", tmp_path / "bare.html")
    assert "± U, and the line" not in (tmp_path / "bare.html").read_text()


def test_the_index_keeps_how_sure_a_value_is(tmp_path) -> None:
    one = check("K", 1e5, "kN/m", 1e3, low=9e4, u=1e3)
    run(tmp_path / "a", [one, check("bare", 1.0, "N", low=0.0)], rig="one")
    (found,) = RunIndex(tmp_path).checks("K")
    assert found.expanded == pytest.approx(2e3)
    (bare,) = RunIndex(tmp_path).checks("bare")
    assert bare.expanded is None
