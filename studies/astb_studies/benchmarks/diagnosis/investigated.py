"""One sealed rig: drawn from a seed as in the diagnosis benchmark, written, investigated, and judged.

It has the springs of a delivery, a little roughness, and one effect, a near miss, a pair or no effect. Most near misses
are so faint that a screening alone cannot distinguish them from similar effects. `astb investigate` reads the file of
the rig in a separate process and selects the plans.

This module is separate from the command, because other processes cannot import names from the main module.
"""

import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Final, Literal

import msgspec

from astb.investigate import LOG, Investigation
from astb_studies.benchmarks.diagnosis.ground_truth import GroundTruth, Kind, draw
from astb_studies.benchmarks.diagnosis.lambda_per_unit import LambdaPerUnit
from astb_studies.benchmarks.diagnosis.next_of_kin import kin
from astb_studies.benchmarks.diagnosis.uncatalogued_terms import roughness, together
from astb_studies.places import ROOT
from bench_protocol.words import SIDES
from bench_protocol.written_values import write_value
from bench_sim.parameters.effects import find_effect
from bench_sim.parameters.model_file import Model, write_model

#: Kinds of hidden effects: as in the diagnosis benchmark, or a near miss of reduced size.
Asked = Kind | Literal["faint"]
FAINT: Final = 0.2
#: Time limit of an investigation (s), for a busy machine.
LIMIT: Final = 3 * 3600.0


class Investigated(msgspec.Struct, frozen=True, kw_only=True):
    """The hidden effects of a rig, and the result of its investigation; ``minutes`` is the time of the bench."""

    seed: int
    kind: str
    hidden: list[str]
    weakest: float
    verdict: str = ""
    causes: list[str] = []
    rivals: list[str] = []
    plans: list[str] = []
    first: str = ""  #: the verdict after the screening alone
    minutes: float = 0.0
    ended: str = ""
    elapsed: float = 0.0
    failure: str = ""

    @property
    def right(self) -> bool:
        """Whether exactly the hidden effects were named, with no other possible cause."""
        return not self.failure and sorted(self.causes) == sorted(self.hidden) and not self.rivals

    @property
    def wrong(self) -> bool:
        """Whether a named cause is neither hidden nor similar to a hidden one, and no hidden one is an alternative."""
        free = {*self.hidden, *(near for name in self.hidden for near in kin(name))}
        return bool(set(self.causes) - free) and not set(self.rivals) & set(self.hidden)


def hidden_in(seed: int, kind: Asked) -> GroundTruth:
    """Draw the hidden effects of a rig."""
    if kind != "faint":
        return draw(seed, kind)
    truth = draw(seed, "near")
    effects = {name: dict(values) for name, values in truth.effects.items()}
    for name, values in effects.items():
        values[find_effect(name)[0].amplitude.name] *= FAINT
    return msgspec.structs.replace(
        truth,
        effects=effects,
        lambdas={name: FAINT * lambda_ for name, lambda_ in truth.lambdas.items()},
        roughness=FAINT * truth.roughness,
    )


def write_rig(truth: GroundTruth, directory: Path) -> tuple[Path, Path]:
    """Write the file of a rig with the springs of a truth, and the sealed file with its effects; return both paths."""
    labels = {label.rpartition(".")[2] for label in truth.base}
    springs = {name: [truth.base.get(f"{s}.{name}", truth.base.get(name)) for s in SIDES] for name in labels}
    rough = together(roughness(truth.seed, truth.roughness / LambdaPerUnit.read().roughness))
    model, rig, sealed = (directory / name for name in ("springs.toml", "rig.toml", "sealed.toml"))
    write_model(model, Model("astb", {**springs, **rough}))
    rig.write_text(
        f'name = "sealed"\ntime = "virtual"\n[simulation]\nparameters = "{model}"\nseed = {truth.seed}\n',
        encoding="utf-8",
    )
    lines = []
    for name, values in truth.effects.items():
        lines.append(f'[effect."{name}"]')
        parameters = find_effect(name)[0].parameters
        lines += [f'{p.name} = "{write_value(values[p.name], p.unit, p.display)}"' for p in parameters]
    sealed.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return rig, sealed


def investigated(case: tuple[int, Asked], budget: str) -> Investigated:
    """Draw a rig, run `astb investigate` on it, and read the result; a failure is also a result."""
    seed, kind = case
    truth, start = hidden_in(seed, kind), time.perf_counter()
    known = Investigated(seed=seed, kind=kind, hidden=list(truth.effects), weakest=truth.weakest)
    with tempfile.TemporaryDirectory(prefix="sealed-") as name:
        rig, sealed = write_rig(truth, Path(name))
        out = Path(name) / "out"
        command = [
            sys.executable,
            "-m",
            "astb",
            "investigate",
            "--virtual",
            "--rig",
            str(rig),
            f"--seed={seed}",
        ]
        command += ["--sealed", str(sealed)] if truth.effects else []
        done = subprocess.run(
            [*command, "--budget", budget, "--out", str(out)],
            check=False,
            capture_output=True,
            text=True,
            timeout=LIMIT,
            cwd=ROOT,
        )
        elapsed = time.perf_counter() - start
        if done.returncode:
            output = done.stderr.strip() or done.stdout.strip()
            failure = f"exit status {done.returncode}: {output.rpartition(chr(10))[2]}"
            return msgspec.structs.replace(known, failure=failure, elapsed=elapsed)
        log = msgspec.json.decode((out / LOG).read_bytes(), type=Investigation)
    last = log.steps[-1]
    return msgspec.structs.replace(
        known,
        verdict=last.verdict,
        causes=last.causes,
        rivals=last.rivals,
        plans=[step.plan for step in log.steps],
        first=log.steps[0].verdict,
        minutes=log.spent,
        ended=log.ended,
        elapsed=elapsed,
        failure="" if last.verdict else last.outcome,
    )
