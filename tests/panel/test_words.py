"""What the panel says of the words that it shows: none of them is without a sentence."""

import re
from pathlib import Path

import pytest

import astb.panel
from bench_protocol.signals import Kind
from bench_protocol.table import TABLE
from bench_records.result import CheckVerdict, Outcome
from bench_records.run_folder import Unfinished
from test_plans.loads import AW0, AW3

PAGE = Path(astb.panel.__file__).parent / "page"
WORDS = dict(
    re.findall(r'^  "([^"]+)": "([^"]+)",$', (PAGE / "words.js").read_text(encoding="utf-8"), re.MULTILINE)
)


@pytest.mark.parametrize(
    "words",
    [
        [one.value for one in CheckVerdict],
        [one.value for one in (*Outcome, *Unfinished)],
        [signal.name.removeprefix("interlock.") for signal in TABLE.of_kind(Kind.INTERLOCK)],
        [AW0, AW3, "specimen", "hold"],
    ],
)
def test_every_word_that_is_shown_has_a_sentence(words):
    assert set(words) <= WORDS.keys()
    for word in words:
        assert WORDS[word].endswith("."), word
