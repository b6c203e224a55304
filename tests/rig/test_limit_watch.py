"""The watch of the stories fails where a limit is broken for long enough, and nowhere else."""

from itertools import groupby

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bench_protocol.can_codec import Samples
from bench_protocol.table import TABLE
from bench_protocol.units import kN, mm
from tests.refusals import refuses
from tests.rig.way_down import PERSISTENCE, LimitWatch

#: Signals with values within their limits, in the allowance beyond, past it on either side, and none.
VALUES = {
    "left.height": (0.0, -135 * mm, 95 * mm, -139 * mm, 99 * mm, np.nan),
    "lateral.force": (0.0, -50 * kN, 50 * kN, -56 * kN, 56 * kN, np.nan),
    "supply.pressure": (0.0, 1e9, np.nan),  # has no span
}
WITHIN = 3  # of those are within the allowance


def stretch(*told: tuple[str, float]) -> Samples:
    """Return samples that come together."""
    signals = np.array([TABLE.index[name] for name, _ in told], np.int64)
    return Samples(np.zeros(len(told), np.int64), signals, np.array([value for _, value in told], float))


#: So many equal values of one signal: runs as long as the watch asks for would hardly be drawn one by one.
runs = st.sampled_from(sorted(VALUES)).flatmap(
    lambda name: st.tuples(st.just(name), st.sampled_from(VALUES[name]), st.integers(1, 70))
)


def broken(told: list[tuple[str, float]]) -> bool:
    """Whether a signal with a span lies past one of its ends for as long as it takes; no number is past both."""
    for name in ("left.height", "lateral.force"):
        low, high = VALUES[name][1:WITHIN]
        values = [value for signal, value in told if signal == name]
        for past in ([not value >= low for value in values], [not value <= high for value in values]):
            longest = max((len(list(run)) for beyond, run in groupby(past) if beyond), default=0)
            if longest >= PERSISTENCE[name.split(".")[1]]:
                return True
    return False


@given(st.lists(runs, max_size=8), st.lists(st.integers(1, 90), min_size=1, max_size=6))
def test_a_watch_fails_where_a_limit_is_broken_and_nowhere_else(drawn, lengths):
    told = [(name, value) for name, value, count in drawn for _ in range(count)]
    watch = LimitWatch()

    def look_at_all() -> None:
        at, turn = 0, 0
        while at < len(told):
            length = lengths[turn % len(lengths)]
            watch.look(stretch(*told[at : at + length]))
            at, turn = at + length, turn + 1

    if broken(told):
        with refuses(AssertionError, "beyond"):
            look_at_all()
    else:
        look_at_all()


@pytest.mark.parametrize(
    ("signal", "value", "samples"), [("left.height", 99 * mm, 4), ("lateral.force", -56 * kN, 60)]
)
def test_a_limit_takes_so_many_samples_in_a_row_one_by_one(signal, value, samples):
    watch = LimitWatch()
    for _ in range(samples - 1):
        watch.look(stretch((signal, value)))
    watch.look(stretch((signal, 0.0)))
    for _ in range(samples - 1):
        watch.look(stretch((signal, value)))
    with pytest.raises(AssertionError, match=signal):
        watch.look(stretch((signal, value)))
