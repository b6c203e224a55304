"""Decoders take whatever strangers send: a slice of `make fuzz`, and every seed that was kept."""

import pytest

from tests.fuzz.decoders import BATCH, DECODERS
from tests.fuzz.mutator import Mutator, keep, seeds

SLICE = 4000


@pytest.mark.parametrize("make", DECODERS, ids=lambda make: make.name)
def test_kept_seeds(make) -> None:
    target = make()
    for data in target.valid():
        target.check([data])


@pytest.mark.parametrize("make", DECODERS, ids=lambda make: make.name)
def test_a_slice_of_the_fuzz(make) -> None:
    target = make()
    inputs = list(Mutator(target.valid(), 1, text=target.text).inputs(SLICE))
    for start in range(0, SLICE, BATCH):
        target.check(inputs[start : start + BATCH])


def test_the_mutator_repeats_itself_and_is_not_dull() -> None:
    first, second = (list(Mutator(seeds("socketcand"), 7, text=True).inputs(2000)) for _ in range(2))
    assert first == second
    assert len(set(first)) > 1500


def test_kept_seeds_are_read_back(tmp_path, monkeypatch) -> None:
    monkeypatch.setattr("tests.fuzz.mutator.SEEDS", tmp_path)
    found = [bytes(range(256)), b'it\'s "quoted"\\', b""]
    for data in found:
        keep("x", data)
    assert seeds("x") == found
