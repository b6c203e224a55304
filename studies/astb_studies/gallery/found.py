"""A diagnosis: scores of the suspects, and the pressure of a bellows before and after the cause is in the model."""

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from astb.diagnose import read_data
from astb_studies.gallery.drawing import LEGEND, figure_of, save
from bench_protocol.units import mbar
from bench_records.plots import ALARM, INK, PALETTE, heading, style
from bench_sim.parameters import load
from diagnosis.contracts import MeasuredRun, Simulator
from diagnosis.finding import Finding, Models

if TYPE_CHECKING:
    from matplotlib.axes import Axes

PALE = "#b9c1c8"
CHANNEL = "left.bellows_pressure"
#: Number of samples per point: 0.1 s.
MEAN = 20
#: Scores below this lie on the edge.
LEAST = 0.1


def before_and_after(runs: Path, path: Path) -> None:
    """Scores on the left; errors of the left bellows' pressure over the whole run on the right."""
    finding = Finding.from_json((runs / "found" / "finding.json").read_bytes())
    simulator, dataset = read_data([runs / "large_sines"], None, load("astb"))
    with style():
        figure, (bars, errors) = figure_of(3.1, 1, 2, width_ratios=(1.0, 2.0))
        scores = [(one.effect, one.score or 0.0) for one in reversed(finding.scores)]
        named = set(finding.names)
        for row, (name, score) in enumerate(scores):
            bars.plot(max(score, LEAST), row, "o", color=PALETTE[0] if name in named else PALE, markersize=7)
        bars.axvline(finding.threshold, color=ALARM, linewidth=1.1)
        bars.text(finding.threshold, len(scores) - 0.45, "chance ends", color=ALARM, fontsize=8, ha="center")
        bars.set_xscale("log")
        bars.set_xlim(LEAST / 1.5, None)
        bars.set_xticks((1, 10, 100), ("1", "10", "100"))
        bars.minorticks_off()
        bars.set_yticks(range(len(scores)), [name.replace(".", ", ") for name, _ in scores], color=INK)
        bars.grid(visible=False, axis="y")
        bars.set_ylim(-0.5, len(scores) - 0.1)
        bars.set_xlabel("score, standard deviations")
        heading(bars, "Suspects", "")
        _errors(errors, simulator, dataset.runs[0], finding.models)
        save(figure, path)


def _errors(axes: "Axes", simulator: Simulator, run: MeasuredRun, models: Models) -> None:
    channel = [one.name for one in simulator.channels].index(CHANNEL)
    times = run.experiment.time
    for base, own, effects, label, colour in (
        (models.before, models.before_runs, {}, "a sound spring", PALETTE[1]),
        (models.after, models.after_runs, models.effects, "with the hole that was found", PALETTE[0]),
    ):
        predicted = simulator.run(run.experiment, base | own[run.experiment.record], effects)
        error = (predicted - run.outputs)[:, channel] / mbar
        scored = np.flatnonzero(run.scored)
        blocks = scored[: scored.size // MEAN * MEAN].reshape(-1, MEAN)
        axes.plot(
            times[blocks].mean(axis=1), error[blocks].mean(axis=1), label=label, linewidth=1, color=colour
        )
    for line in axes.legend(**LEGEND, loc="upper right", ncols=2).get_lines():
        line.set_linewidth(2.0)
    axes.set_xlabel("s")
    axes.margins(x=0.0, y=0.15)
    heading(axes, "Pressure in the left bellows, model less measured", "mbar")
