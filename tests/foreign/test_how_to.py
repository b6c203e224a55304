"""The how-to shows lines of the files that the tests use."""

import re
import tomllib
from pathlib import Path

from bench_protocol.table import TABLE

HERE = Path(__file__).parent
PAGE = (HERE.parents[1] / "docs/how-to/connect-a-rig.md").read_text()


def blocks(language):
    return re.findall(rf"^```{language}\n(.*?)^```", PAGE, flags=re.MULTILINE | re.DOTALL)


def of_file(name):
    """The TOML blocks of the page that begin with the name of their file."""
    return [block for block in blocks("toml") if block.startswith(f"# {name}\n")]


def within(part, whole):
    """Whether a piece of a TOML file equals the whole file."""
    if isinstance(part, dict):
        return all(key in whole and within(value, whole[key]) for key, value in part.items())
    return part == whole


def test_the_pieces_on_the_page_are_those_of_the_wiring_of_rig_b():
    whole = tomllib.loads((HERE / "hall_b" / "wiring.toml").read_text())
    pieces = [tomllib.loads(piece) for piece in of_file("hall_b/wiring.toml")]
    assert pieces and all(within(piece, whole) for piece in pieces)


def test_the_piece_about_signals_of_ours_names_such():
    (piece,) = of_file("mine/wiring.toml")
    assert tomllib.loads(piece)["signals"].keys() <= TABLE.index.keys()


def test_the_function_on_the_page_is_that_of_the_file():
    (function,) = (code for code in blocks("python") if "hall_checksum" in code)
    assert function in (HERE / "hall_b" / "strangers.py").read_text()
