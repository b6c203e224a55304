"""The pace of a twin: half of a processor at most and seldom behind, whatever looks and searches cost."""

from itertools import pairwise

from hypothesis import given
from hypothesis import strategies as st

from diagnosis.twin.pace import BEHIND, EVERY, Pace
from diagnosis.twin.slices import Sliced, finished

#: What a look costs, what it costs until a search can be interrupted, and by how many times longer the clock shows it.
LOOKS = st.lists(
    st.tuples(st.floats(0.001, 5.0), st.floats(0.0, 0.5), st.floats(1.0, 4.0), st.booleans()),
    min_size=2,
    max_size=30,
)


def paced(looks):
    """Watch with looks of such costs; yield start and end of each, the data used by then, and the searches."""
    now, used = 0.0, 0.0
    pace = Pace(lambda: now, lambda: used)
    for look, late, slower, searches in looks:
        pace.begin()
        began = now, used
        now, used = now + slower * look, used + look
        ended, slice_ = now, 0.0
        if searches:
            slice_ = pace.searching() + late
            now, used = now + slower * slice_, used + slice_
        yield *began, ended, slice_
        now = max(now, pace.next())


@given(LOOKS)
def test_the_twin_uses_at_most_half_a_processor(looks):
    made = list(paced(looks))
    for k, (began, used, _ended, _searched) in enumerate(made):
        for later, by_then, *_rest in made[k + 1 :]:
            assert by_then - used <= 0.5 * (later - began) + 1e-9


@given(
    st.lists(st.tuples(st.floats(0.001, BEHIND / 3.5), st.just(0.3), st.just(1.0), st.booleans()), min_size=2)
)
def test_it_is_two_seconds_behind_at_most_if_looks_are_short(looks):
    """A search is interrupted 0.3 s too late; a look costs what the one before has."""
    same = [(looks[0][0], *rest) for _, *rest in looks]
    for (began, *_), (_, _, ended, _) in pairwise(paced(same)):
        assert ended - began <= max(2.0, EVERY + same[0][0]) + 1e-9


@given(LOOKS)
def test_a_search_goes_on_however_long_a_look_takes(looks):
    for (look, late, _, searches), (*_, searched) in zip(looks, paced(looks), strict=True):
        assert not searches or searched - late >= 0.2 * look


def counting(used, cost, steps):
    for _ in range(steps):
        used[0] += cost
        yield
    return steps


@given(st.floats(0.01, 0.5), st.integers(1, 50), st.floats(0.0, 2.0))
def test_sliced_work_gives_the_same_result_within_its_time(cost, steps, seconds):
    used = [0.0]
    work, found = Sliced(counting(used, cost, steps), lambda: used[0]), None
    while found is None:
        before = used[0]
        found = work.go_on(seconds)
        assert used[0] - before < seconds + cost + 1e-9
    assert found == finished(counting([0.0], cost, steps)) == steps
