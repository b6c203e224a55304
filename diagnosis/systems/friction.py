"""The normalised state of a friction that has to be pushed over a presliding displacement before it slides."""

from __future__ import annotations

import numpy as np

from bench_sim.model.compiled import compiled_entry
from diagnosis.contracts import Array


@compiled_entry
def friction_state(x: Array, x_2: float) -> Array:
    """Return Berg's normalised friction state α (n,) along the displacement ``x`` (n,), from 0 at the start.

    From a reversal (x_s, α_s) on, upwards: α = α_s + (x − x_s)·(1 − α_s)/(x_2·(1 − α_s) + x − x_s); downwards alike.
    Source: M. Berg, Vehicle System Dynamics 33 (S1), 1999.
    """
    alpha = np.zeros(x.shape[0])
    x_s = x[0]
    alpha_s = 0.0
    direction = 0.0
    for i in range(1, x.shape[0]):
        step = x[i] - x[i - 1]
        if step * direction < 0.0:
            x_s = x[i - 1]
            alpha_s = alpha[i - 1]
        if step != 0.0:
            direction = 1.0 if step > 0.0 else -1.0
        way = (x[i] - x_s) * direction
        room = 1.0 - alpha_s * direction
        alpha[i] = alpha_s
        if way > 0.0 and room > 0.0:
            alpha[i] += direction * way / (x_2 * room + way) * room
    return alpha
