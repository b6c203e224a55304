"""Scales and lines of a drawing: what is written agrees with the values, and nothing is left out of sight."""

import math
import re

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bench_records.sheet import ACROSS, FINE, UP, Look, Margins, Sheet, _path, _ticks, scale_range

WHOLE = st.integers(-40, 40)
FINITE = st.floats(allow_nan=True, allow_infinity=True)


@given(low=st.floats(-1e9, 1e9), span=st.floats(1e-9, 1e9), most=st.sampled_from([ACROSS, UP]))
def test_numbers_of_a_scale_are_even_within_it_and_state_its_values(
    low: float, span: float, most: int
) -> None:
    low, high = scale_range([np.array([low, low + span])], 0.08)
    places, factor = _ticks(low, high, most)
    values = np.array([value for value, _ in places])
    texts = np.array([float(text.replace("\u2212", "-")) for _, text in places])
    assert 2 <= values.size <= most + 1
    assert low - 1e-6 * (high - low) <= values.min() and values.max() <= high + 1e-6 * (high - low)
    step = np.diff(values).mean()
    assert np.diff(values) == pytest.approx(step, rel=1e-3)
    assert float(f"{step / 10 ** math.floor(math.log10(step)):.4g}") in {1.0, 2.0, 2.5, 5.0, 10.0}
    times = float(factor.replace("\u2212", "-") or 1)
    assert texts * times == pytest.approx(values, abs=1e-3 * step)


@given(st.lists(FINITE, max_size=30), st.floats(0.0, 0.2))
def test_a_scale_has_room_for_every_finite_value(values: list[float], margin: float) -> None:
    low, high = scale_range([np.array(values)], margin)
    assert low < high
    known = [one for one in values if abs(one) < 1e300]
    assert all(low <= one <= high for one in known)
    assert len(_ticks(low, high, UP)[0]) >= 2


def corners(path: str) -> list[list[tuple[int, int]]]:
    """The corners of the lines of a path."""
    lines = []
    for start, steps in re.findall(r"M(-?\d+ -?\d+)l([-\d ]+)", path):
        moves = [int(one) for one in re.findall(r"-?\d+", steps)]
        first = np.array([int(one) for one in start.split()])
        lines.append(
            [tuple(one) for one in np.vstack((first, first + np.cumsum(np.reshape(moves, (-1, 2)), axis=0)))]
        )
    return lines


@given(st.lists(st.lists(st.tuples(WHOLE, WHOLE), min_size=1, max_size=25), min_size=1, max_size=4))
def test_a_path_passes_through_all_points_and_breaks_at_gaps(pieces: list[list[tuple[int, int]]]) -> None:
    gap = (np.nan, 0.0)
    path = _path(np.array([point for piece in pieces for point in (*piece, gap)]))
    moving = [piece for piece in pieces if len(set(piece)) > 1]
    found = corners(path)
    assert len(found) == len(moving) == path.count("M")
    for piece, line in zip(moving, found, strict=True):
        assert (line[0], line[-1]) == (piece[0], piece[-1])
        length = lambda points: sum(map(math.dist, points[:-1], points[1:]))  # noqa: E731
        # Leaving out a corner would shorten the line.
        assert length(line) == pytest.approx(length(piece))


def test_only_values_on_the_scale_are_drawn_at_its_positions() -> None:
    paper = Sheet(Margins(1.0), (0.0, 10.0), (-1.0, 1.0))
    paper.line([-1.0, 0.0, 10.0, 11.0], [0.0, -1.0, 1.0, 0.0], Look("#000", 1.0))
    (line,) = corners(paper.drawn("one"))
    ends = [(paper.left, paper.bottom), (paper.right, paper.top)]
    assert line == [(round(FINE * x), round(FINE * y)) for x, y in ends]


def test_a_logarithmic_scale_has_equal_lengths_for_equal_ratios() -> None:
    paper = Sheet(
        Margins(1.0),
        scale_range([np.array([0.5, 8.0])], 0.05, logarithmic=True),
        (0.0, 1.0),
        logarithmic=True,
    )
    places = paper.x(np.array([0.5, 1.0, 2.0, 4.0, 8.0]))
    assert np.diff(places) == pytest.approx(np.diff(places).mean())
    assert places[0] - paper.left == pytest.approx(0.05 * (places[-1] - places[0]))
