"""A campaign file lists its cases, each of which can run; the page about it is correct."""

import contextlib
import io
import os
import re
import shlex
import subprocess
import sys
from pathlib import Path
from unittest.mock import Mock

import msgspec
import pandas as pd
import pytest
from click.testing import CliRunner
from rich.console import Console

from astb.api import run_plan
from astb.campaigns import plan_case
from astb.campaigns.campaign_file import CampaignError, read_campaign
from astb.campaigns.display import CampaignDisplay, cost, duration, verdicts
from astb.campaigns.kept import read_rows
from astb.campaigns.plan_case import PlanCase, run_plan_case
from astb.campaigns.run import Standing
from astb.cli import commands
from astb.exit_codes import BLOCKED
from tests.refusals import refuses

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs/how-to/run-a-campaign.md").read_text()


def block(language: str, number: int = 0) -> str:
    return re.findall(rf"```{language}\n(.*?)```", PAGE, re.DOTALL)[number]


def cases_of(tmp_path: Path, text: str) -> dict[str, PlanCase]:
    path = tmp_path / "campaign.toml"
    path.write_text(text)
    return read_campaign(path)


def test_the_file_of_the_page_is_as_many_cases_as_the_page_says(tmp_path):
    cases = cases_of(tmp_path, block("toml"))
    assert len(cases) == int(re.search(r"every seed: (\d+) cases", PAGE)[1])
    assert len({msgspec.json.encode(case) for case in cases.values()}) == len(cases)
    assert {case.values.get("load") for case in cases.values()} == {"AW0", "AW3", None}


def test_all_is_combined_with_all_and_a_variant_goes_over_a_change(tmp_path):
    text = """
    plans = ["leak_down"]
    seeds = [3, 5]
    change = { orifice_diameter = ["10 mm", "16 mm"], friction = "250 N" }
    variants = [{ name = "a" }, { name = "b", change = { orifice_diameter = "18 mm" } }]
    """.replace("friction", "friction_vertical")
    found = [
        (case.variant, case.simulation.change["orifice_diameter"], case.simulation.seed)
        for case in cases_of(tmp_path, text).values()
    ]
    assert found == [
        (name, width, seed)
        for name, widths in (("a", ("10 mm", "16 mm")), ("b", ("18 mm",)))
        for width in widths
        for seed in (3, 5)
    ]


def test_who_changes_a_specimens_file_has_another_case(tmp_path):
    specimen = tmp_path / "mine.toml"
    text = (ROOT / "astb" / "data" / "specimens" / "astb.toml").read_text()
    keys = []
    for serial in ("virtual", "virtual", "another"):
        specimen.write_text(text.replace('serial_number = "virtual"', f'serial_number = "{serial}"'))
        keys += cases_of(tmp_path, 'plans = ["leak_down"]\nspecimens = ["mine.toml"]')
    assert keys[0] == keys[1] != keys[2]


def test_parameters_are_in_the_folder_of_the_rig_file(tmp_path, monkeypatch):
    (tmp_path / "rigs").mkdir()
    (tmp_path / "rigs" / "mine.toml").write_text(
        'name = "mine"\n[simulation]\nparameters = "identified.toml"'
    )
    drawn = ROOT / "bench_sim/parameters/astb.toml"
    (tmp_path / "rigs" / "identified.toml").write_text(drawn.read_text())
    monkeypatch.chdir(ROOT)
    (case,) = cases_of(tmp_path, 'plans = ["leak_down"]\nrig = "rigs/mine.toml"').values()
    assert case.simulation.parameters == str(tmp_path / "rigs" / "identified.toml")


def test_a_rig_may_be_named(tmp_path):
    (case,) = cases_of(tmp_path, 'plans = ["leak_down"]\nrig = "local"').values()
    (without,) = cases_of(tmp_path, 'plans = ["leak_down"]').values()
    assert case.simulation == without.simulation
    with refuses(CampaignError, "'locl'"):
        cases_of(tmp_path, 'plans = ["leak_down"]\nrig = "locl"')


def test_the_cost_counts_the_cases_that_are_not_kept(tmp_path):
    cases = cases_of(tmp_path, 'plans = ["leak_down", "tightness"]\nseeds = 4\n')
    assert "8 cases: 0 have results, 8 will run; test time 14 min" in cost(
        cases, [], 2
    )  # 4 × 70 s and 4 × 140 s
    first, *others = [key for key, case in cases.items() if case.plan == "leak_down"]
    row = {"key": first, "plan": "leak_down", "error": "", "seconds": 7.0, "lasted": 70.0}
    # Three cases of 7 s, and four of a plan without rows at the same speed: 14 s each.
    assert (
        cost(cases, [row], 1)
        == "8 cases: 1 have results, 7 will run; test time 13 min, computing time about 77 s"
    )
    assert cost(cases, [row], 7).endswith("computing time about 11 s on 7 processes")
    bad = row | {"key": others[0], "error": "it crashed"}
    assert cost(cases, [row, bad], 1).startswith("8 cases: 2 have results, 6 will run")
    assert cost(cases, [row, bad], 1, again=True) == cost(cases, [row], 1)


def test_an_interrupted_campaign_prints_the_command_that_continues_it(tmp_path, monkeypatch):
    monkeypatch.setattr("astb.campaigns.cli.run_plan_cases", Mock(side_effect=KeyboardInterrupt))
    (tmp_path / "my runs.toml").write_text('plans = ["leak_down"]\n')
    words = ["campaign", str(tmp_path / "my runs.toml"), "--out", str(tmp_path / "out"), "--workers", "1"]
    stopped = CliRunner().invoke(commands, [*words, "--again"])
    assert stopped.exit_code == BLOCKED
    assert shlex.split(stopped.output.partition("Continue with: astb ")[2]) == words


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("seeds = 3", "the key plans is missing"),
        ('plans = ["leakdown"]', "there is no plan 'leakdown'; did you mean 'leak_down'"),
        ('plans = ["leak_down"]\nspecimen = "x"', "specimen is not a key here; did you mean 'specimens'"),
        ('plans = ["leak_down"]\nseeds = 0', "seeds = 0; use a whole number >= 1"),
        ('plans = ["leak_down"]\n[values]\nload = "AW9"', "leak_down has no parameter load"),
        (
            'plans = ["axial_stiffness"]\n[values]\nload = "AW9"',
            "load = 'AW9' is unknown; use one of AW0, AW3",
        ),
        (
            'plans = ["leak_down"]\n[values.aw0]\nx = 1',
            "values.aw0 is for a plan that is not in plans",
        ),
        ('plans = ["leak_down"]\n[change]\norifice_diameter = "1 kg"', "orifice_diameter = '1 kg'"),
        ('plans = ["leak_down"]\nvariants = [{ name = "x", faults = [{ name = "leek" }] }]', "leek"),
        ('plans = ["leak_down"]\nspecimens = ["none.toml"]', "none.toml"),
        ('plans = ["leak_down"]\nrig = "real.toml"', "is a real rig"),
        ('plans = ["leak_down"', "is not TOML"),
    ],
)
def test_what_cannot_be_is_refused_before_anything_runs(tmp_path, text, said):
    (tmp_path / "real.toml").write_text('name = "hall"')
    with pytest.raises(CampaignError, match=re.escape(said)) as refused:
        cases_of(tmp_path, text)
    assert "campaign.toml" in str(refused.value)


def test_through_a_pipe_there_are_plain_lines_now_and_then():
    said = io.StringIO()
    failed = {"key": "k", "error": "ValueError: no"}
    fine = {"key": "k", "error": ""}
    with CampaignDisplay(Console(file=said, width=80)) as display:
        for done, elapsed, row in (
            (0, 0.0, {}),
            (1, 2.0, failed),
            (2, 11.0, fine),
            (3, 12.0, fine),
            (6, 13.0, fine),
        ):
            display(Standing(10, 4, done, 1 if done else 0, elapsed, row))
    assert said.getvalue().splitlines() == [
        "4 of 10 cases have results from earlier",
        "k: ValueError: no",
        "6 of 10 cases, 1 failed, 22 s left",
        "10 of 10 cases, 1 failed",
    ]


@pytest.mark.parametrize(
    ("seconds", "said"), [(3.4, "3 s"), (100, "2 min"), (5000, "83 min"), (9000, "2.5 h")]
)
def test_a_duration_is_rounded(seconds, said):
    assert duration(seconds) == said


def test_verdicts_are_counted_by_plan_and_variant():
    said = io.StringIO()
    rows = [{"plan": "p", "variant": "v", "verdict": verdict} for verdict in ("pass", "fail", "pass", None)]
    Console(file=said, width=80).print(verdicts(rows))
    assert said.getvalue().split() == ["plan", "case", "error", "fail", "pass", "p", "v", "1", "1", "2"]


def test_where_every_case_failed_no_row_has_a_verdict():
    said = io.StringIO()
    Console(file=said, width=80).print(verdicts([{"plan": "p", "variant": "v", "error": "no"}]))
    assert said.getvalue().split() == ["plan", "case", "error", "p", "v", "1"]


def test_a_killed_attempt_does_not_block_the_next(tmp_path, monkeypatch):
    used = []
    monkeypatch.setattr(plan_case, "_row", lambda result: {})
    monkeypatch.setattr(plan_case, "_run", lambda case, directory: used.append(directory))
    case = PlanCase(plan="leak_down")
    run_plan_case(case, str(tmp_path))
    (used[0] / "stream.arrow").write_bytes(b"half of it")
    run_plan_case(case, str(tmp_path))
    assert used[0] != used[1]
    assert not any(used[1].iterdir())


@pytest.mark.slow
def test_a_case_gives_what_the_plan_gives(tmp_path):
    result, _ = run_plan("leak_down", out=tmp_path, seed=4, report=False)
    case = PlanCase(
        plan="leak_down", simulation=msgspec.convert({"seed": 4}, PlanCase.__annotations__["simulation"])
    )
    row = run_plan_case(case, str(tmp_path / "records"))
    assert (row["verdict"], row["reason"]) == (str(result.verdict), "")
    for told, check in zip(row["checks"], result.checks, strict=True):
        assert told | {"parts": check.parts} == msgspec.to_builtins(check)
    assert len(list((tmp_path / "records").rglob("result.json"))) == 1


@pytest.mark.slow
def test_the_command_keeps_what_pandas_reads_as_the_page_says(tmp_path):
    (tmp_path / "orifices.toml").write_text(
        'plans = ["leak_down"]\n[[variants]]\nname = "as drawn"\n'
        '[[variants]]\nname = "leak"\neffects = { "leak.left" = "0.2 mm2" }\n'
    )
    command = [str(Path(sys.executable).with_name("astb")), "campaign", "orifices.toml", "--workers", "1"]
    said = subprocess.run(
        command, cwd=tmp_path, capture_output=True, text=True, timeout=110, check=True
    ).stdout
    assert "2 of 2 cases" in said and "rows: runs/orifices" in said
    again = subprocess.run(
        command, cwd=tmp_path, capture_output=True, text=True, timeout=110, check=True
    ).stdout
    assert again.startswith("2 of 2 cases have results from earlier")
    assert {row["variant"]: row["verdict"] for row in read_rows(tmp_path / "runs/orifices")} == {
        "as drawn": "pass",
        "leak": "fail",
    }
    printed = io.StringIO()
    with contextlib.chdir(tmp_path), contextlib.redirect_stdout(printed):
        exec(block("python"), {})
    assert "air lost per minute, left spring" in printed.getvalue()


@pytest.mark.slow
def test_the_program_of_the_page_runs(tmp_path):
    script = tmp_path / "dice.py"
    script.write_text(block("python", 1))
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    command = [sys.executable, str(script)]
    said = subprocess.run(
        command, cwd=tmp_path, env=environment, capture_output=True, text=True, timeout=110, check=True
    )
    assert said.stdout.startswith("20 rows, the first: 3.")
    assert len(pd.read_parquet(tmp_path / "runs/dice")) == 20
