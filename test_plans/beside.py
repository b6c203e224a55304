"""Interface of a plan to the twin, the model that runs in parallel with the rig, and to its deviations."""

from typing import Protocol

from bench_records.twin import Parting


class Beside(Protocol):
    """State of the twin for a plan. Reads return the present state; in real time they never wait for the model."""

    @property
    def watching(self) -> bool:
        """Whether a twin watches this run."""

    @property
    def parted(self) -> Parting | None:
        """The present deviation of rig and model; None if they agree or there is no twin."""


class Alone:
    """Stand-in for a run without a twin."""

    watching = False
    parted: Parting | None = None
