"""The twin of a run as its plan sees it: the model that runs beside the rig, if one does, and whether they part."""

from typing import Protocol

from bench_records.twin import Parting


class Beside(Protocol):
    """What a plan may ask the twin. It never waits for one in real time: what is known by now is the answer."""

    @property
    def watching(self) -> bool:
        """Whether a twin watches this run."""

    @property
    def parted(self) -> Parting | None:
        """Since when and why perhaps rig and model have parted; None if they go along, or nobody watches."""


class Alone:
    """No twin watches the run."""

    watching = False
    parted: Parting | None = None
