"""A list of registers that is too long, too wild or no list at all is refused in words."""

import pytest

from astb.acceptance.skeleton.register_list import read_register_list
from bench_protocol.input_limits import DESCRIPTION_BYTES
from bench_protocol.written_values import NotAValue, read_written
from drivers.errors import WiringError
from tests.refusals import refuses

HEAD = b"name,table,address,scale\n"


@pytest.mark.parametrize(
    ("content", "told"),
    [
        (HEAD + b"a,input,1,inf\n", "such 0.01"),
        (HEAD + b"a,input,1,1e999\n", "such 0.01"),
        (HEAD + b"a,input,1,0\n", "such 0.01"),
        (HEAD + b"a,input,-1,1\n", "'-1' 10"),
        (HEAD + b"a,input," + b"9" * 400 + b",1\n", "wire 0 65535"),
        (HEAD + b"a,input," + b"9" * 5000 + b",1\n", "wire 0 65535"),
        (HEAD + b'a,input,1,"' + b"x" * 200_000 + b'"\n', "number"),
        (b"x" * (DESCRIPTION_BYTES + 1), "4 MiB"),
    ],
)
def test_a_wild_list_of_registers_is_refused(tmp_path, content, told):
    path = tmp_path / "registers.csv"
    path.write_bytes(content)
    with refuses(WiringError, told):
        read_register_list(path)


@pytest.mark.parametrize("text", ["inf bar", "-inf bar", "1e400 bar"])
def test_a_value_that_is_not_finite_is_none(text):
    with refuses(NotAValue, "finite"):
        read_written("target", text, "Pa")
