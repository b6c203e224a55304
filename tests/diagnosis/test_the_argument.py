"""The page about the diagnosis names the files of each step, and every file of the engine is in one step."""

import re
from pathlib import Path

import diagnosis.engine
from diagnosis.engine import config

ENGINE = Path(diagnosis.engine.__file__).parent
PAGE = Path(__file__).parents[2] / "docs" / "explanation" / "how-the-diagnosis-works.md"
STEPS = dict(
    re.findall(
        r"^## (\d)\. [^\n]+\n\n\*(In .+?)\*\n\n",
        PAGE.read_text(encoding="utf-8"),
        flags=re.MULTILINE | re.DOTALL,
    )
)

#: What several steps use.
SHARED = {
    "__init__.py",
    "columns.py",
    "config.py",
    "contract_check.py",
    "diagnose.py",
    "identify.py",
    "kernels.py",
    "memory.py",
    "p_values.py",
    "runs.py",
    "search_state.py",
    "simulation.py",
    "summary.py",
    "threads.py",
    "wording.py",
}


def test_every_step_of_the_page_names_its_files():
    assert list(STEPS) == list("123456789")
    for files in STEPS.values():
        for name in re.findall(r"`([\w/]+\.py|\w+/)`", files):
            assert (ENGINE / name).exists(), name


def test_every_file_of_the_engine_is_a_step_or_serves_several():
    named = [name for files in STEPS.values() for name in re.findall(r"`([\w/]+\.py)`", files)]
    assert len(named) == len(set(named)), "one file, one step"
    files = {path.name for path in ENGINE.glob("*.py")}
    assert files - set(named) == SHARED


def test_all_thresholds_are_in_the_config():
    assert sum(name.isupper() for name in vars(config)) > 60
    elsewhere = [
        (path.name, line)
        for path in ENGINE.rglob("*.py")
        if path.name != "config.py"
        for line in path.read_text(encoding="utf-8").splitlines()
        if re.match(r"[A-Z_0-9]+(: Final)? = -?[\d.]", line)
    ]
    assert not elsewhere
