"""Pages of records fit a telephone and a sheet of paper: no content is cut off, and no heading is the last line."""

import shutil
from pathlib import Path
from typing import Any

import msgspec
import pytest

import bench_records
from bench_records.comparison import compare_runs
from bench_records.index import KeptCheck, KeptRun
from bench_records.kept_pages import write_comparison, write_trends
from bench_records.printing import write_pdf
from bench_records.report import write_report
from bench_records.trend import trend_of
from tests.pictures import LOOK, faults

#: Elements beyond the right edge of the screen, except in scrollable ones.
BEYOND = """
() => [...document.querySelectorAll("body *")].filter(one => {
  const box = one.getBoundingClientRect();
  return box.width && box.right > innerWidth + 1 && !one.closest("table, .wide, svg");
}).map(one => `${one.tagName} ${one.className}`)
"""
WIDTHS = (390, 820, 1400)


def _trend(path: Path) -> Path:
    base = KeptRun(
        directory="hall-4711/measuring_chain-2", began="", plan="aw0", title="", verdict="pass", reason="",
        rig="hall, the second of two", operator="", specimen="spring", serial_number="7", circumstances="SIMULATED",
        seed=None, duration=1.0, parameters={},
    )  # fmt: skip
    checks = [
        KeptCheck(
            run=msgspec.structs.replace(base, began=f"2026-01-{day:02d}T08:00:00Z"), phase="vertical sine 1 Hz",
            name="left vertical K' at 1 Hz", value=1e5 + 3e2 * day, unit="kN/m", scale=1e3, low=9e4, high=1.1e5,
            verdict="pass", expanded=1.5e3,
        )
        for day in range(1, 9)
    ]  # fmt: skip
    write_trends([trend_of("left vertical K' at 1 Hz", checks)], "4711", path)
    return path


@pytest.mark.slow
def test_no_page_is_wider_than_its_screen(
    browser: Any, passed_run: Path, failed_run: Path, tmp_path: Path
) -> None:
    write_comparison(compare_runs(passed_run, failed_run), tmp_path / "comparison.html")
    pages = [write_report(failed_run), tmp_path / "comparison.html", _trend(tmp_path / "trend.html")]
    for width in WIDTHS:
        page = browser.new_page(viewport={"width": width, "height": 900})
        for one in pages:
            page.goto(one.as_uri())
            if one.name == "report.html":
                page.wait_for_selector("[data-plots=live]", timeout=30_000)
            wide = page.evaluate("document.documentElement.scrollWidth")
            assert (one.name, width, wide, page.evaluate(BEYOND)) == (one.name, width, width, [])
            drawings = [] if width < 820 else page.evaluate(LOOK)
            assert [fault for drawing in drawings for fault in faults(drawing)] == []
        page.close()


def _printed(path: Path, body: str) -> list[list[str]]:
    """The lines of each page, without its foot, of a page in the style of a report."""
    pypdf = pytest.importorskip("pypdf")
    style = (Path(bench_records.__path__[0]) / "style.css").read_text(encoding="utf-8")
    path.write_text(f"<!doctype html><style>{style}</style>{body}", encoding="utf-8")
    texts = [page.extract_text() for page in pypdf.PdfReader(write_pdf(path)).pages]
    return [[line.strip() for line in text.splitlines() if not line.startswith("page ")] for text in texts]


@pytest.mark.slow
@pytest.mark.timeout(180)
def test_on_paper_no_heading_has_one_row(chromium: str, tmp_path: Path) -> None:
    """Wherever a table comes to lie on a page, by 4 mm."""
    row, check_row = (
        "<tr><td>row</td><td>text</td></tr>",
        "<tbody><tr><td>row</td></tr><tr><td>n</td></tr></tbody>",
    )
    head = "<thead><tr><th>one</th><th>other</th></tr></thead>"
    kinds = {
        "events": f"<table>{head}<tbody>{9 * row}</tbody></table>",
        "checks": f'<table class="checks">{head}{9 * check_row}</table>',
    }
    place = '<div style="break-before: page; height: {}mm"></div>'
    body = ""
    for height in range(180, 256, 4):
        for kind, table in kinds.items():
            body += f"{place.format(height)}<section><h2>HEAD {kind} {height}</h2>{table}</section>"
    pages = _printed(tmp_path / "page.html", body)
    heads = [(page, line) for page in pages for line in page if line.startswith("HEAD")]
    assert len(heads) == 2 * len(range(180, 256, 4))
    for page, line in heads:
        rows = sum(one.startswith("row") for one in page[page.index(line) :])
        assert rows >= 3, (line, page)


@pytest.mark.slow
def test_the_first_page_is_a_summary_to_be_signed(chromium: str, failed_run: Path, tmp_path: Path) -> None:
    pypdf = pytest.importorskip("pypdf")
    for name in ("record.parquet", "result.json"):
        shutil.copy(failed_run / name, tmp_path)
    pages = [page.extract_text() for page in pypdf.PdfReader(write_pdf(write_report(tmp_path))).pages]
    for told in ("checks outside the limits", "Not passed", "operator", "Signatures", "approved by"):
        assert told in pages[0]
    assert len(pages) <= 8
