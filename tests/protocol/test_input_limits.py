"""Too large third-party files are refused before they cost memory, and files at the limit are not."""

import contextlib
import struct
import zipfile
import zlib
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bench_protocol import input_limits
from bench_protocol.input_limits import (
    COLUMNS,
    DEPTH,
    LINE_BYTES,
    QUOTED_BYTES,
    TIME,
    Unfit,
    check_dbc,
    check_shape,
    check_text_table,
    check_times,
    open_archive,
    parse_toml,
    read_bounded,
    read_toml,
    size,
)
from tests.refusals import refuses


@pytest.fixture
def file(tmp_path: Path):
    def write(content: bytes) -> Path:
        path = tmp_path / "file"
        path.write_bytes(content)
        return path

    return write


def test_as_many_bytes_as_are_allowed_are_read_and_not_one_more(file):
    assert read_bounded(file(b"x" * 100), 100) == b"x" * 100
    with refuses(Unfit, "101 bytes 100 bytes"):
        read_bounded(file(b"x" * 101), 100)


def test_what_never_ends_or_is_no_file_is_not_read(tmp_path):
    for path in (Path("/dev/zero"), tmp_path):
        with refuses(Unfit, "ordinary"):
            read_bounded(path)
    with pytest.raises(FileNotFoundError):
        read_bounded(tmp_path / "none")


@given(st.integers(0, 2**40))
def test_a_size_in_words_is_the_number(count):
    number, unit = size(count).split()
    factor = 1024 ** ["bytes", "KiB", "MiB", "GiB"].index(unit)
    assert float(number) * factor == pytest.approx(count, rel=1e-3)


@pytest.mark.parametrize(
    ("content", "told"),
    [
        (b"a = " + b"[" * 20_000, "nested"),
        (b"a = " + b"[" * (DEPTH) + b"]" * (DEPTH), "deep a.1.1"),
        (b"a." * 40 + b"b = 1", "deep a.a.a"),
        (b"[a" + b' . "a"' * 40 + b"]", "nested"),
        (b"a = [{" + b"a." * 40 + b"b = 1}]", "nested"),
        (b"a." * 400_000, "nested"),
        (b"".join(b"[%x%s]\n" % (k, b".a" * 30) for k in range(7000)), "names 210000"),
        (b"a = " + b"1" * 5000, "TOML"),
        (b"a = " + b"1" * 30, "than 64"),
        (b"[a]\nb = [1.0, inf]", "a.b.2 inf"),
        (b"a = nan", "a nan"),
        (b"a = 1e999", "a inf"),
        (b"x = 1\n# \xff\n", "UTF-8 2"),
        (b"a", "TOML"),
    ],
)
def test_implausible_toml_is_refused(content, told):
    with refuses(Unfit, told):
        parse_toml(content)


def test_toml_as_people_write_it_is_read(file):
    depth = DEPTH - 1
    dots = b"a.b" * DEPTH
    texts = b"t = ['''" + dots + b"''', \"" + dots + b'", """' + dots + b'"""] # ' + dots + b"\n"
    path = file(
        texts
        + b"a = "
        + b"[" * depth
        + b"1"
        + b"]" * depth
        + b"\n[b]\nc = -1.5e300\nd = 9223372036854775807\n"
    )
    found = read_toml(path)
    assert found["b"] == {"c": -1.5e300, "d": 2**63 - 1}


@pytest.mark.parametrize("end", [b'"', b""], ids=["closed", "open"])
def test_the_longest_text_of_a_dbc_is_bounded(file, end):
    head = b'VERSION "1"\nCM_ "'
    check_dbc(file(head + b"x" * (QUOTED_BYTES - 1) + end))
    with refuses(Unfit, "64 KiB 2"):
        check_dbc(file(head + b"x" * QUOTED_BYTES + end))
    check_dbc(file(b"SIG_VALTYPE_ 1 a : 1;\n" * 10_000))  # outside of quotation marks there is no text


def table(columns: int, rows: int) -> bytes:
    return (b"1," * (columns - 1) + b"1\n") * rows


def test_columns_of_a_table_are_counted_in_every_line(file):
    check_text_table(file(table(COLUMNS, 2)), ",")
    for content in (table(COLUMNS + 1, 1), table(3, 1) + table(COLUMNS + 1, 1)):
        with refuses(Unfit, "10001 columns"):
            check_text_table(file(content), ",")
    check_text_table(file(b'length 5"\n' + table(3, 40 * COLUMNS)), ",")  # an unclosed mark is one


def test_a_line_without_an_end_is_no_line(file):
    check_text_table(file((b"x" * (LINE_BYTES - 1) + b"\n") * 2))
    with refuses(Unfit, "1 MiB 2"):
        check_text_table(file(b"x\n" + b"x" * (LINE_BYTES + 1)))


def test_cells_are_counted_over_all_lines(file, monkeypatch):
    monkeypatch.setattr(input_limits, "CELLS", 30)
    check_text_table(file(table(3, 10)), ",")
    with refuses(Unfit, "33 30"):
        check_text_table(file(table(3, 11)), ",")
    with refuses(Unfit, "33 cells"):
        check_shape(11, 3)


@given(st.floats(allow_nan=True, allow_infinity=True))
def test_a_time_passes_if_nanoseconds_hold_it(seconds):
    times = np.array([0.0, seconds])
    if abs(seconds) <= TIME:
        check_times(times)
        assert abs(int(np.rint(times * 1e9).astype(np.int64)[1]) - seconds * 1e9) <= 1024  # no wrap
    else:
        with refuses(Unfit, "2"):
            check_times(times)


def archive(path: Path, files: dict[str, bytes]) -> Path:
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as made:
        for name, content in files.items():
            made.writestr(name, content)
    return path


def test_an_archive_is_bounded_before_it_is_unpacked(tmp_path, monkeypatch):
    for name, limit in (("UNPACKED_BYTES", 4000), ("UNPACKED_FILES", 3), ("PARSED_BYTES", 2000)):
        monkeypatch.setattr(input_limits, name, limit)
    with open_archive(archive(tmp_path / "a", {"x": b"0" * 1000, "y": b"0" * 3000}), parsed={"x"}) as good:
        assert [len(good.read(name)) for name in ("x", "y")] == [1000, 3000]
    for files, told in (
        ({"x": b"0" * 3000, "y": b"0" * 1001}, "unpacks to"),
        (dict.fromkeys("abcd", b""), "4 files"),
        ({"x": b"0" * 2001}, "holds x"),
    ):
        with pytest.raises(Unfit, match=told):
            open_archive(archive(tmp_path / "b", files), parsed={"x"})


@given(st.data())
def test_a_damaged_archive_is_refused_or_keeps_its_bounds(tmp_path_factory, data):
    """With any contents of its directory: a file has the bounded size, or is not unpacked."""
    path = archive(tmp_path_factory.getbasetemp() / "damaged", {"x": b"0" * 1000, "y": b"ab" * 70})
    content = bytearray(path.read_bytes())
    for _ in range(data.draw(st.integers(0, 4))):
        content[data.draw(st.integers(0, len(content) - 1))] = data.draw(st.integers(0, 255))
    path.write_bytes(content[: data.draw(st.integers(0, len(content)))])
    with contextlib.suppress(Unfit), open_archive(path) as opened:
        for one in opened.infolist():
            with contextlib.suppress(
                *(zipfile.BadZipFile, RuntimeError, EOFError, OSError, ValueError, zlib.error, struct.error)
            ):
                assert len(opened.read(one)) <= one.file_size
