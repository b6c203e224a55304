"""What a refusal must name: its type, and the values, units and places of its message, never the wording."""

import re
from collections.abc import Iterator
from contextlib import contextmanager

import pytest


@contextmanager
def refuses(
    error: type[BaseException] | tuple[type[BaseException], ...], names: str = ""
) -> Iterator[pytest.ExceptionInfo]:
    """Expect ``error``, whose message has the words of ``names`` in their order, with any others between them."""
    with pytest.raises(error) as caught:
        yield caught
    text, at = str(caught.value), 0
    for name in names.split():
        start, end = (r"(?<!\w)" * name[0].isalnum(), r"(?!\w)" * name[-1].isalnum())
        found = re.compile(start + re.escape(name) + end).search(text, at)
        assert found, f"{name} is not in the message, after {text[:at]!r}: {text}"
        at = found.end()
