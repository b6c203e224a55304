"""`astb identify`: estimate the parameters of springs, of an FMU or of any simulator from records, with intervals."""

import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from importlib.metadata import version
from math import ceil, floor
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import msgspec
import numpy as np

from astb.diagnose import BENCH, Progress, progress_bar, read_data, rig_of
from astb.extend import DIGITS, changes_of, interval
from astb.menu import experiments
from astb.tables import open_table
from bench_protocol.os_errors import reason
from bench_protocol.units import litre, mm
from bench_protocol.words import SIDES
from bench_sim.model.layout import Sensor
from bench_sim.model.quantities import SENSOR_QUANTITIES
from bench_sim.parameters import load
from bench_sim.parameters.model_file import Model, write_model
from diagnosis.contracts import DiagnosisError
from diagnosis.engine.identify import Identification, Identified, believed, expected, identify
from diagnosis.estimates import Z95, decimals
from diagnosis.systems.air_spring.identified import (
    ASKED,
    UnknownSpring,
    names_of_shape,
    quantity,
    uncertain_shape,
)
from diagnosis.systems.air_spring.simulator import AirSpring
from diagnosis.systems.fmu.simulator import FmuSimulator
from diagnosis.systems.fmu.written import write_identified
from test_plans.plans.identification import IDENTIFICATION
from test_plans.plans.screening import SCREENING
from test_plans.plans.separating import MENU
from test_plans.specimen import DRAWING

if TYPE_CHECKING:
    from rich.console import Console
    from rich.table import Table

    from bench_sim.parameters import Parameters
    from diagnosis.contracts import Array, Dataset, Simulator
    from test_plans.programmes.motions import Programme
    from test_plans.specimen import Specimen

#: Plans with measured runs, for which the uncertainty of an identification can be predicted.
PROGRAMMES: Final[dict[str, "Programme"]] = {
    one.name: one for one in (IDENTIFICATION, SCREENING, *MENU.values())
}
_OF_SENSORS: Final = frozenset(quantity.name for quantity in SENSOR_QUANTITIES)
#: Possible steps of the heights and lateral displacements at which the shape of a bellows is reported.
_STEPS: Final = (20 * mm, 10 * mm, 5 * mm, 2 * mm, 1 * mm)


@dataclass(frozen=True, slots=True)
class IdentificationRequest:
    """The request of an identification: records, map of foreign files, prior, and a plan for a prediction.

    ``specimen`` is the drawing of the springs and overrides the ``model``; ``simulator`` replaces both.
    """

    data: Sequence[Path]
    map_path: Path | None
    model: str
    specimen: "Specimen | None"
    expect: str | None
    simulator: str | None = None


class Row(msgspec.Struct, frozen=True, kw_only=True):
    """One quantity for display: in its unit, with its 95 % interval and its prior value."""

    name: str
    title: str
    unit: str
    value: float
    low: float
    high: float
    believed_low: float
    believed_high: float
    left: float  #: remaining part of the prior standard deviation
    told: bool


class Shape(msgspec.Struct, frozen=True, kw_only=True):
    """Effective area (m2) and volume (litre) of one bellows at one place (mm), each with its 95 % half width."""

    side: str
    height: float
    shear: float
    area: float
    area_width: float
    volume: float
    volume_width: float


class Answer(msgspec.Struct, frozen=True, kw_only=True):
    """The result of an identification, or the prediction for a run of the plan ``after``."""

    rows: list[Row]
    shapes: list[Shape] = []
    doubts: list[str] = []
    readings: list[str] = []
    further: list[str] = []
    after: str = ""


def identify_data(request: IdentificationRequest, out: Path | None, console: "Console") -> Answer:
    """Run the requested identification, and write the model to ``out`` if given. Without data, return the intervals to
    be expected after a run of the requested plan (default: identification), and write nothing.

    Raises DiagnosisError, RecordError or ParameterError; the text names the file, the value and the correct form.
    """
    if request.simulator is not None:
        _refuse_springs(request, request.simulator)
    parameters = drawn_as(load(request.model), request.specimen)
    ahead = _programme(request.expect) if request.expect else None
    if not request.data:
        return _looked_ahead(parameters, ahead or IDENTIFICATION, console)
    for path in request.data:
        if not path.exists():
            raise DiagnosisError(f"{path} does not exist; check the path")
    if out is not None:
        _make_room(out, request.model)
    with progress_bar(console) as progress:
        progress("read the data", 0.0)
        simulator, dataset = read_data(request.data, request.map_path, parameters, request.simulator)
        if not isinstance(simulator, AirSpring):
            _refuse_springs(request, simulator.name)
            return _of_simulator(simulator, dataset, out, progress)
        found, unknown = identify_springs(dataset, simulator, progress=progress)
        further: list[str] = []
        answer = found
        if ahead:
            progress(f"looking ahead to {ahead.name}", 0.9)
            answer = expected(found, experiments({ahead.name: ahead}, rig=rig_of(unknown.parameters)))
        elif untold := [one for one in _requested_parameters(found) if not one.determined]:
            progress("looking for a run that identifies more parameters", 0.9)
            further = list(_uncertain_parameters(found, untold, unknown.parameters))
    if out is not None:
        write_springs(out, found, dataset, unknown.parameters, request.model)
    return Answer(
        rows=_rows(answer),
        shapes=list(_shapes(found)),
        doubts=list(found.doubts),
        readings=list(dataset.readings),
        further=further,
        after=ahead.name if ahead else "",
    )


def identify_springs(
    dataset: "Dataset", simulator: AirSpring, **options: Any
) -> tuple[Identification, UnknownSpring]:
    """Identify the springs of a dataset, and return the simulator with them; ``options`` are those of `identify`."""
    unknown = UnknownSpring(simulator.parameters, tuple(channel.name for channel in simulator.channels))
    return identify(dataset, unknown, **options), unknown


def _refuse_springs(request: IdentificationRequest, name: str) -> None:
    """Raise DiagnosisError for options that apply only to springs of the bench."""
    given = {
        "--specimen": request.specimen,
        "--expect": request.expect,
        "--model": None if request.model == BENCH else request.model,
    }
    if wrong := [option for option, value in given.items() if value is not None]:
        raise DiagnosisError(
            f"{' and '.join(wrong)}: {name} is not a model of the bench; omit {' and '.join(wrong)}"
        )


def _of_simulator(simulator: "Simulator", dataset: "Dataset", out: Path | None, progress: Progress) -> Answer:
    """Identify all base parameters of a simulator that is no model of the bench, and write them to ``out`` if given."""
    if not simulator.nuisances:
        raise DiagnosisError(
            f"{simulator.name} names no parameter to identify; state [fmu.base] in the map of an FMU, or nuisances in "
            "a simulator"
        )
    found = identify(dataset, simulator, progress=progress)
    if out is not None:
        try:
            write_identified(out, found, simulator, dataset.digest)
        except OSError as error:
            raise DiagnosisError(f"{out} cannot be written: {reason(error)}") from None
    variables = simulator.fmu.variables if isinstance(simulator, FmuSimulator) else {}
    descriptions = {name: one.description for name, one in variables.items()}
    return Answer(
        rows=[_row(one, descriptions.get(one.parameter.name, "")) for one in found.parameters],
        doubts=list(found.doubts),
        readings=list(dataset.readings),
    )


def drawn_as(parameters: "Parameters", specimen: "Specimen | None") -> "Parameters":
    """Return a parameter set with the values of the drawing of a specimen."""
    if specimen is None:
        return parameters
    return parameters.with_values(**{name: getattr(specimen, name) for name in DRAWING})


def _programme(name: str) -> "Programme":
    if name not in PROGRAMMES:
        raise DiagnosisError(f"--expect {name!r} is not possible; possible plans: {', '.join(PROGRAMMES)}")
    return PROGRAMMES[name]


def _looked_ahead(parameters: "Parameters", ahead: "Programme", console: "Console") -> Answer:
    """Predict how well a run would determine the parameters of springs, from a parameter set alone."""
    with progress_bar(console) as progress:
        progress(f"looking ahead to {ahead.name}", 0.0)
        simulator = UnknownSpring(parameters)
        found = believed(simulator, experiments({ahead.name: ahead}, rig=rig_of(parameters)))
    return Answer(rows=_rows(found), after=ahead.name)


def _make_room(out: Path, model: str) -> None:
    """Create the folder of the model. Raises DiagnosisError, before the computation, if ``out`` cannot be written."""
    if out.exists() and Path(model).exists() and out.samefile(model):
        raise DiagnosisError(f"--out {out} is the same file as --model; choose another file")
    try:
        out.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise DiagnosisError(f"{out} cannot be written: {reason(error)}") from None
    if not os.access(out if out.exists() else out.parent, os.W_OK):
        raise DiagnosisError(f"{out} cannot be written: change the permissions, or use another path")


def _rows(found: Identification) -> list[Row]:
    return [_row(one, ASKED[quantity(one.parameter.name)].title) for one in _requested_parameters(found)]


def _requested_parameters(found: Identification) -> list[Identified]:
    return [one for one in found.parameters if quantity(one.parameter.name) in ASKED]


def _uncertain_parameters(
    found: Identification, untold: Sequence[Identified], parameters: "Parameters"
) -> Iterator[str]:
    """Yield a sentence on each parameter in ``untold``, with the expected interval after a run of the identification
    plan.
    """
    runs = experiments({IDENTIFICATION.name: IDENTIFICATION}, rig=rig_of(parameters))
    after = {one.parameter.name: one for one in _requested_parameters(expected(found, runs))}
    for one in untold:
        there = after[one.parameter.name]
        what = (
            f"{one.parameter.name} is not determined by these records: its interval is still {one.share:.0%} of the "
            "prior interval"
        )
        yield what + (
            f"; after astb run {IDENTIFICATION.name}, {there.share:.1%} is expected"
            if there.determined
            else f"; astb run {IDENTIFICATION.name} would not determine this parameter either ({there.share:.0%})"
        )


def _shapes(found: Identification) -> Iterator[Shape]:
    """Yield the shape of each bellows over the range of heights and lateral displacements in the runs."""
    runs = [run.experiment for run in found.model.replay.runs]
    shears = [run.inputs["shear"] for run in runs if "shear" in run.inputs]
    for side in SIDES:
        values, covariance = found.joint(names_of_shape(side))
        heights = _grid([run.inputs[f"{side}.height"] for run in runs])
        places = [(height, 0.0) for height in heights]
        places += [(0.0, shear) for shear in _grid(shears) if shear]
        for height, shear in places:
            (area, volume), widths = uncertain_shape(values, covariance, height, shear)
            yield Shape(
                side=side,
                height=height / mm,
                shear=shear / mm,
                area=float(area),
                area_width=float(Z95 * widths[0]),
                volume=float(volume / litre),
                volume_width=float(Z95 * widths[1] / litre),
            )


def _grid(visited: "Sequence[Array]") -> list[float]:
    """Return round numbers (m) over the range of the data."""
    if not visited:
        return [0.0]
    low, high = min(float(one.min()) for one in visited), max(float(one.max()) for one in visited)
    step = next((one for one in _STEPS if high - low > 3.0 * one), _STEPS[-1])
    return [k * step for k in range(ceil(low / step), floor(high / step) + 1)]


def _row(one: Identified, title: str) -> Row:
    parameter, scale = one.parameter, one.parameter.scale
    width, wide = Z95 * one.deviation, Z95 * parameter.spread
    return Row(
        name=parameter.name,
        title=title,
        unit=parameter.display or parameter.unit,
        value=one.value / scale,
        low=(one.value - width) / scale,
        high=(one.value + width) / scale,
        believed_low=(parameter.nominal - wide) / scale,
        believed_high=(parameter.nominal + wide) / scale,
        left=one.share,
        told=one.determined,
    )


def write_springs(
    path: Path, found: Identification, dataset: "Dataset", parameters: "Parameters", based_on: str
) -> None:
    """Write the identified model, with the interval of each parameter as a comment. Raises DiagnosisError if the file
    cannot be written.
    """
    asked = _requested_parameters(found)
    base = based_on if Path(based_on).suffix != ".toml" else os.path.relpath(based_on, path.parent)
    stated, effects = _stated(parameters, load(based_on))
    changes = stated | changes_of({one.parameter.name: one.value for one in asked}, parameters)
    model = Model(base, changes, effects, _provenance(asked, found, dataset))
    try:
        write_model(path, model, {"change": _notes(asked)}, DIGITS)
    except OSError as error:
        raise DiagnosisError(f"{path} cannot be written: {reason(error)}") from None


def _stated(
    parameters: "Parameters", base: "Parameters"
) -> tuple[dict[str, Any], dict[str, dict[str, float]]]:
    """Return the parameters and the effects of ``parameters`` that differ from ``base``, because of a map, a drawing or
    the rig.
    """
    changes: dict[str, Any] = {}
    for name, entry in parameters.entries.items():
        value, before = np.asarray(entry.value), np.asarray(base.entries[name].value)
        if np.array_equal(value, before):
            continue
        if name in _OF_SENSORS:
            differs = [one for one in Sensor if value[one] != before[one]]
            changes[name] = {one.name.lower(): float(value[one]) for one in differs}
        else:
            changes[name] = value.tolist()
    effects = {name: dict(values) for name, values in parameters.effects.items() if name not in base.effects}
    return changes, effects


def _notes(asked: Sequence[Identified]) -> dict[str, str]:
    notes: dict[str, str] = {}
    for one in asked:
        row, name = _row(one, ""), quantity(one.parameter.name)
        side = one.parameter.name.removesuffix(name).rstrip(".")
        text = f"{side} {interval(row.low, row.high, row.unit)}".strip()
        text += "" if one.determined else ", hardly determined by the records"
        notes[name] = f"{notes[name]}; {text}" if name in notes else text
    return notes


def _provenance(asked: Sequence[Identified], found: Identification, dataset: "Dataset") -> dict[str, Any]:
    return {
        "kind": "identification",
        "data": dataset.digest,
        "runs": [run.experiment.name for run in found.model.replay.runs],
        "deviations": {one.parameter.name: float(f"{one.deviation:.3g}") for one in asked},
        "not_told": [one.parameter.name for one in asked if not one.determined],
        "versions": {package: version(package) for package in ("astb", "numpy", "scipy")},
    }


def show(answer: Answer, out: Path | None, console: "Console") -> None:
    """Print doubts, the table of parameters, the undetermined quantities, and the path of the model."""
    for text in answer.readings:
        console.print(text, soft_wrap=True)
    for doubt in answer.doubts:
        console.print(f"doubtful: {doubt}", style="yellow", soft_wrap=True)
    title = (
        f"Expected accuracy with {answer.after}" if answer.after else "Parameters determined by the records"
    )
    table = open_table(
        title, "parameter", "value", "95 %", "unit", "of prior", "what it is", whole=("parameter",)
    )
    for row in answer.rows:
        digits = max(decimals(row.low, row.high), 0)
        table.add_row(
            row.name,
            f"{row.value:.{digits}f}",
            f"{row.low:.{digits}f} to {row.high:.{digits}f}",
            row.unit.removesuffix("1") if row.unit == "1" else row.unit,
            f"{row.left:.1%}" if row.told else f"{row.left:.0%}, not determined",
            row.title,
        )
    console.print(table)
    if answer.shapes:
        console.print(_table_of_shapes(answer.shapes))
    for text in answer.further:
        console.print(text, soft_wrap=True)
    if out is not None:
        console.print(f"  model: {out}", soft_wrap=True)


def _table_of_shapes(shapes: Sequence[Shape]) -> "Table":
    columns = ("spring", "height, mm", "lateral, mm", "effective area, m2", "±", "volume, litre", "±")
    table = open_table("Effective area and volume in the measured range", *columns)
    for one in shapes:
        area, volume = (max(decimals(0.0, 2.0 * width), 0) for width in (one.area_width, one.volume_width))
        table.add_row(
            one.side,
            f"{one.height:.1f}",
            f"{one.shear:.1f}",
            f"{one.area:.{area}f}",
            f"{one.area_width:.{area}f}",
            f"{one.volume:.{volume}f}",
            f"{one.volume_width:.{volume}f}",
        )
    return table
