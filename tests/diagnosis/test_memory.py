"""Separate pages for large arrays: they exist when written to, and are freed when dropped."""

from __future__ import annotations

import mmap
import sys
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest

from diagnosis.engine.columns import Columns, Trace
from diagnosis.engine.config import OWN_PAGES
from diagnosis.engine.memory import first_rows, give_back, room
from tests.refusals import refuses

ROWS, SAMPLES = 500, 40 * OWN_PAGES * mmap.PAGESIZE // 1000


def resident() -> int:
    """Bytes of this process that are in memory."""
    lines = Path("/proc/self/smaps_rollup").read_text(encoding="utf-8").splitlines()
    return next(int(line.split()[1]) for line in lines if line.startswith("Rss:")) * 1024


@pytest.mark.parametrize("shape", [(0, 0), (3, 0), (3, 5), (ROWS, SAMPLES)])
@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_room_is_an_array_of_zeros_that_can_be_written_to(shape, dtype):
    values = room(shape, dtype)
    assert values.shape == shape and values.dtype == dtype and values.flags.c_contiguous
    assert not values.any()
    values += 1.0
    assert values.sum() == values.size


@pytest.mark.parametrize("count", [0, 1, 7, ROWS - 1, ROWS])
def test_first_rows_keep_what_is_in_them(count):
    values = room((ROWS, SAMPLES))
    values[:] = np.arange(ROWS, dtype=np.float32)[:, None] + 1.0
    kept = first_rows(values, count)
    assert kept.shape == (count, SAMPLES)
    assert (kept == np.arange(count)[:, None] + 1.0).all()


@pytest.mark.skipif(sys.platform != "linux", reason="pages go back where the system is asked for them")
def test_pages_go_back_with_the_rows_that_are_not_kept_and_with_the_array():
    size = ROWS * SAMPLES * 4
    before = resident()
    values = room((ROWS, SAMPLES))
    assert resident() - before < 0.1 * size  # nothing is taken until something is written
    values[:] = 1.0
    assert resident() - before > 0.9 * size
    values = first_rows(values, ROWS // 10)
    assert resident() - before < 0.2 * size
    del values
    assert resident() - before < 0.1 * size


@pytest.mark.skipif(sys.platform != "linux", reason="what is in memory is read in Linux' /proc")
def test_what_was_read_by_arrow_and_dropped_goes_back():
    size, count = 1 << 16, 1500
    before = resident()
    buffers = [pa.allocate_buffer(size) for _ in range(count)]
    for buffer in buffers:
        np.frombuffer(buffer, np.uint8)[:] = 1
    del buffers, buffer
    give_back()
    assert resident() - before < 0.3 * size * count


def test_neighbouring_columns_are_chosen_without_a_copy_and_others_with_the_same_values():
    values = np.arange(20.0, dtype=np.float32).reshape(5, 4)
    columns = Columns(7, [Trace(np.array([0, 2, 3, 4, 6]), values, 0.5)])
    for places in ([2, 3, 4], [0, 1], [1, 5], [0, 3, 6], [6], [4, 2]):
        (trace,) = columns.chosen(places).traces
        expected = np.zeros((7, 4))
        expected[[0, 2, 3, 4, 6]] = 0.5 * values
        told = np.zeros((len(places), 4))
        told[trace.rows] = trace.scale * trace.values
        assert (told == expected[places]).all()
    assert np.shares_memory(columns.chosen([2, 3, 4]).traces[0].values, values)
    assert not np.shares_memory(columns.chosen([0, 3, 6]).traces[0].values, values)


def test_columns_that_were_let_go_of_are_asked_for_in_vain():
    columns = Columns(2, [Trace(np.arange(2), np.ones((2, 5)))])
    other = Columns(2, [Trace(np.arange(2), np.ones((2, 5)))])
    assert (columns.against(other) == 5.0).all()
    columns.let_go()
    with refuses(AttributeError, "traces"):
        columns.against(other)
