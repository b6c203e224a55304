"""The hidden effects of a specimen: drawn from a seed, and written to a file that only the judge opens."""

from functools import cache
from pathlib import Path
from typing import Final, Literal, get_args

import msgspec
import numpy as np

from astb_studies.benchmarks.diagnosis.lambda_per_unit import LambdaPerUnit
from astb_studies.benchmarks.diagnosis.next_of_kin import NEAR
from astb_studies.benchmarks.diagnosis.noises import Condition
from astb_studies.benchmarks.diagnosis.sibling_forms import drawn as sibling
from astb_studies.benchmarks.diagnosis.uncatalogued_terms import UNCATALOGUED
from bench_protocol.words import SIDES
from bench_sim.model.effects import CATALOGUE
from bench_sim.model.effects.effect import Effect, EffectParameter
from bench_sim.parameters import Parameters, load
from bench_sim.parameters.effects import find_effect
from diagnosis.systems.air_spring.parameters import BOTH_SIDES, EACH_SIDE

Kind = Literal["null", "single", "pair", "outside", "near"]
KINDS: Final[tuple[Kind, ...]] = get_args(Kind)
CONDITIONS: Final[tuple[Condition, ...]] = get_args(Condition)
#: Those in which the bench has the form of its model, and only the noise differs.
NOISES: Final = CONDITIONS[:-1]

#: Sizes are drawn evenly in the logarithm of λ.
LAMBDA: Final = (5.0, 500.0)
#: The same for pairs, near misses and terms outside the catalogue: their cause can be found only if λ is large.
LAMBDA_CLEAR: Final = (20.0, 400.0)
#: Springs beyond this number of standard deviations of a delivery are rejected.
DELIVERED: Final = 2.5
#: λ of the unmodelled term: relative to the λ of the hidden effects, and absolute if there are none.
ROUGH: Final = 0.02
ROUGH_ALONE: Final = 0.2


class GroundTruth(msgspec.Struct, frozen=True, kw_only=True):
    """One specimen: its effects with their values (SI) and λ in white noise, its base model's parameters, its noise.

    ``roughness`` is the λ of a smooth random term that is in no model. ``outside`` has a term that is in no catalogue,
    with its size. ``form`` has the model form in which a sibling differs, with its size.
    """

    seed: int
    kind: Kind
    condition: Condition
    effects: dict[str, dict[str, float]] = {}
    lambdas: dict[str, float] = {}
    base: dict[str, float] = {}
    roughness: float = 0.0
    outside: dict[str, float] = {}
    form: dict[str, float] = {}

    @property
    def weakest(self) -> float:
        """λ of the weakest hidden effect; 0 if there is none."""
        return min(self.lambdas.values(), default=0.0)

    @property
    def seen(self) -> dict[str, float]:
        """Every λ in the noise of this bench."""
        table = LambdaPerUnit.read()
        parts = {name: table.part_seen(name, self._shapes(name), self.condition) for name in self.effects}
        return {name: lambda_ * parts.get(name, 1.0) for name, lambda_ in self.lambdas.items()}

    @property
    def apart(self) -> float:
        """The least λ of the parts that the most similar effect cannot imitate."""
        table = LambdaPerUnit.read()
        parts = {name: table.part_apart(name, self._shapes(name)) for name in self.effects}
        return min((lambda_ * parts.get(name, 1.0) for name, lambda_ in self.seen.items()), default=0.0)

    def _shapes(self, name: str) -> list[float]:
        return [self.effects[name][shape.name] for shape in find_effect(name)[0].shapes]

    def write(self, path: Path) -> None:
        """Write the file that the judge opens after the diagnosis."""
        path.write_bytes(msgspec.json.encode(self))

    @staticmethod
    def read(path: Path) -> "GroundTruth":
        """Read the file of `write`, after the diagnosis."""
        return msgspec.json.decode(path.read_bytes(), type=GroundTruth)


def draw(seed: int, kind: Kind, condition: Condition = "white") -> GroundTruth:
    """Draw a bench; the same seed, kind and condition give the same bench."""
    rng = np.random.default_rng([seed, KINDS.index(kind), CONDITIONS.index(condition)])
    per_unit = LambdaPerUnit.read()
    effects: dict[str, dict[str, float]] = {}
    lambdas: dict[str, float] = {}
    outside: dict[str, float] = {}
    if kind == "outside":
        name = str(rng.choice(sorted(UNCATALOGUED)))
        lam = even_in_logarithm(rng, LAMBDA_CLEAR)
        outside = {name: lam / per_unit.outside[name]}
        lambdas = {name: lam}
    elif kind != "null":
        for name in _names(rng, kind, per_unit):
            values, lam = _effect(rng, name, per_unit, LAMBDA if kind == "single" else LAMBDA_CLEAR)
            effects[name], lambdas[name] = values, lam
    return GroundTruth(
        seed=seed,
        kind=kind,
        condition=condition,
        effects=effects,
        lambdas=lambdas,
        base=_springs(rng),
        roughness=ROUGH * min(lambdas.values()) if lambdas else ROUGH_ALONE,
        outside=outside,
        form=sibling(rng) if condition == "sibling" else {},
    )


def visible(effect: Effect, per_unit: LambdaPerUnit) -> bool:
    """Return whether a screening can show an effect; for example, valves that stay shut have no influence.

    A new effect is not hidden before `lambda_per_unit` has measured how well it shows.
    """
    name = f"{effect.name}.{effect.places[0]}" if effect.places else effect.name
    if not effect.diagnosable or name not in per_unit.effects:
        return False
    largest = 0.5 * max(abs(effect.amplitude.low), effect.amplitude.high)
    return largest * per_unit.of(name, [shape.nominal for shape in effect.shapes]) > LAMBDA_CLEAR[0]


def _names(rng: np.random.Generator, kind: Kind, per_unit: LambdaPerUnit) -> list[str]:
    if kind == "near":
        return [_placed(rng, CATALOGUE[str(rng.choice(sorted(NEAR)))])]
    kinds = sorted(name for name, effect in CATALOGUE.items() if visible(effect, per_unit))
    if kind == "single":
        return [_placed(rng, CATALOGUE[str(rng.choice(kinds))])]
    while True:
        first, second = (CATALOGUE[str(name)] for name in rng.choice(kinds, 2, replace=False))
        # Two of one family are a near miss, and two that cannot be distinguished are one.
        if first.family != second.family and first.name not in second.confusers:
            return [_placed(rng, first), _placed(rng, second)]


def _placed(rng: np.random.Generator, effect: Effect) -> str:
    return f"{effect.name}.{rng.choice(effect.places)}" if effect.places else effect.name


def _effect(
    rng: np.random.Generator, name: str, per_unit: LambdaPerUnit, sizes: tuple[float, float]
) -> tuple[dict[str, float], float]:
    effect, _ = find_effect(name)
    # A stop beyond the largest gap of the grid is never touched, so the grid has no λ for it.
    ends = zip(np.min(effect.grid, axis=0), np.max(effect.grid, axis=0), strict=True)
    drawn = zip(effect.shapes, ends, strict=True)
    shapes = {shape.name: float(np.clip(_shape(rng, shape), *end)) for shape, end in drawn}
    lam = even_in_logarithm(rng, sizes)
    amplitude = lam / per_unit.of(name, tuple(shapes.values()))
    low, high = effect.amplitude.low, effect.amplitude.high
    if low < 0.0 and rng.random() < 0.5:
        amplitude = -amplitude
    kept = float(np.clip(amplitude, 0.5 * low, 0.5 * high))
    return {effect.amplitude.name: kept, **shapes}, lam * abs(kept / amplitude)


def _shape(rng: np.random.Generator, shape: EffectParameter) -> float:
    """Draw a shape parameter between its nominal value and half of the way to its limits."""
    if shape.logarithmic:
        low, high = np.sqrt(shape.nominal * shape.low), np.sqrt(shape.nominal * shape.high)
        return float(np.exp(rng.uniform(np.log(low), np.log(high))))
    return float(rng.uniform(0.5 * (shape.nominal + shape.low), 0.5 * (shape.nominal + shape.high)))


def even_in_logarithm(rng: np.random.Generator, sizes: tuple[float, float]) -> float:
    """Draw evenly in the logarithm."""
    return float(np.exp(rng.uniform(*np.log(sizes))))


def _springs(rng: np.random.Generator) -> dict[str, float]:
    """Draw the parameters of the springs of a delivery within their tolerances, by the names of the fit."""

    def drawn(value: float, share: float) -> float:
        return value * (1.0 + share * float(np.clip(rng.standard_normal(), -DELIVERED, DELIVERED)))

    nominal = {name: _designed().entries[name].value.tolist() for name in (*EACH_SIDE, *BOTH_SIDES)}
    each = {
        f"{side}.{name}": drawn(nominal[name][place], share)
        for name, share in EACH_SIDE.items()
        for place, side in enumerate(SIDES)
    }
    return each | {name: drawn(nominal[name][0], share) for name, share in BOTH_SIDES.items()}


@cache
def _designed() -> Parameters:
    return load()
