"""The page of `astb paper`: each figure and table with claim, bench, closed form, deviation and verdict."""

import re
from collections.abc import Iterator
from concurrent.futures import Executor
from dataclasses import dataclass
from importlib.metadata import version
from math import isnan
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from paper_study.checks.evaluation import to_json
from paper_study.comparisons.catalogue import COMPARISONS
from paper_study.comparisons.comparison import MINUS
from paper_study.comparisons.validation import deviations
from paper_study.experiments import OTHER_RIDES
from paper_study.figures.catalogue import draw
from paper_study.sensitivity import PAPER, PLANT, SPREAD
from paper_study.study import FIGURES as DRAWN
from paper_study.study import IDENTIFIED, ComfortRow, Progress, Study
from paper_study.subject import Subject

if TYPE_CHECKING:
    from collections.abc import Iterable

PAGE: Final = "index.html"
CLAIMS: Final = "claims.json"
TABLE: Final = "comfort.csv"

#: The figures in the paper's order: file, heading, what one sees.
SECTIONS: Final = (
    (
        "figure-05",
        "Figure 5. Track excitation",
        "Equation (24) for four amplitudes (a) and three angular frequencies (b). The points are the"
        " platform of the bench in the plan <code>aw0</code>, as its own transducer reports them at 50"
        " Hz.",
    ),
    (
        "figure-06",
        "Figure 6. What the bench measures",
        "(a, b) First harmonic of the lateral force over that of the displacement at 0.5 Hz, half of"
        " the pair's, under five preloads around each load case, each on shims of its own. (c) Vertical"
        " damping c = K″/ω for four pairs of orifice plates; the pressure ratio is the lowest of a"
        " cycle, and the amplitude (1 to 25 mm) is what changes it. The dashed lines of (c) are equation"
        " (19), for which the ratio is a free choice.",
    ),
    (
        "figure-07",
        "Figure 7. Identified effective area and equivalent volume",
        "The chambers are shut off and the springs sheared step by step, so that the mass of gas in the"
        " bellows stays: A = F<sub>z</sub>/p, V ∝ T/p. The fit takes both loads, the forces and the"
        " zeros of the transducers at once. The paper's volume grows. That of a bellows cannot: it would"
        " push itself off its centre.",
    ),
    (
        "figure-08",
        "Figure 8. Model against experiment, and what a deviation proves",
        "(a, b, c) The plant's model with the parameters that were identified from these records, put"
        " to the pressures and amplitudes that the bench reached. Dotted in (c): the same with the"
        " orifice alone, as in the paper; it lies below the bench by the few per cent that the rubber"
        " adds. (d, e, f) At 1.2 Hz and 5 mm three things look alike: the rubber, 5 ms between the"
        " channels of force and displacement, and a C<sub>d</sub> that is believed 5 % too large. The"
        " frequency sweep (d) tells the lag, which grows without end, and C<sub>d</sub>, which changes"
        " its sign; the amplitude sweep (e) tells C<sub>d</sub> again; and in the force from which"
        " pressure times area is taken off (f) the orifice leaves next to nothing: what stays there is"
        " rubber if it is flat, and lag if it rises with the frequency. A single frequency proves none"
        " of them.",
    ),
    (
        "figure-09",
        "Figure 9. Lateral displacement",
        "(a) Secant F/y on the way out, bellows shut off, friction and all; dotted what the model has"
        " without friction. (b) A motion of 1 mm at 2 Hz about each offset, both chambers joined: what"
        " the secant hides.",
    ),
    (
        "figure-10",
        "Figure 10. Roll angle",
        "Both springs stand 20 mm aside and are rolled to both sides, the differential pressure valve"
        " isolated (filled) and open (hollow). The secant rises for one sign of roll and falls for the"
        " other. The first harmonic of 5 mm about that place does not rise at all. Below: how far the"
        " pressures of the two sides part, and where the valve joins them.",
    ),
    (
        "figure-11",
        "Figure 11. Frequency",
        "Amplitude 5 mm where piston speed and force allow it; laterally it becomes less beyond 10 Hz,"
        " and friction makes a spring stiffer at a smaller amplitude. The hollow points at 0.9 mm show"
        " frequency alone. “Pipe” is the connecting pipe of 1.5 m × 50 mm with a plate of 30 mm. Below"
        " 0.3 Hz the heat that the gas exchanges with its walls makes c = K″/ω grow without end.",
    ),
    (
        "comfort",
        "Table. Acceleration of the car body and ride comfort",
        "Half a car at 100 km/h, with 5 mm of track excitation and gusts from a spectrum: rms of the"
        " lateral acceleration at the floor, and N = 6 a<sub>YP95</sub> (ENV 12299, W<sub>d</sub>, 5-s"
        " rms values, 95th percentile of five minutes). Solid: the car of three degrees of freedom on"
        " the plant's springs, with the anti-roll bar of the benchmark car that its masses and heights come"
        " from; dotted: the same car without the bar. Dashed: the paper's equation (28).",
    ),
)

GLOBAL: Final = (
    "sensitivity",
    "Global sensitivity of the geometric parameters",
    "Sobol indices (<code>scipy.stats.sobol_indices</code>): the share of an output's variance that"
    " comes from a parameter, alone (first order) or with what it does together with others (total)."
    f" Each parameter is spread evenly over ± {100 * SPREAD:.0f} % (assumed), AW0, and the load stays: a"
    " larger effective area is a lower pressure. At the paper's pressure ratio of 0.98 its orifice"
    " stands at the maximum of its damping and moves nothing.",
)


@dataclass(frozen=True, slots=True)
class ClaimRow:
    """One claim or check with the layers in which it was evaluated."""

    id: str
    claim: str
    layers: tuple[dict[str, Any], ...]

    @property
    def verdict(self) -> str:
        """The layers in which it holds, in words."""
        held = [one["layer"] for one in self.layers if one["holds"]]
        if not held:
            return "does not hold"
        if len(held) == len(self.layers):
            return "holds" if len(held) == 1 else "holds in both"
        return f"{held[0]} only"


def write(executor: Executor, study: Study, out: Path, progress: Progress) -> Path:
    """Draw the figures and write page, claims and table into ``out``; return the page."""
    from bench_records.templates import environment

    names = [name for name, _, _ in (*SECTIONS, GLOBAL)]
    futures = {name: executor.submit(draw, name, study, out) for name in names}
    progress(DRAWN, 0, len(futures) + 1)
    drawings = {}
    for ready, (name, future) in enumerate(futures.items(), start=1):
        drawings[name] = future.result()
        progress(DRAWN, ready, len(futures) + 1)
    to_json(study.entries, out / CLAIMS)
    (out / TABLE).write_text(comfort_csv(study), encoding="utf-8", newline="\n")

    pages = environment(Path(__file__).parent)
    pages.filters["signed"] = signed
    rows = list(_rows(study.entries))
    text = pages.get_template("page.html.j2").render(
        study=study,
        sections=[
            (name, title, caption, COMPARISONS[name](study), drawings[name])
            for name, title, caption in SECTIONS
        ],
        sensitivity=(*GLOBAL, drawings[GLOBAL[0]]),
        indices=[_index_table(study, layer) for layer in ("paper", "plant")],
        claims=[row for row in rows if row.id.startswith("T")],
        checks=[row for row in rows if row.id.startswith("A")],
        tally=_tally(rows),
        identified=list(_identified(study)),
        deviations=[_deviation(one) for one in deviations(study)],
        rides=_ride_table(study),
        other_rides=_other_rides(study),
        plans=[(plan, results) for plan, results in study.bench.results.items()],
        versions={name: version(name) for name in ("astb", "numpy", "scipy", "numba", "matplotlib")},
        identified_file=IDENTIFIED,
        mark=_mark,
        tone=_tone,
    )
    page = out / PAGE
    page.write_text(text, encoding="utf-8", newline="\n")
    progress(DRAWN, len(futures) + 1, len(futures) + 1)
    return page


# -- tables --------------------------------------------------------------------------------------------------------


def _rows(entries: "Iterable[dict[str, Any]]") -> Iterator[ClaimRow]:
    by_id: dict[str, list[dict[str, Any]]] = {}
    for one in entries:
        by_id.setdefault(one["id"], []).append(one)
    for id_, layers in by_id.items():
        yield ClaimRow(id_, layers[0]["claim"], tuple(layers))


def _tally(rows: list[ClaimRow]) -> dict[str, dict[str, int]]:
    """Count how many claims and checks hold how far."""
    counts: dict[str, dict[str, int]] = {"claims": {}, "checks": {}}
    for row in rows:
        kind = counts["claims" if row.id.startswith("T") else "checks"]
        verdict = "holds" if row.verdict.startswith("holds") else row.verdict
        kind[verdict] = kind.get(verdict, 0) + 1
    return counts


def _tone(verdict: str) -> str:
    """Return the CSS class that colours a verdict."""
    if verdict.startswith("holds"):
        return "pass"
    return "fail" if verdict == "does not hold" else "partly"


def _mark(verdict: str) -> str:
    return {"pass": "✓", "partly": "◐", "fail": "✗"}[_tone(verdict)]


def _identified(study: Study) -> Iterator[tuple[str, str, str, str, str]]:
    """Yield name, identified value, interval, plant's value and unit, in the unit of the parameter file."""
    entries = Subject().parameters("AW0").entries
    for name, one in study.identified.parameters.items():
        entry = entries[name]
        true = float(entry.value.flat[0]) / entry.scale
        value, low, high = (number / entry.scale for number in (one.value, one.low, one.high))
        inside = "" if low <= true <= high else " (outside)"
        yield name, f"{value:.4g}", f"{low:.4g} to {high:.4g}", f"{true:.4g}{inside}", entry.unit


def _deviation(one: Any) -> tuple[str, ...]:
    def shown(share: float, signed: bool = False) -> str:
        if isnan(share):
            return "–"
        return f"{100 * share:+.1f}".replace("-", MINUS) if signed else f"{100 * share:.1f}"

    return (
        one.panel,
        one.curve,
        shown(one.model),
        shown(one.model_worst, signed=True),
        shown(one.without_rubber),
        shown(one.closed),
    )


def _ride_table(study: Study) -> list[dict[str, Any]]:
    """Return one row per wind speed and load, both layers side by side."""
    from paper_study.comfort import describe_mean_comfort

    def with_width(value: float, width: float, digits: int) -> str:
        return f"{value:.{digits}f}" + ("" if isnan(width) else f" ± {width:.{digits}f}")

    plant = {(one.load, one.wind_speed): one for one in study.rides if one.layer == "plant"}
    paper = {(one.load, one.wind_speed): one for one in study.rides if one.layer == "paper"}
    return [
        {
            "load": load,
            "speed": f"{speed:g}",
            "a": with_width(one.acceleration, one.acceleration_width, 4),
            "peak": f"{one.peak:.2f}",
            "N": with_width(one.comfort, one.comfort_width, 3),
            "word": describe_mean_comfort(one.comfort),
            "y": f"{1e3 * one.displacement:.0f}",
            "stop": f"{100 * one.bump_stop_time:.0f}",
            "paper_a": f"{paper[load, speed].acceleration:.4f}",
            "paper_N": f"{paper[load, speed].comfort:.3f}",
        }
        for (load, speed), one in plant.items()
    ]


def _other_rides(study: Study) -> list[tuple[str, str, str, str, str]]:
    """Return what was changed, load, and at the wind speeds: acceleration, index, time on the bump stop."""
    rows: dict[tuple[str, str], list[ComfortRow]] = {}
    for one in study.rides:
        if one.layer in ("plant", *OTHER_RIDES):
            rows.setdefault((one.layer, one.load), []).append(one)
    return [
        (
            "with anti-roll bar" if layer == "plant" else layer,
            load,
            " / ".join(f"{one.acceleration:.3f}" for one in cells),
            " / ".join(f"{one.comfort:.2f}" for one in cells),
            " / ".join(f"{100 * one.bump_stop_time:.0f}" for one in cells),
        )
        for (layer, load), cells in rows.items()
    ]


def comfort_csv(study: Study) -> str:
    """Return the comfort table as comma-separated values, SI."""
    head = (
        "layer,load,wind_speed,acceleration_rms,acceleration_half_width,acceleration_peak,comfort_index,"
        "comfort_half_width,mean_lateral_displacement,bump_stop_time"
    )
    lines = [
        ",".join(
            [one.layer, one.load]
            + [
                "" if isnan(value) else f"{value:.6g}"
                for value in (
                    one.wind_speed,
                    one.acceleration,
                    one.acceleration_width,
                    one.peak,
                    one.comfort,
                    one.comfort_width,
                    one.displacement,
                    one.bump_stop_time,
                )
            ]
        )
        for one in study.rides
    ]
    return "\n".join([head, *lines, ""])


def _index_table(study: Study, layer: str) -> dict[str, Any]:
    """Return the total indices of one layer with the half width of their intervals, one row for each parameter."""
    found = study.sensitivity[layer]
    names = PAPER if layer == "paper" else PLANT
    return {
        "layer": layer,
        "outputs": found.outputs,
        "samples": found.samples,
        "rows": [
            (
                names[name],
                [
                    f"{found.total[k, j]:.2f} ± {0.5 * (found.total_high[k, j] - found.total_low[k, j]):.2f}"
                    for k in range(len(found.outputs))
                ],
            )
            for j, name in enumerate(found.parameters)
        ],
    }


def signed(text: str) -> str:
    """Put a proper minus before numbers, and leave hyphens alone."""
    return re.sub(r"(^|[\s(e])-(?=[\d.])", rf"\1{MINUS}", text)
