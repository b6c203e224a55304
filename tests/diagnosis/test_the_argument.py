"""The page of the argument and the engine agree: each step is a file that says so, and the page names it."""

import re
from pathlib import Path

import pytest

import diagnosis.engine
from diagnosis.engine import config

ENGINE = Path(diagnosis.engine.__file__).parent
PAGE = Path(__file__).parents[2] / "docs" / "explanation" / "how-the-diagnosis-reasons.md"
STEPS = dict(
    re.findall(r"^## (\d)\. [^\n]+\n\n\*(In [^\n]+)\*\n", PAGE.read_text(encoding="utf-8"), flags=re.M)
)


def steps_of_files():
    """Return the step that each file of the engine names first, by its path below the engine."""
    found = {}
    for path in sorted(ENGINE.rglob("*.py")):
        first = path.read_text(encoding="utf-8").partition("\n")[0]
        if step := re.match(
            r'"""(?:With the verdict \()?(?:After an ambiguous verdict \()?[Ss]tep (\d)', first
        ):
            found[path.relative_to(ENGINE).as_posix()] = step[1]
    return found


def test_every_step_of_the_page_names_its_files():
    assert list(STEPS) == list("123456789")
    for files in STEPS.values():
        for name in re.findall(r"`([\w/]+\.py|\w+/)`", files):
            assert (ENGINE / name).exists(), name


@pytest.mark.parametrize(("path", "step"), steps_of_files().items())
def test_every_file_that_is_a_step_is_named_by_the_page(path, step):
    if path not in {"search_state.py", "residual/__init__.py"}:  # what the others hand to each other; a room
        assert f"`{path}`" in STEPS[step]


def test_every_level_stands_beside_the_config_with_its_reason():
    lines = Path(config.__file__).read_text(encoding="utf-8").splitlines()
    levels = [i for i, line in enumerate(lines) if re.match(r"[A-Z_0-9]+: Final = ", line)]
    assert len(levels) > 60
    assert all(lines[i - 1].startswith("#: ") for i in levels)
    elsewhere = [
        (path.name, line)
        for path in ENGINE.rglob("*.py")
        if path.name != "config.py"
        for line in path.read_text(encoding="utf-8").splitlines()
        if re.match(r"[A-Z_0-9]+(: Final)? = -?[\d.]", line)
    ]
    assert not elsewhere
