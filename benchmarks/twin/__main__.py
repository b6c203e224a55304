"""``python -m benchmarks.twin``: how often a twin is wrong, how soon it tells a fault, and its causes.

Runs in virtual time, through the wires, each with a seed of its own: sound rigs, and rigs on which a fault begins at a
drawn instant of what the twin can judge. One line of JSON a run goes to the file of results, so that counting goes on
where it was cut off.
"""

import json
import tempfile
from collections import Counter
from pathlib import Path
from typing import Any, Final

import click
import numpy as np

from astb.rig_in_memory import RigInMemory
from bench_records.record import read
from bench_sim.parameters import load
from bench_sim.rig.faults.panel import PlannedFault
from bench_sim.rig.rig import Rig
from bench_twin.twin import Twin
from test_plans.discovery import plans
from test_plans.execution import execute

#: Plans and the part (s) of each in which a fault begins: there the twin judges.
PLANS: Final = {
    "aw0": (56.0, 85.0),
    "aw3": (61.0, 90.0),
    "screening": (45.0, 550.0),
    "endurance": (55.0, 500.0),
}
#: Faults at three sizes, and the causes of the catalogue that are right for each.
FAULTS: Final[tuple[tuple[str, dict[str, Any], str, tuple[str, ...], tuple[str, ...]], ...]] = (
    ("leak", {"side": "left"}, "area", ("0.1mm2", "0.3mm2", "1mm2"), ("leak.left", "leak_laminar.left")),
    ("leak", {"side": "right"}, "area", ("0.1mm2", "0.3mm2", "1mm2"), ("leak.right", "leak_laminar.right")),
    ("blocked_orifice", {"side": "left"}, "share", ("10%", "30%", "80%"), ("orifice",)),
    ("bias", {"sensor": "load_cell.2"}, "value", ("0.05kN", "0.2kN", "1kN"), ("load_cell",)),
    (
        "drift",
        {"sensor": "left.bellows_pressure"},
        "value",
        ("0.0002bar/s", "0.0006bar/s", "0.002bar/s"),
        ("drift",),
    ),
)


def told(plan: str, seed: int, fault: tuple[str, dict[str, Any], float] | None) -> dict[str, Any]:
    """Run a plan with a fault (name, values, from when on), and return what its twin said."""
    rig = Rig(load("astb"), seed=seed)
    if fault is not None:
        rig.faults.plan(PlannedFault(*fault, None))
    with tempfile.TemporaryDirectory() as folder:
        with RigInMemory(rig).bench(seed=seed) as bench:
            execute(plans()[plan], bench, Path(folder) / plan, rig="virtual", seed=seed)
        story = Twin(read(Path(folder) / plan), load("astb"), "astb").look()
    return {
        "judged": round(story.judged_for, 1),
        "partings": [
            {
                "told": one.told,
                "since": one.since,
                "channel": one.channel,
                "causes": [c.name for c in one.causes],
            }
            for one in story.partings
        ],
    }


def cases(count: int, seed: int) -> list[dict[str, Any]]:
    """Return as many runs, every second one of a sound rig."""
    rng = np.random.default_rng(seed)
    drawn = []
    for k in range(count):
        plan = str(rng.choice(list(PLANS)))
        case: dict[str, Any] = {"plan": plan, "seed": int(rng.integers(2**31)), "fault": None}
        if k % 2:
            name, values, what, sizes, _ = FAULTS[int(rng.integers(len(FAULTS)))]
            size = sizes[int(rng.integers(len(sizes)))]
            at = float(rng.uniform(*PLANS[plan]))
            case["fault"] = [name, values | {what: size}, at]
        drawn.append(case)
    return drawn


@click.command()
@click.option("--count", default=40, show_default=True)
@click.option("--seed", default=1, show_default=True)
@click.option("--out", type=click.Path(path_type=Path), default=Path("runs/twin.jsonl"), show_default=True)
def main(count: int, seed: int, out: Path) -> None:
    """Count."""
    out.parent.mkdir(parents=True, exist_ok=True)
    done = out.read_text().splitlines() if out.exists() else []
    for drawn in cases(count, seed)[len(done) :]:
        fault = drawn["fault"]
        case = drawn | told(drawn["plan"], drawn["seed"], tuple(fault) if fault else None)
        with out.open("a") as file:
            file.write(json.dumps(case) + "\n")
    report([json.loads(line) for line in out.read_text().splitlines()])


def report(lines: list[dict[str, Any]]) -> None:
    """Print what was counted."""
    sound = [one for one in lines if one["fault"] is None]
    early = [
        one for one in lines if one["fault"] and any(p["told"] < one["fault"][2] for p in one["partings"])
    ]
    hours = sum(one["judged"] for one in sound) / 3600.0
    false = sum(bool(one["partings"]) for one in sound)
    click.echo(
        f"sound rigs: {len(sound)} runs, {hours:.2f} h judged, {false} false alarms; {len(early)} before a fault"
    )
    table: dict[str, Counter[str]] = {}
    delays: dict[str, list[float]] = {}
    for one in lines:
        if one["fault"] is None:
            continue
        name, values, at = one["fault"]
        fixed, what, causes = next(
            (fixed, what, causes)
            for known, fixed, what, _, causes in FAULTS
            if known == name and fixed.items() <= values.items()
        )
        key = f"{name} {' '.join(fixed.values())} {values[what]}"
        count = table.setdefault(key, Counter())
        count["runs"] += 1
        after = [p for p in one["partings"] if p["told"] >= at]
        if after:
            count["told"] += 1
            delays.setdefault(key, []).append(after[0]["told"] - at)
            named = after[0]["causes"]
            hit = any(cause.startswith(causes) for cause in named)
            count["named" if hit else "wrong" if named else "unknown"] += 1
    for key in sorted(table):
        delay = f", median delay {np.median(delays[key]):.1f} s" if key in delays else ""
        click.echo(f"{key:44s} {dict(table[key])}{delay}")


if __name__ == "__main__":
    main()
