"""The drawings of docs/explanation/how-the-diagnosis-works.md.

``python -m astb_studies.benchmarks.diagnosis.explanation_drawings`` makes them again.
"""

from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from astb.menu import experiments
from astb_studies.benchmarks.diagnosis.dense_screening import DenseScreening, dense_screening
from astb_studies.benchmarks.diagnosis.rate_drawings import save
from astb_studies.oscillator import Laboratory, Oscillator
from astb_studies.places import DOCS
from bench_protocol.units import Hz, kN, mm, s
from bench_records.plots import ALARM, INK, PALETTE, SHADE, SOFT, heading, style
from bench_sim.model.effects import CATALOGUE
from bench_sim.parameters import load
from diagnosis.contracts import Array, Effects, MeasuredRun
from diagnosis.engine.config import Config
from diagnosis.systems.air_spring.simulator import AirSpring
from diagnosis.systems.piston_effects import friction_state
from test_plans.loads import AW0
from test_plans.plans.screening import SCREENING
from test_plans.programmes.motions import Part, Programme, Stretch, Wave

if TYPE_CHECKING:
    from matplotlib.axes import Axes

GALLERY: Final = DOCS / "gallery"
SEED: Final = 3
#: Which of the oscillator's runs and channels is drawn, and which samples.
SWEEP, FORCE, WINDOW = 1, 1, (500, 1100)
TRUE, IMITATOR, PALE = PALETTE[0], PALETTE[1], "#b9c1c8"

#: The paper's sine, and the loss in N/m that three things add to it on a spring of so many N/m.
SINE: Final = Wave("vertical", 5 * mm, 1.2 * Hz, 12)
LOSS: Final = 10 * kN
SPRING: Final = 500 * kN
RELAXATION, TRAVEL = 0.13 * s, 3 * mm
CYCLES, POINTS = 20, 1000

#: If less of a footprint is left, the drawing names the parameter that imitates it.
HIDDEN: Final = 0.3

#: The effects in the map of cosines.
COMPARED: Final = (
    "force_gain",
    "pressure_gain",
    "area_slope",
    "discharge",
    "auxiliary_volume",
    "leak.left",
    "leak_laminar.left",
    "heat",
    "maxwell",
    "friction",
    "force_lag",
    "force_latency",
)


def _oscillator(hidden: Effects) -> DenseScreening:
    """Return the oscillator with everything of its catalogue, dense_screening where its base model fits best."""
    simulator = Oscillator()
    runs = Laboratory().measure(SEED, hidden).of("fit")
    return dense_screening(simulator, runs, tuple(simulator.catalogue.values()))


def footprints(path: Path) -> None:
    """Draw two footprints before and after projection on the base model, and compare the rest with the residuals."""
    screened = _oscillator({"coulomb": {"amplitude": 0.5}})
    time = 0.01 * np.arange(*WINDOW)

    def drawn(values: Array) -> Array:
        return screened.of(values, SWEEP)[slice(*WINDOW), FORCE]

    with style():
        from matplotlib.figure import Figure

        figure = Figure(figsize=(9.6, 4.6), layout="constrained")
        axes = figure.subplots(2, 2, sharex=True, sharey="row")
        for k, (name, title, colour) in enumerate(
            (
                ("coulomb", "Dry friction, which is there", TRUE),
                ("maxwell", "Maxwell branch, which is not", IMITATOR),
            )
        ):
            i = screened.best(name)
            size = screened.z[i] / screened.norm[i]
            raw, left = size * screened.footprints[:, i], size * screened.left[:, i]
            above, below = axes[:, k]
            above.plot(time, drawn(raw), color=colour, label="whole change")
            above.plot(
                time,
                drawn(raw - left),
                color=INK,
                linewidth=1.0,
                dashes=(4, 1.6),
                label="imitated by the base model",
            )
            heading(above, title, "force, in σ")
            below.plot(
                time, drawn(screened.errors), color=PALE, linewidth=0.7, label="residual of the base model"
            )
            below.plot(time, drawn(left), color=colour, label="footprint")
            heading(
                below,
                f"footprint: {100 * screened.visible[i]:.0f} % of the change; score {screened.z[i]:.0f}",
                "force, in σ",
            )
            below.set_xlabel("s of the sweep")
            for one in (above, below):
                one.margins(x=0.0)
                one.legend(frameon=False, labelcolor=SOFT, loc="upper right", ncols=2, fontsize=8)
        for row in axes:
            low, high = row[0].get_ylim()
            row[0].set_ylim(low, high + 0.22 * (high - low))
        save(figure, path)


def scores(path: Path) -> None:
    """Draw the scores of all candidates, and the largest score that is expected by chance."""
    found = _oscillator({"coulomb": {"amplitude": 0.04}})
    best = sorted((float(found.z[found.best(name)]), name) for name in found.names)
    largest = found.by_chance(20_000, SEED)
    threshold = float(np.quantile(largest, 1.0 - Config().alpha))
    with style():
        from matplotlib.figure import Figure

        figure = Figure(figsize=(9.6, 3.3), layout="constrained")
        bars, chance = figure.subplots(1, 2, width_ratios=(1.25, 1.0))
        for k, (z, _) in enumerate(best):
            bars.barh(k, z, height=0.62, color=TRUE if z > threshold else PALE)
        bars.set_yticks(range(len(best)), [name.replace("_", " ") for _, name in best], color=INK)
        bars.grid(visible=False, axis="y")
        bars.set_xlabel("score, standard deviations")
        heading(bars, "Hidden: dry friction of 0.04 N", "")
        bins = np.arange(-1.0, 5.5, 0.1)
        chance.hist(largest, bins=bins, density=True, color=PALE, label="largest of all")
        normal = np.linspace(-3.0, 5.4, 200)
        density = np.exp(-0.5 * normal**2) / np.sqrt(2.0 * np.pi)
        chance.plot(normal, density, color=INK, linewidth=1.0, label="a single one")
        chance.set_yticks(())
        chance.set_xlabel("score, standard deviations")
        heading(chance, "Hidden: nothing", f"{len(largest)} draws")
        for axes in (bars, chance):
            axes.axvline(threshold, color=ALARM, linewidth=1.1)
        chance.annotate(
            f"threshold {threshold:.1f}", (threshold, 0.5), (6, 0), "data", "offset points", color=ALARM
        )
        chance.legend(frameon=False, labelcolor=SOFT, loc="upper left")
        save(figure, path)


def one_frequency(path: Path) -> None:
    """Draw three causes with the same loss at 1.2 Hz and 5 mm, at a tenth of the amplitude and over frequency (closed
    forms).
    """
    omega = 2.0 * np.pi * SINE.frequency
    # A whole cycle after the cycles in which friction settles.
    turns = np.arange(CYCLES * POINTS + 1) / POINTS
    x = SINE.amplitude * np.sin(2.0 * np.pi * turns)
    state = friction_state(x, TRAVEL)[-POINTS - 1 :]
    x = x[-POINTS - 1 :]
    branch = LOSS * (1.0 + (omega * RELAXATION) ** 2) / (omega * RELAXATION)
    sliding = LOSS / abs(_stiffness(x, state).imag)
    lag = LOSS / (SPRING * omega)
    laws = (
        ("Maxwell branch", PALETTE[0], lambda w: branch * 1j * w * RELAXATION / (1.0 + 1j * w * RELAXATION)),
        ("displacement read late", PALETTE[2], lambda w: SPRING * 1j * w * lag),
    )
    with style():
        from matplotlib.figure import Figure

        figure = Figure(figsize=(9.6, 3.5), layout="constrained")
        axes = figure.subplots(1, 3, width_ratios=(1.0, 1.0, 1.35))
        for one, frequency in zip(axes, (SINE.frequency, 0.1 * SINE.frequency), strict=False):
            for name, colour, law in laws:
                phase = np.linspace(0.0, 2.0 * np.pi, 400)
                loss = law(2.0 * np.pi * frequency).imag * SINE.amplitude * np.cos(phase)
                broad = {"linewidth": 4.0, "alpha": 0.35} if name == laws[0][0] else {}
                one.plot(SINE.amplitude * np.sin(phase) / mm, loss / kN, color=colour, **broad)
            rubbed = sliding * (state - _stiffness(x, state).real * x)
            one.plot(x / mm, rubbed / kN, color=PALETTE[1])
            one.set_xlabel("displacement, mm")
            one.set_ylim(-0.066, 0.066)
            heading(one, f"{frequency:g} Hz", "force out of phase, kN")
        frequencies = np.geomspace(0.05, 10.0, 200)
        loss_axes = axes[2]
        for name, colour, law in laws:
            loss_axes.plot(frequencies, law(2.0 * np.pi * frequencies).imag / kN, color=colour, label=name)
        loss_axes.axhline(LOSS / kN, color=PALETTE[1], linewidth=1.2, label="Berg's friction")
        force_late = (SPRING / (1.0 + 1j * 2.0 * np.pi * frequencies * lag)).imag
        loss_axes.plot(
            frequencies, force_late / kN, color=PALETTE[2], dashes=(4, 1.6), label="force read late"
        )
        loss_axes.axvline(SINE.frequency, color=SOFT, linewidth=0.8, dashes=(1.2, 1.2))
        loss_axes.set_xscale("log")
        loss_axes.set_xticks((0.1, 1.0, 10.0), ("0.1", "1", "10"))
        loss_axes.set_xlim(0.05, 10.0)
        loss_axes.set_ylim(-25.0, 32.0)
        loss_axes.set_xlabel("Hz")
        heading(loss_axes, "Loss over frequency", "K'', kN/m")
        loss_axes.legend(frameon=False, labelcolor=SOFT, loc="lower left", fontsize=8)
        save(figure, path)


def _stiffness(x: Array, force: Array) -> complex:
    """First harmonic of a force over that of its displacement, of one cycle whose last point is its first."""
    turn = np.exp(-2j * np.pi * np.arange(POINTS) / POINTS)
    return complex((force[:-1] @ turn) / (x[:-1] @ turn))


def alike(path: Path) -> None:
    """Cosines of the footprints after projection, for a single sine and for two sections of the screening."""
    simulator = AirSpring(load("astb"), effects=CATALOGUE)
    sine = experiments({"sine": Programme("sine", "One sine", (Part(AW0, (Stretch((SINE,)),)),), "")})
    screening = experiments({"screening": SCREENING})
    cases = (
        ("One sine, empty car", sine, "o"),
        ("Two stretches, both loads", (screening[0], screening[4]), "D"),
    )
    rng = np.random.default_rng(SEED)
    deviations = np.array([channel.noise for channel in simulator.channels])
    with style():
        from matplotlib.figure import Figure

        figure = Figure(figsize=(9.6, 4.3), layout="constrained")
        *maps, rest = figure.subplots(1, 3, sharey=True, width_ratios=(1.0, 1.0, 0.62))
        for axes, (title, chosen, marker) in zip(maps, cases, strict=True):
            runs = []
            for experiment in chosen:
                outputs = simulator.run(experiment, {}, {})
                outputs = outputs + deviations * rng.standard_normal(outputs.shape)
                everywhere = np.ones(len(outputs), dtype=bool)
                runs.append(MeasuredRun(experiment, outputs, everywhere, ~everywhere))
            screened = dense_screening(simulator, runs, [simulator.catalogue[name] for name in COMPARED])
            _map(axes, screened.alike, title)
            filled = "none" if marker == "o" else PALETTE[0]
            left = [screened.visible[screened.most_visible(name)] for name in COMPARED]
            label = "one sine" if marker == "o" else "two stretches"
            rest.plot(left, range(len(left)), marker, color=PALETTE[0], mfc=filled, markersize=5, label=label)
        for k, name in enumerate(COMPARED):
            i = screened.most_visible(name)
            if screened.visible[i] < HIDDEN:
                what = screened.imitators[i].rpartition(".")[2].replace("_", " ")
                rest.text(1.7, k, what, va="center", color=SOFT, fontsize=7.5)
        maps[0].set_yticks(range(len(COMPARED)), COMPARED, color=INK)
        rest.set_xscale("log")
        rest.set_xlim(1e-3, 1.4)
        rest.set_xticks((1e-3, 1e-2, 1e-1, 1.0), ("0.1 %", "1 %", "10 %", "100 %"))
        rest.legend(
            frameon=False, labelcolor=SOFT, loc="upper center", bbox_to_anchor=(0.5, -0.09), fontsize=8
        )
        rest.set_title("Left of it; most taken by", loc="left", fontsize=8.5, fontweight="bold", pad=5)
        save(figure, path)


def _map(axes: "Axes", cosines: Array, title: str) -> None:
    from matplotlib.colors import LinearSegmentedColormap
    from matplotlib.patches import Rectangle

    colours = LinearSegmentedColormap.from_list("alike", ["#ffffff", "#c6dcea", PALETTE[0], "#00334f"])

    def cell(x: int, y: int, colour: Any) -> Rectangle:
        return Rectangle((x - 0.47, y - 0.46), 0.94, 0.92, facecolor=colour, linewidth=0)

    for i, row in enumerate(cosines):
        for j, cosine in enumerate(row):
            if i == j:
                axes.add_patch(cell(j, i, SHADE))
                continue
            axes.add_patch(cell(j, i, colours(min(cosine, 1.0) ** 2)))
            if cosine > 0.9:
                text = f"{cosine:.2f}".removeprefix("0")
                axes.text(j, i, text, ha="center", va="center", fontsize=6, color="white")
    axes.set_xlim(-0.5, len(cosines) - 0.5)
    axes.set_ylim(len(cosines) - 0.5, -0.5)
    axes.set_xticks(
        range(len(COMPARED)), COMPARED, rotation=60, ha="right", rotation_mode="anchor", color=INK
    )
    axes.grid(visible=False)
    axes.set_title(title, loc="left", fontsize=8.5, fontweight="bold", pad=5)
    for edge in axes.spines.values():
        edge.set_visible(False)


def main() -> None:
    """Draw all."""
    footprints(GALLERY / "diagnosis-footprints.svg")
    scores(GALLERY / "diagnosis-scores.svg")
    one_frequency(GALLERY / "diagnosis-one-frequency.svg")
    alike(GALLERY / "diagnosis-alike.svg")


if __name__ == "__main__":
    main()
