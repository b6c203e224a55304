"""The last minute of readings with their model: blocks of segments joined, and their display on a terminal."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from rich.console import Console

from astb.watch.screen import comparison_table
from bench_records.twin import Compared, LastMinute, TwinStory
from diagnosis.contracts import Channel
from diagnosis.twin.innovations import BLOCK, Estimate, Innovations
from diagnosis.twin.last_minute import joined

CHANNELS = (Channel("left.bellows_pressure", "Pa"), Channel("load_cell.1", "N"))


def blocks(values: list[float]) -> Innovations:
    """Innovations whose first channel read ``values``, NaN where nothing; the second one the same, negated."""
    measured = np.outer(values, (1.0, -1.0))
    nothing = Estimate(np.empty(0), np.empty((0, 0)))
    return Innovations(measured, measured + 1.0, 0.0 * measured + 2.0, np.empty((0, 0, 0)), nothing)


@given(
    stretches=st.lists(
        st.tuples(
            st.integers(0, 300), st.lists(st.just(np.nan) | st.integers(1, 9**5), min_size=1, max_size=150)
        ),
        min_size=1,
        max_size=5,
    )
)
def test_segments_are_joined_and_readings_keep_their_column(stretches):
    minute, read, start = None, {}, 0.0
    for pause, values in stretches:
        start = round(start + 0.1 * pause, 3)
        minute = joined(minute, start, CHANNELS, blocks([float(one) for one in values]))
        read |= {round(start + BLOCK * (k + 0.5), 3): one for k, one in enumerate(values) if np.isfinite(one)}
        start += BLOCK * len(values)
    if minute is None:
        assert not read
        return
    assert np.all(np.diff(minute.times) > 0.0)
    one, two = minute.channels
    kept = {time: value for time, value in zip(minute.times, one.measured, strict=True) if value is not None}
    assert kept == {time: value for time, value in read.items() if time > max(read) - 60.0 + 0.5 * BLOCK}
    assert [None if value is None else -value for value in one.measured] == list(two.measured)
    assert all(
        (a is None) == (b is None) == (c is None)
        for a, b, c in zip(one.measured, one.expected, one.band, strict=True)
    )


def test_a_terminal_shows_what_is_beyond_its_band_and_what_was_not_received():
    minute = LastMinute(
        (87.25, 87.75),
        (
            Compared("left.bellows_pressure", (2.01e5, 2.14e5), (2.01e5, 2.2e5), (900.0, 900.0)),
            Compared("load_cell.1", (3e4, None), (3e4, None), (100.0, None)),
            Compared("load_cell.2", (3e4, 2.495e4), (3e4, 2.49e4), (100.0, 110.0)),
        ),
    )
    console = Console(width=100, record=True, force_terminal=True)
    console.print(comparison_table(minute, TwinStory("astb", 88.0, last_minute=minute)))
    text = console.export_text(clear=False).splitlines()
    assert "agrees" in text[0] and "around 87.8 s" in text[0]
    pressure, lost, cell = (line.split() for line in text if line.lstrip().startswith(("left", "load")))
    assert pressure == ["left.bellows_pressure", "bar", "2.140", "2.200", "0.009", "-6.7"]
    assert lost == ["load_cell.1", "kN", "not", "received"]
    assert cell[-1] == "+0.5"
    red = [line for line in console.export_text(styles=True).splitlines() if "\x1b[1;31m" in line]
    assert len(red) == 1 and "left.bellows_pressure" in red[0]
