"""What a reader of a report sees first and cannot mistake: failures, lines, scales, temperatures, dates."""

import itertools
import json
import math
import re
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from matplotlib.colors import to_rgb

from bench_records.curves import Axis, curve
from bench_records.layout import SignalInfo
from bench_records.plot_data import Plot, PlotData
from bench_records.report import CLOSE_ROWS, FAILED_ROWS, least_sure, notable, write_report
from bench_records.report_plots import CURVE, NUMBER_WIDTH, curve_panel, curve_traces, labelled_frequencies
from bench_records.result import check, unavailable
from bench_records.run_drawings import curve_plots, curve_tables
from bench_records.signing import instruments_of
from tests.refusals import refuses

HZ, STIFF = Axis("frequency", "Hz"), Axis("K'", "kN/m", 1e3)


def sweep(name: str, xs, ys, **rest):
    return curve(name, HZ, STIFF, xs, ys, kind="sweep", **rest)


def test_failed_checks_follow_the_verdict(failed_run: Path) -> None:
    page = write_report(failed_run).read_text(encoding="utf-8")
    head, _, rest = page.partition("<h2>What was tested</h2>")
    assert "<h2>Not passed</h2>" in head
    for told in ("right bellows pressure", "lateral acceleration"):
        assert f'<td class="name">{told}</td>' in head and f'<td class="name">{told}</td>' in rest
    assert '<td class="name">left bellows pressure</td>' not in head
    assert head.index("right bellows pressure") < head.index("lateral acceleration"), (
        "failed before without a value"
    )


def test_the_first_page_stays_one_page_however_much_fails() -> None:
    failed = [check(f"bad {n}", 2.0, "N", high=1.0) for n in range(FAILED_ROWS + 7)]
    close = [check(f"near {n}", 0.99, "N", high=1.0) for n in range(CLOSE_ROWS + 1)]
    (_, shown, more), (_, near, others) = notable([*close, unavailable("none", "no cell"), *failed])
    assert (len(shown), more, len(near), others) == (FAILED_ROWS, 8, CLOSE_ROWS, 1)
    assert {row.check.verdict for row in shown} == {"fail"}
    assert notable([check("good", 0.5, "N", high=1.0)]) == []


def test_where_all_conform_the_least_sure_is_named() -> None:
    sure, less = (check(name, value, "N", high=1.0, u=0.1) for name, value in (("sure", 0.1), ("less", 0.75)))
    assert (
        least_sure([sure, less])
        == "The check with the lowest probability of conformity is “less”, with 99.4 %."
    )
    assert least_sure([sure, check("bad", 2.0, "N", high=1.0, u=0.1)]) == ""


@given(st.lists(st.floats(0.05, 60.0).map(lambda f: round(f, 2)), min_size=2, max_size=40, unique=True))
def test_all_frequencies_without_overlap_are_labelled(frequencies: list[float]) -> None:
    places = sorted(frequencies)
    told = labelled_frequencies([sweep("K", places, places)])
    assert set(told) <= set(places) and (told[0], told[-1]) == (places[0], places[-1])
    points = 72 * (CURVE.width - CURVE.left - CURVE.right) / (1.1 * math.log(places[-1] / places[0]))
    half = lambda f: NUMBER_WIDTH * (len(f"{f:g}") + 1) / 2  # noqa: E731
    for one, other in itertools.pairwise(told[:-1]):
        assert points * math.log(other / one) >= half(one) + half(other)
    for left_out in set(places) - set(told):
        near = min(told, key=lambda one: abs(points * math.log(one / left_out)) - half(one))
        assert abs(points * math.log(near / left_out)) < half(near) + half(left_out)


def test_all_frequencies_of_the_plans_are_stated() -> None:
    places = [0.5, 1.0, 1.5, 2.0, 3.0]
    picture = curve_panel("name", "K'", [sweep("pair", places, places)])
    told = re.findall(r'text-anchor: middle[^>]*">([\d.]+)<', picture)
    assert told == ["0.5", "1", "1.5", "2", "3"]
    (drawn,) = curve_plots([sweep("pair", places, places)])
    assert drawn.plot.ticks == places


def lab(color: str) -> np.ndarray:
    """A colour in CIE L*a*b*, in which 2.3 is just seen: from sRGB under D65."""
    rgb = np.array(to_rgb(color))
    linear = np.where(rgb <= 0.04045, rgb / 12.92, ((rgb + 0.055) / 1.055) ** 2.4)
    rows = [[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]]
    xyz = np.array(rows) @ linear / np.array([0.9505, 1.0, 1.089])
    f = np.where(xyz > 216 / 24389, np.cbrt(xyz), (24389 / 27 * xyz + 16) / 116)
    return np.array([116 * f[1] - 16, 500 * (f[0] - f[1]), 200 * (f[1] - f[2])])


@pytest.mark.parametrize("count", range(2, 17))
def test_lines_are_distinguishable(count: int) -> None:
    names = ["slow", *(f"{n / 2:g} Hz" for n in range(1, count))]
    traces = curve_traces([sweep(name, [1.0, 2.0], [1.0, 2.0]) for name in names])
    for place, one in enumerate(traces):
        # Of many lines only neighbours are compared by a reader; of a few, all.
        for other in traces[place + 1 : place + 2 if count > 8 else None]:
            apart = float(np.linalg.norm(lab(one.color) - lab(other.color)))
            assert apart > 20.0 or one.dash != other.dash, (one.label, other.label, apart)


def test_a_line_under_another_shows_at_its_edges() -> None:
    left, right = curve_traces([sweep(side, [1.0, 2.0], [1.0, 2.0]) for side in ("left", "right")])
    assert left.width > 2 * right.width and right.dash and not left.dash


def test_uncertainties_of_points_are_drawn_and_passed_to_the_script() -> None:
    known = sweep("K", [1.0, 2.0, 4.0], [3e3, 4e3, 5e3], expanded=[1e2, None, 3e2])
    bare = sweep("K", [1.0, 2.0, 4.0], [3e3, 4e3, 5e3])
    (trace,) = curve_traces([known])
    assert trace.expanded is not None and trace.expanded[[0, 2]].tolist() == [0.1, 0.3]
    ends, none = (curve_panel("a", "K", [one]).count("h70") for one in (known, bare))
    assert (ends, none) == (4, 0), "both ends of both known uncertainties"
    data = PlotData()
    data.add(Plot("sweep", "K", "x", "y", [trace, *curve_traces([bare])]))
    ((one, other),) = (plot["traces"] for plot in json.loads(data.json))
    assert one["expanded"][2:] == [0.1, 0.3] and other["expanded"] is None
    with refuses(ValueError, "2 3 points"):
        sweep("K", [1.0, 2.0, 4.0], [1.0, 2.0, 3.0], expanded=[1.0, 2.0])


def test_temperatures_are_printed_in_degrees_celsius(passed_run: Path) -> None:
    page = write_report(passed_run).read_text(encoding="utf-8")
    heads = [one for one in re.findall(r'text-anchor: end[^>]*">([^<]*)<', page) if one in {"K", "°C"}]
    assert heads == ["°C"]
    assert SignalInfo("t", "K").shown(293.15) == pytest.approx(20.0)
    assert SignalInfo("p", "bar", 1e5).shown(2e5) == 2.0
    warm = curve("gas", HZ, Axis("temperature", "degC", 1.0, 273.15), [1.0], [293.15], kind="sweep")
    (table,) = curve_tables([warm])
    assert table.columns[1].endswith("°C") and table.rows[0][1] == "20.0"


def test_an_invalid_date_is_reported() -> None:
    piece = {
        "signal": "left.height",
        "type": "laser",
        "serial_number": "1",
        "certificate": "c",
        "calibrated": "",
    }
    told = instruments_of({"instruments": {"pieces": [{**piece, "due": "9999-12-31"}]}})
    assert [one.due for one in told] == ["no due date"]
    told = instruments_of({"instruments": {"pieces": [{**piece, "due": "2027-02-03"}]}})
    assert [one.due for one in told] == ["2027-02-03"]
