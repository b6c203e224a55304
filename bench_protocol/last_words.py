"""Suppression of errors that libraries print when a partly initialized object is destroyed."""

from __future__ import annotations

import gc
import sys
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def no_last_words() -> Iterator[None]:
    """Suppress the output of errors that destructors raise inside the block."""
    hook = sys.unraisablehook
    sys.unraisablehook = lambda _: None
    try:
        yield
    finally:
        gc.collect()
        sys.unraisablehook = hook
