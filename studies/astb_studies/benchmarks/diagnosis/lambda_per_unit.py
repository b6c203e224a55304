"""Detectability of each effect in a screening: a table of λ per unit of amplitude, from which sizes are drawn.

``python -m astb_studies.benchmarks.diagnosis.lambda_per_unit RECORD``
makes it again; it changes only with the model and the plan.
"""

from collections.abc import Mapping, Sequence
from functools import cache
from itertools import product
from pathlib import Path
from typing import Any, Final

import click
import msgspec
import numpy as np

from astb_studies.benchmarks.diagnosis.linearised_base import LinearisedBase
from astb_studies.benchmarks.diagnosis.next_of_kin import kin
from astb_studies.benchmarks.diagnosis.noises import LOST, Condition, noise_of
from astb_studies.benchmarks.diagnosis.uncatalogued_terms import UNCATALOGUED, roughness
from bench_sim.model.effects import CATALOGUE
from bench_sim.parameters import load
from diagnosis.contracts import Effects, Experiment, Hypothesis
from diagnosis.engine.footprints import Candidate, candidates
from diagnosis.systems.air_spring.simulator import AirSpring
from diagnosis.systems.records import read_records

TABLE: Final = Path(__file__).with_name("lambda_per_unit.json")
#: Roughness is random: its λ is the mean of this number of draws.
_ROUGH: Final = 5
#: Conditions with other noise.
_OTHER: Final[tuple[Condition, ...]] = ("AR 0.6", "AR 0.9", "12 bits")
#: Points along each shape at which effects are compared with their next of kin, by how many shapes they have.
_FINER: Final = (1, 25, 7, 5)
#: Sizes at which terms outside the catalogue are measured, in their own units.
_SMALL: Final[Mapping[str, float]] = {
    "snag": 20.0,
    "one_way": 20.0,
    "buckle": 20.0,
    "flap": 1e-5,
    "rough": 10.0,
}


class LambdaPerUnit(msgspec.Struct, frozen=True):
    """λ per unit (SI) of amplitude: of each effect at the points of its shape grid, of each term outside.

    ``in_noise`` is the part of λ that remains at the same points in the noise of a condition, which is correlated or
    coarser. ``apart`` is the part of λ that the most similar effect cannot imitate. It has more points, because an
    effect between two points of a grid may be equal to a similar one.
    """

    effects: dict[str, list[tuple[list[float], float]]]
    outside: dict[str, float]
    roughness: float
    apart: dict[str, list[tuple[list[float], float]]]
    in_noise: dict[str, dict[str, list[float]]]

    @staticmethod
    @cache
    def read() -> "LambdaPerUnit":
        """Return the table that is kept."""
        return msgspec.json.decode(TABLE.read_bytes(), type=LambdaPerUnit)

    def of(self, name: str, shapes: Sequence[float]) -> float:
        """Return λ per unit of an effect, at the nearest point of its grid (by ratios)."""
        return self.effects[name][_nearest(self.effects[name], shapes)][1]

    def part_apart(self, name: str, shapes: Sequence[float]) -> float:
        """Return the fraction of λ that the most similar effect cannot imitate; 1 without a similar one."""
        return self.apart[name][_nearest(self.apart[name], shapes)][1] if name in self.apart else 1.0

    def part_seen(self, name: str, shapes: Sequence[float], condition: str) -> float:
        """Return the ratio of the λ of an effect in the noise of a condition to that in white noise."""
        if condition == "frames lost":
            return float(np.sqrt(1.0 - LOST))
        parts = self.in_noise.get(condition)
        return parts[name][_nearest(self.effects[name], shapes)] if parts else 1.0


def _nearest(points: Sequence[tuple[list[float], float]], shapes: Sequence[float]) -> int:
    """Return which point is nearest by ratios."""

    def away(place: int) -> float:
        return sum(float(np.log(a / b) ** 2) for a, b in zip(points[place][0], shapes, strict=True))

    return min(range(len(points)), key=away)


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
    runs, bench = read_records([directory], simulator).runs, simulator.parameters
    base = LinearisedBase(simulator, runs, noise_of("white", bench))
    terms = _WithTerms(load(), effects={})

    def of_term(name: str, seed: int = 0) -> float:
        values = {name: {"size": _SMALL[name], "seed": float(seed)}}
        return (
            base.lambda_of(lambda experiment, given: terms.run(experiment, {}, given), values) / _SMALL[name]
        )

    effects: dict[str, list[tuple[list[float], float]]] = {}
    in_noise: dict[str, dict[str, list[float]]] = {}
    entries = candidates(list(simulator.catalogue.values()))
    white = base.lambdas_per_unit(entries)
    for candidate, one in zip(entries, white, strict=True):
        effects.setdefault(candidate.effect.name, []).append((list(candidate.shapes), one))
    for condition in _OTHER:
        there = LinearisedBase(simulator, runs, noise_of(condition, bench)).lambdas_per_unit(entries)
        parts = in_noise.setdefault(condition, {})
        for candidate, one, other in zip(entries, white, there, strict=True):
            parts.setdefault(candidate.effect.name, []).append(other / one if one > 0.0 else 1.0)
    apart = {}
    for name in effects:
        relatives = [
            finer
            for relative in kin(name)
            if relative in effects
            for finer in _finely(simulator.catalogue[relative])
        ]
        if relatives:
            mine = _finely(simulator.catalogue[name])
            parts_apart = base.parts_apart(mine, relatives)
            apart[name] = [(list(one.shapes), part) for one, part in zip(mine, parts_apart, strict=True)]
    rough = [of_term("rough", seed) for seed in range(_ROUGH)]
    outside = {name: of_term(name) for name in UNCATALOGUED}
    return LambdaPerUnit(effects, outside, float(np.mean(rough)), apart, in_noise)


def _finely(effect: Hypothesis) -> list[Candidate]:
    """Return the candidates of an effect on a fine grid over the same range."""
    ends = zip(np.min(effect.grid, axis=0), np.max(effect.grid, axis=0), strict=True)
    count = _FINER[len(effect.shapes)]
    axes = [np.unique(np.geomspace(low, high, count)).tolist() for low, high in ends]
    return [Candidate(effect, shapes) for shapes in product(*axes)]


@click.command()
@click.argument("record", type=click.Path(path_type=Path, exists=True))
def main(record: Path) -> None:
    """Measure the table on RECORD, a screening of a healthy bench, and keep it."""
    found = measured_on(record)
    TABLE.write_bytes(msgspec.json.format(msgspec.json.encode(found), indent=1) + b"\n")


if __name__ == "__main__":
    main()
