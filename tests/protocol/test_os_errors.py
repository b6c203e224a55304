"""Errors of the operating system have a remedy; others keep their text."""

from pathlib import Path

import pytest

from bench_protocol.os_errors import reason


def test_a_frequent_error_has_a_remedy(tmp_path: Path) -> None:
    for path in (tmp_path, tmp_path / "none"):
        with pytest.raises(OSError, match=r"\[Errno") as caught:
            path.read_bytes()
        what, remedy = reason(caught.value).split("; ")
        assert what == caught.value.strerror and "path" in remedy


def test_another_error_keeps_its_text() -> None:
    assert reason(OSError("the line is silent")) == "the line is silent"
    assert reason(TimeoutError()) == "TimeoutError"
