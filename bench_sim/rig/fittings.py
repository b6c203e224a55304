"""Parts that a person changes between runs: shims under the emergency springs, orifice plates, connecting pipes."""

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
    """The orifice plates and pipes that the settings require."""

    plate: int  #: bore in steps of the setting, because no single-precision number is exactly 13 mm
    pipe: bool

    @classmethod
    def by(cls, settings: Mapping[str, float]) -> "Ordered":
        """Return the orifice plates and pipes for ``settings`` (SI)."""
        return cls(round(settings[_BORE.name] / _BORE.step), bool(settings["rig.pipe"]))


class Fittings:
    """The parts that are fitted to ``plant``, and the check whether they may be changed now.

    The parameter set may differ from the settings, for example by a plate with a wrong bore. So the plant changes only
    if the settings change.
    """

    def __init__(
        self, plant: Plant, settings: Mapping[str, float], springs: ReplacementSprings | None = None
    ) -> None:
        self._plant, self._springs = plant, springs
        self._ordered = Ordered.by(settings)

    def change(self, settings: Mapping[str, float], *, engaged: bool) -> bool:
        """Install the parts for ``settings`` and return True. Return False, with nothing changed, if that is not
        allowed now.

        Shims require that the actuators are not ``engaged``. Plates and pipes also require chambers without pressure.
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
        """Return whether air would escape from an open flange. The true pressure decides, not the reading of a
        sensor.
        """
        gauge = self._springs.pressures() if self._springs else self._plant.ideal()[_CHAMBERS]
        return not (np.abs(gauge) < _FLANGE_PRESSURE).all()

    def _springs_accept(self, ordered: Ordered, preload: float) -> bool:
        """Return whether springs of an FMU have inputs for the required changes."""
        if self._springs is None:
            return True
        adjustable, par = self._springs.adjustable, self._plant.parameters
        plates = ordered.plate == self._ordered.plate or "orifice_diameter" in adjustable
        shims = bool((par.nominal_preload == preload).all()) or "nominal_preload" in adjustable
        return plates and shims and ordered.pipe == self._ordered.pipe

    def _shim(self, preload: float, engaged: bool) -> bool:
        """Insert shims so that the height is zero at ``preload`` (N per spring). Return False if that is not allowed
        now.

        The bolster moves by the change of the emergency springs' deflection, so the bellows do not move.
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
        """Change the plates and pipes of both sides if the settings require others."""
        par = self._plant.parameters
        if ordered.plate != self._ordered.plate:
            par.orifice_diameter[:] = ordered.plate * _BORE.step
        if ordered.pipe != self._ordered.pipe:
            par.pipe_length[:] = PIPE_LENGTH if ordered.pipe else 0.0
            self._plant.state[State.PIPE_FLOW : State.PIPE_FLOW + SIDES] = 0.0
        self._ordered = ordered
