"""The bench as a system with something hidden: measured in a process of its own, of which only files come back."""

import subprocess
import sys
import tempfile
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Final

from benchmarks.diagnosis.truth import Condition, Kind, Truth
from diagnosis.contracts import Dataset, Simulator

#: A bench is screened within a minute; on a busy machine in several.
LIMIT: Final = 1800.0


class NotMeasured(RuntimeError):
    """The process that hides and measures came to no record; says why."""


@dataclass(frozen=True)
class Sealed:
    """What a sealed process left behind: measured runs, and the file that only the judge opens."""

    dataset: Dataset
    truth: Path

    def open(self) -> Truth:
        """Open the seal."""
        return Truth.read(self.truth)


@dataclass(frozen=True)
class Bench:
    """The air springs, by a screening with so many stretches under each load."""

    name: str = "bench"
    stretches: int = 3

    @cached_property
    def simulator(self) -> Simulator:
        """What is diagnosed."""
        from bench_sim.model.effects import CATALOGUE
        from bench_sim.parameters import load
        from diagnosis.systems.air_spring import AirSpring

        return AirSpring(load(), effects=CATALOGUE)

    def measure(self, seed: int, kind: Kind, condition: Condition, directory: Path) -> Sealed:
        """Let another process hide something and measure it; read the record. Raises NotMeasured."""
        from astb.diagnose import with_roles
        from diagnosis.systems.air_spring import AirSpring
        from diagnosis.systems.records import read_records

        record, sealed = directory / "record", directory / "truth.json"
        command = [sys.executable, "-m", "benchmarks.diagnosis.sealed", f"--seed={seed}", f"--kind={kind}"]
        command += [f"--condition={condition}", f"--stretches={self.stretches}", f"--out={record}"]
        done = subprocess.run(
            [*command, f"--truth={sealed}"],
            check=False,
            capture_output=True,
            text=True,
            timeout=LIMIT,
            cwd=Path(__file__).parents[2],
        )
        if done.returncode:
            raise NotMeasured(done.stderr.strip().rpartition("\n")[2])
        assert isinstance(self.simulator, AirSpring)
        return Sealed(with_roles(read_records([record], self.simulator)), sealed)


def in_a_room() -> "tempfile.TemporaryDirectory[str]":
    """Return a directory for one case, which goes with it."""
    return tempfile.TemporaryDirectory(prefix="sealed-")
