"""Threads of a diagnosis, and those of the linear algebra used with it."""

from threadpoolctl import threadpool_info, threadpool_limits

from diagnosis.engine.config import Config
from diagnosis.engine.diagnose import diagnose


def algebra():
    """How many threads each library of linear algebra uses now."""
    return {one["num_threads"] for one in threadpool_info() if one["user_api"] == "blas"}


def test_while_a_diagnosis_lasts_the_algebra_keeps_to_one_core(laboratory, oscillator):
    lab = laboratory(oscillator())
    seen = []
    with threadpool_limits(limits=2, user_api="blas"):
        diagnose(
            lab.measure(3),
            lab.simulator,
            Config(seed=1, effects=()),
            lambda _text, _part: seen.append(algebra()),
        )
        assert algebra() == {2}
    assert seen
    assert all(threads == {1} for threads in seen)
