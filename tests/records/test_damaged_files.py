"""A damaged record or result is refused at any place of the damage, and costs no more."""

import random
from pathlib import Path

import pytest

from bench_protocol.input_limits import RESULT_BYTES
from bench_records.layout import META, PARQUET, RESULT, STREAM, RecordError, SignalInfo
from bench_records.record import read
from bench_records.recorder import Recorder
from bench_records.result import check, conclude, read_result
from bench_records.run_folder import facts_of, open_run
from tests.refusals import refuses


@pytest.fixture(scope="module")
def files(tmp_path_factory) -> dict[str, bytes]:
    """The files of a small run, those that it has while it goes on included."""
    folder = tmp_path_factory.mktemp("run")
    recorder = Recorder(folder, [SignalInfo("a", "mm", 1e-3), SignalInfo("b")], {"plan": "x"}, start_ns=0)
    recorder.receive([1, 2, 3], [0, 1, 0], [1.0, 2.0, 3.0])
    recorder.event(2, "note", "something")
    recorder.flush()
    found = {STREAM: (folder / STREAM).read_bytes()}
    recorder.close()
    conclude("x", "X.", "X.", [check("a", 1.0, high=2.0)]).write(folder)
    return found | {name: (folder / name).read_bytes() for name in (PARQUET, META, RESULT)}


def changed(data: bytes, chance: random.Random) -> bytes:
    """Change, leave out or double a few bytes, or put another text in place of a word."""
    place, length = chance.randrange(len(data)), chance.randint(1, 8)
    new = chance.choice(
        [chance.randbytes(length), b"", b"[" * 3000, b"null", b"9" * 400, data[place : place + 40]]
    )
    return data[:place] + new + data[place + length :]


@pytest.mark.parametrize("name", [STREAM, PARQUET, META, RESULT])
def test_wherever_a_file_was_changed_it_is_read_or_refused_in_words(files, name, tmp_path):
    chance, refused = random.Random(name), 0
    for number in range(60):
        folder = tmp_path / str(number)
        folder.mkdir()
        for other in {PARQUET, META, RESULT} - {name} if name != STREAM else {RESULT}:
            (folder / other).write_bytes(files[other])
        (folder / name).write_bytes(changed(files[name], chance))
        for look in (read, read_result, open_run, facts_of):
            try:
                look(folder)
            except RecordError as error:
                refused += 1
                assert len(str(error)) < 2000
    assert refused or name == META


def test_a_result_that_is_too_long_is_not_read(tmp_path: Path):
    with (tmp_path / RESULT).open("wb") as file:
        file.truncate(RESULT_BYTES + 1)
    with refuses(RecordError, "16 MiB"):
        read_result(tmp_path)
