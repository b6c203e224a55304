"""A kept run in the panel: gone to at any instant, with events and curves, and made to go on otherwise from there."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from bench_records.record import read
from tests.pictures import BENCH_WORDS, faults

pytestmark = [pytest.mark.slow, pytest.mark.real_time, pytest.mark.timeout(300)]

#: Where a picture goes, to be looked at.
PICTURES = os.environ.get("ASTB_PICTURES", "")


@pytest.fixture
def kept(bench_panel):
    """A virtual run of the panel's own rig."""
    command = [sys.executable, "-m", "astb", "run", "leak_down", "--virtual", "--rig", bench_panel.rig_file]
    subprocess.run([*command, "--out", bench_panel.out], check=True, capture_output=True)
    return read(bench_panel.out / "leak_down")


def test_a_run_is_gone_back_to_and_goes_on_otherwise_from_there(open_page, bench_panel, kept) -> None:
    page = open_page()
    page.click("#views >> text=Runs")
    page.click("tr:has(a[href$='=leak_down']) >> td >> nth=3")
    page.click(".checks button >> text=Replay")
    page.wait_for_selector(".replay svg.bench")
    page.get_by_label("go to an event").select_option(index=3)
    event = float(page.get_attribute(".replay", "data-time"))
    assert any(abs(event - phase.start) < 0.06 for phase in kept.phases)
    page.get_by_label("instant of the run").fill("400")
    times, values = kept.series("left.bellows_pressure")
    drawn = page.text_content(".replay [data-signal='left.bellows_pressure'] .value")
    assert float(drawn.removesuffix(" bar")) == pytest.approx(
        values[times.searchsorted(40.0, "right") - 1] / 1e5, abs=0.006
    )
    assert faults(page.evaluate(BENCH_WORDS)) == []
    with page.expect_popup() as curves:
        page.click("text=Curves at this time")
    curves.value.wait_for_selector(".replay[data-time='40.000']")

    page.fill("input[aria-label='the change']", "leak.left=9 m2")
    page.click("#rehearse-from >> text=Rehearse from 40.0 s")
    page.wait_for_selector("#again >> text=leak.left: area = 9e+06 mm2 is outside")
    page.fill("input[aria-label='the change']", "leak.left=0.5mm2")
    page.click("#rehearse-from")
    page.wait_for_selector("#again >> text=CLEAR")
    told = page.text_content("#again")
    assert re.search(r"left\.bellows_pressure deviates from 40\.\d+ s", told), told
    if PICTURES:
        for width, height in {1800: 1000, 1024: 768, 390: 844}.items():
            page.set_viewport_size({"width": width, "height": height})
            page.wait_for_timeout(200)
            page.locator(".replay svg").scroll_into_view_if_needed()
            page.screenshot(path=Path(PICTURES) / f"time-machine-{width}.png")
    with page.expect_popup() as rehearsed:
        page.click("#again >> text=Open the rehearsal page")
    assert "continues from 40 s with leak.left = 0.5mm2" in " ".join(
        rehearsed.value.text_content("body").split()
    )
    viewer = open_page(command=False)
    viewer.click("#views >> text=Runs")
    viewer.click("tr:has(a[href$='=leak_down']) >> td >> nth=3")
    viewer.click(".checks button >> text=Replay")
    viewer.wait_for_selector("#rehearse-from:disabled")
