"""Runs that are killed by SIGKILL on real wires, in each part of a run: at most one second is lost."""

import random

import pytest

from astb_studies.benchmarks.killed_runs import ALLOWED, MOMENTS, killer


@pytest.mark.slow
@pytest.mark.real_time
def test_a_killed_run_is_a_readable_record_wherever_it_was() -> None:
    draw = random.Random()
    with killer() as kills:
        found = [kills.kill(when, draw.uniform(*span)) for when, span in MOMENTS.items()]
    assert [one.wrong for one in found] == [[], [], []], found
    under_way = found[list(MOMENTS).index("under way")]
    assert under_way.listed == "interrupted"
    assert under_way.lost <= ALLOWED
