"""The interface of springs that are computed outside the model, such as by an FMU."""

from typing import Protocol

import numpy as np
import numpy.typing as npt

from bench_sim.model.external_springs import ExternalSprings


class ReplacementSprings(Protocol):
    """The methods of springs that replace those of the plant."""

    @property
    def arrays(self) -> ExternalSprings:
        """Return the arrays that the tick reads and writes."""

    @property
    def notes(self) -> tuple[str, ...]:
        """Return sentences for the user, which are shown before a run."""

    @property
    def too_slow(self) -> bool:
        """Whether a rig in real time could not catch up after late ticks."""

    @property
    def adjustable(self) -> frozenset[str]:
        """Return the parameters that a person changes between runs and for which these springs have inputs."""

    @property
    def owned(self) -> frozenset[str]:
        """Return the names of the bench parameters that these springs replace."""

    def pressures(self) -> npt.NDArray[np.float64]:
        """Return the gauge pressures in Pa of all chambers whose pressure these springs give."""

    def limit_timeout(self) -> None:
        """Reduce the timeout of a step to the time that clients of a rig in real time allow."""

    def failure(self) -> str:
        """Return a text with the reason why the springs have failed."""
