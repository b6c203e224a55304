"""Misspelt names: the nearest name is suggested once, wherever a name can be given."""

import copy

import pytest

from bench_protocol.suggestion import did_you_mean
from bench_protocol.table import TABLE
from tests.refusals import refuses


@pytest.mark.parametrize(
    ("ask", "error", "said"),
    [
        (lambda bench: bench.left.hight, AttributeError, "'hight' 'height'"),
        (lambda bench: bench.left.xyz, AttributeError, "'xyz'"),
        (lambda bench: bench.sample("left.hight"), KeyError, "'left.height'"),
        (lambda bench: bench.average("lft.height"), KeyError, "'left.height'"),
        (lambda bench: bench.readings.value("supply.pres"), KeyError, "'supply.pressure'"),
        (lambda bench: TABLE["xyz"], KeyError, "'xyz'"),
    ],
)
def test_did_you_mean_names_the_nearest(bench, ask, error, said):
    with refuses(error, said):
        ask(bench)


def test_python_does_not_say_it_once_more(bench):
    with pytest.raises(AttributeError) as raised:
        bench.left.hight  # noqa: B018
    assert raised.value.obj is None, "with the object Python would add its suggestion"


def test_a_device_can_be_copied_and_asked_for_what_it_lacks(bench):
    assert not hasattr(bench.left, "_repr_html_")
    assert copy.copy(bench.left).height == pytest.approx(bench.left.height, nan_ok=True)


def test_all_names_are_listed_if_none_is_close():
    assert did_you_mean("height", ["hight", "force"]) == "did you mean 'hight'?"
    assert did_you_mean("height", ["force", "axis"]) == "use one of force, axis"
    assert did_you_mean("height", ["force", "axis"], "ask elsewhere") == "ask elsewhere"
