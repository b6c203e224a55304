"""The report page: it loads no other file, shows every part of the finding, and is reproducible."""

from __future__ import annotations

import re
from dataclasses import replace
from html.parser import HTMLParser
from xml.etree import ElementTree

import msgspec
import numpy as np
import pytest

from astb_studies.oscillator import REACH, UNIT_SPEED
from diagnosis import estimates
from diagnosis.engine.diagnose import diagnose
from diagnosis.finding import Finding, Suspect, Verdict
from diagnosis.report.page import HEADLINES, TONES, first_screen, render, write_report
from diagnosis.report.words import pair, prose, shown, typeset
from tests.pictures import LOOK, faults

VOID = {"meta", "br", "hr", "img", "link", "input"}


class Balance(HTMLParser):
    """Counts opened and closed tags, and collects the text."""

    def __init__(self):
        super().__init__()
        self.open, self.text = [], []

    def handle_starttag(self, tag, attrs):
        if tag not in VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag, attrs):
        pass

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        self.text.append(data)


@pytest.fixture(scope="module")
def found(laboratory, force_surface):
    lab = laboratory()
    menu = [replace(e, name=f"again {e.name}", minutes=2.0) for e in lab.experiments()]
    return diagnose(lab.measure(3, {"coulomb": {"amplitude": 0.3}}), lab.simulator, menu=menu)


@pytest.fixture(scope="module")
def no_finding(laboratory):
    lab = laboratory(samples=600)
    return diagnose(lab.measure(4), lab.simulator)


def text_of(page):
    parser = Balance()
    parser.feed(page)
    assert parser.open == []
    return re.sub(r"\s+", " ", " ".join(parser.text))


@pytest.mark.slow
def test_the_page_tells_suspects_with_the_test_that_they_do_not_pass(found):
    (first, *_) = found.causes
    suspect = Suspect(
        effect=first.effect,
        title=first.title,
        family=first.family,
        parameters=first.parameters,
        strength=first.strength,
        why="it explains only 3 % of the misfit in force",
    )
    unresolved = msgspec.structs.replace(
        found, verdict=Verdict.UNRESOLVED, causes=[], ambiguous_with=[], suspects=[suspect]
    )
    text = text_of(render(unresolved))
    assert "Where to look first" in text and f"Not accepted: {typeset(suspect.why)}." in text
    assert first.title in text and shown(first.parameters[0].value, 4) in text
    assert "Where to look first" not in text_of(render(found))


@pytest.mark.slow
def test_the_page_tells_the_finding(found):
    text = text_of(render(found))
    parts = [text.index(prose(one)) for _, one in first_screen(found)]
    assert len(parts) == 4 and parts == sorted(parts)
    assert parts[-1] < text.index("Terms") < text.index("Scores")
    for part in (
        "The cause",
        "Improvement on",
        "Tested effects",
        "Smallest detectable effects",
        "can distinguish",
    ):
        assert part in text
    for cause in found.causes:
        assert cause.title in text and shown(cause.parameters[0].value, 4) in text
    for gain in found.gains:
        assert gain.channel in text and shown(gain.rmse_after) in text
    assert found.provenance.fit[0] in text


def test_a_page_without_finding_shows_the_detectable_sizes(no_finding):
    assert no_finding.verdict is Verdict.NO_EFFECT
    text = text_of(render(no_finding))
    assert text.index("Smallest detectable effects") < text.index("How well the model predicts")
    assert "The cause" not in text


def test_the_page_loads_no_other_file(found):
    page = render(found)
    assert not re.search(r'(src|href)="(?!#|data:)', page) and "@import" not in page and "<script" not in page


def test_drawings_are_sound(found):
    drawings = re.findall(r"<svg class=\"plot\".*?</svg>", render(found), flags=re.DOTALL)
    assert len(drawings) >= 8
    for drawing in drawings:
        root = ElementTree.fromstring(drawing.replace("xlink:href", "href"))
        x, y, width, height = map(float, root.get("viewBox").split())
        assert (x, y) == (0, 0) and 100 < width < 800 and 50 < height < 1200
    ids = re.findall(r'\bid="([^"]+)"', " ".join(drawings))
    assert len(ids) == len(set(ids))


@pytest.mark.slow
@pytest.mark.slow
def test_words_of_the_drawings_are_plain_and_apart(found, browser):
    page = browser.new_page(viewport={"width": 1200, "height": 900})
    page.set_content(render(found))
    drawings = page.evaluate(LOOK)
    page.close()
    assert sum(bool(one["words"]) for one in drawings) > 5
    assert [fault for one in drawings for fault in faults(one)] == []


def test_the_same_finding_gives_the_same_bytes(found, tmp_path):
    one = write_report(found, tmp_path / "one.html").read_bytes()
    again = write_report(Finding.from_json(found.to_json()), tmp_path / "two.html").read_bytes()
    assert one == again


def test_every_verdict_has_a_headline_and_a_tone():
    assert set(HEADLINES) == set(TONES) == set(Verdict)


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (0.0, "0"),
        (1234.5, "1\u2009234"),
        (-0.012345, "\u22120.0123"),
        (9.996, "10.0"),
        (1.5e-7, "1.50·10⁻⁷"),
        (-2.5e12, "\u22122.50·10¹²"),
        (None, "–"),
        (np.nan, "–"),
    ],
)
def test_numbers_are_printed_to_three_digits(value, text):
    assert shown(value) == text


def test_sentences_are_typeset():
    assert prose("falls by -1.5e-07 bar") == "Falls by −1.5·10⁻⁷ bar"
    assert prose("left.force is off; AW-3 is not") == "left.force is off; AW-3 is not"
    text = "-9.9e+37 may be none (null = [-9.9e+37, 1e6] says so); columns.a.sign = -1 is right"
    assert typeset(text) == text.replace("-9.9e+37 may", "−9.9·10³⁷ may"), "TOML is copied from the page"


def test_value_and_error_of_a_fitted_number_end_with_the_same_digit(found):
    estimate = found.causes[0].parameters[0]
    value, error = pair(estimate.value, estimate.sd)
    assert len(value.partition(".")[2]) == len(error.partition(".")[2]) > 0
    told = re.search(r"([\d.]+) ± ([\d.]+) ", found.sentence)
    assert told and len(told[1].partition(".")[2]) == len(told[2].partition(".")[2])
    assert pair(None, 1.0) == ("–", "–")


@pytest.mark.slow
def test_no_bar_stands_on_a_logarithmic_scale(found):
    """A bar is a patch; except for background, axes and two spines there are none."""
    scores = re.search(r'<svg class="plot"(?:(?!</svg>).)*id="scores-.*?</svg>', render(found), re.DOTALL)[0]
    assert 'id="scores-patch_5"' not in scores and 'id="scores-line2d' in scores


def test_the_surface_of_a_speed_has_its_own_unit(force_surface):
    assert not any("asinh" in one for one in force_surface.coordinates)
    speeds = sorted({speed for _, speed in force_surface.centres})
    assert speeds[0] == -speeds[-1]
    assert np.arcsinh(speeds[-1] / UNIT_SPEED) == pytest.approx(REACH[1])


@pytest.mark.parametrize("digits", [2, 3])
def test_a_percentage_is_never_a_power_of_ten(digits: int) -> None:
    """Whatever its size: it is the number to its digits, or the bound below 0.01 %."""
    for power in range(-12, 5):
        for mantissa in (1.0, 1.14, 9.949, 9.96):
            part = mantissa * 10.0**power
            number, sign = estimates.percent(part, digits).removeprefix("less than ").split(" ")
            assert sign == "%" and "e" not in number
            assert float(number) == pytest.approx(max(100.0 * part, 0.01), rel=0.5 * 10.0 ** (1 - digits))
    assert estimates.percent(0.0) == "0 %"
