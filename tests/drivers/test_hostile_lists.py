"""A list of registers that is too long, too wild or no list at all is refused in words."""

import pytest

from astb.acceptance.skeleton.register_list import register_points
from bench_protocol.input_limits import DESCRIPTION_BYTES
from bench_protocol.written_values import NotAValue, read_written
from drivers.errors import WiringError

HEAD = b"name,table,address,scale\n"


@pytest.mark.parametrize(
    ("content", "told"),
    [
        (HEAD + b"a,input,1,inf\n", "must be a number, such as 0.01"),
        (HEAD + b"a,input,1,1e999\n", "must be a number, such as 0.01"),
        (HEAD + b"a,input,1,0\n", "must be a number, such as 0.01"),
        (HEAD + b"a,input,-1,1\n", "is no number; one such as 10"),
        (HEAD + b"a,input," + b"9" * 400 + b",1\n", "on the wire 0 to 65535"),
        (HEAD + b"a,input," + b"9" * 5000 + b",1\n", "on the wire 0 to 65535"),
        (HEAD + b'a,input,1,"' + b"x" * 200_000 + b'"\n', "must be a number"),
        (b"x" * (DESCRIPTION_BYTES + 1), "at most 4 MiB are read"),
    ],
)
def test_a_wild_list_of_registers_is_refused(tmp_path, content, told):
    path = tmp_path / "registers.csv"
    path.write_bytes(content)
    with pytest.raises(WiringError, match=told):
        register_points(path)


@pytest.mark.parametrize("text", ["inf bar", "-inf bar", "1e400 bar"])
def test_a_value_that_is_not_finite_is_none(text):
    with pytest.raises(NotAValue, match="is not finite"):
        read_written("target", text, "Pa")
