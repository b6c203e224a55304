"""Benchmarks are measured by hand: that they still fit the code they measure is seen here."""

import importlib

import pytest

from benchmarks.__main__ import NAMES


@pytest.mark.parametrize("name", NAMES)
def test_every_benchmark_can_be_started(name):
    assert callable(importlib.import_module(f"benchmarks.{name}").run)
