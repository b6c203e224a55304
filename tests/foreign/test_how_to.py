"""The how-to goes through the very files that the tests use."""

import re
import tomllib
from pathlib import Path

from bench_protocol.table import TABLE

HERE = Path(__file__).parent
PAGE = (HERE.parents[1] / "docs/how-to/point-the-plans-at-a-real-rig.md").read_text()


def blocks(language):
    return re.findall(rf"^```{language}\n(.*?)^```", PAGE, flags=re.MULTILINE | re.DOTALL)


def lines(text):
    return [line for line in text.splitlines() if line.strip() and not line.startswith("#")]


def test_the_pieces_on_the_page_are_the_wiring_of_rig_b_and_nothing_is_left_out():
    rig_file, *pieces, _ = blocks("toml")
    assert lines(rig_file) == lines((HERE / "hall_b.toml").read_text())
    assert lines("".join(pieces)) == lines((HERE / "hall_b_wiring.toml").read_text())


def test_the_last_piece_on_the_page_is_about_signals_of_ours():
    assert tomllib.loads(blocks("toml")[-1])["signals"].keys() <= TABLE.index.keys()


def test_the_function_on_the_page_is_that_of_the_file():
    (function,) = blocks("python")
    assert function in (HERE / "strangers.py").read_text()
