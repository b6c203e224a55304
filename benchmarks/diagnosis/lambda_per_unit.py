"""How well a screening shows each effect: a table of λ per unit of its amplitude, in which sizes are drawn.

``python -m benchmarks.diagnosis.lambda_per_unit RECORD`` makes it anew; it changes only with the model and the plan.
"""

from collections.abc import Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Any, Final

import click
import msgspec
import numpy as np

from bench_sim.model.effects import CATALOGUE
from bench_sim.parameters import load
from benchmarks.diagnosis.linearised_base import LinearisedBase
from benchmarks.diagnosis.uncatalogued_terms import UNCATALOGUED, roughness
from diagnosis.contracts import Effects, Experiment
from diagnosis.engine.footprints import candidates
from diagnosis.systems.air_spring import AirSpring
from diagnosis.systems.records import read_records

TABLE: Final = Path(__file__).with_name("lambda_per_unit.json")
#: Roughness is random: its λ is the mean of so many.
_ROUGH: Final = 5
#: Sizes at which terms outside the catalogue are measured, in their own units.
_SMALL: Final[Mapping[str, float]] = {
    "snag": 20.0,
    "one_way": 20.0,
    "buckle": 20.0,
    "flap": 1e-5,
    "rough": 10.0,
}


class LambdaPerUnit(msgspec.Struct, frozen=True):
    """λ per unit (SI) of amplitude: of each effect at the points of its shape grid, of each term outside."""

    effects: dict[str, list[tuple[list[float], float]]]
    outside: dict[str, float]
    roughness: float

    @staticmethod
    @cache
    def read() -> "LambdaPerUnit":
        """Return the table that is kept."""
        return msgspec.json.decode(TABLE.read_bytes(), type=LambdaPerUnit)

    def of(self, name: str, shapes: Sequence[float]) -> float:
        """Return λ per unit of an effect, at the nearest point of its grid (by ratios)."""

        def away(point: tuple[list[float], float]) -> float:
            return sum(float(np.log(a / b) ** 2) for a, b in zip(point[0], shapes, strict=True))

        return min(self.effects[name], key=away)[1]


class _WithTerms(AirSpring):
    """The bench with terms outside the catalogue, given like effects."""

    def record(self, experiment: Experiment, parameters: Mapping[str, float], effects: Effects) -> Any:
        record = super().record(experiment, parameters, {})
        for name, values in effects.items():
            size = values["size"]
            changes = roughness(int(values["seed"]), size) if name == "rough" else UNCATALOGUED[name](size)
            for parameter, value in changes.items():
                record[parameter] = value
        return record


def measured_on(directory: Path) -> LambdaPerUnit:
    """Measure the table on the record of a screening of a healthy bench."""
    simulator = AirSpring(load(), effects=CATALOGUE)
    base = LinearisedBase(simulator, read_records([directory], simulator).runs)
    terms = _WithTerms(load(), effects={})

    def of_term(name: str, seed: int = 0) -> float:
        values = {name: {"size": _SMALL[name], "seed": float(seed)}}
        return (
            base.lambda_of(lambda experiment, given: terms.run(experiment, {}, given), values) / _SMALL[name]
        )

    effects: dict[str, list[tuple[list[float], float]]] = {}
    entries = candidates(list(simulator.catalogue.values()))
    for candidate, one in zip(entries, base.lambdas_per_unit(entries), strict=True):
        effects.setdefault(candidate.effect.name, []).append((list(candidate.shapes), one))
    rough = [of_term("rough", seed) for seed in range(_ROUGH)]
    return LambdaPerUnit(effects, {name: of_term(name) for name in UNCATALOGUED}, float(np.mean(rough)))


@click.command()
@click.argument("record", type=click.Path(path_type=Path, exists=True))
def main(record: Path) -> None:
    """Measure the table on RECORD, a screening of a healthy bench, and keep it."""
    found = measured_on(record)
    TABLE.write_bytes(msgspec.json.format(msgspec.json.encode(found), indent=1) + b"\n")


if __name__ == "__main__":
    main()
