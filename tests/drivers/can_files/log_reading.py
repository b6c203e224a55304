"""How the tests read a log and compare the frames, and the rows of the table that they cover."""

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pytest

from bench_protocol.account import Account
from drivers.can_files.frames import CanLogError
from drivers.can_files.reading import read_log
from tests.drivers.can_files.log_forms import Sample

TESTED: set[str] = set()


def form(name: str) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Mark the row of the table that a test covers."""
    TESTED.add(name)
    return lambda test: test


def read(folder: Path, name: str, content: str | bytes, **keys: object) -> tuple[list[Sample], Account]:
    path, account = folder / name, Account()
    path.write_bytes(content.encode() if isinstance(content, str) else content)
    found = [
        Sample(time, int(kind.channel.removeprefix("can")), kind.identifier, kind.extended, kind.fd, data)
        for time, kind, data in read_log(path, account, **keys)  # type: ignore[arg-type]
    ]
    return found, account


def same(found: Sequence[Sample], expected: Sequence[Sample], within: int = 0) -> None:
    """Equal frames at equal intervals: where a log begins is not the same in all forms."""
    assert [one[1:] for one in found] == [one[1:] for one in expected]
    if found:
        times = np.array([one.time for one in found]) - found[0].time
        others = np.array([one.time for one in expected]) - expected[0].time
        np.testing.assert_allclose(times, others, atol=within, rtol=0)


def refused(folder: Path, name: str, content: str | bytes, said: str, **keys: object) -> None:
    with pytest.raises(CanLogError, match=said):
        read(folder, name, content, **keys)


def replace_channel(one: Sample, channel: int) -> Sample:
    return one._replace(channel=channel)
