"""The rig of a case, in virtual time, on which an effect of the catalogue begins while it runs."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, Final

from astb.rig_in_memory import RigInMemory
from bench_sim.parameters import load
from bench_sim.parameters.effects import find_effect
from bench_sim.rig.faults.panel import PlannedFault
from bench_sim.rig.rig import Rig
from bench_sim.rig.turn import differing, turn
from benchmarks.diagnosis import sealed
from benchmarks.diagnosis.ground_truth import draw
from benchmarks.twin.cases import GOES_ON, Case
from drivers.bench import Bench

#: An effect that creeps grows in steps of so many s.
_STEP: Final = 0.1
#: The bench is stopped so many s after the last second that counts.
_LATER: Final = 1.0
#: What drifts does so from the start of the rig; one that begins later is a fault of its own.
_DRIFT: Final = "pressure_drift"


@contextmanager
def bench_of(case: Case) -> Iterator[Bench]:
    """Yield a connected bench on the rig of a case; a sibling is sound."""
    if case.sibling:
        with sealed.bench_of(draw(case.seed, "null", "sibling")) as bench:
            yield bench
        return
    rig = Rig(load("astb"), seed=case.seed)
    if case.effect:
        begin(rig, case)
    with RigInMemory(rig).bench(seed=case.seed) as bench:
        yield bench


def begin(rig: Rig, case: Case) -> None:
    """Let the effect of a case begin when its time has come; some time later somebody stops the bench."""
    rig.faults.plan(PlannedFault("estop", {}, case.at + GOES_ON + _LATER, None))
    kind, _, place = case.effect.partition(".")
    if kind == _DRIFT:
        values = {"sensor": f"{place}.bellows_pressure", "value": f"{case.size} Pa/s"}
        rig.faults.plan(PlannedFault("drift", values, case.at, None))
        return
    steps = max(round(case.creeps / _STEP), 1)
    for k in range(steps):
        after = rig.plant.parameter_array.copy()[0]
        changed(case, (k + 1) / steps)(after)
        turn(rig, case.at + k * _STEP, differing(rig.plant.parameters, after), after)


def changed(case: Case, share: float = 1.0) -> Callable[[Any], None]:
    """Return what gives a record of parameters so much of the effect of a case."""
    effect, place = find_effect(case.effect)
    values = {shape.name: shape.nominal for shape in effect.shapes}
    values[effect.amplitude.name] = share * case.size
    return lambda par: effect.change(par, place, values)
