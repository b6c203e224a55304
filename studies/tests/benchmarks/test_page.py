"""The page of benchmarks: new results replace old ones, and the other results stay."""

from pathlib import Path

import pytest

from astb_studies.benchmarks import page
from astb_studies.benchmarks.measure import BenchmarkRow, Section, Spread


def section(title: str, figure: float) -> Section:
    return Section(title, [BenchmarkRow("one step", "s", Spread.of([figure]))], ["What one must know."])


def test_a_section_that_is_measured_anew_replaces_its_old_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(page, "PAGE", tmp_path / "benchmarks.md")
    page.write_page([section("A step", 1e-6), section("A tick", 2e-6)], {"date": "yesterday"})
    before = page.PAGE.read_text(encoding="utf-8")
    page.write_page([section("A step", 3e-6), section("A trip", 4e-6)], {"date": "today"})
    text = page.PAGE.read_text(encoding="utf-8")
    step, tick, trip = text.split("\n## ")[1:]
    assert step.startswith("A step\n\n*today*\n\n|") and "3 µs" in step and "1 µs" not in text
    assert tick.strip() == before.split("\n## ")[2].strip() and "*yesterday*" in tick
    assert trip.startswith("A trip") and trip.endswith("What one must know.\n")
    page.write_page([], {})
    assert page.PAGE.read_text(encoding="utf-8") == text


def test_the_page_in_the_documentation_is_as_it_would_be_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    text = page.PAGE.read_text(encoding="utf-8")
    monkeypatch.setattr(page, "PAGE", tmp_path / "benchmarks.md")
    page.PAGE.write_text(text, encoding="utf-8")
    page.write_page([], {})
    assert page.PAGE.read_text(encoding="utf-8") == text
