"""The rig of a case, in virtual time, on which effects of the catalogue begin while it runs."""

from collections.abc import Iterator
from contextlib import contextmanager
from operator import itemgetter
from typing import Any, Final

from astb.rig_in_memory import RigInMemory
from astb_studies.benchmarks.diagnosis import sealed
from astb_studies.benchmarks.diagnosis.ground_truth import draw
from astb_studies.benchmarks.twin.cases import Case
from bench_sim.parameters import load
from bench_sim.parameters.effects import find_effect
from bench_sim.rig.faults.panel import PlannedFault
from bench_sim.rig.rig import Rig
from bench_sim.rig.turn import differing, turn
from drivers.bench import Bench

#: Step (s) in which a creeping effect grows.
_STEP: Final = 0.1
#: Delay (s) between the last second that counts and the stop of the bench.
_LATER: Final = 1.0
#: A drift begins with the rig; a drift that begins later is a separate fault.
_DRIFT: Final = "pressure_drift"


@contextmanager
def bench_of(case: Case) -> Iterator[Bench]:
    """Yield a connected bench on the rig of a case."""
    if case.sibling:
        truth = draw(case.seed, "null", "sibling")
        with sealed.bench_of(truth, lambda rig: begin(rig, case)) as bench:
            yield bench
        return
    rig = Rig(load("astb"), seed=case.seed)
    begin(rig, case)
    with RigInMemory(rig).bench(seed=case.seed) as bench:
        yield bench


def begin(rig: Rig, case: Case) -> None:
    """Start and stop the effects of a case at their times; later a user stops the bench.

    A sound rig is not changed.
    """
    if not case.effect:
        return
    rig.faults.plan(PlannedFault("estop", {}, case.until + _LATER, None))
    changes: list[tuple[float, str, float]] = []  # when, which effect, and its size from then on
    for effect, size, at, end in (
        (case.effect, case.size, case.at, case.gone),
        (case.second, case.second_size, case.second_at, 0.0),
    ):
        kind, _, place = effect.partition(".")
        if kind == _DRIFT:
            values = {"sensor": f"{place}.bellows_pressure", "value": f"{size} Pa/s"}
            rig.faults.plan(PlannedFault("drift", values, at, end - at if end else None))
            continue
        if effect:
            steps = max(round(case.creeps / _STEP), 1)
            changes += [(at + k * _STEP, effect, size * (k + 1) / steps) for k in range(steps)]
        if end:
            changes.append((end, effect, 0.0))
    sound = rig.plant.parameter_array[0].copy()
    before, present = sound, dict[str, float]()
    for at, effect, size in sorted(changes, key=itemgetter(0)):
        present[effect] = size
        after = sound.copy()
        for name, amplitude in present.items():
            change(after, name, amplitude)
        turn(rig, at, differing(before, after), after)
        before = after


def change(par: Any, effect: str, size: float) -> None:
    """Give a record of parameters an effect of this size (SI)."""
    kind, place = find_effect(effect)
    values = {shape.name: shape.nominal for shape in kind.shapes}
    values[kind.amplitude.name] = size
    kind.change(par, place, values)
