"""Oscillators with hidden effects: cases of the benchmark that take one second each."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cache, cached_property
from typing import Any, Final

import numpy as np

from astb_studies.benchmarks.diagnosis import oscillator_siblings
from astb_studies.benchmarks.diagnosis.ground_truth import (
    CONDITIONS,
    KINDS,
    LAMBDA_CLEAR,
    ROUGH,
    ROUGH_ALONE,
    Condition,
    GroundTruth,
    Kind,
    even_in_logarithm,
)
from astb_studies.benchmarks.diagnosis.linearised_base import LinearisedBase
from astb_studies.oscillator import (
    REACH,
    SURFACE_SHAPE,
    Laboratory,
    Oscillator,
    coefficients_of,
    force_surface,
)
from diagnosis.contracts import Array, Dataset, Effects, Experiment
from diagnosis.engine.footprints import Candidate, candidates

#: Steps with which a specimen is integrated, for one step of the model with which it is diagnosed.
FINER: Final = 4
#: Sizes at which λ of terms outside the catalogue is measured: a stop (N/m), a damper that acts upwards only (N).
UNCATALOGUED: Final = {"stop": 100.0, "one_way": 1.0}
#: Sizes at which λ of the forms of siblings is measured, in their own units.
UNIT_OF_FORM: Final = {"tiring": 1.0, "softening": 50.0, "warming": 50.0, "seating": 1.0}
#: Where the stop begins to act (m).
GAP: Final = 0.02
LAMBDA: Final = (4.0, 400.0)
#: λ of the other form of a sibling, without the part that the most similar effect of the catalogue imitates.
LAMBDA_FORM: Final = (5.0, 50.0)
COLOURS: Final[dict[Condition, float]] = {"AR 0.6": 0.6, "AR 0.9": 0.9}


@dataclass(frozen=True)
class FinelyIntegrated(Oscillator):
    """The same oscillator, integrated with a quarter of the step; its drive is linear between samples in both.

    ``form`` has the additional terms of a sibling.
    """

    form: Mapping[str, float] = field(default_factory=dict)

    def run(self, experiment: Experiment, parameters: Any, effects: Effects) -> Array:
        n = FINER * (len(experiment.time) - 1) + 1
        time = np.linspace(experiment.time[0], experiment.time[-1], n)
        drive = np.interp(time, experiment.time, experiment.inputs["drive"])
        fine = replace(experiment, time=time, inputs={"drive": drive})
        return oscillator_siblings.run(Oscillator(), self.form, fine, parameters, effects)[::FINER]


@dataclass(frozen=True)
class OscillatorCases:
    """Draws hidden effects and measures runs of ``samples``, by default ten seconds."""

    name: str = "oscillator"
    samples: int = 1000

    @cached_property
    def simulator(self) -> Oscillator:
        """The simulator for the diagnosis."""
        return Oscillator(surfaces=(force_surface(),))

    def draw(self, seed: int, kind: Kind, condition: Condition) -> GroundTruth:
        """Draw a specimen; its base parameters are those that its measurement will draw from the same seed."""
        rng = np.random.default_rng([seed, KINDS.index(kind), CONDITIONS.index(condition)])
        effects, lambdas, outside = {}, {}, {}
        if kind == "outside":
            name = str(rng.choice(sorted(UNCATALOGUED)))
            lambdas[name] = even_in_logarithm(rng, LAMBDA_CLEAR)
            outside[name] = lambdas[name] / _of_term(self, name)
        for name in self._names(rng, kind):
            lam = even_in_logarithm(rng, LAMBDA if kind == "single" else LAMBDA_CLEAR)
            effect = self.simulator.catalogue[name]
            shapes = effect.grid[int(rng.integers(len(effect.grid)))]
            size = lam / _of_effect(self, name, shapes)
            if not effect.one_sided and rng.random() < 0.5:
                size = -size
            effects[name] = {
                "amplitude": size,
                **{p.name: v for p, v in zip(effect.shapes, shapes, strict=True)},
            }
            lambdas[name] = lam
        chance = np.random.default_rng(seed)
        base = {
            n.name: n.nominal + n.spread * float(chance.standard_normal())
            for n in self.simulator.nuisances
            if not n.per_run
        }
        form = {}
        if condition == "sibling":
            name = str(rng.choice(sorted(oscillator_siblings.FORMS)))
            size = even_in_logarithm(rng, LAMBDA_FORM) / _of_form(self, name)
            form[name] = size if rng.random() < 0.5 else -size
        rough = ROUGH * min(lambdas.values()) if lambdas else ROUGH_ALONE
        return GroundTruth(
            seed=seed,
            kind=kind,
            condition=condition,
            effects=effects,
            lambdas=lambdas,
            base=base,
            roughness=rough,
            outside=outside,
            form=form,
        )

    def data(self, truth: GroundTruth) -> Dataset:
        """Measure a specimen."""
        given: dict[str, dict[str, float]] = dict(truth.effects)
        surface = truth.roughness / _of_roughness(self) * self._rough(truth.seed)
        for name, size in truth.outside.items():
            if name == "stop":
                given["stop"] = {"amplitude": size, "gap": GAP}
            else:
                surface = surface + size * _one_way()
        given["force"] = coefficients_of(surface)
        return Laboratory(FinelyIntegrated(form=truth.form), self.samples).measure(
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
        """Return a smooth random force over x and v, without the part that a changed stiffness of the base model
        describes.
        """
        chance = np.random.default_rng([seed, 77]).standard_normal(SURFACE_SHAPE[0] * SURFACE_SHAPE[1])
        absorbed = self._absorbed
        return (chance - np.linalg.pinv(absorbed) @ absorbed @ chance).reshape(SURFACE_SHAPE)

    @cached_property
    def _absorbed(self) -> Array:
        units = np.eye(SURFACE_SHAPE[0] * SURFACE_SHAPE[1]).reshape(-1, *SURFACE_SHAPE)
        return self._base.absorbed(
            lambda e, given: self.simulator.run(e, {}, given),
            [{"force": coefficients_of(unit)} for unit in units],
        )

    @cached_property
    def _base(self) -> LinearisedBase:
        quiet = Laboratory(self.simulator, self.samples).measure(0, loud=0.0)
        return LinearisedBase(self.simulator, quiet.of("fit"))

    def lambda_of(self, effects: Effects) -> float:
        """Return λ of hidden effects of any size."""
        return self._base.lambda_of(lambda e, given: self.simulator.run(e, {}, given), effects)


# Kept for all cases of a campaign, whose subjects are equal.
@cache
def _of_effect(cases: OscillatorCases, name: str, shapes: tuple[float, ...]) -> float:
    """λ per unit of an effect."""
    return cases._base.lambdas_per_unit([Candidate(cases.simulator.catalogue[name], shapes)])[0]


@cache
def _of_term(cases: OscillatorCases, name: str) -> float:
    """λ per unit of a term outside the catalogue."""
    size = UNCATALOGUED[name]
    if name == "stop":
        return cases.lambda_of({"stop": {"amplitude": size, "gap": GAP}}) / size
    return cases.lambda_of({"force": coefficients_of(size * _one_way())}) / size


@cache
def _of_form(cases: OscillatorCases, name: str) -> float:
    """λ per unit of the part of a sibling's other form that no effect can imitate."""
    size = UNIT_OF_FORM[name]

    def run(experiment: Experiment, given: Effects) -> Array:
        return oscillator_siblings.run(cases.simulator, {name: size}, experiment, {}, given)

    entries = candidates(list(cases.simulator.catalogue.values()))
    return cases._base.lambda_apart(run, {}, entries) / size


@cache
def _of_roughness(cases: OscillatorCases) -> float:
    """λ of the roughness before it is scaled, the mean of five."""
    found = [cases.lambda_of({"force": coefficients_of(cases._rough(seed))}) for seed in range(5)]
    return float(np.mean(found))


def _one_way() -> Array:
    """A damper that acts upwards only: the force is 0 at negative speeds, and proportional to positive speeds."""
    cells = SURFACE_SHAPE[1] - 2
    speeds = np.sinh(REACH[1] * (2.0 * (np.arange(SURFACE_SHAPE[1]) - 0.5) / cells - 1.0))
    return np.maximum(speeds, 0.0) * np.ones((SURFACE_SHAPE[0], 1))
