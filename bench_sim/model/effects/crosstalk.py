"""Crosstalk: the lateral load cells feel the vertical force, F_y,m = F_y + c F_z, half of it on each of the two."""

from collections.abc import Mapping
from typing import Any, Final

from bench_sim.model.effects.channels import LATERAL_CELLS, VERTICAL_CELLS
from bench_sim.model.effects.effect import Effect, EffectParameter
from bench_sim.model.layout import Sensor


def _change(par: Any, place: int | None, values: Mapping[str, float]) -> None:
    for felt in LATERAL_CELLS:
        for cause in VERTICAL_CELLS:
            cell, other = felt - Sensor.LOAD_CELL_1, cause - Sensor.LOAD_CELL_1
            par.load_cell_crosstalk[cell, other] += 0.5 * values["share"]


EFFECT: Final = Effect(
    name="crosstalk",
    family="sensor",
    title="lateral load cells respond to the vertical force",
    plain="the lateral load cells respond to the vertical force",
    amplitude=EffectParameter("share", "1", "%", 0.01, nominal=0.0, typical=0.01, low=-0.1, high=0.1),
    change=_change,
    touches=frozenset({"sensor"}),
    confusers=("coupling",),
    equation="F_y,m = F_y + c F_z",
    source="alignment of a load cell; data sheets state about 1 %",
    separated_by="vertical motion without lateral motion and roll, at both load cases",
)
