"""Parts that are changed by hand between runs: shims under the emergency springs, orifice plates, connecting pipes."""

from collections.abc import Mapping
from typing import Final, NamedTuple

import numpy as np

from bench_protocol.signals import Group
from bench_protocol.table import TABLE
from bench_protocol.units import bar
from bench_protocol.words import PIPE_LENGTH
from bench_sim.model.layout import SIDES, State
from bench_sim.model.plant import Plant
from bench_sim.model.wiring import sensors_of
from bench_sim.rig.springs import ReplacementSprings

#: Up to which gauge pressure a user may open a flange.
_FLANGE_PRESSURE: Final = 0.3 * bar
_CHAMBERS: Final = sensors_of(Group.PRESSURE)
_BORE: Final = TABLE["rig.orifice_diameter"]


class Ordered(NamedTuple):
    """The plates and pipes that the settings ask for."""

    plate: int  #: bore in steps of the setting: no single says exactly 13 mm
    pipe: bool

    @classmethod
    def by(cls, settings: Mapping[str, float]) -> "Ordered":
        """Return what ``settings`` (SI) ask for."""
        return cls(round(settings[_BORE.name] / _BORE.step), bool(settings["rig.pipe"]))


class Fittings:
    """The parts fitted to ``plant``, and the states in which they may be changed.

    The parameter set may differ from the settings: a plate with a wrong bore stays in until a user orders
    another one. So only a change of the order changes the plant.
    """

    def __init__(
        self, plant: Plant, settings: Mapping[str, float], springs: ReplacementSprings | None = None
    ) -> None:
        self._plant, self._springs = plant, springs
        self._ordered = Ordered.by(settings)

    def change(self, settings: Mapping[str, float], *, engaged: bool) -> bool:
        """Fit what ``settings`` ask for; return False, with nothing changed, where that is not allowed now.

        Shims want disengaged actuators (``engaged`` False), plates and pipes chambers without pressure as well.
        """
        ordered = Ordered.by(settings)
        if not self._springs_accept(ordered, settings["rig.nominal_preload"]):
            return False
        if ordered != self._ordered and (engaged or self._under_pressure()):
            return False
        if not self._shim(settings["rig.nominal_preload"], engaged):
            return False
        self._fit(ordered)
        return True

    def _under_pressure(self) -> bool:
        """Show whether air would come out of an open flange; the air asks no sensor."""
        gauge = self._springs.pressures() if self._springs else self._plant.ideal()[_CHAMBERS]
        return not (np.abs(gauge) < _FLANGE_PRESSURE).all()

    def _springs_accept(self, ordered: Ordered, preload: float) -> bool:
        """Return whether springs that an FMU computes have inputs for all that is to be changed."""
        if self._springs is None:
            return True
        adjustable, par = self._springs.adjustable, self._plant.parameters
        plates = ordered.plate == self._ordered.plate or "orifice_diameter" in adjustable
        shims = bool((par.nominal_preload == preload).all()) or "nominal_preload" in adjustable
        return plates and shims and ordered.pipe == self._ordered.pipe

    def _shim(self, preload: float, engaged: bool) -> bool:
        """Set the height to zero for ``preload`` (N per spring), as shims under the emergency springs do.

        The bolster is lifted or lowered by what the emergency springs differ between the two loads, so that the
        bellows do not feel it.
        """
        par, x = self._plant.parameters, self._plant.state
        change = preload - par.nominal_preload
        if not change.any():
            return True
        if engaged:
            return False
        lift = change / par.emergency_stiffness_vertical if par.emergency_spring else np.zeros(SIDES)
        x[State.BOLSTER_VERTICAL] += lift.mean()
        x[State.BOLSTER_ROLL] += 0.5 * (lift[0] - lift[1]) / par.spring_half_spacing
        x[State.LEVER : State.LEVER + SIDES] += lift
        par.nominal_preload[:] = preload
        return True

    def _fit(self, ordered: Ordered) -> None:
        """Change plates and pipes of both sides where the order differs from the last one."""
        par = self._plant.parameters
        if ordered.plate != self._ordered.plate:
            par.orifice_diameter[:] = ordered.plate * _BORE.step
        if ordered.pipe != self._ordered.pipe:
            par.pipe_length[:] = PIPE_LENGTH if ordered.pipe else 0.0
            self._plant.state[State.PIPE_FLOW : State.PIPE_FLOW + SIDES] = 0.0
        self._ordered = ordered
