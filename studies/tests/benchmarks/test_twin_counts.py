"""Counts of twins are stored, and the page shows them."""

from astb_studies.benchmarks.twin.__main__ import all_counted
from astb_studies.benchmarks.twin.page import PAGE
from astb_studies.benchmarks.twin.tables import tables


def test_the_page_tells_what_was_counted():
    assert tables(all_counted()) in PAGE.read_text(encoding="utf-8")
