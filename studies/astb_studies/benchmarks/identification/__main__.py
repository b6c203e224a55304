"""``python -m astb_studies.benchmarks.identification``: coverage of the intervals of `astb identify`.

Springs are drawn from the prior. The plan `identification` measures a virtual rig through its buses; the rig has
its own sensor errors. The identified parameters are compared with the drawn ones. Each pair of springs adds one line
of JSON to the file of results, so an interrupted count resumes.
"""

import json
import tempfile
from pathlib import Path
from typing import Any, Final

import click
import numpy as np
from scipy.special import ndtr, ndtri
from scipy.stats import t as student

from astb.diagnose import read_data
from astb.rig_in_memory import RigInMemory
from bench_sim.parameters import Parameters, load
from bench_sim.rig.rig import Rig
from diagnosis.engine.identify import identify
from diagnosis.estimates import Z95
from diagnosis.systems.air_spring.identified import ASKED, UnknownSpring, quantity
from test_plans.discovery import plans
from test_plans.execution import execute

PLAN: Final = "identification"
COUNTED: Final = Path(__file__).parent / "counted.jsonl"
#: Limit of the draw, in standard deviations from the prior: further away, a spring is hardly physical.
FURTHEST: Final = 2.0


def drawn(seed: int) -> Parameters:
    """Return springs whose parameters are drawn from the prior without its tails."""
    chance, parameters = np.random.default_rng(seed), load("astb")
    values: dict[str, Any] = {}
    tail = ndtr(-FURTHEST)
    for name, prior in ASKED.items():
        away = ndtri(chance.uniform(tail, 1.0 - tail, size=2))
        values[name] = np.asarray(parameters.entries[name].value) * (
            1.0 + prior.spread * (away if prior.each else away[0])
        )
    return parameters.with_values(**values)


def round_trip(seed: int, plan: str = PLAN) -> dict[str, Any]:
    """Return the drawn value of each parameter, its identified value, and its standard deviation (SI)."""
    springs = drawn(seed)
    with tempfile.TemporaryDirectory() as folder:
        record = Path(folder) / plan
        with RigInMemory(Rig(springs, seed=seed)).bench(seed=seed) as bench:
            result = execute(plans()[plan], bench, record, rig="virtual", seed=seed)
        if result.reason:
            return {"seed": seed, "plan": plan, "reason": result.reason}
        simulator, dataset = read_data([record], None, load("astb"))
    unknown = UnknownSpring(load("astb"), tuple(channel.name for channel in simulator.channels))
    found = identify(dataset, unknown, workers=1)
    rows = {
        one.parameter.name: [_true(springs, one.parameter.name), one.value, one.deviation, one.share]
        for one in found.parameters
        if quantity(one.parameter.name) in ASKED
    }
    return {
        "seed": seed,
        "plan": plan,
        "rows": {name: [float(f"{one:.7g}") for one in row] for name, row in rows.items()},
        "doubts": list(found.doubts),
    }


def _true(springs: Parameters, name: str) -> float:
    return float(springs.entries[quantity(name)].value[int(name.startswith("right."))])


@click.command()
@click.option("--count", default=100, show_default=True, help="Up to so many pairs of springs in the file.")
@click.option("--out", type=click.Path(path_type=Path), default=COUNTED)
def main(count: int, out: Path) -> None:
    """Count."""
    done = len(out.read_text().splitlines()) if out.exists() else 0
    for seed in range(done + 1, count + 1):
        line = json.dumps(round_trip(seed))
        with out.open("a") as file:
            file.write(line + "\n")
    report([json.loads(line) for line in out.read_text().splitlines()])


def report(lines: list[dict[str, Any]]) -> None:
    """Print the results: coverage with its interval over pairs, and the error of each quantity."""
    pairs = [one for one in lines if "rows" in one]
    away: dict[str, list[float]] = {}
    for pair in pairs:
        for name, (true, value, deviation, _) in pair["rows"].items():
            away.setdefault(quantity(name), []).append((value - true) / deviation)
    share, half = coverage(pairs)
    count = sum(len(one["rows"]) for one in pairs)
    click.echo(f"{len(pairs)} pairs of {len(lines)}, {count} intervals: {share:.1%} ± {half:.1%} hold")
    for name, values in sorted(away.items(), key=lambda item: abs(np.mean(item[1])), reverse=True):
        one = np.array(values)
        click.echo(
            f"{name:32s} mean {one.mean():+5.2f} ± {one.std(ddof=1) / np.sqrt(one.size):4.2f}, "
            f"rms {np.sqrt(np.mean(one**2)):4.2f}, hold {np.mean(np.abs(one) < Z95):4.0%} of {one.size}"
        )


def coverage(pairs: list[dict[str, Any]]) -> tuple[float, float]:
    """Return the fraction of intervals that contain the true value, and the half width of its 95 % interval. Errors of
    one pair of springs are correlated, so the pairs are the sample.
    """
    held = [
        np.mean([abs(value - true) < Z95 * deviation for true, value, deviation, _ in one["rows"].values()])
        for one in pairs
    ]
    n = len(held)
    return float(np.mean(held)), float(student.ppf(0.975, n - 1) * np.std(held, ddof=1) / np.sqrt(n))


if __name__ == "__main__":
    main()
