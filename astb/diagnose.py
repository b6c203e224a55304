"""`astb diagnose`: measured data against a model: what is wrong with it, what causes that, and the better model."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from difflib import get_close_matches
from pathlib import Path
from typing import TYPE_CHECKING, Final

from astb.menu import experiments
from diagnosis.contracts import Dataset, DiagnosisError, Simulator
from diagnosis.finding import Cause, Estimate, Finding
from test_plans.screening import SCREENING
from test_plans.separating import MENU

if TYPE_CHECKING:
    from rich.console import Console

    from bench_sim.parameters import Parameters
    from diagnosis.engine.config import Config

FINDING: Final = "finding.json"
REPORT: Final = "report.html"
EXTENDED: Final = "extended.toml"

Progress = Callable[[str, float], None]


@dataclass(frozen=True, slots=True)
class Request:
    """What is asked: data, the map of their columns if they are not the bench's, the model in doubt, candidates."""

    data: Sequence[Path]
    map_path: Path | None
    model: str
    effects: str | None
    seed: int


def diagnose_data(request: Request, out: Path, console: "Console") -> Finding:
    """Diagnose what is asked and write all results into ``out``.

    DiagnosisError, RecordError or ParameterError, which name the file, the value and what would be right.
    """
    from bench_sim.parameters import load
    from diagnosis.engine.config import Config

    for path in request.data:
        if not path.exists():
            raise DiagnosisError(f"{path} does not exist")
    parameters = load(request.model)
    make_room(out)
    with bar(console) as progress:
        progress("read the data", 0.0)
        simulator, dataset = read_data(request.data, request.map_path, parameters, request.seed)
        config = Config(seed=request.seed, effects=chosen_effects(request.effects, simulator))
        return conclude(simulator, dataset, config, request.model, out, progress)


def conclude(
    simulator: Simulator,
    dataset: Dataset,
    config: "Config",
    model: str,
    out: Path,
    progress: Progress,
) -> Finding:
    """Diagnose, and write finding, report and, for the bench, the extended ``model`` into ``out``.

    Of a bench the finding ranks the menu of separating runs.
    """
    from astb.extend import write_extended
    from diagnosis.engine.diagnose import diagnose
    from diagnosis.report.page import write_report
    from diagnosis.systems.air_spring import AirSpring

    bench = isinstance(simulator, AirSpring)
    finding = diagnose(dataset, simulator, config, progress, experiments(MENU) if bench else ())
    (out / FINDING).write_bytes(finding.to_json())
    write_report(finding, out / REPORT)
    if bench and finding.models.effects:
        write_extended(out / EXTENDED, finding, model)
    return finding


def make_room(out: Path) -> None:
    """Make the directory of results, without those of an earlier diagnosis. DiagnosisError if it cannot be used."""
    try:
        out.mkdir(parents=True, exist_ok=True)
        for name in (FINDING, REPORT, EXTENDED):
            (out / name).unlink(missing_ok=True)
    except OSError as error:
        raise DiagnosisError(f"{out} cannot be used for the results: {error.strerror}") from None


@contextmanager
def bar(console: "Console") -> Iterator[Progress]:
    """Show how far a diagnosis is, while the block lasts."""
    from rich.progress import BarColumn, Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

    columns = (
        SpinnerColumn(),
        BarColumn(),
        TextColumn("{task.percentage:>3.0f} %"),
        TimeElapsedColumn(),
        TextColumn("{task.description}"),
    )
    with Progress(*columns, console=console, transient=True) as progress:
        task = progress.add_task("", total=1.0)
        yield lambda text, done: progress.update(task, description=text, completed=done)


def read_data(
    paths: Sequence[Path], map_path: Path | None, parameters: "Parameters", seed: int
) -> tuple[Simulator, Dataset]:
    """Return the system and its measured runs: records of the bench, or any files that a map explains.

    Of the bench's runs, ``seed`` draws which of the screening choose models and tell the gain.

    DiagnosisError or RecordError, which name the file and what would be right.
    """
    if map_path is not None:
        from diagnosis.systems.mapping import read_mapped

        return read_mapped(paths, map_path)
    for path in paths:
        if not path.is_dir():
            raise DiagnosisError(
                f"{path} is no directory of a run on the bench; files of other origin need --map FILE, which says "
                "what their columns are"
            )
    from bench_sim.model.effects import CATALOGUE
    from diagnosis.systems.air_spring import AirSpring
    from diagnosis.systems.records import read_records

    simulator = AirSpring(parameters, effects=CATALOGUE)
    return simulator, with_roles(read_records(paths, simulator), seed)


def with_roles(dataset: Dataset, seed: int) -> Dataset:
    """Return the dataset with the runs of the screening split by ``seed``, and all that were made to decide fitted."""
    from diagnosis.engine.runs import split

    screening = [run for run in dataset.runs if run.experiment.name.startswith(SCREENING.name)]
    if not screening:
        return dataset
    drawn = split(replace(dataset, runs=tuple(screening)), seed).runs
    roles = {run.experiment.name: run.role for run in drawn}
    runs = (replace(run, role=roles.get(run.experiment.name, run.role)) for run in dataset.runs)
    return replace(dataset, runs=tuple(runs))


def chosen_effects(text: str | None, simulator: Simulator) -> tuple[str, ...] | None:
    """Return the effects named in ``text``, with commas; None stands for the whole catalogue.

    A name without its place stands for all places. DiagnosisError for one that the catalogue does not have.
    """
    if text is None:
        return None
    chosen: dict[str, None] = {}
    for name in (part.strip() for part in text.split(",")):
        found = [one for one in simulator.catalogue if name in {one, one.partition(".")[0]}]
        if not found:
            near = get_close_matches(name, simulator.catalogue, n=1)
            right = f"{near[0]} would be one" if near else f"there are {', '.join(simulator.catalogue)}"
            raise DiagnosisError(f"--effects: {name!r} is no effect of {simulator.name}; {right}")
        chosen |= dict.fromkeys(found)
    return tuple(chosen)


def tell(finding: Finding, out: Path, console: "Console") -> None:
    """Show what was found: the sentence, causes with units and intervals, rivals, the next run, where the report is."""

    def line(text: str, style: str = "") -> None:
        console.print(text, style=style, highlight=False, markup=False, soft_wrap=True)

    line(finding.sentence, "bold")
    for cause in finding.causes:
        line(f"  {_cause(cause)}")
    for rival in finding.ambiguous_with:
        line(f"  or, instead of {rival.instead_of}: {rival.effect} ({rival.title})")
    for unknown in finding.unknowns:
        if unknown.kept:
            line(f"  {unknown.sentence}")
    for run in finding.next_runs[:1]:
        line(f"  the run that would decide: astb run {run.experiment.partition(' ')[0]}")
    if not finding.next_runs:
        for sensor in finding.next_sensors[:1]:
            line(f"  what would decide: {sensor.sentence}")
    line(f"  report: {out / REPORT}")


def _cause(cause: Cause) -> str:
    values = ", ".join(_estimate(one) for one in cause.parameters)
    return f"{cause.effect}: {cause.title}; {values}"


def _estimate(one: Estimate) -> str:
    if one.value is None:
        return f"{one.name} unknown"
    text = f"{one.name} {one.value:.3g} {one.unit}".rstrip()
    if one.low is None or one.high is None:
        return text
    return f"{text} (95 %: {one.low:.3g} to {one.high:.3g})"
