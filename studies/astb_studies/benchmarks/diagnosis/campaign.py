"""Many sealed cases in several processes; the judgement of each is kept at once, as a line of JSON."""

import time
import traceback
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing
from pathlib import Path
from typing import Final

import msgspec

from astb.campaigns.core import carried_out
from astb.campaigns.workers import cluster
from astb_studies.benchmarks.diagnosis.ground_truth import Condition, GroundTruth, Kind
from astb_studies.benchmarks.diagnosis.judge import Judged, failed, judge

#: The counted cases are part of the sources: they took days of a core, and the pages can be checked against them.
COUNTED: Final = Path(__file__).parent / "counted"
#: The kinds of cases, drawn in this order again and again: half of them ordinary, the others difficult.
ROUND: Final[tuple[tuple[Kind, Condition], ...]] = (
    ("single", "white"),
    ("null", "white"),
    ("single", "white"),
    ("outside", "white"),
    ("single", "AR 0.6"),
    ("near", "white"),
    ("single", "white"),
    ("pair", "white"),
    ("single", "frames lost"),
    ("null", "AR 0.6"),
    ("single", "white"),
    ("outside", "white"),
    ("single", "12 bits"),
    ("null", "AR 0.9"),
    ("single", "white"),
    ("near", "white"),
    ("single", "AR 0.9"),
    ("null", "12 bits"),
    ("single", "white"),
    ("null", "frames lost"),
)


class Case(msgspec.Struct, frozen=True):
    """The key of a case: equal keys give equal hidden effects."""

    system: str
    kind: Kind
    condition: Condition
    seed: int


def cases(system: str, count: int) -> list[Case]:
    """Return the first ``count`` cases of a system."""
    return [Case(system, *ROUND[i % len(ROUND)], seed=1000 + i) for i in range(count)]


def nulls(system: str, count: int, condition: Condition) -> list[Case]:
    """Return cases without a hidden effect."""
    return [Case(system, "null", condition, seed=100_000 + i) for i in range(count)]


def siblings(system: str, count: int) -> list[Case]:
    """Return sibling rigs, every second one with a hidden effect."""
    kinds: tuple[Kind, Kind] = ("null", "single")
    return [Case(system, kinds[i % 2], "sibling", seed=200_000 + i) for i in range(count)]


def file_of(system: str, folder: Path = COUNTED) -> Path:
    """Where the lines of a system are kept."""
    return folder / f"{system}.jsonl"


def done(system: str, folder: Path = COUNTED) -> list[Judged]:
    """Return the kept cases of a system."""
    path = file_of(system, folder)
    if not path.exists():
        return []
    return [msgspec.json.decode(line, type=Judged) for line in path.read_bytes().splitlines() if line]


def carry_out(case: Case, effects: tuple[str, ...] | None = None) -> Judged:
    """Hide, measure, diagnose and judge one case; a failure is a result too.

    ``effects`` are the candidates, None represents all.
    """
    from diagnosis.engine.config import Config
    from diagnosis.engine.diagnose import diagnose

    start = time.perf_counter()
    config = Config(seed=case.seed, workers=1, effects=effects, with_panel=False)
    truth: GroundTruth | None = None
    try:
        if case.system == "oscillator":
            from astb_studies.benchmarks.diagnosis.oscillator_cases import OscillatorCases

            oscillators = OscillatorCases()
            truth = oscillators.draw(case.seed, case.kind, case.condition)
            finding = diagnose(oscillators.data(truth), oscillators.simulator, config)
            simulator = oscillators.simulator
        else:
            from astb_studies.benchmarks.diagnosis.bench_cases import BenchCases, temporary_directory

            bench = BenchCases()
            with temporary_directory() as directory:
                sealed = bench.measure(case.seed, case.kind, case.condition, Path(directory))
                start = time.perf_counter()
                finding = diagnose(sealed.dataset, bench.simulator, config)
                truth = sealed.open()
            simulator = bench.simulator
    except Exception as error:
        place = traceback.extract_tb(error.__traceback__)[-1]
        reason = f"{type(error).__name__} at {Path(place.filename).name}:{place.lineno}: {error}"
        truth = truth or GroundTruth(seed=case.seed, kind=case.kind, condition=case.condition)
        return failed(truth, reason, system=case.system, elapsed=time.perf_counter() - start)
    return judge(finding, truth, simulator, system=case.system, elapsed=time.perf_counter() - start)


def run(
    planned: Sequence[Case], processes: int, report: Callable[[Judged, int], None], folder: Path = COUNTED
) -> None:
    """Carry out the cases that a folder does not have yet, and store each case there as soon as it is judged."""
    kept = {
        (j.system, j.kind, j.condition, j.seed)
        for system in {c.system for c in planned}
        for j in done(system, folder)
    }
    left = [c for c in planned if (c.system, c.kind, c.condition, c.seed) not in kept]
    folder.mkdir(parents=True, exist_ok=True)
    for number, judged in enumerate(_carried_out(left, processes)):
        with file_of(judged.system, folder).open("ab") as file:
            file.write(msgspec.json.encode(judged) + b"\n")
        report(judged, len(left) - number - 1)


def _carried_out(left: Sequence[Case], processes: int) -> Iterator[Judged]:
    if processes == 1:
        yield from map(carry_out, left)
        return
    by_key = {f"{case.system} {case.kind} {case.condition} {case.seed}": case for case in left}
    with cluster(workers=processes) as client, closing(carried_out(client, carry_out, by_key)) as ended:
        for one in ended:
            case = by_key[one.key]
            truth = GroundTruth(seed=case.seed, kind=case.kind, condition=case.condition)
            yield one.value or failed(truth, one.error, system=case.system, elapsed=one.seconds)
