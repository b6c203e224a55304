"""Draw the figure of docs/tutorials/diagnose-measured-data.md: python tools/tutorial_figures.py."""

from pathlib import Path

import matplotlib as mpl
import numpy as np

from diagnosis.engine.diagnose import diagnose
from diagnosis.systems.mapping import read_mapped

mpl.use("Agg")
from matplotlib import pyplot as plt

TUTORIALS = Path(__file__).parents[1] / "docs" / "tutorials"
DEMOS = Path(__file__).parents[1] / "astb" / "data" / "demos"
SEALS = {"NAPN": "#c0392b", "O-ring": "#2471a3", "PK": "#1e8449"}
BAR, MM = 1e5, 1e-3


def half_loops(simulator, dataset) -> tuple[list[float], list[float]]:
    """Return for each run the mean pressure (bar), and half of the force difference between in-stroke and out-stroke
    (N).
    """
    pressures, halves = [], []
    for run in dataset.runs:
        left = (run.outputs - simulator.run(run.experiment, {}, {}))[:, 0]
        speed = run.experiment.inputs["speed"]
        inwards, outwards = (run.scored & np.isfinite(left) & side for side in (speed > 2e-3, speed < -2e-3))
        pressures.append(float(run.experiment.inputs["pressure"].mean() / BAR))
        halves.append(0.5 * float(np.median(left[inwards]) - np.median(left[outwards])))
    return pressures, halves


def main() -> None:
    plt.rcParams.update({"font.size": 9, "svg.hashsalt": "astb", "svg.fonttype": "none"})
    figure, (loop, law) = plt.subplots(1, 2, figsize=(9.0, 3.6), layout="constrained")
    for seal, colour in SEALS.items():
        simulator, dataset = read_mapped(
            sorted((DEMOS / "piston").glob(f"friction__{seal}_*bar.csv")),
            DEMOS / "piston" / "piston.toml",
        )
        pressures, halves = half_loops(simulator, dataset)
        law.plot(pressures, halves, "o", color=colour, ms=3.5, mfc="none", label=seal)
        fitted = [run.role == "fit" for run in dataset.runs]
        line = np.polynomial.Polynomial.fit(np.array(pressures)[fitted], np.array(halves)[fitted], 1)
        law.plot((0.0, 7.5), line(np.array((0.0, 7.5))), color=colour, lw=1.0)
        if seal == "PK":
            models = diagnose(dataset, simulator).models
            run = dataset.of("report")[2]
            x = run.experiment.inputs["displacement"] / MM
            area = simulator.run(run.experiment, {}, {})
            before = simulator.run(run.experiment, models.before, {})
            after = simulator.run(run.experiment, models.after, models.effects)
            for outputs, style, title in (
                (run.outputs, {"color": "0.2", "lw": 0.8}, "measured, 7 bar"),
                (before, {"color": "0.6", "lw": 1.2, "ls": "--"}, "before: F = p·A"),
                (after, {"color": colour, "lw": 1.2}, "after: with the cause found"),
            ):
                loop.plot(x[run.scored], (outputs - area)[run.scored, 0], label=title, **style)
    loop.set(xlabel="displacement in mm", ylabel="F − p·A in N", title="A stroke that no fit has seen (PK)")
    law.set(
        xlabel="gauge pressure in bar", ylabel="half the loop in N", title="Friction grows with the pressure"
    )
    law.axvspan(6.5, 7.5, color="0.93", zorder=0)
    law.text(7.0, 0.5, "report", ha="center", color="0.4")
    law.set(xlim=(0.0, 7.5), ylim=(0.0, None))
    for axes in (loop, law):
        axes.legend(frameon=False, fontsize=8)
        axes.spines[["top", "right"]].set_visible(False)
    figure.savefig(TUTORIALS / "measured-friction.svg", metadata={"Date": None})


if __name__ == "__main__":
    main()
