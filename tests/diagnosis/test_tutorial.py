"""The tutorial of the hidden effect shows its files, types commands that exist, and counts the candidates rightly."""

import importlib.util
import json
import re
import subprocess
import sys
from pathlib import Path

import click
import pytest

from astb.cli import commands
from bench_sim.model.effects import CATALOGUE
from bench_sim.parameters import load
from bench_sim.parameters.model_file import load_effects
from diagnosis.systems.air_spring.simulator import AirSpring

ROOT = Path(__file__).parents[2]
SPEC = importlib.util.spec_from_file_location("tutorial", ROOT / "tools" / "tutorial_hidden_effect.py")
tutorial = importlib.util.module_from_spec(SPEC)
SPEC.loader.exec_module(tutorial)
PAGE = tutorial.PAGE.read_text()


def test_every_file_that_is_used_is_shown_and_can_be_read(tmp_path):
    used = {word for command in tutorial.commands(PAGE) for word in command if word.endswith(".toml")}
    assert {name for name in used if not name.startswith("runs/")} == tutorial.files(PAGE).keys()
    for name, text in tutorial.files(PAGE).items():
        (tmp_path / name).write_text(text)
        assert load_effects(tmp_path / name)


@pytest.mark.parametrize("arguments", tutorial.commands(PAGE), ids=" ".join)
def test_every_command_can_be_typed(arguments):
    name, *rest = arguments
    command = commands.get_command(click.Context(commands), name)
    assert command is not None
    command.make_context(name, rest)


@pytest.mark.parametrize("pattern", [pattern for pattern, _ in tutorial.FIGURES])
def test_every_figure_has_its_place(pattern):
    assert len(re.findall(pattern, PAGE)) == 1


@pytest.mark.slow
def test_what_the_rig_loses_is_what_the_page_says(tmp_path):
    """Of the runs that the page types the quick ones; the tool that writes all figures carries out the rest, too."""
    for name, text in tutorial.files(PAGE).items():
        (tmp_path / name).write_text(text)
    for name, row in (("rig", r"\| the rig"), ("before", r"\| the model before")):
        (typed,) = (one for one in tutorial.commands(PAGE) if one[-1] == f"runs/{name}")
        command = [sys.executable, "-m", "astb", *typed]
        done = subprocess.run(command, cwd=tmp_path, capture_output=True, check=False)
        assert done.returncode in {0, 1}, done.stderr
        result = json.loads((tmp_path / tutorial.RESULTS[name]).read_text())
        ((pattern, of),) = (one for one in tutorial.FIGURES if one[0].startswith(row))
        (told,) = re.findall(pattern, PAGE)
        found = [number(one) for one in of({name: result})]
        assert [number(one) for one in told] == pytest.approx(found, abs=0.011)


def number(text: str) -> float:
    return float(text.replace("\u2212", "-"))


def test_the_page_counts_the_candidates_that_there_are():
    candidates = len(AirSpring(load(), effects=CATALOGUE).catalogue)
    assert set(re.findall(r"(\d+) candidates", PAGE)) == {str(candidates)}
