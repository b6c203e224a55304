"""Springs that somebody else computes, as the rig knows them."""

from typing import Protocol

import numpy as np
import numpy.typing as npt

from bench_sim.model.elsewhere import Elsewhere


class Springs(Protocol):
    """What stands in for the springs of the plant."""

    @property
    def arrays(self) -> Elsewhere:
        """What the tick works on."""

    @property
    def said(self) -> tuple[str, ...]:
        """What should be known of them beforehand, in words."""

    @property
    def too_slow(self) -> bool:
        """Whether a rig in real time could not catch up with them."""

    @property
    def told(self) -> frozenset[str]:
        """Parameters of the springs that hands change between runs, and of which these springs are told."""

    @property
    def owned(self) -> frozenset[str]:
        """Parameters that are theirs: of the bench's own values nothing depends on these."""

    def pressures(self) -> npt.NDArray[np.float64]:
        """Return the gauge pressure in all chambers, Pa."""

    def hurry(self) -> None:
        """Be waited for no longer than the wires of a rig in real time may keep silent."""

    def why(self) -> str:
        """Return in words why they are lost."""
