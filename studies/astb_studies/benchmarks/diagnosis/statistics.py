"""Rates with their exact binomial intervals."""

from collections.abc import Sequence
from dataclasses import dataclass


@dataclass(frozen=True)
class Rate:
    """``hits`` of ``count``, with the 95 % interval of Clopper and Pearson."""

    hits: int
    count: int

    @classmethod
    def of(cls, hits: Sequence[bool]) -> "Rate":
        """Count."""
        return cls(sum(hits), len(hits))

    @property
    def value(self) -> float:
        """The rate; NaN without cases."""
        return self.hits / self.count if self.count else float("nan")

    @property
    def interval(self) -> tuple[float, float]:
        """The exact 95 % interval: beyond either end, the observed count would have a probability of at most 2.5 %."""
        from scipy.stats import beta

        k, n = self.hits, self.count
        low = float(beta.ppf(0.025, k, n - k + 1)) if k > 0 else 0.0
        high = float(beta.ppf(0.975, k + 1, n - k)) if k < n else 1.0
        return low, high

    def meets(self, aim: float) -> bool:
        """Whether the measured rate meets an aim: below a half, that is an upper limit."""
        return self.value <= aim if aim < 0.5 else self.value >= aim

    def __str__(self) -> str:
        low, high = self.interval
        return f"{100 * self.value:.3g} % ({100 * low:.3g} … {100 * high:.3g})"
