"""The ports of a running rig take whatever strangers send: a slice of `make fuzz`, over sockets."""

import pytest

from tests.fuzz.ports import PORTS, flood

pytestmark = pytest.mark.real_time


@pytest.mark.slow
@pytest.mark.parametrize("name", PORTS)
def test_a_slice_of_the_flood(name: str) -> None:
    said = flood(name, 60_000, seed=2, minutes=1.0)
    assert "nothing found" in said
