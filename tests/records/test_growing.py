"""A record that is read while it is written: whatever was read by then is what the whole record holds."""

import numpy as np
import pytest

from bench_records.growing import GrowingRecord
from bench_records.layout import RecordError, SignalInfo
from bench_records.record import read
from bench_records.recorder import Recorder
from tests.refusals import refuses

SIGNALS = [SignalInfo("left.height", "mm", 1e-3), SignalInfo("right.height", "mm", 1e-3)]


def written(recorder: Recorder, rng: np.random.Generator, second: int) -> None:
    """Append a second of samples, out of order here and there, and an event."""
    times = second * 1_000_000_000 + rng.permutation(100) * 10_000_000
    recorder.receive(np.sort(times) if second % 3 else times, rng.integers(0, 2, 100), rng.normal(size=100))
    recorder.event(int(times.min()), "setting", "", number=second)
    recorder.flush()


def test_every_read_sees_written_data_until_the_end(tmp_path):
    rng = np.random.default_rng(3)
    recorder = Recorder(tmp_path / "run", SIGNALS, {"plan": "aw0"})
    with GrowingRecord(tmp_path / "run") as growing:
        assert len(growing) == 0 and growing.duration == 0.0 and growing.meta["plan"] == "aw0"
        for second in range(20):
            written(recorder, rng, second)
            if second % 2:
                assert growing.look()
                assert len(growing) == 100 * (second + 1)
                assert growing.duration == pytest.approx(second + 0.99)
                assert len(growing.events) == second + 1
        recorder.close()
        assert not growing.look()
        whole = read(tmp_path / "run")
        assert growing.start_ns == whole.start_ns and growing.events == whole.events
        assert len(growing) == len(whole) and growing.duration == whole.duration
        for name in whole.signals:
            for mine, of_all in zip(growing.series(name), whole.series(name), strict=True):
                assert np.array_equal(mine, of_all)


def test_a_batch_that_is_being_written_waits_for_the_next_look(tmp_path):
    rng = np.random.default_rng(4)
    recorder = Recorder(tmp_path / "whole", SIGNALS, {})
    for second in range(3):
        written(recorder, rng, second)
    stream = (tmp_path / "whole" / "record.arrows").read_bytes()
    beside = Recorder(tmp_path / "run", SIGNALS, {})
    with GrowingRecord(tmp_path / "run") as growing, (tmp_path / "run" / "record.arrows").open("r+b") as file:
        seen = []
        for end in range(len(stream) // 2, len(stream) + 1, 97):
            file.seek(0)
            file.write(stream[:end])
            file.flush()
            growing.look()
            seen.append(len(growing))
        file.seek(0)
        file.write(stream)
        file.flush()
        growing.look()
        assert len(growing) == 300
        assert seen == sorted(seen) and set(seen) <= {100, 200, 300}
    beside.close()
    recorder.close()


def test_no_file_without_a_writer(tmp_path):
    Recorder(tmp_path / "run", SIGNALS, {}).close()
    with refuses(RecordError, "writing"):
        GrowingRecord(tmp_path / "run")


def test_an_unknown_signal_is_refused(tmp_path):
    with Recorder(tmp_path / "run", SIGNALS, {}), GrowingRecord(tmp_path / "run") as growing:
        assert all(not len(one) for one in growing.series("left.height"))
        with refuses(RecordError, "'left.hight'"):
            growing.series("left.hight")


def test_thinned_each_second_keeps_the_sample_nearest_to_its_mean(tmp_path):
    rng = np.random.default_rng(6)
    recorder = Recorder(tmp_path / "run", SIGNALS, {})
    with GrowingRecord(tmp_path / "run") as growing:
        for second in range(200):
            written(recorder, rng, second)
        times = np.array([50_250_000_000, 199_990_000_000])
        recorder.receive(times, np.ones(2, np.int64), np.full(2, np.nan))
        recorder.flush()
        growing.look()
        whole = {name: growing.series(name) for name in growing.signals}
        growing.thin(59.9)
        assert all(len(growing.series(name)[0]) == len(whole[name][0]) for name in whole), (
            "it waits for a minute"
        )
        for before in (80.0, 110.0, 150.5):
            growing.thin(before)
        for name, (times, values) in whole.items():
            kept_times, kept = growing.series(name)
            old, kept_old = times < 150.5, kept_times < 150.5
            for mine, of_all in ((kept_times, times), (kept, values)):
                assert np.array_equal(mine[~kept_old], of_all[~old], equal_nan=True)
            assert np.array_equal(np.floor(kept_times[kept_old]), np.unique(np.floor(times[old])))
            for time, value in zip(kept_times[kept_old], kept[kept_old], strict=True):
                there = values[np.floor(times) == np.floor(time)]
                if time < 150.0:
                    away = np.abs(there - np.nanmean(there))
                    assert abs(value - np.nanmean(there)) == pytest.approx(np.nanmin(away), abs=1e-12)
        recorder.close()
        assert not growing.look()
