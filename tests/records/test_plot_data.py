"""The packed plots of a page equal the drawn ones, to a 65534th of the range, and each series only once."""

import base64
import json
import zlib

import numpy as np
from hypothesis import example, given
from hypothesis import strategies as st

from bench_records.plot_data import GAP, STEPS, Plot, PlotData, Trace


def unpacked(data: PlotData, place: list[float]) -> np.ndarray:
    """As the script reads it, from the description of the format alone."""
    steps = np.frombuffer(zlib.decompress(base64.b64decode(data.packed)), "<u2")
    start, count, low, high = place
    part = steps[int(start) : int(start + count)]
    return np.where(part == GAP, np.nan, low + part / STEPS * (high - low))


@example([0.0, 2.2250738585072014e-308], 1)
@example([0.0, 5e-324], 1)
@example([0.0, 4.7e-319, 1e-318], 1)
@given(
    st.lists(st.floats(-1e9, 1e9) | st.just(float("nan")), max_size=50),
    st.integers(1, 4),
)
def test_numbers_come_back(values: list[float], copies: int) -> None:
    ys = np.array(values)
    xs = np.arange(ys.size, dtype=float)
    data = PlotData()
    for _ in range(copies):
        data.add(Plot("time", "t", "s", "m", [Trace("a", "#000", (), xs, ys)]))
    (trace,) = json.loads(data.json)[copies - 1]["traces"]
    swing = np.nanmax(ys) - np.nanmin(ys) if np.isfinite(ys).any() else 0.0
    np.testing.assert_allclose(unpacked(data, trace["y"]), ys, rtol=1e-12, atol=0.51 * swing / STEPS)
    np.testing.assert_allclose(
        unpacked(data, trace["x"]), xs, rtol=1e-12, atol=0.51 * max(ys.size, 1) / STEPS
    )
    steps = zlib.decompress(base64.b64decode(data.packed))
    assert len(steps) <= 4 * ys.size  # both series once, however often they are drawn


def test_no_text_ends_its_element() -> None:
    data = PlotData()
    evil = "</script><script>alert(1)</script>"
    data.add(Plot("sweep", evil, evil, evil, [Trace(evil, evil, (), np.ones(1), np.ones(1))]))
    assert "<" not in data.json
    assert json.loads(data.json)[0]["title"] == evil
