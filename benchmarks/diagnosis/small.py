"""The small system: an oscillator with hidden terms, on which hundreds of diagnoses are cheap."""

from dataclasses import dataclass, replace
from functools import cache, cached_property
from typing import Any, Final

import numpy as np

from benchmarks.diagnosis.footprint import Ground
from benchmarks.diagnosis.truth import (
    CONDITIONS,
    KINDS,
    LAMBDA_CLEAR,
    ROUGH,
    ROUGH_ALONE,
    Condition,
    Kind,
    Truth,
    even_in_logarithm,
)
from diagnosis.contracts import Array, Dataset, Effects, Experiment
from diagnosis.engine.footprints import Candidate
from tests.diagnosis import conftest as lab

#: So many steps of the truth for one of the model.
FINER: Final = 4
#: Sizes in between which λ is measured, of terms outside the catalogue: a stop (N/m), damping upwards only (N).
OUTSIDE: Final = {"stop": 100.0, "one_way": 1.0}
GAP: Final = 0.02
LAMBDA: Final = (4.0, 400.0)
COLOURS: Final[dict[Condition, float]] = {"AR 0.6": 0.6, "AR 0.9": 0.9}


class Finer(lab.Oscillator):
    """The same oscillator in a quarter of the step; its drive is a line between samples in both."""

    def run(self, experiment: Experiment, parameters: Any, effects: Effects) -> Array:
        n = FINER * (len(experiment.time) - 1) + 1
        time = np.linspace(experiment.time[0], experiment.time[-1], n)
        drive = np.interp(time, experiment.time, experiment.inputs["drive"])
        fine = replace(experiment, time=time, inputs={"drive": drive})
        return super().run(fine, parameters, effects)[::FINER]


@dataclass(frozen=True)
class Small:
    """The oscillator with its measurements of a quarter of a minute."""

    name: str = "oscillator"
    samples: int = 1000

    @cached_property
    def simulator(self) -> lab.Oscillator:
        """What is diagnosed."""
        return lab.Oscillator(surfaces=(lab._surface(),))

    def draw(self, seed: int, kind: Kind, condition: Condition) -> Truth:
        """Draw a specimen; its base parameters are those that its measurement will draw from the same seed."""
        rng = np.random.default_rng([seed, KINDS.index(kind), CONDITIONS.index(condition)])
        effects, strengths, outside = {}, {}, {}
        if kind == "outside":
            name = str(rng.choice(sorted(OUTSIDE)))
            strengths[name] = even_in_logarithm(rng, LAMBDA_CLEAR)
            outside[name] = strengths[name] / self._strength(name)
        for name in self._names(rng, kind):
            lam = even_in_logarithm(rng, LAMBDA if kind == "single" else LAMBDA_CLEAR)
            effect = self.simulator.catalogue[name]
            shapes = effect.grid[int(rng.integers(len(effect.grid)))]
            size = lam / self._per_unit(name, shapes)
            if not effect.one_sided and rng.random() < 0.5:
                size = -size
            effects[name] = {
                "amplitude": size,
                **{p.name: v for p, v in zip(effect.shapes, shapes, strict=True)},
            }
            strengths[name] = lam
        chance = np.random.default_rng(seed)
        base = {
            n.name: n.nominal + n.spread * float(chance.standard_normal())
            for n in self.simulator.nuisances
            if not n.per_run
        }
        rough = ROUGH * min(strengths.values()) if strengths else ROUGH_ALONE
        return Truth(
            seed=seed,
            kind=kind,
            condition=condition,
            effects=effects,
            strengths=strengths,
            base=base,
            roughness=rough,
            outside=outside,
        )

    def data(self, truth: Truth) -> Dataset:
        """Measure a specimen."""
        given: dict[str, dict[str, float]] = dict(truth.effects)
        surface = truth.roughness / self._roughness() * self._rough(truth.seed)
        for name, size in truth.outside.items():
            if name == "stop":
                given["stop"] = {"amplitude": size, "gap": GAP}
            else:
                surface = surface + size * _one_way()
        given["force"] = _coefficients(surface)
        return lab.Laboratory(Finer(), self.samples).measure(
            truth.seed,
            given,
            colour=COLOURS.get(truth.condition, 0.0),
            dropped=0.1 if truth.condition == "frames lost" else 0.0,
            quantised=truth.condition == "12 bits",
        )

    def _names(self, rng: np.random.Generator, kind: Kind) -> list[str]:
        names = [name for name in sorted(self.simulator.catalogue) if name != "maxwell_two"]
        if kind == "single":
            return [str(rng.choice(names))]
        if kind == "near":
            return ["maxwell_two"]
        if kind == "pair":
            families: dict[str, str] = {}
            for name in rng.permutation(names).tolist():
                families.setdefault(self.simulator.catalogue[name].family, name)
            return list(families.values())[:2]
        return []

    def _rough(self, seed: int) -> Array:
        """A smooth random force over x and v, less what the base model would absorb: that is its own stiffness."""
        chance = np.random.default_rng([seed, 77]).standard_normal(lab.ROWS * lab.COLUMNS)
        followed = self._absorbed
        return (chance - np.linalg.pinv(followed) @ followed @ chance).reshape(lab.ROWS, lab.COLUMNS)

    @cached_property
    def _absorbed(self) -> Array:
        units = np.eye(lab.ROWS * lab.COLUMNS).reshape(-1, lab.ROWS, lab.COLUMNS)
        return self._ground.absorbed(
            lambda e, given: self.simulator.run(e, {}, given),
            [{"force": _coefficients(unit)} for unit in units],
        )

    @cached_property
    def _ground(self) -> Ground:
        quiet = lab.Laboratory(self.simulator, self.samples).measure(0, loud=0.0)
        return Ground(self.simulator, quiet.of("fit"))

    def _per_unit(self, name: str, shapes: tuple[float, ...]) -> float:
        return _kept(self, ("effect", name, shapes))

    def _strength(self, name: str) -> float:
        return _kept(self, ("outside", name, ()))

    def _roughness(self) -> float:
        return _kept(self, ("rough", "", ()))

    def measured(self, what: tuple[str, str, tuple[float, ...]]) -> float:
        """Return λ per unit of an effect, of a term outside, or of the roughness (mean of five)."""
        kind, name, shapes = what
        if kind == "effect":
            return self._ground.strengths([Candidate(self.simulator.catalogue[name], shapes)])[0]

        def of(effects: Effects) -> float:
            return self._ground.strength(lambda e, given: self.simulator.run(e, {}, given), effects)

        if kind == "rough":
            return float(np.mean([of({"force": _coefficients(self._rough(seed))}) for seed in range(5)]))
        size = OUTSIDE[name]
        if name == "stop":
            return of({"stop": {"amplitude": size, "gap": GAP}}) / size
        return of({"force": _coefficients(size * _one_way())}) / size


@cache
def _kept(system: Small, what: tuple[str, str, tuple[float, ...]]) -> float:
    return system.measured(what)


def _one_way() -> Array:
    """A damper that acts upwards only: nothing at negative speeds, then in proportion."""
    cells = lab.COLUMNS - 2
    speeds = np.sinh(lab.SWIFT * (2.0 * (np.arange(lab.COLUMNS) - 0.5) / cells - 1.0))
    return np.maximum(speeds, 0.0) * np.ones((lab.ROWS, 1))


def _coefficients(surface: Array) -> dict[str, float]:
    return {f"c{i}{j}": float(surface[i, j]) for i in range(lab.ROWS) for j in range(lab.COLUMNS)}
