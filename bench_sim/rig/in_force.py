"""The active settings: how they are applied, and how they return to their defaults when a command ends."""

import math
from collections.abc import Mapping
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from bench_protocol.rates import TICK
from bench_protocol.rest import CONNECTING, REST
from bench_protocol.table import TABLE
from bench_protocol.units import kN, mm
from bench_protocol.words import ACTUATORS, CONTROL_MODES, SIDES
from bench_sim.model.plant import Plant
from bench_sim.rig.controls import Target
from bench_sim.rig.fittings import Fittings
from bench_sim.rig.generator import FunctionGenerator
from bench_sim.rig.registers import RegisterBank
from bench_sim.rig.safe_position import Grip
from bench_sim.rig.springs import ReplacementSprings

#: By control mode: how far from its set-point (SI) an actuator may be that goes on when HOLD or ACTIVE begins. One that
#: follows the fastest wave lags by 9 mm.
NEAR: Final = {"off": np.inf, "force": 10 * kN, "displacement": 10 * mm}
_ACTUATORS: Final = tuple(Target[name.upper()] for name in ACTUATORS)


class InForce:
    """Applies settings to the tick's ``controls`` and to the fitted parts of the ``plant``. ``values`` are all
    signals by table row.
    """

    def __init__(
        self,
        controls: Any,
        values: npt.NDArray[np.float64],
        registers: RegisterBank,
        generator: FunctionGenerator,
        plant: Plant,
        springs: ReplacementSprings | None = None,
    ) -> None:
        self._controls, self._values, self._registers = controls, values, registers
        self.generator, self._fittings = generator, Fittings(plant, registers.active, springs)
        #: Unload rate of actuators that are being released, N/s each.
        self._letting_go: npt.NDArray[np.float64] = plant.parameters.actuator_unload_rate
        self._apply_air(registers.active)

    def apply(self, settings: Mapping[str, float]) -> bool:
        """Apply all settings at once, and change control modes without a jump. Return whether that is allowed now."""
        c = self._controls
        if self.generator.busy and (c["control"] != _modes(settings)).any():
            return False  # a mode must not change under a running program
        if not self._fittings.change(settings, engaged=bool(c["engaged"] or c["grip"] != Grip.OPEN)):
            return False
        c["refitted"] = 1
        self._apply_air(settings)
        return True

    def rest(self, *, vented: bool) -> None:
        """Set active and staged settings to their defaults. Settings that would move air change only with ``vented``.
        The set-points of the actuators become their present readings. With ``vented`` the program is removed.
        """
        registers, c = self._registers, self._controls
        registers.active.update(
            {name: value for name, value in REST.items() if vented or name not in CONNECTING}
        )
        registers.drop_staged()
        if vented:
            self.generator.clear()
        self._apply_air(registers.active)
        for target in _ACTUATORS:
            self.take_present(target)
        c["goal"] = c["setpoint"]
        c["slew"] = 0

    def take_present(self, target: Target) -> None:
        """Set an actuator's set-point to its present reading, so that nothing moves when it is engaged."""
        c = self._controls
        c["setpoint"][target] = c["goal"][target] = self._present(target)
        c["slew"][target] = 0

    def engage(self) -> None:
        """Engage the actuators at their present position. An actuator moves on to its set-point only if this has been
        received but not yet reached; the others stay.
        """
        c = self._controls
        for target in _ACTUATORS:
            if c["slew"][target]:
                c["setpoint"][target] = self._present(target)
            else:
                self.take_present(target)
                if c["grip"] == Grip.OPEN and self._mode(target) == "force":
                    # It follows without force: its reading is decaying, or its zero error.
                    c["goal"][target] = 0.0
                    c["slew"][target] = math.ceil(
                        abs(c["setpoint"][target]) / (self._letting_go[target] * TICK)
                    )
        c["engaged"] = 1
        c["shut_in"] = c["ordered"] = 0

    @property
    def astray(self) -> bool:
        """Whether the reading of an actuator is far from its set-point: the actuator did not follow, or the reading
        is wrong.
        """
        return any(
            abs(self._commanded(target) - self._measured(target)) > NEAR[self._mode(target)]
            for target in _ACTUATORS
        )

    def _present(self, target: Target) -> float:
        """Return the set-point, without the generator's offset, at which an actuator keeps its present reading; 0
        without a reading.
        """
        measured = self._measured(target)
        return 0.0 if np.isnan(measured) else measured - float(self._controls["offset"][target])

    def _mode(self, target: Target) -> str:
        return CONTROL_MODES[int(self._controls["control"][target])]

    def _commanded(self, target: Target) -> float:
        return float(self._controls["setpoint"][target] + self._controls["offset"][target])

    def _measured(self, target: Target) -> float:
        mode = self._mode(target)
        return 0.0 if mode == "off" else float(self._values[TABLE.index[f"{ACTUATORS[target]}.{mode}"]])

    def _apply_air(self, settings: Mapping[str, float]) -> None:
        c = self._controls
        for k, side in enumerate(SIDES):
            c["air_mode"][k] = settings[f"air.{side}_mode"]
            c["air_target"][k] = settings[f"air.{side}_target"]
            c["reservoir"][k] = settings[f"air.{side}_reservoir"]
        c["dpv"] = settings["air.dpv"]
        for actuator, mode in zip(_ACTUATORS, _modes(settings), strict=True):
            if c["control"][actuator] != mode:
                c["control"][actuator] = mode
                self.take_present(actuator)


def _modes(settings: Mapping[str, float]) -> tuple[float, float, float]:
    """Return the control mode of each actuator."""
    return settings["vertical.control"], settings["vertical.control"], settings["lateral.control"]
