"""A record keeps every sample, whatever happens to the process, and the same samples make the same bytes."""

import shutil
import signal
import subprocess
import sys
import threading
import time
from itertools import pairwise
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bench_records.conversion import recover
from bench_records.layout import META, PARQUET, STREAM, RecordError, SignalInfo
from bench_records.record import read
from bench_records.recorder import Recorder
from tests.refusals import refuses

SIGNALS = [
    SignalInfo("left.height", "mm", 1e-3, "left"),
    SignalInfo("rig.state", names={0: "OFF"}),
    SignalInfo("c"),
]
MS = 1_000_000

samples = st.lists(
    st.tuples(st.integers(0, 10**12), st.integers(0, 2), st.floats(allow_nan=True, allow_infinity=True)),
    max_size=60,
)


def write(
    directory: Path, rows: list[tuple[int, int, float]], cuts: set[int] = frozenset(), **options: object
) -> Path:
    """A record of the rows, appended in pieces; at each cut the stream is flushed as well."""
    with Recorder(directory, SIGNALS, {"plan": "x", "seed": 3}, start_ns=0, **options) as recorder:
        edges = sorted({0, len(rows), *(cut for cut in cuts if cut < len(rows))})
        for first, last in pairwise(edges):
            recorder.receive(*zip(*rows[first:last], strict=True))
            recorder.flush()
    return directory / PARQUET


@given(rows=samples)
@settings(max_examples=40, deadline=None)
def test_every_sample_comes_back(
    tmp_path_factory: pytest.TempPathFactory, rows: list[tuple[int, int, float]]
) -> None:
    directory = tmp_path_factory.mktemp("record")
    write(directory, rows)
    record = read(directory)
    assert len(record) == len(rows)
    for index, info in enumerate(SIGNALS):
        expected = sorted(((t, v) for t, i, v in rows if i == index), key=lambda pair: pair[0])
        times, values = record.series(info.name)
        np.testing.assert_allclose(times, [t / 1e9 for t, _ in expected], rtol=1e-15)
        np.testing.assert_array_equal(values, [v for _, v in expected])


@given(rows=samples, cuts=st.sets(st.integers(1, 60), max_size=8))
@settings(max_examples=30, deadline=None)
def test_bytes_do_not_depend_on_batches(
    tmp_path_factory: pytest.TempPathFactory, rows: list[tuple[int, int, float]], cuts: set[int]
) -> None:
    whole = write(tmp_path_factory.mktemp("whole"), rows)
    pieces = write(tmp_path_factory.mktemp("pieces"), rows, cuts)
    assert whole.read_bytes() == pieces.read_bytes()
    assert whole.with_name(META).read_bytes() == pieces.with_name(META).read_bytes()


def test_bytes_do_not_depend_on_batches_of_a_long_record(tmp_path: Path) -> None:
    """Long enough for several pages in each column, where batches could leave their traces."""
    rows = 300_000
    times, index = np.arange(rows) * MS, np.arange(rows) % 3
    values = np.sin(np.arange(rows))
    made = []
    for name, size in (("a", rows), ("b", 777), ("c", 50_000)):
        with Recorder(tmp_path / name, SIGNALS, start_ns=0) as recorder:
            for first in range(0, rows, size):
                part = slice(first, first + size)
                recorder.receive(times[part], index[part], values[part])
                if size > 1000:
                    recorder.flush()
        made.append((tmp_path / name / PARQUET).read_bytes())
    assert made[0] == made[1] == made[2]


def test_bytes_do_not_depend_on_the_order_of_meta_data(tmp_path: Path) -> None:
    entries = {"plan": "x", "versions": {"a": 1, "b": 2}}
    backwards = {"versions": {"b": 2, "a": 1}, "plan": "x"}
    made = []
    for name, meta in (("a", entries), ("b", backwards)):
        with Recorder(tmp_path / name, SIGNALS, meta, start_ns=0):
            pass
        made.append([(tmp_path / name / file).read_bytes() for file in (PARQUET, META)])
    assert made[0] == made[1]


def test_foreign_readers_find_the_promised_columns(passed_run: Path) -> None:
    schema = pq.read_schema(passed_run / PARQUET)
    assert schema.field("time_ns").type == pa.int64()
    assert pa.types.is_dictionary(schema.field("signal").type)
    assert schema.field("signal").type.value_type == pa.string()
    assert schema.field("value").type == pa.float64()
    metadata = pq.read_metadata(passed_run / PARQUET).metadata
    assert metadata[b"astb.map_hash"] == b'"5f0c2f6a9e7b41d3"'
    assert metadata[b"astb.lateness"] == b'{"late":0,"max_us":412.0}'
    assert not (passed_run / STREAM).exists()
    assert sorted(path.name for path in passed_run.iterdir() if path.suffix == ".part") == []


WRITER = """
import sys, time
from bench_records.layout import SignalInfo
from bench_records.recorder import Recorder

recorder = Recorder(sys.argv[1], [SignalInfo("x")], {"plan": "killed"}, start_ns=0)
recorder.event(0, "state", "begun")
end = time.monotonic() + float(sys.argv[2])
count = 0
while time.monotonic() < end:
    now = time.monotonic_ns()
    recorder.receive([now], [0], [float(count)])
    count += 1
    print("at", count, now, flush=True)
    time.sleep(0.002)
print("idle", count, now, flush=True)
time.sleep(60)
"""


@pytest.mark.slow
@pytest.mark.real_time
@pytest.mark.parametrize("silent", [False, True], ids=["while samples come", "after they stopped"])
def test_a_killed_process_loses_at_most_a_second(tmp_path: Path, silent: bool) -> None:
    writer = subprocess.Popen(
        [sys.executable, "-c", WRITER, str(tmp_path), "0.3" if silent else "60"],
        stdout=subprocess.PIPE, text=True, cwd=Path(__file__).parents[2],
    )  # fmt: skip
    assert writer.stdout is not None
    last_count = last_ns = 0
    try:
        started = None
        for line in writer.stdout:
            word, last_count, last_ns = line.split()[0], int(line.split()[1]), int(line.split()[2])
            started = started or time.monotonic()
            if word == "idle":
                time.sleep(1.0)
                break
            if time.monotonic() - started > 1.3:
                break
    finally:
        writer.send_signal(signal.SIGKILL)
        writer.wait(10)
        writer.stdout.close()
    left = read(tmp_path)
    recovery = recover(tmp_path)
    assert not recovery.complete
    assert "at most the last second" in str(recovery)
    record = read(tmp_path)
    times, values = record.series("x")
    np.testing.assert_array_equal(values, np.arange(values.size))  # a gapless beginning
    assert last_ns / 1e9 - times[-1] <= 1.0
    if silent:
        assert values.size == last_count
    assert [event.text for event in record.events] == ["begun"]
    assert record.meta["recovered"] == str(recovery)
    assert not (tmp_path / STREAM).exists()
    assert (left.meta, left.events, left.start_ns) == (record.meta, record.events, record.start_ns)
    np.testing.assert_array_equal(left.series("x"), record.series("x"))


def test_in_virtual_time_the_last_second_at_most_is_unwritten_at_any_moment(tmp_path: Path) -> None:
    before = threading.active_count()
    recorder = Recorder(tmp_path / "run", SIGNALS, start_ns=0, in_background=False)
    assert threading.active_count() == before
    for cycle in range(500):  # 10 s in an instant
        recorder.receive([cycle * 20 * MS], [0], [float(cycle)])
        if cycle % 99 == 98:
            copy = tmp_path / f"killed at {cycle}"
            copy.mkdir()
            shutil.copy(tmp_path / "run" / STREAM, copy)
            recover(copy)
            times = read(copy).series("left.height")[0]
            assert cycle * 0.02 - times[-1] <= 1.0
    recorder.close()
    assert len(read(tmp_path / "run")) == 500


@pytest.fixture(scope="module")
def stream(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    """A closed stream of 50 batches of 20 samples, value = position, with an event each ten batches."""
    directory = tmp_path_factory.mktemp("stream")
    recorder = Recorder(directory, SIGNALS, {"plan": "cut"}, start_ns=0)
    for batch in range(50):
        index = np.arange(20 * batch, 20 * batch + 20)
        recorder.receive(index * MS, index % 3, index)
        if batch % 10 == 0:
            recorder.event(batch * 20 * MS, "state", f"batch {batch}")
        recorder.flush()
    data = (directory / STREAM).read_bytes()
    recorder.close()
    return data


@given(data=st.data())
@settings(max_examples=60, deadline=None)
def test_wherever_the_stream_breaks_off_a_beginning_remains(
    tmp_path_factory: pytest.TempPathFactory, stream: bytes, data: st.DataObject
) -> None:
    length = data.draw(st.integers(0, len(stream)))
    directory = tmp_path_factory.mktemp("cut")
    (directory / STREAM).write_bytes(stream[:length])
    try:
        recovery = recover(directory)
    except RecordError as error:
        assert "ends before its first sample" in str(error)
        assert length < 2000, "the head of the stream was there, and yet nothing was recovered"
        return
    record = read(directory)
    assert len(record) == recovery.samples
    assert recovery.samples % 20 == 0
    found = np.sort(np.concatenate([record.series(info.name)[1] for info in SIGNALS]))
    np.testing.assert_array_equal(found, np.arange(recovery.samples))
    whole_batch = (len(stream) // 50) + 600
    assert recovery.samples >= 20 * ((length - 2000) // whole_batch)
    assert recovery.unreadable_bytes < whole_batch


def test_a_closed_stream_that_was_not_converted_is_recovered_whole(tmp_path: Path, stream: bytes) -> None:
    (tmp_path / STREAM).write_bytes(stream + b"\xff\xff\xff\xff\x00\x00\x00\x00")
    recovery = recover(tmp_path)
    assert recovery.complete
    assert recovery.samples == 1000
    assert recovery.events == 5
    assert "nothing was lost" in str(recovery)


@pytest.mark.parametrize("content", [b"", b"hello, this is not an Arrow stream at all" * 10, b"\xff" * 4096])
def test_a_foreign_stream_is_refused_and_kept(tmp_path: Path, content: bytes) -> None:
    (tmp_path / STREAM).write_bytes(content)
    with refuses(RecordError, "stream"):
        recover(tmp_path)
    assert (tmp_path / STREAM).read_bytes() == content
    assert not (tmp_path / PARQUET).exists()


def test_somebody_elses_arrow_stream_is_refused(tmp_path: Path) -> None:
    table = pa.table({"a": [1, 2, 3]})
    with pa.ipc.new_stream(str(tmp_path / STREAM), table.schema) as writer:
        writer.write_table(table)
    with refuses(RecordError):
        recover(tmp_path)


def test_recovery_without_a_loss_has_no_effect(tmp_path: Path) -> None:
    with refuses(RecordError, "record.arrows"):
        recover(tmp_path)


def test_a_left_over_stream_is_never_overwritten(tmp_path: Path, stream: bytes) -> None:
    (tmp_path / STREAM).write_bytes(stream)
    with refuses(RecordError):
        Recorder(tmp_path, SIGNALS)
    assert (tmp_path / STREAM).read_bytes() == stream


def test_an_older_record_gives_way_only_to_a_finished_one(tmp_path: Path) -> None:
    write(tmp_path, [(1, 0, 1.0)])
    recorder = Recorder(tmp_path, SIGNALS, start_ns=0)
    recorder.receive([1, 2], [0, 0], [7.0, 8.0])
    with refuses(RecordError):
        read(tmp_path)
    recorder.close()
    np.testing.assert_array_equal(read(tmp_path).series("left.height")[1], [7.0, 8.0])


def test_what_exceeds_the_limit_is_counted(tmp_path: Path) -> None:
    write(tmp_path, [(i, 0, float(i)) for i in range(25)], {7, 9, 20}, limit=10)
    record = read(tmp_path)
    np.testing.assert_array_equal(record.series("left.height")[1], np.arange(10))
    assert record.meta["dropped"] == 15


def test_samples_and_events_from_several_threads(tmp_path: Path) -> None:
    recorder = Recorder(tmp_path, SIGNALS, start_ns=0)

    def feed(index: int) -> None:
        for i in range(400):
            recorder.receive([i * MS, i * MS], [index, index], [i, i + 0.5])

    threads = [threading.Thread(target=feed, args=(index,)) for index in range(3)]
    for thread in threads:
        thread.start()
    for i in range(200):
        recorder.event(i, "check", str(i))
        recorder.flush()
    for thread in threads:
        thread.join()
    recorder.close()
    record = read(tmp_path)
    for info in SIGNALS:
        np.testing.assert_array_equal(record.series(info.name)[1], np.arange(800) / 2)
    assert [event.text for event in record.events] == [str(i) for i in range(200)]


def test_the_callers_arrays_are_copied(tmp_path: Path) -> None:
    buffer = np.array([1.0, 2.0])
    with Recorder(tmp_path, SIGNALS, start_ns=0) as recorder:
        recorder.receive(np.array([1, 2]), np.array([0, 0], np.int16), buffer)
        buffer[:] = -1.0
    np.testing.assert_array_equal(read(tmp_path).series("left.height")[1], [1.0, 2.0])


def test_phases_nest_and_end_with_what_encloses_them(tmp_path: Path) -> None:
    second = 1000 * MS
    with Recorder(tmp_path, SIGNALS, start_ns=10 * second) as recorder:
        recorder.event(10 * second, "phase", "main", edge="begin")
        recorder.event(11 * second, "phase", "sine", edge="begin")
        recorder.event(12 * second, "phase", "sine", edge="end")
        recorder.event(12 * second, "phase", "left open by an exception", edge="begin")
        recorder.event(14 * second, "phase", "main", edge="end")
        recorder.event(15 * second, "phase", "never begun", edge="end")
        recorder.event(15 * second, "phase", "teardown", edge="begin")
        recorder.receive([18 * second], [0], [0.0])
    told = [(phase.name, phase.start, phase.end, phase.level) for phase in read(tmp_path).phases]
    assert told == [
        ("main", 0.0, 4.0, 0),
        ("sine", 1.0, 2.0, 1),
        ("left open by an exception", 2.0, 4.0, 1),
        ("teardown", 5.0, 8.0, 0),
    ]


@pytest.mark.parametrize(
    ("arrays", "complaint"),
    [
        (([1, 2], [0], [1.0]), "length (2,) (1,) (1,)"),
        (([[1]], [[0]], [[1.0]]), "length"),
        (([1], [3], [1.0]), "index 3 0 2"),
        (([1], [-1], [1.0]), "index -1"),
    ],
)
def test_samples_that_do_not_fit(tmp_path: Path, arrays: tuple[list, list, list], complaint: str) -> None:
    with Recorder(tmp_path, SIGNALS) as recorder, refuses(RecordError, complaint):
        recorder.receive(*arrays)
    assert len(read(tmp_path)) == 0


def test_misuse_says_what_would_be_right(tmp_path: Path) -> None:
    with refuses(RecordError, "listed"):
        Recorder(tmp_path, [SignalInfo("a"), SignalInfo("a")])
    with refuses(RecordError, "'events'"):
        Recorder(tmp_path, SIGNALS, {"events": 1})
    with refuses(RecordError, "scale 0"):
        SignalInfo("a", scale=0.0)
    with refuses(RecordError, "least 1"):
        Recorder(tmp_path, SIGNALS, limit=0)
    assert list(tmp_path.iterdir()) == []
    (tmp_path / "file").write_text("")
    with refuses(RecordError, "written"):
        Recorder(tmp_path / "file", SIGNALS)
    recorder = Recorder(tmp_path, SIGNALS)
    with refuses(RecordError, "JSON"):
        recorder.event(0, "state", "odd", thing=object())
    recorder.close()
    recorder.close()
    for act in (
        lambda: recorder.receive([1], [0], [1.0]),
        lambda: recorder.event(0, "a", "b"),
        recorder.flush,
    ):
        with refuses(RecordError, "closed"):
            act()


def test_a_full_disk_is_reported_and_what_was_written_stays(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    recorder = Recorder(tmp_path, SIGNALS, start_ns=0)
    recorder.receive([1], [0], [1.0])
    recorder.flush()
    written = recorder._writer

    class Full:
        def write_batch(self, *_: object, **__: object) -> None:
            raise OSError(28, "No space left on device")

    monkeypatch.setattr(recorder, "_writer", Full())
    recorder.receive([2], [0], [2.0])
    with refuses(RecordError, "disk"):
        recorder.flush()
    with refuses(RecordError, "disk"):
        recorder.receive([3], [0], [3.0])
    with refuses(RecordError, "disk"):
        recorder.close()
    assert written is not None
    assert recover(tmp_path).samples == 1


@pytest.mark.real_time
def test_fast_enough_for_the_bus(tmp_path: Path) -> None:
    """200 000 samples/s with room to spare, and the 650 000 of a 100 s run closed at once."""
    rng = np.random.default_rng(1)
    rows = 650_000
    times = np.repeat(np.arange(rows // 50), 50) * 5 * MS
    index = np.tile(np.arange(50) % 3, rows // 50).astype(np.int16)
    values = np.round(rng.normal(size=rows), 3)
    recorder = Recorder(tmp_path, SIGNALS)
    begun = time.perf_counter()
    for first in range(0, rows, 250):
        part = slice(first, first + 250)
        recorder.receive(times[part], index[part], values[part])
    appended = time.perf_counter() - begun
    recorder.close()
    closed = time.perf_counter() - begun - appended
    print(f"append {rows / appended:,.0f} samples/s, close {closed * 1e3:.0f} ms")
    assert rows / appended > 400_000
    assert closed < 1.5  # 0.3 s on an idle machine
    shutil.rmtree(tmp_path)
