"""What a diagnosis may be told: levels, limits and how much of the machine it may use."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Config:
    """The defaults are those under which the false-alarm and naming rates of the reference were measured."""

    alpha: float = 0.003  #: chance of a score above the threshold in data that hold nothing
    alpha_unknown: float = 0.002  #: the same of the omnibus test for what has no name
    seed: int = 1
    workers: int = 2
    max_effects: int = 3
    fits: int = 8  #: so many effects with the highest scores are fitted at each step
    effects: tuple[str, ...] | None = None  #: only these of the catalogue; None: all
    ambiguous: float = 10.0  #: BIC gap under which two causes are not told apart
    lpd_loss: float = 3.0  #: what a cause may cost in log density on the select runs
    rough: float = (
        0.03  #: a further cause must leave at least this part of the λ of those that were found before
    )
    gain: float = 0.05  #: least part of the explainable RMSE that a cause must explain on the select runs
