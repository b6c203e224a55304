"""A record is read back as it was written, at any rate, and never says more than was received."""

from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from bench_records.layout import PARQUET, RecordError, SignalInfo
from bench_records.record import Record, read
from bench_records.recorder import Recorder
from tests.refusals import refuses

SECOND = 1_000_000_000


def make(directory: Path, **series: tuple[list[float], list[float]]) -> Record:
    """A record of series given as (seconds, values); signals named state are discrete."""
    signals = [SignalInfo(name, names={0: "OFF", 1: "ON"} if name == "state" else {}) for name in series]
    with Recorder(directory, signals, {"plan": "x"}, start_ns=100 * SECOND) as recorder:
        for index, (times, values) in enumerate(series.values()):
            recorder.receive([100 * SECOND + round(t * SECOND) for t in times], [index] * len(times), values)
    return read(directory)


def test_a_straight_line_survives_any_rate(tmp_path: Path) -> None:
    times = np.sort(np.random.default_rng(3).uniform(0, 10, 400))
    times[0], times[-1] = 0.0, 10.0
    record = make(tmp_path, x=(times, 3 * times - 1))
    for rate in (1, 7.5, 100, 1000):
        frame = record.frame(["x"], rate)
        assert frame.index.name == "time_s"
        assert len(frame) == int(10 * rate) + 1
        np.testing.assert_allclose(frame["x"], 3 * frame.index.to_numpy() - 1, atol=1e-7)


def test_named_values_are_held_and_lines_are_drawn(tmp_path: Path) -> None:
    record = make(tmp_path, state=([0, 0.5, 1], [0, 1, 0]), x=([0, 0.5, 1], [0, 1, 0]))
    frame = record.frame(["state", "x"], 8)
    assert frame["state"].tolist() == [0, 0, 0, 0, 1, 1, 1, 1, 0]
    np.testing.assert_allclose(frame["x"], [0, 0.25, 0.5, 0.75, 1, 0.75, 0.5, 0.25, 0])


def test_gaps_ends_and_nan_are_not_bridged(tmp_path: Path) -> None:
    record = make(
        tmp_path,
        gap=([1, 2, 4, 5], [1.0, 2.0, 4.0, 5.0]),
        stale=([0, 1, 2, 3, 4, 5, 6], [0.0, 1.0, np.nan, 3.0, 4.0, 5.0, 6.0]),
        never=([], []),
    )
    frame = record.frame(["gap", "stale", "never"], 2)
    expected = [np.nan, np.nan, 1, 1.5, 2, np.nan, np.nan, np.nan, 4, 4.5, 5, np.nan, np.nan]
    np.testing.assert_array_equal(frame["gap"], expected)
    np.testing.assert_array_equal(
        frame["stale"], [0, 0.5, 1, np.nan, np.nan, np.nan, 3, 3.5, 4, 4.5, 5, 5.5, 6]
    )
    assert frame["never"].isna().all()
    assert not record.frame(["gap"], 2, gap=3.0)["gap"].iloc[2:11].isna().any()


def test_series_are_in_order_of_time_even_if_frames_were_not(tmp_path: Path) -> None:
    times, values = make(tmp_path, x=([3, 1, 2], [30.0, 10.0, 20.0])).series("x")
    np.testing.assert_array_equal(times, [1, 2, 3])
    np.testing.assert_array_equal(values, [10, 20, 30])


def test_wrong_questions(tmp_path: Path) -> None:
    with Recorder(tmp_path, [SignalInfo("left.height")], start_ns=0) as recorder:
        recorder.receive([0, 10 * SECOND], [0, 0], [1.0, 2.0])
    record = read(tmp_path)
    with refuses(RecordError, "'left.hight' 'left.height'"):
        record.series("left.hight")
    for rate in (0.0, -1.0, float("nan"), float("inf")):
        with refuses(RecordError, "rate"):
            record.frame(["left.height"], rate)
    with refuses(RecordError, "choose"):
        record.frame(["left.height"], 1e9)


def test_missing_foreign_and_damaged_files(tmp_path: Path, passed_run: Path) -> None:
    with refuses(RecordError, "record.parquet"):
        read(tmp_path)
    with refuses(RecordError, "nowhere"):
        read(tmp_path / "nowhere")
    path = tmp_path / PARQUET
    pq.write_table(pa.table({"time_ns": [1], "signal": ["x"], "value": [1.0]}), path)
    with refuses(RecordError, "record"):
        read(tmp_path)
    whole = (passed_run / PARQUET).read_bytes()
    for damaged in (b"", b"PAR1", whole[: len(whole) // 2], whole[:1000] + bytes(4000) + whole[5000:]):
        path.write_bytes(damaged)
        with refuses(RecordError, "record.parquet"):
            read(tmp_path)


def test_a_single_flipped_bit_in_the_data_is_noticed(tmp_path: Path, passed_run: Path) -> None:
    whole = (passed_run / PARQUET).read_bytes()
    meta = pq.read_metadata(passed_run / PARQUET).row_group(0)
    for column in range(3):
        chunk = meta.column(column)
        flipped = bytearray(whole)
        flipped[chunk.data_page_offset + chunk.total_compressed_size // 2] ^= 0x10
        (tmp_path / PARQUET).write_bytes(flipped)
        with refuses(RecordError, "damaged"):
            read(tmp_path)


def test_an_empty_record_can_be_read(tmp_path: Path) -> None:
    with Recorder(tmp_path, []):
        pass
    record = read(tmp_path)
    assert (len(record), record.duration, record.phases, record.events) == (0, 0.0, [], [])


def test_pandas_reads_it(passed_run: Path) -> None:
    frame = pd.read_parquet(passed_run / PARQUET)
    times, values = read(passed_run).series("left.height")
    mine = frame[frame["signal"] == "left.height"]
    np.testing.assert_array_equal(mine["value"], values)
    np.testing.assert_array_equal(mine["time_ns"] - 5 * SECOND, np.round(times * 1e9))


def test_meta_events_and_phases(passed_run: Path) -> None:
    record = read(passed_run)
    assert record.meta["versions"]["astb"] == "0.1.0"
    assert record.meta["seed"] == 7
    assert record.duration == pytest.approx(100.0, abs=0.01)
    assert [phase.name for phase in record.phases if phase.level == 0] == ["setup", "main", "teardown"]
    sine = next(phase for phase in record.phases if phase.name == "vertical sine 1.0 Hz")
    assert (sine.start, sine.duration, sine.level) == (45.0, 7.0, 1)
    active = next(event for event in record.events if "ACTIVE" in event.text)
    assert record.time_of(active) == 31.0
    assert active.data == {"by": "plan"}
    assert record.signals["rig.state"].names[9] == "FAULT HOLD"
