"""The view Twin: the model's statements during a run, as stored in twin.json."""

import os
from pathlib import Path

import pytest

from bench_records.record import read
from bench_records.twin import Deviation, DeviationState, Judged, PossibleCause, TwinStory, write_twin
from bench_sim.parameters import load
from bench_sim.rig.faults.panel import PlannedFault
from diagnosis.twin.twin import Twin
from tests.twin.test_twin import Growing, run

#: Where pictures go, to be looked at.
PICTURES = os.environ.get("ASTB_PICTURES", "")
#: How many dots of a plot are painted.
PAINTED = """(one) => {
  const { data } = one.getContext("2d").getImageData(0, 0, one.width, one.height);
  return data.filter((value, k) => k % 4 === 3 && value > 0).length;
}"""
HOLE = PossibleCause(
    "leak.left",
    "leak of a bellows (orifice), left",
    2e-7,
    1.7e-7,
    2.3e-7,
    "0.20 mm² (0.17 to 0.23)",
    since=214.0,
)
STORY = TwinStory(
    "astb",
    300.0,
    (
        Judged(0.0, 60.0, None, "a service valve fills a spring"),
        Judged(60.0, 200.0, True),
        Judged(200.0, 300.0, False),
    ),
    (
        Deviation(
            222.0,
            214.0,
            "left.bellows_pressure",
            measured=4.02e5,
            expected=4.11e5,
            band=2e3,
            causes=(HOLE,),
            sentence="From 214 s on the left bellows lost air like a hole of 0.20 mm² (0.17 to 0.23).",
            earliest=212.0,
            latest=215.5,
            course=(DeviationState(222.0, "told", (HOLE,)), DeviationState(250.0, "surer", (HOLE,))),
        ),
    ),
)


def test_the_newest_run_with_a_twin_is_shown_in_display_units(client, parts, keep):
    page = client(command=False)
    assert page.get("/api/twin").json() == {"runs": [], "run": "", "story": None}
    for name in ("one", "two", "three"):
        keep(parts.out, name, 0.004)
    for name in ("one", "two"):
        write_twin(parts.out / name, STORY)
    told = page.get("/api/twin").json()
    assert (told["runs"], told["run"]) == (["two", "one"], "two")
    (parting,) = told["story"]["partings"]
    assert (parting["measured"], parting["unit"], parting["lasts"]) == (pytest.approx(4.02), "bar", True)
    assert told["story"]["judged_for"] == 240.0
    assert page.get("/api/twin", params={"run": "one"}).json()["run"] == "one"
    for none in ("three", "../one", "nowhere"):
        assert page.get("/api/twin", params={"run": none}).status_code == 404
    (parts.out / "one" / "twin.json").write_text("{")
    assert page.get("/api/twin", params={"run": "one"}).status_code == 404


@pytest.mark.slow
@pytest.mark.real_time
def test_the_view_says_since_when_they_part_in_which_reading_and_why_perhaps(open_page, bench_panel, keep):
    keep(bench_panel.out, "watched", 0.004)
    write_twin(bench_panel.out / "watched", STORY)
    page = open_page(command=False)
    page.click("#views >> text=Twin")
    # Other tests leave newer runs with a twin in the panel's folder.
    page.wait_for_selector("#view .filters option[value=watched]", state="attached")
    page.select_option("#view .filters select", "watched")
    page.wait_for_selector(".verdict-twin.parted >> text=since 214.0")
    text = " ".join((page.text_content("#view") or "").split())
    for words in (
        "in left.bellows_pressure",
        "4.020 bar",
        "4.110 ± 0.02 bar",
        "4.5 × uncertainty below",
        "hole of 0.20 mm²",
    ):
        assert words in text, (words, text)
    assert "reported at 222.0" in text and "narrowed down at 250.0" in text
    assert page.get_attribute(".strip", "aria-label").endswith(
        "200.0\u2009s to 214.0\u2009s agreed; 214.0\u2009s to 300.0\u2009s deviated"
    )
    strip, mark = (page.locator(one).bounding_box() for one in (".strip", ".strip b"))
    assert (mark["x"] + mark["width"] / 2 - strip["x"]) / strip["width"] == pytest.approx(214 / 300, abs=0.01)
    fits_everywhere(page, "twin")


def clock(seconds: float) -> str:
    """A time of more than a minute, as a page says it."""
    return f"of {int(seconds // 60)}:{int(seconds % 60):02d}\u2009min"


def fits_everywhere(page, name: str) -> None:
    """Nothing of a page needs to be moved sideways at any size of a screen."""
    for width, height in {1800: 1000, 1024: 768, 768: 1024, 390: 844}.items():
        page.set_viewport_size({"width": width, "height": height})
        page.wait_for_timeout(200)
        assert page.evaluate("document.querySelector('main').scrollWidth <= innerWidth"), width
        for dark in (False, True):
            page.emulate_media(color_scheme="dark" if dark else "light")
            page.wait_for_timeout(100)
            if PICTURES:
                page.screenshot(path=Path(PICTURES) / f"{name}-{width}{'-dark' if dark else ''}.png")


@pytest.mark.slow
@pytest.mark.real_time
def test_readings_are_shown_with_the_bands_of_a_running_twin(open_page, bench_panel, keep, tmp_path):
    leak = PlannedFault("leak", {"side": "left", "area": "1mm2"}, 75.0, None)
    record = Growing(read(run("aw0", tmp_path, 13, leak)))
    twin = Twin(record, load("astb"), "astb")
    keep(bench_panel.out, "goes on", 0.004)
    page = open_page(command=False)
    page.click("#views >> text=Twin")

    def seen(until: float) -> dict[str, str]:
        record.until = until
        write_twin(bench_panel.out / "goes on", twin.look(ended=False))
        page.wait_for_selector("#view .filters option[value='goes on']", state="attached")
        page.select_option("#view .filters select", "goes on")
        page.wait_for_selector(f"text={clock(until)}")
        return {
            one.get_attribute("aria-label"): one.inner_text() for one in page.locator(".lately .card").all()
        }

    sound = seen(72.0)
    assert len(sound) == len(twin.story.last_minute.channels) > 12
    assert page.locator(".lately .card.parted").count() == 0
    assert (
        "bar, expected" in sound["left bellows pressure"] and "kN, expected" in sound["vertical left force"]
    )
    canvas = page.locator(".lately canvas").first.element_handle()
    parted = seen(88.0)
    assert page.locator(".lately .card.parted .far").count() >= 1
    assert parted.keys() == sound.keys() and parted != sound
    assert canvas.evaluate("(one) => one.isConnected && one.width > 100"), (
        "plots continue, they are not recreated"
    )
    assert canvas.evaluate(PAINTED) > 500
    fits_everywhere(page, "lately")
