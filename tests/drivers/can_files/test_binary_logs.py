"""Changed binary logs of CAN frames: equal, refused, or with counted losses; never different."""

import gzip
import random
from collections.abc import Sequence
from pathlib import Path

import pytest

from bench_protocol.account import Account
from drivers.can_files.frames import CanLogError
from tests.drivers.can_files.binary_forms import blf, mdf
from tests.drivers.can_files.log_forms import Sample, recording
from tests.drivers.can_files.log_reading import read, refused

_WITHIN = 1000  # ns: python-can's times are floats of seconds since 1970


def changed(rng: random.Random, frames: list[Sample], changes: Sequence[str]) -> list[Sample]:
    if "channels" in changes:
        frames = [one._replace(channel=1 + (one.identifier == 0x2AF)) for one in frames]
    if "lost" in changes:
        frames = [one for one in frames if rng.random() > 0.05]
    if "twice" in changes:
        frames = frames + frames
    if "back" in changes:
        frames = frames[len(frames) // 2 :] + frames[: len(frames) // 2]
    return frames


def is_equal_or_reported(
    found: Sequence[Sample], account: Account, frames: Sequence[Sample], told: bool
) -> None:
    """Each frame that came is one of the recording, in its order and at its time; missing frames are ``told``."""
    times = {one[1:]: one.time for one in frames}
    assert len(found) <= len(frames)
    shift = found[0].time - times[found[0][1:]]
    for one in found:
        assert abs(one.time - times[one[1:]] - shift) <= _WITHIN
    assert [one.time for one in found] == sorted(one.time for one in found)
    assert len(found) == len(frames) or told, account.lines()


@pytest.mark.parametrize("seed", range(50))
def test_a_blf_in_any_form_and_changed(tmp_path, seed: int) -> None:
    rng = random.Random(seed)
    changes = rng.sample(["beside", "channels", "lost", "twice", "back", "cut", "packed"], rng.randrange(4))
    frames = changed(rng, recording(40, fd=rng.random() < 0.4), changes)
    beside = rng.randrange(1, 5) * ("beside" in changes)
    content = blf(rng, frames, beside)
    if "cut" in changes:
        content = content[: rng.randrange(144, len(content))]
    name = "a.blf" + ".gz" * ("packed" in changes)
    try:
        found, account = read(tmp_path, name, gzip.compress(content) if "packed" in changes else content)
    except CanLogError as error:
        assert {"twice", "back", "cut"} & set(changes), error
        return
    assert not {"twice", "back"} & set(changes) or "cut" in changes
    is_equal_or_reported(found, account, frames, told=bool(account.counts))
    if "cut" not in changes:
        assert sum(account.counts.values()) == beside


@pytest.mark.mdf
@pytest.mark.parametrize("seed", range(24))
def test_raw_bus_logging_in_any_form_and_changed(tmp_path: Path, seed: int) -> None:
    pytest.importorskip("asammdf", reason="MDF needs the extra mdf: `make test-mdf`")
    rng = random.Random(seed)
    changes = rng.sample(["beside", "channels", "lost", "cut", "back"], rng.randrange(4))
    frames = changed(rng, recording(40, fd=rng.random() < 0.4), changes)
    beside = rng.randrange(1, 3) * ("beside" in changes)
    content = mdf(rng, frames, beside)
    if "cut" in changes:
        content = content[: rng.randrange(64, len(content))]
    try:
        found, account = read(tmp_path, "a.mf4", content)
    except CanLogError as error:
        assert {"cut", "back"} & set(changes), error
        return
    assert "back" not in changes
    is_equal_or_reported(found, account, frames, told=bool(account.counts))
    assert bool(account.counts) == bool(beside) or "cut" in changes


@pytest.mark.mdf
@pytest.mark.parametrize("kind", ["OTHER", "LIN", "NONE"])
def test_frames_of_another_bus_are_never_passed_over(tmp_path: Path, kind: str) -> None:
    pytest.importorskip("asammdf", reason="MDF needs the extra mdf: `make test-mdf`")
    content = mdf(random.Random(3), recording(), kind=kind)
    refused(tmp_path, "a.mf4", content, r"group 0 has frames, but its source is not marked as a CAN bus")
