"""Rubber that follows a power law of the frequency: a fractional Kelvin-Voigt element in the shell.

    K(iω) = r k_sh (iω/ω₀)^α,   ω₀ = 2π · 1 Hz

realised by six Maxwell branches with time constants from 1.5 ms to 400 s in equal ratios, whose stiffnesses are the
least-squares fit of (iω/ω₀)^α, relative to its size, from 0.003 to 30 Hz: smooth in α, within
7 % anywhere and 4 % in the mean square for α from 0.1 to 0.7. Slower than that it relaxes. Source: Bagley & Torvik,
AIAA J. 21 (1983); Sjöberg & Kari, Nonlinear Dyn. 33 (2003) for rubber isolators; sizes assumed.
"""

from collections.abc import Mapping
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from bench_sim.model.effects.effect import Effect, EffectParameter
from bench_sim.model.effects.maxwell import add_branch

#: Time constants of the branches in s.
TIMES: Final = np.geomspace(1.5e-3, 400.0, 6)
_UNIT: Final = 2.0 * np.pi
_OMEGA: Final = _UNIT * np.geomspace(0.003, 30.0, 81)
_BRANCHES: Final = 1j * _OMEGA[:, None] * TIMES / (1.0 + 1j * _OMEGA[:, None] * TIMES)


def ladder(order: float) -> NDArray[np.float64]:
    """Stiffnesses (6,) of the branches that together have (iω/ω₀)^``order``."""
    wanted = (1j * _OMEGA / _UNIT) ** order
    left = _BRANCHES / np.abs(wanted)[:, None]
    right = wanted / np.abs(wanted)
    both = np.concatenate([left.real, left.imag]), np.concatenate([right.real, right.imag])
    return np.linalg.lstsq(*both, rcond=None)[0]


def _change(par: Any, place: int | None, values: Mapping[str, float]) -> None:
    for stiffness, time in zip(ladder(values["order"]), TIMES, strict=True):
        add_branch(par, values["ratio"] * float(stiffness), float(time))


EFFECT: Final = Effect(
    name="fractional",
    family="rubber",
    title="fractional Kelvin-Voigt rubber",
    plain="the rubber is viscoelastic like a fractional Kelvin-Voigt element",
    amplitude=EffectParameter("ratio", "1", "1", 1.0, nominal=0.0, typical=0.3, low=0.0, high=5.0),
    change=_change,
    shapes=(EffectParameter("order", "1", "1", 1.0, nominal=0.3, typical=0.3, low=0.1, high=0.7),),
    grid=((0.15,), (0.3,), (0.5,), (0.7,)),
    touches=frozenset({"force"}),
    confusers=("maxwell", "maxwell_two", "friction"),
    phenomenon="relaxation of the rubber",
    equation="K(iω) = r k_sh (iω/ω₀)^α",
    source="Bagley & Torvik 1983; Sjöberg & Kari 2003; sizes assumed",
    separated_by="one amplitude from 0.05 to 10 Hz: stiffness and loss rise with the same power of the frequency",
)
