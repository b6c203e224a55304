"""Libraries that print what goes wrong while a half-made object is thrown away: nobody is to read that."""

from __future__ import annotations

import gc
import sys
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def no_last_words() -> Iterator[None]:
    """Be silent about what destructors raise of objects that are thrown away within."""
    hook = sys.unraisablehook
    sys.unraisablehook = lambda _: None
    try:
        yield
    finally:
        gc.collect()
        sys.unraisablehook = hook
