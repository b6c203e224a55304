"""`astb diagnose`: compares measured data with a model, finds errors and their causes, and extends the model."""

from collections.abc import Callable, Collection, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Final

from astb.extend import write_extended
from astb.frames_import import columns_of_frames
from astb.menu import experiments
from astb.stiffness import StiffnessChecks
from bench_protocol.dimensions import ordinary
from bench_protocol.os_errors import reason
from bench_protocol.suggestion import did_you_mean
from bench_records.record import read
from bench_sim.model.effects import CATALOGUE
from bench_sim.parameters import ParameterError, load
from bench_sim.parameters.dimensions import built_as, dimensions_of
from diagnosis.contracts import Dataset, DiagnosisError, Experiment, Role, Simulator
from diagnosis.engine.config import Config
from diagnosis.engine.diagnose import diagnose
from diagnosis.engine.summary import TESTING
from diagnosis.estimates import decimals, in_words
from diagnosis.finding import Cause, Estimate, Finding, Provenance, Rival, Suspect, Verdict
from diagnosis.report.page import first_screen, headline, write_report
from diagnosis.systems.air_spring.simulator import AirSpring
from diagnosis.systems.fmu.simulator import FmuSimulator
from diagnosis.systems.fmu.written import PARAMETERS, VALUES, write_found
from diagnosis.systems.mapping import read_mapped
from diagnosis.systems.records import dataset_of
from test_plans.description import Description
from test_plans.plans.screening import SCREENING
from test_plans.plans.separating import MENU

if TYPE_CHECKING:
    from rich.console import Console

    from bench_records.record import Record
    from bench_sim.parameters import Parameters
    from diagnosis.engine.config import Config
    from test_plans.description import Description

FINDING: Final = "finding.json"
REPORT: Final = "report.html"
EXTENDED: Final = "extended.toml"
#: The model that is tested by default.
BENCH: Final = "astb"

Progress = Callable[[str, float], None]


@dataclass(frozen=True, slots=True)
class DiagnosisRequest:
    """The request of a diagnosis: data, the map of foreign files, the model to test, and the candidate effects (None:
    all).

    ``simulator`` is a user's simulator, "package.module:factory", instead of the bench and its ``model``.
    """

    data: Sequence[Path]
    map_path: Path | None
    simulator: str | None
    model: str
    effects: str | None
    seed: int


def diagnose_data(request: DiagnosisRequest, out: Path, console: "Console") -> Finding:
    """Run the requested diagnosis, and write all results into ``out``.

    Raises DiagnosisError, RecordError or ParameterError; the text names the file, the value and the correct form.
    """
    for path in request.data:
        if not path.exists():
            raise DiagnosisError(f"{path} does not exist; check the path")
    if request.simulator is not None and request.model != BENCH:
        raise DiagnosisError(
            f"--model {request.model} and --simulator {request.simulator} name two different models; give only one of "
            "these options"
        )
    parameters = load(request.model)
    clear_results(out)
    with progress_bar(console) as progress:
        progress("reading the data", 0.0)
        simulator, dataset = read_data(request.data, request.map_path, parameters, request.simulator)
        config = Config(
            seed=request.seed, effects=chosen_effects(request.effects, simulator, parameters.effects)
        )
        return conclude(simulator, dataset, config, request.model, out, progress)


def conclude(
    simulator: Simulator,
    dataset: Dataset,
    config: "Config",
    model: str,
    out: Path,
    progress: Progress,
) -> Finding:
    """Diagnose, and write finding and report into ``out``. Also write the extended ``model`` of a bench if an effect
    was added to it, or the values of an FMU.

    For a bench, the finding also ranks further runs by how well they separate the causes, and predicts stiffness and
    damping in other plans.
    """
    further: tuple[Experiment, ...] = ()
    checks: StiffnessChecks | None = None
    if bench := isinstance(simulator, AirSpring):
        rig = rig_of(simulator.parameters)
        further, checks = experiments(MENU, rig=rig), StiffnessChecks(rig)
    finding = diagnose(dataset, simulator, config, progress, further, checks)
    (out / FINDING).write_bytes(finding.to_json())
    write_report(finding, out / REPORT)
    if bench and finding.models.effects:
        write_extended(out / EXTENDED, finding, model)
    if isinstance(simulator, FmuSimulator):
        write_found(out, finding, simulator)
    return finding


def rig_of(parameters: "Parameters") -> "Description":
    """Return the description of a rig that has the dimensions of a parameter set, in the form that plans read."""
    return Description("the rig", ordinary().built(dimensions_of(parameters)))


def clear_results(out: Path) -> None:
    """Create the directory of results, and remove those of an earlier diagnosis.

    Raises DiagnosisError if it cannot be used.
    """
    try:
        out.mkdir(parents=True, exist_ok=True)
        for name in (FINDING, REPORT, EXTENDED, PARAMETERS, VALUES):
            (out / name).unlink(missing_ok=True)
    except OSError as error:
        raise DiagnosisError(f"{out} cannot be used for the results: {reason(error)}") from None


@contextmanager
def progress_bar(console: "Console") -> Iterator[Progress]:
    """Yield a function that shows progress as a text and a fraction: on a terminal as a bar, otherwise as lines."""
    if not console.is_terminal:
        yield lambda text, done: console.print(f"{done:4.0%} {text}", soft_wrap=True)
        return
    from rich.progress import BarColumn, Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

    columns = (
        SpinnerColumn(),
        BarColumn(),
        TextColumn("{task.percentage:>3.0f} %"),
        TimeElapsedColumn(),
        TextColumn("{task.description}", markup=False),
    )
    with Progress(*columns, console=console, transient=True) as progress:
        task = progress.add_task("", total=1.0)
        yield lambda text, done: progress.update(task, description=text, completed=done)


def read_data(
    paths: Sequence[Path], map_path: Path | None, parameters: "Parameters", own: str | None = None
) -> tuple[Simulator, Dataset]:
    """Return a simulator and the runs to compare with it: records of the bench, or files for a map or a user's
    simulator.

    Runs of the bench get their roles from `with_roles`. Raises DiagnosisError or RecordError, which name the file and
    the correct form.
    """
    if map_path is not None or own is not None:
        return read_mapped(paths, map_path, own, columns_of_frames)
    for path in paths:
        if not path.is_dir():
            raise DiagnosisError(
                f"{path} is not the folder of a run; for other files, give --map FILE, which describes their columns"
            )
    records = [read(path) for path in paths]
    simulator = AirSpring(built_for(parameters, records), effects=CATALOGUE)
    return simulator, with_roles(dataset_of(paths, records, simulator))


def built_for(parameters: "Parameters", records: "Sequence[Record]") -> "Parameters":
    """Return ``parameters`` with the dimensions of the rig that the records state.

    Raises DiagnosisError if the dimensions differ between the records.
    """
    first, *others = ((one.path.parent, _stated_in(one)) for one in records)
    for where, stated in others:
        differ = [name for name in {**first[1], **stated} if first[1].get(name) != stated.get(name)]
        if differ:
            raise DiagnosisError(
                f"the rigs of {where} and {first[0]} have different dimensions: {', '.join(differ)}; diagnose these "
                "runs one by one"
            )
    try:
        return built_as(parameters, first[1])
    except ParameterError as error:
        raise DiagnosisError(f"{first[0]}: {error}") from None


def _stated_in(record: "Record") -> dict[str, float]:
    known = record.meta.get("dimensions", {}).get("known", {})
    return {name: one["value"] for name, one in known.items()}


def with_roles(dataset: Dataset) -> Dataset:
    """Return the dataset with a role for each run. Of each screening, one run selects the model ("select"), one
    validates it ("report"), and the others are fitted ("fit").

    Runs of other plans are fitted. In a complete screening, the two runs that are not fitted have different loads and
    stretches, so that the fit includes every load, and every stretch under at least one load. With few runs, only one
    ("report") or none is not fitted.
    """
    screenings: dict[str, list[str]] = {}
    for run in dataset.runs:
        plan, _, rest = run.experiment.name.partition(" ")
        if plan == SCREENING.name:
            screenings.setdefault(rest.partition(" (")[2], []).append(run.experiment.name)
    roles: dict[str, Role] = {}
    for names in screenings.values():
        roles |= _kept_back(names)
    runs = (replace(run, role=roles.get(run.experiment.name, "fit")) for run in dataset.runs)
    return replace(dataset, runs=tuple(runs))


def _kept_back(names: Sequence[str]) -> dict[str, Role]:
    """Return the roles of those runs of a screening that are not fitted.

    If possible, at least one run under every load is fitted.
    """
    loads: dict[str, list[str]] = {}
    for name in names:
        loads.setdefault(name.split()[2], []).append(name)
    spare = [runs for runs in loads.values() if len(runs) > 1]
    if len(spare) > 1 or (spare and len(spare[0]) > 2):
        return {spare[0][-1]: "select", spare[-1][-2]: "report"}
    last = spare[0][-1] if spare else names[-1]
    return {last: "report"} if len(names) > 1 else {}


def chosen_effects(
    text: str | None, simulator: Simulator, held: Collection[str] = ()
) -> tuple[str, ...] | None:
    """Return the effects named in ``text``, separated by commas; None stands for the whole catalogue.

    A name without a place stands for all places. Raises DiagnosisError for an effect that is not in the catalogue, or
    that is already in the model (``held``).
    """
    if text is None:
        return None
    chosen: dict[str, None] = {}
    for name in (part.strip() for part in text.split(",")):
        found = [one for one in simulator.catalogue if name in {one, one.partition(".")[0]}]
        if not found and (already := [one for one in held if name in {one, one.partition(".")[0]}]):
            raise DiagnosisError(
                f"--effects: the model contains {already[0]} already; name only effects that it does not contain"
            )
        if not found:
            right = did_you_mean(name, simulator.catalogue)
            raise DiagnosisError(f"--effects: {name!r} is not an effect of {simulator.name}; {right}")
        chosen |= dict.fromkeys(found)
    return tuple(chosen)


def show(finding: Finding, out: Path, console: "Console") -> None:
    """Print the finding: doubts, the four parts of its summary, causes with intervals, rivals, remarks on the data, and
    the path of the report.
    """

    def line(text: str, style: str = "") -> None:
        console.print(text, style=style, soft_wrap=True)

    for doubt in finding.doubts:
        line(f"doubtful: {doubt}", "yellow")
    line(headline(finding), "bold")
    for label, text in first_screen(finding):
        line(f"{label}: {text}")
    for one in _candidates(finding):
        line(f"  {one}")
    for run in finding.next_runs[:1]:
        line(f"  command of the next run: astb run {run.experiment.partition(' ')[0]}")
    for one in (*finding.readings, *_checked(finding)):
        line(f"  data: {one}")
    line(f"  model: {finding.provenance.identity or finding.provenance.simulator}")
    line(f"  {_roles(finding.provenance)}")
    if (out / VALUES).exists():
        line(f"  parameters: {out / PARAMETERS}, and {out / VALUES} for other tools")
    line(f"  report: {out / REPORT}")


def _checked(finding: Finding) -> list[str]:
    """Return the results of those data checks that raise no doubt, one line for all columns with the same result."""
    columns: dict[tuple[str, str], list[str]] = {}
    for row in finding.quality:
        if not row.doubt:
            columns.setdefault((row.file, row.found), []).append(row.column)
    return [f"{file}, {', '.join(names)}: {found}" for (file, found), names in columns.items()]


def _candidates(finding: Finding) -> Iterator[str]:
    """Yield a line for each cause and each of its laws, for each alternative cause, and for each cause that was not
    accepted.
    """
    for cause in finding.causes:
        possible = "possible " if finding.verdict is Verdict.AMBIGUOUS else ""
        yield f"{possible}cause: {_described(cause)}"
        for law in cause.laws:
            yield f"another possible law of {cause.phenomenon}: {_described(law)}"
    laws = {(cause.effect, law.effect) for cause in finding.causes for law in cause.laws}
    titles = {cause.effect: cause.title for cause in finding.causes}
    for rival in (one for one in finding.ambiguous_with if (one.instead_of, one.effect) not in laws):
        yield f"possible instead of {titles[rival.instead_of]}: {_described(rival)}"
    for suspect in finding.suspects:
        yield f"not accepted: {_described(suspect)}"


def _roles(of: Provenance) -> str:
    """Return the runs of each role as text."""
    roles: tuple[tuple[Role, list[str]], ...] = (
        ("fit", of.fit),
        ("select", of.select),
        ("report", of.report),
    )
    return "; ".join(f"{TESTING[role]}: {_runs(names)}" for role, names in roles if names)


def _runs(names: Sequence[str], most: int = 4) -> str:
    return ", ".join(names) if len(names) <= most else f"{len(names)} runs"


def _described(one: Cause | Rival | Suspect) -> str:
    values = ", ".join(_estimate(parameter) for parameter in one.parameters)
    return f"{one.title} (effect name {one.effect}): {values}"


def _estimate(one: Estimate) -> str:
    name, unit = in_words(one.name), "" if one.unit == "1" else f" {one.unit}"
    if one.below is not None:
        return f"{name} below {one.below:.2g}{unit} (too small to measure)"
    if one.value is None:
        return f"{name} unknown"
    if one.low is None or one.high is None:
        return f"{name} = {one.value:.4g}{unit}"
    digits = decimals(one.low, one.high)
    return f"{name} = {one.value:.{digits}f}{unit} (95 % interval: {one.low:.{digits}f} to {one.high:.{digits}f})"
