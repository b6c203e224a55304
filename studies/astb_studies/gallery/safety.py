"""Times until the bench is safe after the loss of its commander, for each cut, in virtual time."""

from pathlib import Path
from typing import Final

import numpy as np

from astb_studies.benchmarks.cuts import CUTS
from astb_studies.benchmarks.virtual_cuts import virtual_cuts
from astb_studies.gallery.drawing import figure_of, save
from bench_records.plots import ALARM, INK, PALETTE, heading, style

#: Of each kind; the benchmark makes ten times as many.
COUNT: Final = 12
SEED: Final = 1


def time_to_safe(_runs: Path, path: Path) -> None:
    """Draw a row for each kind of cut, and a point for each cut."""
    scatter = np.random.default_rng(SEED).uniform(-0.22, 0.22, COUNT)
    with style():
        figure, axes = figure_of(3.6)
        for row, kind in enumerate(CUTS):
            safe = [safe for _, safe in virtual_cuts(kind, COUNT, SEED)]
            axes.plot(
                safe, row + scatter, "o", color=PALETTE[0], markersize=3.5, alpha=0.7, markeredgewidth=0
            )
            axes.plot((kind.safe_within,) * 2, (row - 0.35, row + 0.35), color=ALARM, linewidth=2)
        axes.set_yticks(range(len(CUTS)), [kind.name for kind in CUTS], color=INK)
        axes.invert_yaxis()
        axes.grid(visible=False, axis="y")
        axes.set_xlim(left=0)
        axes.set_xlabel("s from the cut until it is safe")
        heading(axes, "Time to the safe state", f"{COUNT * len(CUTS)} cuts; red: promised")
        save(figure, path)
