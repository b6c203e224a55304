"""The end of a campaign: which kind of case failed which check, on a page, in Excel, on the terminal."""

import io
import re
from typing import Any

import msgspec
import pandas as pd
import pytest
from rich.console import Console

from astb.campaigns.display import failed_checks, verdicts
from astb.campaigns.findings import distributions, failures_first, verdict_of
from astb.campaigns.page import write_page, write_workbook
from astb.campaigns.plan_case import PlanCase
from bench_records.result import check

EVIL = '=HYPERLINK("http://x")<script>'


def row(load: str, seed: int, value: float, variant: str = "as drawn") -> dict[str, Any]:
    one = check("K' at 1 Hz", value * 1e3, "kN/m", 1e3, low=90e3, high=110e3, u=1e3)
    other = check("zero", 0.0, "N", high=1.0)
    return {
        "key": f"{load}{seed}", "plan": "stiff", "values": {"load": load, "plate": None}, "variant": variant,
        "specimen": "astb", "seed": seed, "change": {}, "verdict": "fail" if value > 110 else "pass", "reason": "",
        "error": "", "checks": [msgspec.to_builtins(each) for each in (one, other)],
    }  # fmt: skip


ROWS = [
    *(row("AW0", seed, 100.0 + seed) for seed in range(3)),
    *(row("AW3", seed, 109.0 + seed) for seed in range(4)),
    {"key": "x", "plan": "stiff", "values": {}, "variant": EVIL, "seed": 7, "error": "ValueError: no"},
]


def printed(table: Any) -> str:
    text = io.StringIO()
    Console(file=text, width=160).print(table)
    return text.getvalue()


def test_keys_and_kinds_distinguish_the_loads() -> None:
    keys = {PlanCase(plan="stiff", values={"load": load}).key.rpartition("/")[0] for load in ("AW0", "AW3")}
    assert keys == {"stiff/load=AW0/seed 0", "stiff/load=AW3/seed 0"}
    strange = PlanCase(plan="stiff", values={"file": "../a b/c"}).key
    assert strange.count("/") == 3 and ".." not in strange.replace("..ab", "")


def test_each_load_has_a_distribution_of_its_own_and_what_fails_comes_first() -> None:
    found = distributions(ROWS)
    first = found[0]
    assert (first.kind.values, first.check, first.failed, first.cases) == ("load=AW3", "K' at 1 Hz", 2, 4)
    assert (first.values, first.low, first.high) == ([109.0, 110.0, 111.0, 112.0], 90.0, 110.0)
    assert (first.mean, first.scatter) == (110.5, pytest.approx(1.2909944))
    assert next(one.values for one in found if one.kind.values == "load=AW0") == [100.0, 101.0, 102.0]
    order = [verdict_of(one) for one in failures_first(ROWS)]
    assert order == ["fail"] * 2 + ["error"] + ["pass"] * 5


def test_the_terminal_says_which_check_failed() -> None:
    assert re.search(r"stiff +load=AW3, as drawn +2 +2", printed(verdicts(ROWS)))
    assert re.search(r"K' at 1 Hz +2 of 4 +stiff +load=AW3, as drawn", printed(failed_checks(ROWS)))
    assert failed_checks(ROWS[:3]) is None


def test_the_page_shows_cases_by_checks_with_failures_first(tmp_path) -> None:
    write_page(ROWS, tmp_path / "page.html", "plates")
    page = (tmp_path / "page.html").read_text(encoding="utf-8")
    assert re.findall(r'<td class="verdict (\w+)">', page) == ["fail"] * 2 + ["error"] + ["pass"] * 5
    assert page.count('class="cell fail"') == 2 and page.count('class="cell marginal"') == 2
    assert "<script>" not in page and "ValueError: no" in page
    (failed,) = re.findall(r'<tr class="fail">.*?2 of 4.*?</tr>', page)
    assert failed.count("#a8201a") == 2 and failed.count("#00694e") == 2, "a stroke for each value"


def test_excel_has_the_same_and_no_text_becomes_a_formula(tmp_path) -> None:
    pytest.importorskip("xlsxwriter")
    pytest.importorskip("openpyxl")
    write_workbook(ROWS, tmp_path / "table.xlsx")
    book = pd.read_excel(tmp_path / "table.xlsx", sheet_name=None)
    cases = book["1 stiff"]
    assert list(cases["verdict"]) == ["fail"] * 2 + ["error"] + ["pass"] * 5
    assert list(cases["K' at 1 Hz, kN/m"].dropna())[:2] == [111.0, 112.0]
    assert EVIL in set(cases["variant"])
    spreads = book["distributions"]
    assert spreads.loc[0, ["values", "check", "mean", "failed", "cases"]].tolist() == [
        "load=AW3", "K' at 1 Hz", 110.5, 2, 4,
    ]  # fmt: skip


@pytest.mark.slow
def test_the_page_fits_a_telephone(browser: Any, tmp_path) -> None:
    write_page(ROWS, tmp_path / "page.html", "plates")
    for width in (390, 820, 1400):
        page = browser.new_page(viewport={"width": width, "height": 900})
        page.goto((tmp_path / "page.html").as_uri())
        assert page.evaluate("document.documentElement.scrollWidth") == width
        page.close()
