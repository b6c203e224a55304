"""Changes parameters of a running bench at one instant, without a change of its state."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import numpy.typing as npt

from bench_protocol.rates import TICK
from bench_sim.model.layout import EXTRA_BRANCHES, EXTRA_DASHPOTS, State
from bench_sim.model.sensors import DRIFTS, arrives_late
from bench_sim.parameters.loading import ParameterError

if TYPE_CHECKING:
    from bench_sim.model.plant import Plant
    from bench_sim.rig.rig import Rig

#: Parameters that cannot change while the state stays, with the reason.
_GAS: Final = "the gas in the springs keeps its mass and its energy"
_BUILT: Final = "the geometry of the rig cannot change during a run"
_REFUSED: Final = {
    "gas_constant": _GAS,
    "heat_capacity_ratio": _GAS,
    "wall_heat_capacity": "the stored heat of the walls would change without a heat flow",
    "nominal_preload": "the plan itself changes the preload, with plates and shims",
    **dict.fromkeys(
        (
            "spring_half_spacing",
            "centre_height",
            "column_height",
            "actuator_half_spacing",
            "lateral_actuator_height",
        ),
        _BUILT,
    ),
    **dict.fromkeys(
        ("sensor_low", "sensor_high"), "the range of a transducer is fixed when the rig is built"
    ),
    "sensor_accuracy": "the parameter is used only when the rig is built, to draw the bias of a transducer",
}
#: Parameters that change the gas volume.
VOLUMES: Final = frozenset(
    (
        "bellows_volume",
        "auxiliary_volume",
        "bellows_compliance",
        "effective_area_growth",
        "area_reference_pressure",
    )
)


def differing(before: Any, after: Any) -> list[str]:
    """Return the names of the parameters that differ between two records.

    Raises `ParameterError` for a parameter that cannot change while the bench runs.
    """
    names = [name for name in before.dtype.names if not np.array_equal(before[name], after[name])]
    for name in names:
        if name in _REFUSED:
            raise ParameterError(
                f"{name} cannot change while the rig runs: {_REFUSED[name]}; set it from the start, in "
                "[simulation.change] of a rig file"
            )
    return names


def turn(rig: "Rig", at: float, names: list[str], after: Any) -> None:
    """Set the parameters ``names`` to those of the record ``after``, from ``at`` s of the rig's time on.

    Active faults also change the new values. Raises RuntimeError for parameters of springs that an FMU computes.
    """
    points = rig.faults.points
    points.parameters.own(names)

    values = {name: np.array(after[name]) for name in names}
    points.schedule.at(round(at / TICK), lambda: points.parameters.under(lambda: take(rig.plant, values)))


def take(plant: "Plant", values: Mapping[str, npt.NDArray[np.float64]]) -> None:
    """Set parameters of a running plant, and adapt its memory to them.

    Masses, energies, positions and speeds do not change. Rubber that begins to relax is relaxed at its present
    position. If a reading gets a delay, it stays constant until its first delayed value arrives. Drifts and a slow
    clock start now.
    """
    par, mem = plant.parameters, plant.memory
    found = {name: np.array(value) for name, value in values.items()}
    for rate, start in DRIFTS:
        if rate in found:
            found[start] = found.get(start, np.array(par[start])) - mem.time * (found[rate] - par[rate])
    _take_dashpots(
        plant, *(found.get(f"extra_branch_{one}", par[f"extra_branch_{one}"]) for one in ("ratio", "time"))
    )
    late = arrives_late(par)
    for name, value in found.items():
        par[name] = value
    if not late and arrives_late(par):
        mem.sensor_history[:] = mem.sensor_output[:, np.newaxis]


def _take_dashpots(plant: "Plant", ratios: npt.NDArray[np.float64], times: npt.NDArray[np.float64]) -> None:
    """Keep the dash-pot positions of each extra rubber branch, even if the index of the branch has changed.

    The list of branches has no gaps: when a branch ends, those after it move up. A new branch is relaxed at the
    position of its bellows.
    """
    par, mem = plant.parameters, plant.memory
    first = int(State.EXTRA_VERTICAL_DASHPOT)
    dashpots = plant.state[first : first + EXTRA_DASHPOTS * EXTRA_BRANCHES].reshape(
        EXTRA_BRANCHES, EXTRA_DASHPOTS
    )
    before = dashpots.copy()
    relaxed = np.concatenate((mem.bellows_vertical, mem.bellows_lateral))
    had = {float(par.extra_branch_time[k]): k for k in np.flatnonzero(par.extra_branch_ratio)[::-1]}
    for branch in np.flatnonzero(ratios):
        same = had.get(float(times[branch]), branch if par.extra_branch_ratio[branch] else None)
        dashpots[branch] = relaxed if same is None else before[same]
