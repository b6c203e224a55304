"""Benches with hidden effects: each is screened in its own process, which returns only files."""

import subprocess
import sys
import tempfile
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Final

from astb_studies.benchmarks.diagnosis.ground_truth import Condition, GroundTruth, Kind
from astb_studies.benchmarks.diagnosis.sealed import ScreeningFailed
from astb_studies.places import ROOT
from diagnosis.contracts import Dataset, Simulator

#: A bench is screened within a minute; on a busy machine in several.
LIMIT: Final = 1800.0


@dataclass(frozen=True)
class Sealed:
    """Output of the measuring process: measured runs, and the file of the hidden effects that only the judge opens."""

    dataset: Dataset
    truth: Path

    def open(self) -> GroundTruth:
        """Read the hidden effects."""
        return GroundTruth.read(self.truth)


@dataclass(frozen=True)
class BenchCases:
    """Hides in the bench of two air springs, and screens it."""

    name: str = "bench"

    @cached_property
    def simulator(self) -> Simulator:
        """The simulator for the diagnosis."""
        from bench_sim.model.effects import CATALOGUE
        from bench_sim.parameters import load
        from diagnosis.systems.air_spring.simulator import AirSpring

        return AirSpring(load(), effects=CATALOGUE)

    def measure(self, seed: int, kind: Kind, condition: Condition, directory: Path) -> Sealed:
        """Draw and measure hidden effects in another process; read the record. Raises ScreeningFailed."""
        from astb.diagnose import with_roles
        from diagnosis.systems.air_spring.simulator import AirSpring
        from diagnosis.systems.records import read_records

        record, sealed = directory / "record", directory / "truth.json"
        command = [
            sys.executable,
            "-m",
            "astb_studies.benchmarks.diagnosis.sealed",
            f"--seed={seed}",
            f"--kind={kind}",
        ]
        command += [f"--condition={condition}", f"--out={record}"]
        done = subprocess.run(
            [*command, f"--truth={sealed}"],
            check=False,
            capture_output=True,
            text=True,
            timeout=LIMIT,
            cwd=ROOT,
        )
        if done.returncode:
            raise ScreeningFailed(done.stderr.strip().rpartition("\n")[2])
        assert isinstance(self.simulator, AirSpring)
        return Sealed(with_roles(read_records([record], self.simulator)), sealed)


def temporary_directory() -> "tempfile.TemporaryDirectory[str]":
    """Return a directory for one case, which is removed after it."""
    return tempfile.TemporaryDirectory(prefix="sealed-")
