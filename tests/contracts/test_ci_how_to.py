"""The examples for CI servers: their syntax is valid, their options exist, and they find the files of a run."""

import re
import shlex
from pathlib import Path

import click
import pytest

from astb.cli import commands
from bench_records.layout import JUNIT
from test_plans.discovery import plans

PAGE = (Path(__file__).parents[2] / "docs/how-to/run-on-a-ci-server.md").read_text(encoding="utf-8")
RUNS = re.findall(r"astb run (?!…)[^\n']+", PAGE)


def test_there_is_an_example_for_each_server():
    assert len(RUNS) == 3


@pytest.mark.parametrize("line", RUNS)
def test_a_command_has_options_and_plans_that_exist(line):
    command = commands.get_command(click.Context(commands), "run")
    words = shlex.split(line)[2:]
    values, names, _ = command.make_parser(click.Context(command)).parse_args(words)
    assert set(values["plans"]) <= set(plans()) and values["out"] == "runs", names


def test_the_patterns_find_the_results():
    patterns = re.findall(r"runs/\*/[\w.]+", PAGE)
    assert len(patterns) == 3
    assert all(Path("runs/aw0", JUNIT).match(one) for one in patterns)


def test_yaml_examples_are_valid():
    yaml = pytest.importorskip("yaml")
    blocks = re.findall(r"```yaml\n(.*?)```", PAGE, flags=re.DOTALL)
    gitlab, github = map(yaml.safe_load, blocks)
    assert gitlab["springs"]["artifacts"]["reports"]["junit"] == f"runs/*/{JUNIT}"
    assert [step for step in github["jobs"]["springs"]["steps"] if step.get("if") == "always()"]
