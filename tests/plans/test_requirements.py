"""A check carries the requirement that it verifies to result, report, JUnit, trend and the table of requirements."""

import json
from pathlib import Path
from xml.etree import ElementTree as ET

import pytest
from click.testing import CliRunner
from msgspec.structs import replace

from astb.cli import commands
from bench_protocol.named_files import place_of
from bench_records.check_table import check_rows
from bench_records.index import RunIndex
from bench_records.junit import junit
from bench_records.kept_pages import trend_words
from bench_records.result import Result, check, conclude
from bench_records.trend import trend_of
from test_plans.check_names import CheckName
from test_plans.specimen import PACKAGE, SpecimenError, read_specimen

CLAUSE = "EN 13597 7.3"


@pytest.fixture
def result() -> Result:
    checks = [check(name, 1.0, "mm", 1e-3, low=0.0, high=2.0) for name in ("free", "bound")]
    return conclude("aw0", "Title", "Text", [checks[0], replace(checks[1], requirement=CLAUSE)], rig="local")


def specimen_file(folder: Path, requirements: str) -> Path:
    path = folder / "mine.toml"
    path.write_text(f"{place_of(PACKAGE, 'astb').read_text()}\n[requirements]\n{requirements}\n")
    return path


def test_the_file_of_the_specimen_has_priority_over_the_plan(tmp_path):
    specimen = read_specimen(specimen_file(tmp_path, f"\"left vertical K' at *\" = '{CLAUSE}'"))
    name = CheckName("{side} vertical K' at {f:g} Hz", "", requirement="R-1")
    assert specimen.requirement(name.of(side="left", f=2.0)) == CLAUSE
    assert specimen.requirement(name.of(side="right", f=2.0)) == "R-1"
    assert specimen.requirement("right height") == ""


def test_a_requirement_that_is_no_text_is_refused(tmp_path):
    with pytest.raises(SpecimenError, match=r"requirements\.air lost = 7 is not a text"):
        read_specimen(specimen_file(tmp_path, '"air lost" = 7'))


def test_result_junit_and_report_carry_it(result):
    assert Result.from_json(result.to_json()) == result
    free, bound = json.loads(result.to_json())["checks"]
    assert "requirement" not in free and bound["requirement"] == CLAUSE
    cases = {case.get("name"): case for case in ET.fromstring(junit(result)).iter("testcase")}
    assert [one.get("value") for one in cases["bound"].iter("property")] == [CLAUSE]
    assert not list(cases["free"].iter("property"))
    free_row, bound_row = check_rows(result.checks)
    assert CLAUSE in bound_row.detail and "requirement" not in free_row.detail


def test_trend_and_table_of_requirements_carry_it(result, tmp_path):
    for name in ("one", "two"):
        result.write(tmp_path / name)
    (first, last) = RunIndex(tmp_path).checks("bound")
    assert CLAUSE in " ".join(trend_words(trend_of("bound", [first, last])))
    told = CliRunner().invoke(commands, ["runs", "--out", str(tmp_path), "--requirements", "--json"])
    (row,) = json.loads(told.output)
    assert (row["requirement"], row["name"], row["run"]["directory"]) == (CLAUSE, "bound", "two")
    shown = CliRunner().invoke(commands, ["runs", "--out", str(tmp_path), "--requirements"]).output
    assert "1 requirements, 1 checks" in shown and CLAUSE in shown and "free" not in shown


@pytest.mark.slow
def test_a_run_takes_the_requirements_of_its_specimen(tmp_path):
    path = specimen_file(tmp_path, f"'air lost per minute, *' = '{CLAUSE}'")
    words = ["run", "leak_down", "--virtual", "--specimen", str(path), "--out", str(tmp_path / "runs")]
    assert CliRunner().invoke(commands, words).exit_code == 0
    found = RunIndex(tmp_path / "runs").checks()
    assert [one.requirement for one in found] == [CLAUSE] * 2
    assert {one.name for one in found} == {
        f"air lost per minute, {side} spring" for side in ("left", "right")
    }
