"""The interface of springs that are computed outside the model, such as by an FMU."""

from typing import Protocol

import numpy as np
import numpy.typing as npt

from bench_sim.model.external_springs import ExternalSprings


class ReplacementSprings(Protocol):
    """Replace the springs of the plant."""

    @property
    def arrays(self) -> ExternalSprings:
        """Arrays that the tick reads and writes."""

    @property
    def notes(self) -> tuple[str, ...]:
        """Sentences for the user before a run."""

    @property
    def too_slow(self) -> bool:
        """Whether a rig in real time could not catch up."""

    @property
    def adjustable(self) -> frozenset[str]:
        """Parameters that an operator changes between runs and for which these springs have inputs."""

    @property
    def owned(self) -> frozenset[str]:
        """Parameters of the bench's model that these springs replace."""

    def pressures(self) -> npt.NDArray[np.float64]:
        """Return the gauge pressure in all chambers, Pa."""

    def limit_timeout(self) -> None:
        """Limit the timeout of a step to what clients of a rig in real time allow."""

    def failure(self) -> str:
        """Return as text why they have failed."""
