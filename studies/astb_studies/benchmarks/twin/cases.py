"""The cases of a count: the plan, the rig, and the effect that begins during the run.

Every second case is sound. One in three of these is a *sibling*: springs as delivered, and one law of another form
that no parameter of the model and no effect covers (`sibling_forms`). In the other cases, an effect of the catalogue
begins late in the plan, as a step or as a ramp, in one of three sizes. Harder cases are two effects one after the
other, an effect that ends again, and an effect on a sibling.
"""

from collections.abc import Iterator
from itertools import islice
from typing import Final

import msgspec
import numpy as np
from msgspec.structs import replace

from astb_studies.benchmarks.diagnosis.ground_truth import draw
from astb_studies.benchmarks.diagnosis.sibling_forms import CURVED
from bench_sim.model.effects import CATALOGUE
from bench_sim.model.effects.effect import Effect, ShownBy
from bench_sim.parameters.effects import find_effect

#: Plans of faulty rigs, and the part (s) of each in which an effect begins.
PLANS: Final = {
    "aw0": (56.0, 85.0),
    "screening": (45.0, 500.0),
    "endurance": (55.0, 200.0),
    "leveling": (50.0, 120.0),
}
#: Sizes of an effect, relative to that of an ordinary fault.
SIZES: Final = (1.0, 3.0, 10.0)
#: Duration (s) of the ramp of a creeping effect.
CREEPS: Final = 30.0
#: A run continues for this time (s) after the start of the effect; later detections do not count.
GOES_ON: Final = 60.0
#: Range of the delay (s) of a second effect after the first, and of the duration (s) of an effect that ends again.
_BETWEEN: Final = (4.0, 12.0)
_STAYS: Final = (8.0, 20.0)
#: Plans in real time. There, effects begin in the first `_SOON` s of the usual interval.
_LIVE: Final = ("aw0", "endurance", "screening")
_SOON: Final = 20.0
#: Largest part of the physical range that an effect uses.
_WITHIN: Final = 0.8
#: A clock does not become slow suddenly, and a replay of the motion cannot show a fault of the actuators.
_NOT_BEGUN: Final = ("clock_skew",)
#: Sound rigs run many plans, also long ones: every hour of motion counts equally.
_SOUND: Final = ("aw0", "aw3", "screening", "leveling", "leak_down", "tightness", "endurance")
_LONG: Final = 0.75  #: part of the sound cases that are endurance or a hold


class Case(msgspec.Struct, frozen=True):
    """One run. Without an ``effect`` the rig is sound; it begins at ``at`` s and takes ``creeps`` s to its size."""

    plan: str
    seed: int
    values: dict[str, str] = {}  #: of the plan's parameters, as text
    sibling: bool = False
    effect: str = ""
    size: float = 0.0  #: the amplitude in SI
    step: int = 0  #: which of `SIZES`
    at: float = 0.0
    creeps: float = 0.0
    gone: float = 0.0  #: time (s) at which it ends; 0 if it stays
    second: str = ""  #: another effect, its amplitude, and when it begins
    second_size: float = 0.0
    second_at: float = 0.0

    @property
    def until(self) -> float:
        """End (s) of the run, some time after the last start or end of an effect."""
        return max(self.at, self.gone, self.second_at) + GOES_ON


def sound(count: int, seed: int) -> Iterator[Case]:
    """Yield ``count`` fault-free rigs."""
    rng = np.random.default_rng([seed, 0])
    for _ in range(count):
        values: dict[str, str] = {}
        plan = str(rng.choice(_SOUND))
        if rng.random() < _LONG:
            plan = str(rng.choice(("endurance", "tightness"), p=(0.8, 0.2)))
        if plan == "endurance":
            values = {
                "load": str(rng.choice(("AW0", "AW3"))),
                "axis": str(rng.choice(("vertical", "lateral"))),
                "amplitude": f"{rng.uniform(3.0, 15.0):.1f} mm",
                "frequency": f"{rng.uniform(0.3, 2.0):.2f} Hz",
                "cycles": str(int(rng.integers(300, 900))),
                "intervals": str(int(rng.integers(1, 5))),
            }
        elif plan == "tightness":
            values = {"hold": f"{rng.uniform(60.0, 900.0):.0f} s"}
        yield Case(plan, int(rng.integers(2**31)), values, sibling=bool(rng.random() < 1.0 / 3.0))


def faulty(count: int, seed: int) -> Iterator[Case]:
    """Yield ``count`` rigs in which an effect begins: all effects and sizes in turn, as a step and as a ramp."""
    rng = np.random.default_rng([seed, 1])
    names = [name for name, effect in CATALOGUE.items() if effect.diagnosable and name not in _NOT_BEGUN]
    for k in range(count):
        if k % len(names) == 0:
            rng.shuffle(names)
        effect = CATALOGUE[names[k % len(names)]]
        plan = "leveling" if effect.shown_by is ShownBy.CONNECTED_VALVES else str(rng.choice(list(PLANS)))
        step = int(rng.integers(len(SIZES)))
        place = f".{rng.choice(effect.places)}" if effect.places else ""
        yield Case(
            plan,
            int(rng.integers(2**31)),
            effect=f"{effect.name}{place}",
            size=amplitude(effect, step),
            step=step,
            at=round(float(rng.uniform(*PLANS[plan])), 1),
            creeps=float(rng.choice((0.0, CREEPS))),
        )


def harder(count: int, seed: int) -> Iterator[Case]:
    """Yield ``count`` rigs: in turn with two effects, with an effect that ends, and siblings with one effect."""
    rng = np.random.default_rng([seed, 2])
    ones, others = (
        (one for one in faulty(100 * count, place) if one.step and one.plan != "leveling" and not one.creeps)
        for place in (seed, seed + 1)
    )
    for k, case in enumerate(islice(ones, count)):
        if k % 3 == 0:
            other = next(one for one in others if _are_distinct(case.effect, one.effect))
            later = round(case.at + float(rng.uniform(*_BETWEEN)), 1)
            yield replace(case, second=other.effect, second_size=other.size, second_at=later)
        elif k % 3 == 1:
            yield replace(case, gone=round(case.at + float(rng.uniform(*_STAYS)), 1))
        else:
            # A curved area is written at every tick, and would undo an effect on it.
            fit = next(
                one for one in range(case.seed, 2**32) if CURVED not in draw(one, "null", "sibling").form
            )
            yield replace(case, seed=fit, sibling=True)


def _are_distinct(name: str, other: str) -> bool:
    """Return whether two effects are of different families and do not imitate each other."""
    (one, _), (two, _) = find_effect(name), find_effect(other)
    return one.family != two.family and one.name not in two.confusers and two.name not in one.confusers


def live(count: int, seed: int) -> Iterator[Case]:
    """Yield ``count`` faulty rigs for real time, with large effects that begin early in a judged part of the plan."""
    large = (one for one in faulty(100 * count, seed) if one.step and one.plan in _LIVE)
    for case in islice(large, count):
        first, last = PLANS[case.plan]
        share = (case.at - first) / (last - first)
        yield replace(case, at=round(first + _SOON * share, 1))


def amplitude(effect: Effect, step: int) -> float:
    """Return an amplitude (SI) of one of the `SIZES`, as far as it is possible."""
    one = effect.amplitude
    return float(np.clip(one.typical * SIZES[step], _WITHIN * one.low, _WITHIN * one.high))
