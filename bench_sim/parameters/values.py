"""Values in parameter and rig files, as people write them."""

from typing import Any

from bench_protocol.written_values import NotAValue, read_written
from bench_sim.parameters.loading import ParameterError


def read_value(what: str, text: Any, si: str) -> float:
    """Return ``text``, such as ``0.2 mm2``, in the SI unit ``si``; `ParameterError`, which begins with ``what``."""
    try:
        return read_written(what, text, si)
    except NotAValue as error:
        raise ParameterError(str(error)) from None
