"""Interface of a plan to the twin, the model that runs in parallel with the rig, and to its deviations."""

from typing import Protocol

from bench_records.twin import Deviation


class TwinState(Protocol):
    """State of the twin for a plan. Reads return the present state; in real time they never wait for the model."""

    @property
    def watching(self) -> bool:
        """Whether a twin watches this run."""

    @property
    def deviation(self) -> Deviation | None:
        """The present deviation of rig and model; None if they agree or there is no twin."""


class NoTwin:
    """Stand-in for a run without a twin."""

    watching = False
    deviation: Deviation | None = None
    parted = deviation  # the old name, for one release
