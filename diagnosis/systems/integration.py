"""Integration of a system with a fixed step: the classical Runge-Kutta method for a custom right-hand side.

The right-hand side is a function ``rates(state, inputs, p)`` of the state (k,), the present inputs (m,), and a tuple of
other values. It returns the k rates of change as a tuple or an array. It may use plain Python and numpy. Compiled by
``numba.njit`` it is a hundred times faster; then the method is compiled with it, once for each process.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import lru_cache
from typing import Any

import numpy as np

from diagnosis.contracts import Array, DiagnosisError

Rates = Callable[[Array, Array, Any], Any]


def integrate(
    rates: Rates,
    start: Sequence[float],
    inputs: Sequence[Array],
    step: float,
    p: tuple[Any, ...] = (),
    *,
    parts: int = 1,
    held: Sequence[bool] = (),
) -> Array:
    """Return the states (n, k) at the samples, from ``start`` (k,); ``inputs`` are m arrays (n,), ``step`` is in s.

    Inputs are interpolated linearly between samples, or keep their value until the next one if ``held`` (m,). Each step
    between two samples is divided into ``parts``. The error is of fourth order in step/parts for smooth rates. Raises
    DiagnosisError if the arguments do not fit together.
    """
    driven = np.ascontiguousarray(
        np.column_stack([np.asarray(values, dtype=np.float64) for values in inputs])
    )
    first = np.asarray(start, dtype=np.float64)
    straight = 1.0 - np.array(held or [False] * len(inputs), dtype=np.float64)
    for wrong, found, right in (
        (first.ndim != 1, f"start has the shape {first.shape}", "(k,)"),
        (not step > 0.0, f"step is {step:g} s", "more than 0 s"),
        (parts < 1, f"parts is {parts}", "1 or more"),
        (
            len(straight) != len(inputs),
            f"held has {len(straight)} values",
            f"none, or {len(inputs)} (one for each input)",
        ),
    ):
        if wrong:
            raise DiagnosisError(f"integrate: {found}; use {right}")
    # What numba has compiled keeps the function that it was made of.
    march = _compiled() if hasattr(rates, "py_func") else _march
    states: Array = march(rates, first, driven, step, parts, p, straight)
    return states


@lru_cache
def _compiled() -> Callable[..., Array]:
    from numba import njit

    compiled: Callable[..., Array] = njit(nogil=True, error_model="numpy")(_march)
    return compiled


def _march(
    rates: Rates,
    start: Array,
    inputs: Array,
    step: float,
    parts: int,
    p: tuple[Any, ...],
    straight: Array,
) -> Array:
    n, h = len(inputs), step / parts
    states = np.empty((n, len(start)))
    state = start.copy()
    states[0] = state
    for i in range(1, n):
        before = inputs[i - 1]
        slope = straight * (inputs[i] - before) / parts
        for j in range(parts):
            now, half, then = before + j * slope, before + (j + 0.5) * slope, before + (j + 1) * slope
            a = np.asarray(rates(state, now, p))
            b = np.asarray(rates(state + 0.5 * h * a, half, p))
            c = np.asarray(rates(state + 0.5 * h * b, half, p))
            d = np.asarray(rates(state + h * c, then, p))
            state = state + h / 6.0 * (a + 2.0 * b + 2.0 * c + d)
        states[i] = state
    return states
