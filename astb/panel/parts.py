"""What the routes of the panel are made of."""

from dataclasses import dataclass
from pathlib import Path

from astb.panel.access import Access
from astb.panel.runs import Runs
from astb.panel.watch import Watch


@dataclass(frozen=True, slots=True)
class Parts:
    """What routes are made of: the rig as it is watched, its runs, who may do what, where records go."""

    watch: Watch
    runs: Runs
    access: Access
    out: Path
