"""In a real browser the plots of a report zoom and show values; on paper its pages have numbers and pictures."""

import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from bench_records.layout import RecordError
from bench_records.printing import CHOSEN, write_pdf
from bench_records.record import read
from bench_records.report import write_report
from tests.refusals import refuses

#: What the drawing says of the left height.
DRAWN = """() => [...document.querySelectorAll(".replay .label")]
  .find((one) => one.querySelector("title").textContent === "left height").querySelector(".value").textContent"""


@pytest.fixture(scope="module")
def page(browser: Any, passed_run: Path) -> Iterator[Any]:
    source = write_report(passed_run)
    page = browser.new_page(viewport={"width": 1100, "height": 900})
    page.route("**", lambda route: route.continue_() if "file:" in route.request.url else route.abort())
    page.faults = []
    page.on("pageerror", lambda error: page.faults.append(str(error)))
    page.on("requestfailed", lambda request: page.faults.append(request.url))
    page.goto(source.as_uri())
    page.wait_for_selector("[data-plots=live]", timeout=30_000)
    yield page
    page.close()


@pytest.mark.slow
def test_plots_zoom_together_and_show_values(page: Any) -> None:
    scale = """place => [place.plot.scales.x.min, place.plot.scales.x.max]"""
    heights, supply = (
        page.locator(f".zoom:has(.u-title:text-is('{title}'))") for title in ("Heights", "Supply (gauge)")
    )
    whole = heights.evaluate(scale)
    area = heights.locator(".u-over")
    area.scroll_into_view_if_needed()
    box = area.bounding_box()
    at = [(box["x"] + part * box["width"], box["y"] + box["height"] / 2) for part in (0.35, 0.55, 0.45)]
    page.mouse.move(*at[0])
    page.mouse.down()
    page.mouse.move(*at[1], steps=4)
    page.mouse.up()
    zoomed = heights.evaluate(scale)
    assert zoomed[1] - zoomed[0] == pytest.approx(0.2 * (whole[1] - whole[0]), rel=0.02)
    assert supply.evaluate(scale) == pytest.approx(zoomed)
    page.mouse.move(*at[2])
    pointed = [float(text.replace("−", "-")) for text in heights.locator(".u-value").all_inner_texts()]
    assert pointed[0] == pytest.approx(zoomed[0] + 0.45 * (zoomed[1] - zoomed[0]), abs=0.5)
    # Between 35 and 67 s both springs move by 5 mm about their rest, as commanded.
    assert all(-6.0 <= height <= 6.0 for height in pointed[1:])
    page.mouse.dblclick(*at[2])
    assert heights.evaluate(scale) == pytest.approx(whole)
    assert page.faults == []


@pytest.mark.slow
def test_the_run_is_seen_in_the_drawing_at_any_instant(page: Any, passed_run: Path) -> None:
    record, place = read(passed_run), page.locator(".replay")
    times, values = record.series("left.height")

    def height() -> float:
        text = page.evaluate(DRAWN)
        return float(text.removesuffix(" mm").replace("−", "-"))

    def stands(time: float) -> float:
        return float(values[times.searchsorted(time + 1e-6, side="right") - 1] * 1e3)

    for time in (12.3, 47.5, 60.0):
        page.evaluate("time => (location.hash = `t=${time}`)", time)
        page.wait_for_selector(f".replay[data-time='{time:.3f}']")
        assert height() == pytest.approx(stands(time), abs=0.06)
    slider = place.get_by_label("instant of the run")
    slider.press("ArrowRight")
    assert place.get_attribute("data-time") == "60.100"
    event = place.get_by_label("go to an event")
    phase = record.phases[-1]
    event.select_option(
        label=next(one for one in event.locator("option").all_inner_texts() if phase.name in one)
    )
    assert float(place.get_attribute("data-time")) == pytest.approx(phase.start, abs=0.051)
    plot = page.locator(".zoom:has(.u-title:text-is('Heights')) .u-over")
    plot.click(position={"x": plot.bounding_box()["width"] / 2, "y": 20})
    assert float(place.get_attribute("data-time")) == pytest.approx(record.duration / 2, abs=2.0)
    place.get_by_text("Play").click()
    before = float(place.get_attribute("data-time"))
    page.wait_for_function("before => document.querySelector('.replay').dataset.time > before", arg=before)
    place.get_by_text("Pause").click()
    assert page.faults == []


@pytest.mark.slow
def test_a_report_is_dark_where_the_screen_is_and_light_on_paper(page: Any) -> None:
    shade = "() => getComputedStyle(document.documentElement).backgroundColor"
    shades = {}
    for media in ("screen", "print"):
        for scheme in ("light", "dark"):
            page.emulate_media(media=media, color_scheme=scheme)
            shades[media, scheme] = page.evaluate(shade)
    page.emulate_media(media="screen", color_scheme="light")
    assert shades.pop(("screen", "dark")) not in set(shades.values())
    assert set(shades.values()) == {"rgb(255, 255, 255)"}


@pytest.mark.slow
def test_in_print_there_are_pictures_instead(page: Any) -> None:
    picture, plot = page.locator(".zoom > svg").first, page.locator(".zoom > .uplot").first
    assert (picture.is_visible(), plot.is_visible()) == (False, True)
    page.emulate_media(media="print")
    assert (picture.is_visible(), plot.is_visible()) == (True, False)
    page.emulate_media(media="screen")


@pytest.mark.slow
def test_a_pdf_has_page_numbers_and_says_on_each_page_which_record_it_is_of(
    chromium: str, passed_run: Path, tmp_path: Path
) -> None:
    pypdf = pytest.importorskip("pypdf")
    for name in ("record.parquet", "result.json"):
        shutil.copy(passed_run / name, tmp_path)
    pages = pypdf.PdfReader(write_pdf(write_report(tmp_path))).pages
    texts = [page.extract_text() for page in pages]
    assert len(texts) > 2
    for number, text in enumerate(texts, 1):
        assert f"page {number} of {len(texts)}" in text and "record " in text
    assert "operator\nnot recorded" in texts[0]
    assert not any("Drag over a plot" in text for text in texts), "there is no dragging on paper"
    assert "signature" in texts[0] and "SHA-256 of record.parquet" in texts[0]
    assert [float(side) for side in pages[0].mediabox[2:]] == pytest.approx([595, 842], abs=1.5)  # A4


def test_without_a_browser_the_error_says_what_would_help(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(CHOSEN, str(tmp_path / "nothing"))
    with pytest.raises(RecordError, match=f"was not found .*apt install chromium, or .*{CHOSEN}"):
        write_pdf(tmp_path / "report.html")


def test_a_browser_without_output_is_reported(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    broken = tmp_path / "broken"
    broken.write_text("#!/bin/sh\necho no display >&2\nexit 5\n")
    broken.chmod(0o755)
    monkeypatch.setenv(CHOSEN, str(broken))
    with refuses(RecordError, "display"):
        write_pdf(tmp_path / "report.html")
