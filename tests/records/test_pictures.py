"""The words of all pictures that we write: no markup, nothing outside, nothing on other words."""

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bench_records.plots import panel, style, svg
from tests.pictures import LOOK, faults

DOCS = Path(__file__).parents[2] / "docs"
PICTURES = sorted(DOCS.rglob("*.svg"))


@pytest.fixture(scope="module")
def page(browser: Any) -> Iterator[Any]:
    page = browser.new_page(viewport={"width": 1400, "height": 1000})
    yield page
    page.close()


def _faults(page: Any) -> list[str]:
    drawings = page.evaluate(LOOK)
    assert any(one["words"] for one in drawings)
    return [f"{one['name']}: {fault}" for one in drawings for fault in faults(one)]


@pytest.mark.slow
def test_words_of_the_pictures_in_the_docs(page: Any) -> None:
    assert len(PICTURES) > 20
    found = []
    for one in PICTURES:
        page.goto(one.as_uri())
        found += [f"{one.name}: {fault}" for fault in _faults(page)]
    assert found == []


@pytest.mark.slow
def test_words_of_the_pictures_in_a_report(page: Any, passed_run: Path) -> None:
    from bench_records.report import write_report

    page.goto(write_report(passed_run).as_uri())
    assert _faults(page) == []


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        ('<text x="20" y="40">one</text><text x="60" y="40">two</text>', []),
        ('<text x="20" y="40">seven</text><text x="40" y="44">eight</text>', ["on each other: seven / eight"]),
        ('<text x="20" y="40">$\\mathdefault{1}$</text>', ["markup: $\\mathdefault{1}$"]),
        ('<text x="180" y="40">too long</text>', ["outside the picture: too long"]),
        ('<text x="0" y="0" transform="translate(2 50) rotate(-90)">turned</text>', ["outside the picture: turned"]),
        (
            '<g id="axes_1"><path d="M0 0H100V90H0Z" fill="none"/>'
            '<g id="legend_1"><text x="80" y="40">a key</text></g></g>',
            ["leaves its axes: a key"],
        ),
    ],
)  # fmt: skip
def test_faults_are_seen(page: Any, words: str, expected: list[str]) -> None:
    page.set_content(f'<svg width="200" height="90" font-size="14">{words}</svg>')
    assert [one for drawing in page.evaluate(LOOK) for one in faults(drawing)] == expected


@settings(max_examples=12, deadline=None)
@given(
    scale=st.sampled_from(["log", "symlog", "linear"]),
    low=st.floats(1e-6, 1e5),
    span=st.floats(1.5, 1e6),
)
def test_ticks_of_any_scale_are_plain_numbers(scale: str, low: float, span: float) -> None:
    with style():
        figure, axes = panel(2.0)
        axes.plot([low, low * span], [-low, low * span])
        axes.set_xscale("log")
        axes.set_yscale(scale)
        text = svg(figure, "name")
    told = [re.sub("<[^>]*>", "", one) for one in re.findall(r"<text.*?</text>", text, re.DOTALL)]
    for one in filter(None, (one.strip() for one in told)):
        assert np.isfinite(float(one.replace("\u2212", "-").replace("\u2009", ""))), one
