"""The report contains all of the result, loads no other file, and is reproducible."""

import html
import os
import re
import shutil
import subprocess
import sys
import time
from html.parser import HTMLParser
from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from bench_records.check_table import BAR_WIDTH, check_rows, range_bar
from bench_records.layout import RecordError, SignalInfo
from bench_records.plots import ALARM
from bench_records.recorder import Recorder
from bench_records.report import report_page, write_report
from bench_records.report_plots import envelope
from bench_records.result import Timing, check, conclude, read_result
from bench_records.twin import Deviation, TwinStory, write_twin
from tests.refusals import refuses

ROOT = Path(__file__).parents[2]
VOID = {"meta", "br", "hr", "img", "input", "link"}


class Page(HTMLParser):
    """The page taken apart: its text, its ids, its references; complains about tags that do not match."""

    def __init__(self, source: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.words: list[str] = []
        self.ids: list[str] = []
        self.attributes: list[tuple[str, str, str | None]] = []
        self.feed(source)
        self.close()
        assert self.open == []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        if tag not in VOID:
            self.open.append(tag)
        self.attributes += [(tag, name, value) for name, value in attrs]
        self.ids += [value for name, value in attrs if name == "id" and value]

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.handle_starttag(tag, attrs)
        if tag not in VOID:
            self.open.pop()

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        if not self.open or self.open[-1] not in {"style", "script"}:
            self.words.append(data)

    @property
    def text(self) -> str:
        return re.sub(r"[ \n]+", " ", " ".join(self.words))  # thin spaces stay


@pytest.fixture(scope="module")
def passed_page(passed_run: Path) -> str:
    return write_report(passed_run).read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def failed_page(failed_run: Path) -> str:
    return write_report(failed_run).read_text(encoding="utf-8")


@pytest.fixture
def small_run(tmp_path: Path) -> Path:
    """A record of one signal, without a result."""
    with Recorder(
        tmp_path, [SignalInfo("x", "mm", 1e-3, "way", "Ways")], {"plan": "small"}, start_ns=0
    ) as recorder:
        recorder.receive(np.arange(100) * 10_000_000, np.zeros(100, np.int16), np.arange(100) * 1e-3)
    return tmp_path


def test_every_check_with_its_limits_and_verdict(failed_run: Path, failed_page: str) -> None:
    text = Page(failed_page).text.replace("\u2007", "").replace("\u2008", "")
    text = " ".join(text.split())
    for row in check_rows(read_result(failed_run).checks):
        cells = [row.name, row.value, row.low, row.high, row.unit]
        pattern = r"\s*(?:–\s*)?".join(
            re.escape(cell.strip("\u2007\u2008")) for cell in cells if cell.strip("\u2007\u2008")
        )
        shown = re.search(pattern + rf"\s*{re.escape(row.sign)}\s*{row.check.verdict} (.*)", text)
        assert shown and shown[1].startswith("; ".join(filter(None, [row.check.phase, row.check.note])))


def test_verdict_instruction_phases_events_and_origin(failed_run: Path, failed_page: str) -> None:
    page = Page(failed_page)
    assert "fail 1 of 11 checks outside the limits" in page.text
    assert "vertical and lateral stiffness and damping, first harmonic, 5 mm" in page.text
    for phase in read_result(failed_run).phases:
        assert phase.name in page.words
    for words in (
        "ACTIVE → FAULT HOLD",
        "5f0c2f6a9e7b41d3",
        "9b1f20d7c4f1e8a2",
        "versions › numpy",
        "440\u2009000",
    ):
        assert words in page.text
    for panel in ("Heights", "Pressures (gauge)", "Gas temperatures", "Vertical force over displacement"):
        assert panel in page.text
    assert "138\u2009µs" in page.text
    assert "No tick was late." in page.text
    assert "58\u2009410" in page.text


def test_the_first_trip_is_reported_first(failed_page: str, passed_page: str) -> None:
    text = Page(failed_page).text
    assert "The first limit that tripped: right bellows pressure above 2.2 bar at 86.000\u2009s." in text
    assert (
        "Next events: 12\u2009ms later, ACTIVE → FAULT HOLD; 300\u2009ms later, left height error above 8 mm."
        in text
    )
    assert "Pressures (gauge) around the trip" in text
    assert "The first limit that tripped" not in passed_page
    panels, calm = (
        [svg for svg in re.findall(r"<svg class=\"plot\".*?</svg>", page, re.DOTALL) if 'id="time' in svg]
        for page in (failed_page, passed_page)
    )
    assert len(panels) == len(calm) == 6
    assert all(ALARM in panel for panel in panels)
    assert not any(ALARM in panel for panel in calm)


def test_the_page_loads_no_other_file_and_is_small(passed_page: str, failed_page: str) -> None:
    for source in (passed_page, failed_page):
        page = Page(source)
        assert "@import" not in source
        assert "http" not in re.sub(r'xmlns(:\w+)?="[^"]*"', "", source).replace(
            "https://github.com/leeoniya/uPlot", ""
        )
        for _, name, value in page.attributes:
            if name in {"src", "href", "xlink:href"}:
                assert value is not None
                assert value.startswith("#")
        assert len(source.encode()) < 1_500_000


def test_ids_are_unique_and_references_resolve(failed_page: str) -> None:
    page = Page(failed_page)
    assert len(page.ids) == len(set(page.ids))
    wanted = set(re.findall(r"url\(#([^)]+)\)", failed_page)) | set(
        re.findall(r'href="#([^"]+)"', failed_page)
    )
    assert wanted
    assert wanted <= set(page.ids)


def test_every_drawing_is_well_formed(failed_page: str) -> None:
    drawings = re.findall(r"<svg.*?</svg>", failed_page, flags=re.DOTALL)
    assert len(drawings) > 20
    for drawing in drawings:
        ET.fromstring(drawing.replace("xlink:href", "href"))


@pytest.mark.slow
def test_the_same_files_make_the_same_bytes_in_any_process(
    passed_run: Path, passed_page: str, failed_page: str, tmp_path: Path
) -> None:
    for name in ("record.parquet", "result.json"):
        shutil.copy(passed_run / name, tmp_path)
    # Drawings share their axes: what another report drew in them must not be seen here.
    assert failed_page
    assert write_report(tmp_path).read_text(encoding="utf-8") == passed_page
    command = """
import sys
from bench_records.report import write_report
write_report(sys.argv[1])
assert "pandas" not in sys.modules, "half a second for a library that a report has no use for"
"""
    environment = {**os.environ, "PYTHONHASHSEED": "12345", "TZ": "Asia/Tokyo", "LANG": "C"}
    subprocess.run([sys.executable, "-c", command, str(tmp_path)], check=True, cwd=ROOT, env=environment)
    assert (tmp_path / "report.html").read_text(encoding="utf-8") == passed_page


def test_quick_enough(passed_run: Path, passed_page: str, tmp_path: Path) -> None:
    for name in ("record.parquet", "result.json"):
        shutil.copy(passed_run / name, tmp_path)
    begun = time.process_time()
    write_report(tmp_path)
    print(f"report: {time.process_time() - begun:.2f} s of processor time")
    assert time.process_time() - begun < 2.0  # 0.4 s on an idle machine


def test_a_cut_off_run_is_blocked_but_shown(small_run: Path) -> None:
    page = Page(write_report(small_run).read_text(encoding="utf-8"))
    assert "blocked the run was cut off before its end, after " in page.text
    assert "Ways" in page.text


@pytest.mark.parametrize(
    ("meta", "told"),
    [
        ({"simulated": True, "time": "virtual"}, "SIMULATED VIRTUAL TIME"),
        ({"simulated": True, "effects": {"leak.left": "0.2 mm²"}}, "SIMULATED effect leak.left = 0.2 mm²"),
        ({"simulated": True, "change": {"orifice_diameter": "18 mm"}}, "changed orifice_diameter = 18 mm"),
        ({"simulated": True, "change": {"area": ["1 m2", "2 m2"]}}, "changed area = 1 m2, 2 m2"),
        (
            {"simulated": True, "change": {"sensor_lag": {"left_height": "2 ms"}}},
            "sensor_lag = left_height 2 ms",
        ),
        ({"simulated": True, "faults": ["leak, side = left"]}, "SIMULATED fault leak, side = left"),
        ({"simulated": True, "sealed_effects": True}, "SIMULATED sealed effects (not shown)"),
    ],
)
def test_the_head_says_under_which_circumstances_was_measured(tmp_path: Path, meta: dict, told: str) -> None:
    with Recorder(tmp_path, [SignalInfo("x", quantity="Ways")], meta):
        pass
    page = Page(write_report(tmp_path).read_text(encoding="utf-8"))
    assert told in page.text[: page.text.index("blocked the run was cut off")]


def test_a_real_rig_needs_no_such_words(tmp_path: Path) -> None:
    with Recorder(tmp_path, [SignalInfo("x", quantity="Ways")], {"simulated": False, "time": "real"}):
        pass
    page = write_report(tmp_path).read_text(encoding="utf-8")
    assert 'class="circumstances"' not in page


def test_an_empty_record_makes_a_page(tmp_path: Path) -> None:
    with Recorder(tmp_path, [SignalInfo("x", quantity="Ways")]):
        pass
    assert "blocked" in Page(write_report(tmp_path).read_text(encoding="utf-8")).text


def test_no_record_no_report(tmp_path: Path) -> None:
    with refuses(RecordError, "record"):
        write_report(tmp_path)
    assert list(tmp_path.iterdir()) == []


def test_a_foreign_result_is_not_passed_over(small_run: Path) -> None:
    (small_run / "result.json").write_text('{"verdict": "pass"}')
    with refuses(RecordError, "result"):
        write_report(small_run)


def test_texts_of_others_stay_texts(tmp_path: Path) -> None:
    evil = "<script>alert('x')</script> & $a_b$ {{ 7*7 }}"
    signals = [SignalInfo("x", "<b>", 1.0, evil, evil), SignalInfo("s", label=evil, names={0: evil, 1: "ON"})]
    with Recorder(tmp_path, signals, {"plan": evil, evil: evil}, start_ns=0) as recorder:
        recorder.event(0, "phase", evil, edge="begin")
        recorder.receive([0, 1_000_000_000, 10_000_000_000], [0, 0, 0], [0.0, 1.0, 2.0])
        recorder.receive([0, 10_000_000_000], [1, 1], [0.0, 1.0])
        recorder.event(5_000_000_000, "trip", evil, signal="x", why=evil)
    conclude(evil, evil, evil, [check(evil, 1.0, evil, low=0, note=evil)], rig=evil).write(tmp_path)
    source = write_report(tmp_path).read_text(encoding="utf-8")
    page = Page(source)
    assert "<script>alert" not in source
    assert html.escape(evil, quote=False).split(" &")[0].split("(")[0] in source
    assert page.text.count("{{ 7*7 }}") >= 10
    assert page.text.count("$a_b$") >= 10  # no mathematics typeset by accident


def test_virtual_time_claims_no_punctuality(small_run: Path) -> None:
    timing = Timing(ticks=1000, late=0)
    conclude("small", "", "", [check("x", 1, low=0)], timing=timing).write(small_run)
    text = Page(write_report(small_run).read_text(encoding="utf-8")).text
    assert "virtual time, so every tick was on time" in text
    assert "No tick was late" not in text


@pytest.mark.parametrize(
    ("withdrawn", "banner"), [(None, "pass"), (False, "pass deviates"), (True, "pass")], ids=str
)
def test_a_pass_with_a_deviation_from_the_model_is_not_green(
    small_run: Path, withdrawn: bool | None, banner: str
) -> None:
    conclude("aw0", "Title.", "Title.", [check("height", 1.0, "m", low=0.0, high=2.0, margin=0.0)]).write(
        small_run
    )
    if withdrawn is not None:
        found = Deviation(
            9.0, 7.0, "left.height", 1.0, 2.0, 0.1, sentence="LEAK OF 1 mm²", withdrawn=withdrawn
        )
        write_twin(small_run, TwinStory("astb", 20.0, all_deviations=(found,)))
    page = report_page(small_run)
    assert f'<div class="banner {banner}">' in page
    assert ("LEAK OF 1 mm²" in page.split("<h2>")[0]) == ("deviates" in banner)


def test_a_marginal_run_says_so(passed_page: str) -> None:
    text = Page(passed_page).text
    assert "10 checks within the limits, 1 of them close to a limit" in text
    assert "▲ marginal" in text


def test_a_failed_value_is_never_rounded_onto_its_limit() -> None:
    (row,) = check_rows([check("x", 10.0000004e3, "kPa", 1e3, low=0.0, high=10e3)])
    assert (row.value, row.high) == ("10.0000004", "10.0000000")


def test_a_value_without_an_uncertainty_says_why() -> None:
    (row,) = check_rows([check("x", 1.0, low=0.0, without="nobody knows the instruments")])
    assert (row.uncertainty, row.detail) == ("", "no uncertainty: nobody knows the instruments")


def test_numbers_of_any_size_can_be_read() -> None:
    leak, count, force = check_rows(
        [
            check("leak", -2.5e-10, "m³/(s·Pa)", low=-5e-10, high=5e-10),
            check("samples lost", 0, high=0),
            check("force", 53.5e3, "kN", 1e3, low=50e3, high=60e3),
        ]
    )
    strip = "\u2007\u2008"
    assert leak.value.strip(strip) == "−2.500·10⁻¹⁰"
    assert (count.value.strip(strip), count.low.strip(strip)) == ("0", "–")
    assert (force.value.strip(strip), force.high.strip(strip)) == ("53.5", "60.0")


numbers = st.floats(-1e9, 1e9)


@settings(deadline=None, suppress_health_check=[HealthCheck.too_slow])  # a busy machine is no fault
@given(low=numbers, width=st.floats(1e-3, 1e9), value=numbers, sides=st.sampled_from(["both", "low", "high"]))
def test_range_bars_show_what_the_verdict_says(low: float, width: float, value: float, sides: str) -> None:
    high = low + width
    if not low < high:
        return
    one = check("x", value, low=low if sides != "high" else None, high=high if sides != "low" else None)
    bar = range_bar(one)
    assert bar.place is not None
    assert (
        0
        <= bar.left
        <= bar.inner_left + 1e-9
        <= bar.inner_right + 2e-9
        <= bar.right + 3e-9
        <= BAR_WIDTH + 4e-9
    )
    if bar.left + 1e-6 < bar.place < bar.right - 1e-6:
        assert one.passed or bar.beyond
    if bar.place < bar.left - 1e-6 or bar.place > bar.right + 1e-6:
        assert not one.passed


@given(
    values=st.lists(st.floats(-1e6, 1e6) | st.just(float("nan")), min_size=1, max_size=400),
    bins=st.integers(1, 40),
    seed=st.integers(0, 1000),
)
def test_thinned_series_keep_extremes_and_add_no_points(values: list[float], bins: int, seed: int) -> None:
    array = np.array(values)
    times = np.sort(np.random.default_rng(seed).uniform(0, 10, array.size))
    shown_t, shown_v = envelope(times, array, bins)
    known = array[~np.isnan(array)]
    shown = shown_v[~np.isnan(shown_v)]
    assert set(shown) <= set(known)
    assert (known.size == 0) == (shown.size == 0)
    if known.size:
        assert (shown.min(), shown.max()) == (known.min(), known.max())
    assert np.all(np.diff(shown_t) >= 0)
    assert set(shown_t) <= set(times)
    assert shown_v.size <= max(4 * bins + 2, 2 * bins * 2)


def test_a_gap_in_a_series_stays_a_gap() -> None:
    times = np.concatenate((np.arange(0, 10, 0.01), np.arange(20, 30, 0.01)))
    for bins in (100, 5000):
        shown_t, shown_v = envelope(times, np.ones(times.size), bins)
        hole = np.flatnonzero(np.isnan(shown_v))
        assert hole.size == 1
        assert shown_t[hole[0] - 1] < 10.01
        assert shown_t[hole[0] + 1] >= 20
