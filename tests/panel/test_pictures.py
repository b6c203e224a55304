"""Every page on a phone, a tablet and a desk: no page is too wide, and no button is covered."""

import subprocess
import sys
from pathlib import Path

import pytest

from bench_records.layout import REPORT
from bench_records.notes import add_note
from tests.pictures import inaccessible

#: A plan is run first, which takes as long as others keep the machine busy.
pytestmark = [pytest.mark.slow, pytest.mark.timeout(400)]

PHOTO = Path(__file__).parents[2] / "docs" / "gallery" / "panel-lost.png"
SIZES = {390: 844, 820: 1180, 1400: 900}
VIEWS = ("live", "twin", "runs", "diagnoses", "specimens", "reservations", "faults", "bus")

#: How much wider than the screen the page is, what of it stands out, and which buttons something else lies upon.
LOOK = """() => {
  const main = document.querySelector("main");
  const wide = Math.max(document.documentElement.scrollWidth, main?.scrollWidth ?? 0) - innerWidth;
  const beyond = (one) => one.getBoundingClientRect().right > innerWidth + 1;
  const out = [...document.querySelectorAll("body *")].filter(beyond);
  const covered = [];
  for (const one of document.querySelectorAll("button, nav a, select, input, a[href], summary")) {
    if (!one.checkVisibility() || !one.getClientRects().length) continue;
    one.scrollIntoView({ block: "center" });
    const box = one.getClientRects()[0];
    const found = document.elementFromPoint(box.left + box.width / 2, box.top + box.height / 2);
    const free = found && one.contains(found);
    if (!free) covered.push(`${one.outerHTML.slice(0, 90)} by ${found?.outerHTML.slice(0, 60)}`);
  }
  main?.scrollTo(0, 0);
  scrollTo(0, 0);
  const stop = document.getElementById("estop")?.getBoundingClientRect();
  return { wide, out: wide > 0 ? out.slice(-5).map((one) => one.outerHTML.slice(0, 120)) : [], covered,
    stop: !stop || (stop.top >= 0 && stop.bottom <= innerHeight && stop.left >= 0 && stop.right <= innerWidth) };
}"""


def looked_at(page, pictures, name: str) -> None:
    """Keep a picture of a page, and see that it fits its screen and that all of it can be pressed."""
    page.screenshot(path=pictures / f"{name}.png")
    assert inaccessible(page) == [], name
    found = page.evaluate(LOOK)
    assert found["wide"] <= 0, (name, found)
    assert found["covered"] == [], name
    assert found["stop"], f"{name}: STOP is out of sight"


@pytest.fixture(scope="module")
def pictures(tmp_path_factory):
    """Where the pictures go, to be looked at."""
    return tmp_path_factory.mktemp("pictures")


@pytest.fixture(scope="module")
def made(bench_panel, keep):
    """Runs, a diagnosis and a real report in the folder of the panel."""
    for name, value in (("one", 0.004), ("two", 0.005), ("failed_one", 0.012)):
        keep(bench_panel.out, name, value, more=("width",))
    add_note(bench_panel.out / "failed_one", "A scratch on the left bellows", "A. Tester", PHOTO)
    diagnosis = bench_panel.out / "found_of_one"
    diagnosis.mkdir()
    (diagnosis / REPORT).write_text("<p>the report</p>")
    (diagnosis / "finding.json").write_text(
        '{"verdict": "named", "sentence": "The left bellows leaks.", "provenance": {"simulator": "the bench"}}'
    )
    command = [sys.executable, "-m", "astb", "run", "aw0", "--virtual", "--out", str(bench_panel.out)]
    subprocess.run(command, check=True, capture_output=True)


@pytest.mark.parametrize("width", SIZES)
def test_every_view_fits_its_screen_and_no_button_is_covered(open_page, made, pictures, width) -> None:
    page = open_page(size=(width, SIZES[width]))
    page.wait_for_selector("body:not(.stale)")
    for view in VIEWS:
        page.click(f"#views button >> text={view.title()}")
        page.wait_for_selector("#view :is(.readings, table, .fault, .said)")
        page.wait_for_timeout(300)
        if view == "runs":
            page.click("tr:has(a[href$='=failed_one'])", position={"x": 4, "y": 4})
            page.wait_for_selector(".checks .check")
        if view == "specimens":
            page.click("table.list button >> text=astb")
            page.wait_for_selector("section[aria-label=specimen] td")
        looked_at(page, pictures, f"{view}-{width}")
        if view == "live":
            page.click(".side button.ask >> nth=-1")
            assert "not applied yet" in page.text_content(
                "section[aria-label=interlocks] .help:not([hidden])"
            )
            page.click("section[aria-label=interlocks] button.ask")
            start = page.locator("#start").bounding_box()
            assert start["y"] + start["height"] <= SIZES[width], "Start is on the first screen"


@pytest.mark.parametrize("width", SIZES)
def test_a_report_a_trend_and_a_comparison_fit_their_screens(
    open_page, bench_panel, made, pictures, width
) -> None:
    page = open_page(size=(width, SIZES[width]))
    for name, path in {
        "report": "report?run=aw0",
        "trend": "trend?run=one&place=0",
        "trends": "trend?run=aw0&place=0&place=7",
        "compare": "compare?a=one&b=two",
    }.items():
        page.goto(f"{bench_panel.watching}kept/{path}")
        page.wait_for_timeout(300)
        page.screenshot(path=pictures / f"{name}-{width}.png", full_page=True)
        looked_at(page, pictures, f"{name}-top-{width}")
