"""The text of foreign files is what another program wrote, whatever its encoding, or is refused in words."""

import codecs

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bench_protocol.input_limits import parse_toml
from bench_protocol.text import Unfit, decode, only_utf_8
from tests.refusals import refuses

#: What python writes for them begins with a mark, but for the first and the last.
ENCODINGS = ["utf-8", "utf-8-sig", "utf-16", "utf-32", "cp1252"]
LETTERS = st.text(st.sampled_from("aZ09 .,;\n°µäßÜé€"), min_size=1)


@given(LETTERS, st.sampled_from(ENCODINGS))
def test_what_another_program_wrote_is_read(text, encoding):
    content = text.encode(encoding)
    assert decode(content, encoding)[0] == text
    if encoding != "cp1252":
        assert decode(content) == (text, decode(content)[1])


@given(LETTERS)
def test_what_is_not_utf_8_is_taken_as_windows_and_named(text):
    content = ("Weg in µm: " + text).encode(
        "cp1252"
    ) + b"\xb5 "  # that is no UTF-8, whatever stands before it
    assert decode(content) == (content.decode("cp1252"), "cp1252")


@pytest.mark.parametrize("name", ["utf-16-le", "utf-16-be"])
def test_utf_16_without_a_mark_is_seen(name):
    text = "time;Höhe\n" + "0,01;17,5\n" * 20
    assert decode(text.encode(name)) == (text, name.upper())


@pytest.mark.parametrize(
    ("content", "encoding", "told"),
    [
        (b"a\nb\0c", "", "line 2 0"),
        (b"a\n\x81", "", "cp1252 3 2"),
        (b"a\xff", "utf-8", "utf-8 2"),
        (b"a", "klingon", 'encoding "klingon" "utf-8"'),
        (b"a", "zip", 'encoding "zip"'),
        (codecs.BOM_UTF16_LE + b"a", "", "UTF-16-LE"),
    ],
)
def test_what_is_no_text_is_refused(content, encoding, told):
    with refuses(Unfit, told):
        decode(content, encoding)


def test_a_mark_is_no_part_of_toml():
    assert parse_toml("Höhe = '°C'".replace("Höhe", '"Höhe"').encode("utf-8-sig")) == {"Höhe": "°C"}


@pytest.mark.parametrize(
    ("content", "told"),
    [
        ("a = 1\nb = 'Höhe'".encode("cp1252"), '2 "ö" cp1252 UTF-8'),
        ("a = 1".encode("utf-16"), "UTF-16-LE UTF-8"),
    ],
)
def test_toml_is_only_in_utf_8(content, told):
    with refuses(Unfit, told):
        only_utf_8(content)
    with refuses(Unfit, told):
        parse_toml(content)


@pytest.mark.parametrize(
    ("content", "told"),
    [
        ("a = 1\na = 2\n", "line 2, a = 2: the key or the table occurs twice"),
        ("[a]\n[a]\nb = 1\n", r"line 2, \[a\]: the key or the table occurs twice"),
        (
            "a = wide",
            "line 1, a = wide: the value is not valid; write a number, true, false, or a text between quotation marks",
        ),
        ('path = "C:\\xyz"', r"between single quotation marks"),
        ('a = "x', 'line 1, a = "x: the closing quotation mark of a text is missing'),
        ('a = "x\nb = 1', 'line 1, a = "x: the closing quotation mark of a text is missing'),
        ("a = 'x", "line 1, a = 'x: the closing quotation mark of a text is missing"),
        ("a = 'x\nb = 'y'", "line 1, a = 'x: the closing quotation mark of a text is missing"),
        ("a = [1,", r"line 1, a = \[1,: a bracket is not closed"),
        ("a = [1,\nb = 2\n", "line 2, b = 2: a bracket is not closed"),
        ("a = { b = ", "line 1, a = { b =: a bracket is not closed"),
        ("a = [\nwide,\n]", "line 2, wide,: the value is not valid"),
        ("a = [1,\n2\n", "line 2, 2: a bracket is not closed"),
        ("hello", "line 1, hello: the key has no value"),
        ("bore = 25 mm", "line 1, bore = 25 mm: there is text after the value"),
        ("a = " + "1" * 5000, "a number has too many digits"),
    ],
)
def test_invalid_toml_is_reported_with_its_line(content, told):
    with pytest.raises(Unfit, match="is not TOML: .*" + told):
        parse_toml(content.encode())
