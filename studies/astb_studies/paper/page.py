"""The page of `astb paper`: each figure and table with claim, bench, closed form, deviation and verdict."""

import re
from collections.abc import Callable, Iterator
from concurrent.futures import Executor
from dataclasses import dataclass
from importlib.metadata import version
from math import isnan
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from jinja2 import Environment, FileSystemLoader, StrictUndefined, Template
from markupsafe import Markup

from astb_studies.paper.checks.evaluation import to_json
from astb_studies.paper.closed_form import angular_frequency
from astb_studies.paper.comfort import describe_mean_comfort
from astb_studies.paper.comparisons.comparison import MINUS, comparisons_of
from astb_studies.paper.comparisons.validation import deviations
from astb_studies.paper.experiments import OTHER_RIDES, WIND_SPEEDS
from astb_studies.paper.figures.catalogue import GLOBAL, SECTIONS, draw
from astb_studies.paper.sensitivity import PAPER, PLANT
from astb_studies.paper.stated import spatial_correlation, tables, topologies
from astb_studies.paper.study import FIGURES as DRAWN
from astb_studies.paper.study import IDENTIFIED, ComfortRow, Progress, Study
from astb_studies.paper.subject import Subject
from bench_records.document import Document

if TYPE_CHECKING:
    from collections.abc import Iterable

PAGE: Final = "index.html"
CLAIMS: Final = "claims.json"
TABLE: Final = "comfort.csv"
_HERE: Final = Path(__file__).parent


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
    names = [one.name for one in (*SECTIONS, GLOBAL)]
    futures = {name: executor.submit(draw, name, study, out) for name in names}
    progress(DRAWN, 0, len(futures) + 1)
    drawings = {}
    for ready, (name, future) in enumerate(futures.items(), start=1):
        drawings[name] = future.result()
        progress(DRAWN, ready, len(futures) + 1)
    to_json(study.entries, out / CLAIMS)
    (out / TABLE).write_text(comfort_csv(study), encoding="utf-8", newline="\n")

    rows = list(_rows(study.entries))
    text = _template().render(
        study=study,
        sections=[
            (one.name, one.title, one.caption, comparisons_of(study, one.name), drawings[one.name])
            for one in SECTIONS
        ],
        sensitivity=(GLOBAL.name, GLOBAL.title, GLOBAL.caption, drawings[GLOBAL.name]),
        tables=tables(),
        topologies=topologies(),
        wind=spatial_correlation(),
        indices=[_index_table(study, layer) for layer in ("paper", "plant")],
        claims=[row for row in rows if row.id.startswith("T")],
        checks=[row for row in rows if row.id.startswith("A")],
        tally=_tally(rows),
        identified=list(_identified(study)),
        deviations=[_deviation(one) for one in deviations(study)],
        rides=_ride_table(study),
        omega=f"{_angular_frequency():.2f}",
        other_rides=_other_rides(study),
        plans=[
            *study.bench.results.items(),
            *((name, [one]) for name, one in {**study.bench.combined, **study.bench.rides}.items()),
        ],
        versions={name: version(name) for name in ("astb", "numpy", "scipy", "numba", "matplotlib")},
        identified_file=IDENTIFIED,
        mark=_mark,
        tone=_tone,
    )
    page = out / PAGE
    kind = f"astb paper{' --quick' if study.quick else ''}\u2002·\u2002seed {study.seeds[0]}"
    style = (_HERE / "page.css").read_text(encoding="utf-8")
    document = Document("The paper on the bench", kind, [Markup(text)], style=style)
    page.write_text(document.html(), encoding="utf-8", newline="\n")
    progress(DRAWN, len(futures) + 1, len(futures) + 1)
    return page


def _template() -> Template:
    """Return the template of the page; a missing value is an error."""
    pages = Environment(
        loader=FileSystemLoader(_HERE),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    pages.filters["signed"] = signed
    return pages.get_template("page.html.j2")


# -- tables --------------------------------------------------------------------------------------------------------


def _rows(entries: "Iterable[dict[str, Any]]") -> Iterator[ClaimRow]:
    by_id: dict[str, list[dict[str, Any]]] = {}
    for one in entries:
        by_id.setdefault(one["id"], []).append(one)
    for id_, layers in by_id.items():
        yield ClaimRow(id_, layers[0]["claim"], tuple(layers))


def _tally(rows: list[ClaimRow]) -> dict[str, dict[str, int]]:
    """Return the number of claims and checks by verdict."""
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


def _angular_frequency() -> float:
    """Return ω = 2π V/λ of the track under the car of the table (rad/s)."""
    car = Subject().vehicle.record
    return float(angular_frequency(float(car.train_speed), float(car.track_wavelength)))


def _other_rides(study: Study) -> list[tuple[str, str, str, str, str]]:
    """Return the rows: the change, the load, and at the wind speeds acceleration, index and time on the bump stop."""
    rows: dict[tuple[str, str], dict[float, ComfortRow]] = {}
    for one in study.rides:
        if one.layer in ("plant", *OTHER_RIDES):
            rows.setdefault((one.layer, one.load), {})[one.wind_speed] = one

    def listed(cells: dict[float, ComfortRow], text_of: Callable[[ComfortRow], str]) -> str:
        return " / ".join(text_of(cells[speed]) if speed in cells else "–" for speed in WIND_SPEEDS)

    return [
        (
            "with anti-roll bar" if layer == "plant" else layer,
            load,
            listed(cells, lambda one: f"{one.acceleration:.3f}"),
            listed(cells, lambda one: f"{one.comfort:.2f}"),
            listed(cells, lambda one: f"{100 * one.bump_stop_time:.0f}"),
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
    """Replace hyphens before numbers by minus signs; keep other hyphens."""
    return re.sub(r"(^|[\s(e])-(?=[\d.])", rf"\1{MINUS}", text)
