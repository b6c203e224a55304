"""Each function that the architecture page lists on the way of a pressure exists and is called in a run."""

import importlib
import re
from pathlib import Path

import pytest

from astb import run_plan

PAGE = Path(__file__).parents[2] / "docs" / "explanation" / "architecture.md"
STEP = re.compile(r"^\d+\. `([\w/]+)\.py: ([\w.]+)`([^.]*)", re.MULTILINE)


def test_each_function_of_the_list_is_called_in_a_run(tmp_path, monkeypatch: pytest.MonkeyPatch) -> None:
    text = PAGE.read_text(encoding="utf-8").partition("## The way of a pressure")[2].partition("\n## ")[0]
    steps = STEP.findall(text)
    assert len(steps) > 10
    called: dict[str, int] = {}

    def counted(name: str, function):
        def wrapper(*args, **kwargs):
            called[name] = called.get(name, 0) + 1
            return function(*args, **kwargs)

        return wrapper

    expected = set()
    for file, name, rest in steps:
        module = importlib.import_module(file.replace("/", "."))
        *owner, last = name.split(".")
        home = getattr(module, owner[0]) if owner else module
        function = getattr(home, last)
        if "(compiled)" in rest:
            assert hasattr(function, "py_func") or callable(function)
            continue
        expected.add(name)
        monkeypatch.setattr(home, last, counted(name, function))
    run_plan("leak_down", out=tmp_path)
    assert set(called) == expected
